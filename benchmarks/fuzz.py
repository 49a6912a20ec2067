"""Random and mutated input to every reader: records or a ReadError, nothing else.

Good files come from the simulator.  They are damaged as disks, radios, spreadsheets and
hands damage them; warnings count as errors, since no user should see one of NumPy's.
"""

import json
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from whichroad.answers import AnswerError, osrm_match, trace_attributes, trace_route
from whichroad.errors import MapError, ReadError
from whichroad.observations import Drive, WithGyro
from whichroad.readers import NmeaParser, read_drive, read_vehicle
from whichroad.roadmap import RoadMap
from whichroad.settings import Vehicle
from whichroad.simulate import SimulatedDrive, draw_town, simulate_drive, write_drive

from . import Figure, Options, seeds_text
from .fuzz_formats import for_robots, formats, overture, requests_of, sumo_net, ubx_frame

SECONDS = 60.0
_KEPT = 20  # tracebacks told per reader
_LINES = 150  # of a good text file that are damaged

Random = np.random.Generator
Mutation = Callable[[bytes, Random], bytes]


@dataclass(frozen=True, slots=True)
class Reader:
    """One reader, a good file for it, and how it is called."""

    name: str
    good: bytes
    read: Callable[[Path], int]  # returns how many records came
    suffix: str
    refusal: type[Exception] = ReadError


_STRANGE = (
    *(b"", b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"99999999999999999999"),
    *(b"-0", b"0", b"1e5", b"0x1F", b"true", b"NULL", b"1,5", b'"', b'"a\nb"', b"--", b"."),
    *("é漢字🚗".encode(), "\u202e٣".encode(), b"\xff\xfe", b"\x00", b"2026-13-45T99:99:99Z"),
    *(b"1969-12-31T23:59:59Z", b"9999-12-31", b"$GPGGA,", b"*00", b"\r", b"\x1b[31m"),
)


def _random(data: bytes, random: Random) -> bytes:
    return random.bytes(int(random.integers(0, 4000)))


def _flip(data: bytes, random: Random) -> bytes:
    changed = np.frombuffer(data, np.uint8).copy()
    for place in random.integers(0, len(changed), int(random.integers(1, 30))):
        changed[place] ^= 1 << int(random.integers(0, 8))
    return changed.tobytes()


def _cut(data: bytes, random: Random) -> bytes:
    begin, end = sorted(random.integers(0, len(data), 2).tolist())
    return (data[:begin], data[begin:], data[:begin] + data[end:])[int(random.integers(0, 3))]


def _garbage(data: bytes, random: Random) -> bytes:
    at = int(random.integers(0, len(data)))
    return data[:at] + random.bytes(int(random.integers(1, 300))) + data[at:]


def _zeros(data: bytes, random: Random) -> bytes:
    begin = int(random.integers(0, len(data)))
    end = min(begin + int(random.integers(1, 600)), len(data))
    return data[:begin] + bytes(end - begin) + data[end:]


def _lines(data: bytes, random: Random) -> bytes:
    """Lines shuffled, doubled, lost."""
    lines = data.splitlines(keepends=True)
    keep = random.integers(0, len(lines), len(lines))
    if random.random() < 0.5:
        keep = np.sort(keep)
    head = lines[:1] if random.random() < 0.7 else []
    return b"".join(head + [lines[k] for k in keep])


def _cells(data: bytes, random: Random) -> bytes:
    """Some cells of some lines become strange."""
    lines = data.splitlines(keepends=True)
    for k in random.integers(0, len(lines), int(random.integers(1, 12))):
        for mark in (b",", b'"', b" ", b"#"):
            cells = lines[k].split(mark)
            if len(cells) > 1:
                cells[int(random.integers(0, len(cells)))] = _strange(random)
                lines[k] = mark.join(cells)
                break
    return b"".join(lines)


def _column(data: bytes, random: Random) -> bytes:
    """Two columns change places, or one becomes strange all the way down."""
    rows = [line.split(b",") for line in data.splitlines()]
    width = max(map(len, rows))
    a, b = random.integers(0, width, 2).tolist()
    word = _strange(random) if random.random() < 0.5 else None
    for row in rows[1:] if random.random() < 0.7 else rows:
        if max(a, b) < len(row):
            row[a], row[b] = (row[b], row[a]) if word is None else (word, row[b])
    return b"\n".join(b",".join(row) for row in rows)


def _numbers(data: bytes, random: Random) -> bytes:
    """One number of the file is replaced wherever it stands."""
    words = data.replace(b",", b" ").replace(b'"', b" ").split()
    word = words[int(random.integers(0, len(words)))] if words else b""
    return data.replace(word, _strange(random)) if len(word) > 1 else data


