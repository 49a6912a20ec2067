"""How fast logs are read: NMEA sentences, CAN frames, rows, UBX messages, points of tracks.

Each figure is the least disturbed of three runs over one file, read from the disk's cache.
"""

import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from whichroad.observations import Drive
from whichroad.readers import NmeaParser, read_drive
from whichroad.settings import Vehicle

from . import Figure, Options
from .fuzz_formats import ubx

START = 1_780_300_800.0  # s since 1970 UTC
SENTENCES = 1_000_000
FRAMES = 500_000
ROWS = 1_000_000
POINTS = 100_000
REPEATS = 3
_TAIL = b"GPGSA,A,3,04,09,16,26,07,03,27,02,,,,,1.21,0.94,0.76"
_DBC = """VERSION ""
BU_: Brakes
BO_ 928 WheelTicks: 8 Brakes
 SG_ Left : 0|16@1+ (1,0) [0|65535] "" Brakes
 SG_ Right : 16|16@1+ (1,0) [0|65535] "" Brakes
BO_ 930 Other: 8 Brakes
 SG_ Unused : 7|16@0+ (0.01,0) [0|655.35] "km/h" Brakes
"""


def _sealed(body: str) -> bytes:
    data = body.encode()
    check = int(np.bitwise_xor.reduce(np.frombuffer(data, np.uint8)))
    return b"$%s*%02X\r\n" % (data, check)