def _strange(random: Random) -> bytes:
    return _STRANGE[int(random.integers(0, len(_STRANGE)))]


def _sealed(data: bytes, random: Random) -> bytes:
    """NMEA sentences with strange fields and a checksum that is right."""
    lines = []
    for line in _cells(data, random).splitlines():
        body = line.partition(b"*")[0].lstrip(b"$")
        check = np.bitwise_xor.reduce(np.frombuffer(body, np.uint8)) if body else 0
        lines.append(b"$" + body + b"*%02X" % int(check))
    return b"\r\n".join(lines)


def _sealed_ubx(data: bytes, random: Random) -> bytes:
    """UBX messages with strange payloads and checksums that are right."""
    frames = []
    for piece in data.split(b"\xb5\x62")[1:]:
        kind, payload = int.from_bytes(piece[:2], "big"), bytearray(piece[4:-2])
        if payload and random.random() < 0.2:
            for _ in range(int(random.integers(1, 6))):
                payload[int(random.integers(0, len(payload)))] = int(random.integers(0, 256))
        if random.random() < 0.02:
            payload = payload[: int(random.integers(0, len(payload) + 1))]
        frames.append(ubx_frame(kind, bytes(payload)))
    return b"".join(frames)


_BINARY: tuple[Mutation, ...] = (_random, _flip, _flip, _cut, _garbage, _zeros)
_TEXT: tuple[Mutation, ...] = (*_BINARY, _lines, _cells, _cells, _column, _numbers)


def _records(drives: Sequence[Drive]) -> int:
    """How many records; complains where they are not what observations.py promises."""
    count = 0
    for drive in drives:
        odometry = drive.odometry
        two = isinstance(odometry, WithGyro)
        for log in (drive.fixes, *((odometry.distance, odometry.gyro) if two else (odometry,))):
            if log is None:
                continue
            count += len(log.time)
            if np.any(np.diff(log.time) <= 0):
                raise AssertionError("times do not increase")
            for name in log.__dataclass_fields__:
                values = getattr(log, name)
                endless = name.startswith("sigma_")  # infinite: not reported
                if np.isnan(values).any() or (np.isinf(values).any() and not endless):
                    raise AssertionError(f"{name} is not finite")
    return count


def _stream(path: Path) -> int:
    parser, data = NmeaParser(), path.read_bytes()
    pieces = [data[k : k + 1000] for k in range(0, len(data), 1000)]
    return sum(len(parser.feed(piece)) for piece in pieces) + len(parser.flush())


def _first_lines(path: Path) -> bytes:
    return b"".join(path.read_bytes().splitlines(keepends=True)[:_LINES])