def nmea(sentences: int) -> bytes:
    """Bursts of GGA, GST, RMC, VTG and GSA at 1 Hz, over midnights."""
    log = bytearray()
    for k in range(sentences // 5):
        day, second = divmod(k, 86_400)
        clock = f"{second // 3600:02d}{second // 60 % 60:02d}{second % 60:02d}.00"
        place = f"49{24 + k % 7:02d}.{k % 1_000_000:06d},N,008{k % 59:02d}.{k % 999_983:06d},E"
        log += _sealed(f"GPGGA,{clock},{place},1,09,0.9,52.0,M,45.0,M,,")
        log += _sealed(f"GPGST,{clock},1.2,2.60,1.30,{k % 180}.0,2.20,1.90,3.10")
        log += _sealed(f"GPRMC,{clock},A,{place},{k % 60}.123,{k % 360}.12,{1 + day:02d}0626,,,A")
        log += _sealed(f"GPVTG,{k % 360}.12,T,,M,{k % 60}.123,N,100.123,K,A")
        log += _sealed(_TAIL.decode())
    return bytes(log)


def candump(frames: int) -> bytes:
    """A wheel frame in every five, 16 bits that wrap."""
    lines = []
    for k in range(frames):
        stamp = START + k * 0.002
        if k % 5:
            lines.append(f"({stamp:.6f}) can0 3A2#{k % 65_536:04X}{k % 251:04X}00000000")
        else:
            ticks = (k // 5) * 5 % 65_536
            word = ticks.to_bytes(2, "little").hex().upper()
            lines.append(f"({stamp:.6f}) can0 3A0#{word}{word}00000000")
    return "\n".join([*lines, ""]).encode()


def table(rows: int) -> bytes:
    """Fixes with covariance and speed, ISO times."""
    from io import BytesIO

    import pyarrow as pa
    import pyarrow.csv

    k = np.arange(rows)
    stamps = pa.array(((START + 0.1 * k) * 1e6).astype("datetime64[us]")).cast("string")
    columns: dict[str, Any] = {
        "time": stamps,
        "lat": 49.0 + 1e-6 * (k % 1000),
        "lon": 8.0 + 1e-6 * (k % 1000),
        "cov_ee_m2": 4.0 + k % 3,
        "cov_en_m2": 0.5 * np.ones(rows),
        "cov_nn_m2": 4.0 + k % 2,
        "speed_mps": 10.0 + 0.01 * (k % 100),
        "bearing_deg": k % 360,
    }
    file = BytesIO()
    pyarrow.csv.write_csv(pa.table(columns), file)
    return file.getvalue()


def _fastest(work: Callable[[], Any], clock: Callable[[], float] = time.perf_counter) -> float:
    """Seconds of the fastest of a few calls."""
    times = []
    for _ in range(REPEATS):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times)


def _whole(drive: Drive, records: int) -> None:
    log = drive.fixes or drive.odometry
    if log is None or len(log.time) != records or drive.skipped:
        raise AssertionError(f"read {log and len(log.time)} of {records}, {drive.skipped}")


def run(options: Options) -> list[Figure]:
    """Sentences, frames and rows a second."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        return [*_nmea(folder, options), *_can(folder), *_csv(folder), *_tracks(folder)]


def _nmea(folder: Path, options: Options) -> list[Figure]:
    path = folder / "log.nmea"
    data = nmea(SENTENCES)
    path.write_bytes(data)
    _whole(read_drive(path)[0], SENTENCES // 5)
    seconds = _fastest(lambda: read_drive(path))
    options.say(f"NMEA: {len(data) / 1e6:.0f} MB in {seconds:.2f} s")
    part = data[: len(data) // 20]
    bursts = part.split(b"$GPGGA")

    def stream() -> None:
        parser = NmeaParser()
        for burst in bursts[1:]:
            parser.feed(b"$GPGGA" + burst)

    live = _fastest(stream)
    return [
        Figure("NMEA log", SENTENCES / seconds, ">= 100000", "sentences/s", SENTENCES),
        Figure("NMEA stream, one burst", 1e6 * live / len(bursts), "", "us", len(bursts)),
    ]


def _can(folder: Path) -> list[Figure]:
    log, dbc = folder / "can.log", folder / "car.dbc"
    log.write_bytes(candump(FRAMES))
    dbc.write_text(_DBC)
    vehicle = Vehicle(signals={"wheel_rl_ticks": "Left", "wheel_rr_ticks": "Right"})
    _whole(read_drive([], can=log, dbc=dbc, vehicle=vehicle)[0], FRAMES // 5)
    seconds = _fastest(lambda: read_drive([], can=log, dbc=dbc, vehicle=vehicle))
    return [Figure("CAN, candump", FRAMES / seconds, "", "frames/s", FRAMES)]


def _csv(folder: Path) -> list[Figure]:
    path = folder / "fixes.csv"
    path.write_bytes(table(ROWS))
    _whole(read_drive(path)[0], ROWS)
    seconds = _fastest(lambda: read_drive(path))
    return [Figure("CSV table", ROWS / seconds, "", "rows/s", ROWS)]


def _tracks(folder: Path) -> list[Figure]:
    """UBX, RTKLIB and GPX, by the seconds that the process computes."""
    stamps = np.datetime64("2026-06-01T12:00:00", "us") + np.arange(POINTS) * np.timedelta64(1, "s")
    lat, lon = 49.0 + 1e-6 * (np.arange(POINTS) % 1000), np.full(POINTS, 8.7)
    rows = list(zip(stamps.astype("datetime64[s]").astype(str), lat, lon, strict=True))
    head = "%  UTC  latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m)\n"
    points = "\n".join(
        f'<trkpt lat="{a:.7f}" lon="{o:.7f}"><ele>1</ele><time>{s}Z</time><hdop>0.9</hdop></trkpt>'
        for s, a, o in rows
    )
    files = {
        "log.ubx": ubx(stamps, lat, lon),
        "log.pos": head.encode() + "".join(
            f"{s[:10].replace('-', '/')} {s[11:]}.000 {a:.9f} {o:.9f} 50.0 5 8 1.5 1.2 3.0 -0.4\n"
            for s, a, o in rows
        ).encode(),
        "log.gpx": f'<gpx version="1.1"><trk><trkseg>\n{points}</trkseg></trk></gpx>'.encode(),
    }  # fmt: skip
    figures = []
    for name, content in files.items():
        (folder / name).write_bytes(content)
        records = POINTS * (3 if name == "log.ubx" else 1)
        fixes = read_drive(folder / name)[0].fixes
        if fixes is None or len(fixes) != POINTS:
            raise AssertionError(f"{name}: not all was read")
        seconds = _fastest(partial(read_drive, folder / name), time.process_time)
        what = "UBX log" if name == "log.ubx" else f"{name[4:].upper()} log"
        figures.append(Figure(what, records / seconds, ">= 100000", "records/s", records))
    return figures