def _tables(drive: SimulatedDrive, folder: Path) -> dict[str, bytes]:
    """Fixes and wheels of the drive in one table, a GPX track, an RTKLIB solution."""
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    fixes, wheels = drive.drive.fixes, drive.drive.odometry
    assert fixes is not None
    rows = slice(0, _LINES)
    stamps = (fixes.time[rows] * 1e6).astype("datetime64[us]")
    table = pa.table(
        {
            "time": [f"{s}Z" for s in stamps],
            "lat": fixes.lat_deg[rows],
            "lon": fixes.lon_deg[rows],
            "cov_ee_m2": fixes.cov_ee[rows],
            "cov_en_m2": fixes.cov_en[rows],
            "cov_nn_m2": fixes.cov_nn[rows],
            "speed_mps": fixes.speed[rows],
            "bearing_deg": fixes.bearing_deg[rows],
            "wheel_rl_ticks": np.interp(fixes.time, wheels.time, wheels.left)[rows],
            "wheel_rr_ticks": np.interp(fixes.time, wheels.time, wheels.right)[rows],
            "reverse": np.zeros(len(stamps), np.int64),
            "drive_id": ["a" if k < _LINES // 2 else "b" for k in range(len(stamps))],
        }
    )
    pyarrow.csv.write_csv(table, folder / "t.csv")
    pyarrow.parquet.write_table(table, folder / "t.parquet")
    places = list(zip(stamps, fixes.lat_deg[rows], fixes.lon_deg[rows], strict=True))
    points = "\n".join(
        f'<trkpt lat="{lat:.7f}" lon="{lon:.7f}"><time>{s}Z</time><hdop>0.9</hdop></trkpt>'
        for s, lat, lon in places
    )
    head = "%  UTC  latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m)\n"
    lines = "".join(
        f"{str(s)[:10].replace('-', '/')} {str(s)[11:23]} {lat:.9f} {lon:.9f} 50.0 5 8 "
        "1.5 1.2 3.0 -0.4\n"
        for s, lat, lon in places
    )
    circles = table.drop(["cov_ee_m2", "cov_en_m2", "cov_nn_m2", "wheel_rl_ticks"])
    circles = circles.append_column("sigma_m", [fixes.cov_ee[rows] ** 0.5])
    circles = circles.append_column("yaw_rate_radps", [np.zeros(len(stamps))])
    circles = circles.append_column("odometer_m", [10.0 * np.arange(len(stamps))])
    circles = circles.append_column("gear", [["R" if k < 20 else "D" for k in range(len(stamps))]])
    circles = circles.set_column(0, "time_ms", [1e3 * fixes.time[rows]])
    pyarrow.csv.write_csv(circles, folder / "c.csv")
    return formats(stamps, fixes.lat_deg[rows], fixes.lon_deg[rows], folder) | {
        "sigma": (folder / "c.csv").read_bytes(),
        "csv": (folder / "t.csv").read_bytes(),
        "parquet": (folder / "t.parquet").read_bytes(),
        "gpx": f'<gpx version="1.1"><trk><trkseg>\n{points}\n</trkseg></trk></gpx>'.encode(),
        "pos": (head + lines).encode(),
    }


def _by_library(candump: Path, path: Path) -> bytes:
    """The same frames in a format that python-can writes."""
    import can

    with can.LogReader(str(candump)) as log, can.Logger(str(path)) as writer:
        for message in log:
            writer(message)
    return path.read_bytes()


def readers(folder: Path) -> list[Reader]:
    """Every reader with a good file of its own, written by the simulator."""
    town = folder / "town.osm"
    town.write_text(draw_town())
    roads = RoadMap.from_osm(town)
    roads.save(folder / "town.map")
    drive = simulate_drive(roads, seed=1, length_m=1500.0)
    files = {p.name: p for p in write_drive(drive, roads, folder, force=True)}
    dbc, can = files["vehicle.dbc"], files["can.log"]
    vehicle = read_vehicle(files["vehicle.toml"])
    tables = _tables(drive, folder)

    def drives(path: Path) -> int:
        return _records(read_drive(path))

    def by_names(path: Path) -> int:
        return _records(read_drive(path, columns={"time": "Datum_Zeit"}, tz="Europe/Berlin"))

    def with_dbc(path: Path) -> int:
        return _records(read_drive([], can=path, dbc=dbc, vehicle=vehicle))

    def by_dbc(path: Path) -> int:
        return _records(read_drive([], can=can_short, dbc=path, vehicle=vehicle))

    def of_edges(path: Path) -> int:
        return len(RoadMap.from_edges(path))

    def of_osrm(path: Path) -> int:
        places, _, options = path.read_bytes().decode("latin-1").partition("\n")
        return len(json.dumps(osrm_match(roads, places, options), allow_nan=False))

    def of_valhalla(path: Path) -> int:
        answer = trace_attributes(roads, path.read_bytes()), trace_route(roads, path.read_bytes())
        return len(json.dumps(answer, allow_nan=False))

    osrm, valhalla = requests_of(drive)
    can_short = folder / "short.log"
    can_short.write_bytes(_first_lines(can))
    nmea = _first_lines(files["drive.nmea"])
    return [
        Reader("nmea", nmea, drives, ".nmea"),
        Reader("nmea stream", nmea, _stream, ".nmea"),
        Reader("ubx", tables["ubx"], drives, ".ubx"),
        Reader("ros bag", for_robots(tables["parquet"], folder / "d.bag"), drives, ".bag"),
        Reader("ros 2 bag", for_robots(tables["parquet"], folder / "d.db3"), drives, ".db3"),
        Reader("mcap", for_robots(tables["parquet"], folder / "d.mcap"), drives, ".mcap"),
        Reader("csv", tables["csv"], drives, ".csv"),
        Reader("csv, odometer and gyro", tables["sigma"], drives, ".csv"),
        Reader("parquet", tables["parquet"], drives, ".parquet"),
        Reader("gpx", tables["gpx"], drives, ".gpx"),
        Reader("pos", tables["pos"], drives, ".pos"),
        Reader("json", tables["json"], drives, ".json"),
        Reader("geojson", tables["geojson"], drives, ".geojson"),
        Reader("kml", tables["kml"], drives, ".kml"),
        Reader("gpkg", tables["gpkg"], drives, ".gpkg"),
        Reader("gnss logger", tables["gnss logger"], drives, ".txt"),
        Reader("csv, own names", tables["own names"], by_names, ".csv"),
        Reader("places alone", tables["places"], drives, ".txt"),
        Reader("any suffix", tables["csv"], drives, ".dat"),
        Reader("candump", can_short.read_bytes(), with_dbc, ".log"),
        Reader("asc", _by_library(can_short, folder / "log.asc"), with_dbc, ".asc"),
        Reader("blf", _by_library(can_short, folder / "log.blf"), with_dbc, ".blf"),
        Reader("mf4", _by_library(can_short, folder / "log.mf4"), with_dbc, ".mf4"),
        Reader("dbc", dbc.read_bytes(), by_dbc, ".dbc"),
        Reader(
            "vehicle.toml",
            files["vehicle.toml"].read_bytes(),
            lambda p: int(isinstance(read_vehicle(p), Vehicle)),
            ".toml",
        ),
        Reader(
            "compiled map",
            (folder / "town.map").read_bytes(),
            lambda p: len(RoadMap.open(p)),
            ".map",
            MapError,
        ),
        Reader(".net.xml", sumo_net(roads), of_edges, ".net.xml", MapError),
        Reader("overture", overture(roads), of_edges, ".parquet", MapError),
        Reader("request of osrm", osrm, of_osrm, ".txt", AnswerError),
        Reader("request of valhalla", valhalla, of_valhalla, ".json", AnswerError),
        Reader(".osm", town.read_bytes(), lambda p: len(RoadMap.from_osm(p)), ".osm", MapError),
    ]


def _mutations(reader: Reader) -> tuple[Mutation, ...]:
    if reader.name.startswith("nmea"):
        return (*_TEXT, _sealed, _sealed)
    if reader.suffix == ".ubx":
        return (*_BINARY, _sealed_ubx, _sealed_ubx)
    binary = (".parquet", ".blf", ".mf4", ".map", ".gpkg", ".bag", ".mcap", ".db3")
    return _BINARY if reader.suffix in binary else _TEXT


def _attack(reader: Reader, seconds: float, random: Random, path: Path) -> dict[str, Any]:
    """One reader's counts after `seconds` of bad input."""
    told: dict[str, Any] = {"inputs": 0, "records": 0, "read_errors": 0, "other_errors": []}
    told["slowest"] = 0.0  # s
    path.write_bytes(reader.good)
    if not reader.read(path):
        told["other_errors"].append("the good file gives no records")
    mutations = _mutations(reader)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        data = reader.good
        for _ in range(int(random.choice((1, 1, 1, 2, 3)))):
            data = mutations[int(random.integers(0, len(mutations)))](data or b"\n", random)
        path.unlink()  # a map may still be looking at the old one
        path.write_bytes(data)
        told["inputs"] += 1
        begin = time.monotonic()
        try:
            told["records"] += reader.read(path)
        except reader.refusal as refusal:
            told["read_errors"] += 1
            if "\n" in str(refusal):
                told["other_errors"].append(f"more than one line: {refusal!r}")
        except Exception as error:
            if len(told["other_errors"]) < _KEPT:
                told["other_errors"].append(_where(error))
        told["slowest"] = max(told["slowest"], time.monotonic() - begin)
    return told


def _where(error: Exception) -> str:
    """What went wrong in which line of ours."""
    ours = [f for f in traceback.extract_tb(error.__traceback__) if "whichroad" in f.filename]
    last = ours[-1] if ours else traceback.extract_tb(error.__traceback__)[-1]
    first = (str(error).splitlines() or [""])[0]
    return f"{Path(last.filename).name}:{last.lineno}: {type(error).__name__}: {first}"


def fuzz(seconds: float, seed: int, say: Callable[[str], None]) -> dict[str, dict[str, Any]]:
    """Attack each reader for `seconds`.

    Args:
        seconds: For each reader.
        seed: Of the damage.
        say: Takes a line when a reader is done.

    Returns:
        Reader -> inputs, records, read_errors, other_errors (where and what; must be empty),
        slowest (s, of one input).
    """
    told = {}
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        folder = Path(name)
        every = readers(folder)
        warnings.simplefilter("error")
        for reader in every:
            path = folder / f"bad{reader.suffix}"
            random = np.random.default_rng([seed, *reader.name.encode()])
            done = told[reader.name] = _attack(reader, seconds, random, path)
            for line in dict.fromkeys(done["other_errors"]):
                say(f"{reader.name}: {line}")
            say(
                f"{reader.name}: {done['inputs']} inputs, {done['records']} records, "
                f"{done['read_errors']} refused, {done['slowest']:.2f} s at most"
            )
    return told


def run(options: Options) -> list[Figure]:
    """Errors that are none of ours, for each reader."""
    seed = options.seeds.start if options.seeds else 0
    seconds = options.more.get("seconds", SECONDS)
    return [
        Figure(
            f"other errors: {name}",
            len(told["other_errors"]),
            "<= 0",
            "",
            told["inputs"],
            seeds=seeds_text(range(seed, seed + 1)),
        )
        for name, told in fuzz(seconds, seed, options.say).items()
    ]
