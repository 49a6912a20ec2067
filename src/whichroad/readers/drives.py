"""Reading drives: files of any known format, combined on one clock."""

import glob
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from ..errors import ReadError, SettingError
from ..observations import Drive, OdometryLog, WithGyro
from ..settings import Settings, Vehicle
from ..wording import by_reason
from .can import read_can
from .checks import listed
from .combining import Part, combined
from .csv_text import layout_of
from .drive_tables import read_table
from .geo_files import read_geo
from .gnss_logger import read_gnss_logger
from .gpx import read_gpx
from .json_files import read_json
from .kml import read_kml
from .names import NoSuchColumn
from .nmea import read_nmea
from .reading import Reading
from .ros import is_bag, read_bag
from .rtklib import read_pos
from .source import STDIN, Source, is_file, is_file_object
from .ubx import read_ubx

AnyPath = str | PathLike[str]

_SUFFIXES = {
    **dict.fromkeys((".parquet", ".geoparquet", ".pq", ".arrow", ".feather", ".ipc"), "table"),
    **dict.fromkeys((".tsv", ".tab"), "table"),
    **dict.fromkeys((".nmea", ".nma"), "nmea"),
    **dict.fromkeys((".blf", ".asc", ".trc", ".mf4", ".candump"), "can"),
    **dict.fromkeys((".gpkg", ".shp", ".fgb"), "geo"),
    ".gpx": "gpx",
    ".pos": "pos",
    ".ubx": "ubx",
}
_CONTENTS = (  # first bytes of each format
    ("table", re.compile(rb"\A(PAR1|ARROW1|FEA1)")),
    ("geo", re.compile(rb"\A(SQLite format 3\x00|fgb\x03fgb|\x00\x00\x27\x0a)")),
    ("can", re.compile(rb"^\s*\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]{3,8}(#|\s+\[)", re.MULTILINE)),
    ("can", re.compile(rb"\Atimestamp,arbitration_id,extended,remote,error,dlc,data")),
    ("nmea", re.compile(rb"\$[A-Z]{2}(GGA|RMC|GST|ZDA|VTG|GLL|GSA|GSV),")),
    ("ubx", re.compile(rb"\xb5\x62\x01\x07[\x54\x5c]\x00")),
    ("gpx", re.compile(rb"<gpx[\s>]")),
    ("kml", re.compile(rb"<kml[\s>]")),
    ("pos", re.compile(rb"\A(%[^\n]*\n)*%\s+(GPST|UTC|JST)\s", re.MULTILINE)),
    ("gnss_logger", re.compile(rb"^#?\s*Fix,Provider,", re.MULTILINE)),
    ("json", re.compile(rb"\A(\xef\xbb\xbf)?\s*[{\[]")),
    ("json", re.compile(rb"\A[-\dT:.Z]+\t\*\s*\t\{")),  # OwnTracks' recorder
    ("table", re.compile(rb"\A\s*[^\n,;\t\x00]+[,;\t][^\n\x00]*(\n|\Z)")),
)
_STRANGERS = (  # what is not read: what it is, what to do, what it begins with
    ("XML, but no GPX", "export GPX", re.compile(rb"\A(\xef\xbb\xbf)?\s*<")),
    ("compressed or a spreadsheet", "unpack it, or save it as CSV",
     re.compile(rb"\A(\x1f\x8b|PK\x03\x04|BZh|\x28\xb5\x2f\xfd)")),
    ("text in UTF-16", "save it in UTF-8", re.compile(rb"\A(\xff\xfe|\xfe\xff)")),
)  # fmt: skip
_IN_A_CRS = frozenset(("table", "geo", "json"))  # formats whose places may be in any system
_ZIP, _SHAPES = b"PK\x03\x04", re.compile(rb"\.shp")  # a Shapefile in an archive
_SNIFF = 1 << 16  # bytes read to recognise a format
_READERS: dict[str, Callable[[Source, Reading], list[Drive]]] = {
    "nmea": lambda source, reading: [read_nmea(source, reading.settings)],
    "gpx": lambda source, reading: read_gpx(source, reading.settings),
    "pos": lambda source, reading: [read_pos(source, reading.settings)],
    "kml": read_kml,
    "json": read_json,
    "geo": read_geo,
    "gnss_logger": read_gnss_logger,
    "table": read_table,
    "ubx": read_ubx,
}


def read_drive(
    paths: Any,
    *,
    vehicle: Vehicle | None = None,
    dbc: AnyPath | None = None,
    can: AnyPath | None = None,
    settings: Settings | None = None,
    crs: Any = None,
    id: str | None = None,
    columns: Mapping[str, str | int] | None = None,
    tz: str | None = None,
) -> list[Drive]:
    """Read the files of a drive, or of several drives, and put them on one clock.

    The format follows from the suffix, else from the content; docs/formats.md lists all.
    Files that follow each other, or that are at the same places at the same times, are one
    drive; others are drives of their own.  The vehicle's clock offsets, named by file or by
    role (`gnss`, `odometry`, `can`), are added first.

    Args:
        paths: One or several of: a file, a folder, a pattern such as `day1/*.gpx`, `-` for
            standard input, an open file.
        vehicle: Wheels, clocks and the names of CAN signals.
        dbc: What the CAN frames mean.
        can: A CAN log, where its name does not show that it is one.
        settings: Gives the sigma of fixes that report none.
        crs: Reference system of `x, y` columns, and of geometries that name none.
        id: The column of tables whose values tell drives apart.
        columns: Own names of columns in tables: {"time": "ts", "speed_kmh": "v"}; of tables
            without a line of names the numbers of columns, from 1.
        tz: Zone of times in tables that name none, such as Europe/Berlin; None: UTC.

    Returns:
        One drive, or one for each id of a table, track of a GPX file or file of its own.

    Raises:
        ReadError: A file could not be understood, holds nothing that locates a vehicle, or
            the files share no time.
    """
    reading = Reading.of(vehicle, settings, crs=crs, id=id, columns=columns, tz=tz)
    files, folders, notes = _files([paths] if is_file(paths) else list(paths))
    if not files and not folders and can is None:
        raise ReadError("drive: no file was given; at least one log or table was expected")
    parts = _parts(files, reading, dbc)
    if can is not None:
        parts.append(_can_part(can, reading, dbc))
    _check_used(parts, dbc, crs)
    parts = [_on_our_clock(part, reading.vehicle) for part in parts]
    for folder in folders:
        parts += _recording(folder, reading.vehicle, reading.settings)
    drives = combined(parts, reading.vehicle)
    if not any(_holds_anything(drive) for drive in drives):
        reasons = ", ".join(by_reason(d.skipped) for d in drives if d.skipped)
        names = ", ".join(part.name for part in parts)
        raise ReadError(
            f"{names}: neither fixes nor odometry ({reasons or 'nothing was skipped'}); "
            "at least one was expected"
        )
    return [replace(d, notes=(*notes, *d.notes)) for d in drives] if notes else drives


def _check_used(parts: Sequence[Part], dbc: AnyPath | None, crs: Any) -> None:
    """Refuse options that none of the files is concerned by.

    Raises:
        SettingError: There is one.
    """
    kinds = {part.kind for part in parts}
    names = ", ".join(part.name for part in parts)
    if dbc is not None and "can" not in kinds:
        raise SettingError(
            f"dbc (--dbc) is {Path(dbc).name}, and {names} holds no CAN frames; a CAN log was "
            "expected with it; give it by can= (--can)"
        )
    if crs is not None and not kinds & _IN_A_CRS:
        raise SettingError(
            f"crs (--crs) is {crs}, and {names} is not a table; a table with columns x, y was "
            "expected with it; leave it out"
        )


def _files(given: Sequence[Any]) -> tuple[list[Any], list[Path], list[str]]:
    """Single files, folders that are recordings, and notes on files of folders passed over."""
    files: list[Any] = []
    recordings: list[Path] = []
    notes: list[str] = []
    for one in given:
        single = is_file_object(one) or str(one) == STDIN
        if single or Path(one).is_file() or is_bag(Path(one)):
            files.append(one)
        elif Path(one).is_dir():
            inside, others = _inside(Path(one))
            if inside:
                files += inside
                if others:
                    notes.append(f"{Path(one).name}: not read: {listed(others, 5)}")
            else:
                recordings.append(Path(one))
        elif glob.has_magic(str(one)):
            found = sorted(glob.glob(str(one), recursive=True))
            if not found:
                raise ReadError(
                    f"{one}: no file matches; a pattern such as day1/*.gpx was expected"
                )
            more = _files(found)
            files, recordings, notes = files + more[0], recordings + more[1], notes + more[2]
        else:
            files.append(one)
    return files, recordings, notes


def _inside(folder: Path) -> tuple[list[Path], list[str]]:
    """The drives' files of a folder, and the names of others; none of a recording."""
    if (folder / "fixes.arrow").is_file() or (folder / "odometry.arrow").is_file():
        return [], []
    inside, others = [], []
    for path in sorted(path for path in folder.iterdir() if path.is_file()):
        try:
            if format_of(path) != "can":
                inside.append(path)
                continue
        except ReadError:
            pass
        others.append(path.name)
    return inside, others


def _parts(files: Sequence[Any], reading: Reading, dbc: AnyPath | None) -> list[Part]:
    """What the files hold; own names of columns are those of at least one of several tables."""
    parts, found, missing = [], set[str](), dict[str, NoSuchColumn]()
    for file in files:
        here, file = reading, _kept(file)
        while True:
            try:
                parts.append(_part(file, here, dbc))
                break
            except NoSuchColumn as error:
                if len(files) == 1:
                    raise
                missing[error.alias] = error
                own = {name: column for name, column in here.columns.items() if name != error.alias}
                here = replace(here, columns=own, id=here.id if "drive_id" in own else None)
        if parts[-1].kind == "table":
            found |= here.columns.keys()
    for alias in missing.keys() - found:
        raise missing[alias]
    return parts


def _kept(file: Any) -> Any:
    """What can be read more than once."""
    return Source.of(file) if is_file_object(file) or str(file) == STDIN else file


def _part(file: Any, reading: Reading, dbc: AnyPath | None) -> Part:
    """What a file of any format holds."""
    if not isinstance(file, Source) and is_bag(Path(file)):
        return Part(Path(file).name, "ros", read_bag(Path(file), reading), False)
    if not isinstance(file, Source) and _kind_of_path(file) == "can":
        return _can_part(file, reading, dbc)
    source = Source.of(file)
    kind = _kind(source, reading)
    if kind == "can":
        raise ReadError(f"{source.name}: a CAN log; give the path of an unpacked file (--can)")
    drives = _READERS[kind](source, reading)
    return Part(source.name, kind, drives, len(drives) > 1 or drives[0].drive_id != source.stem)


def _can_part(path: AnyPath, reading: Reading, dbc: AnyPath | None) -> Part:
    return Part(Path(path).name, "can", [read_can(path, dbc, reading.vehicle)], False)


def _kind_of_path(path: AnyPath) -> str | None:
    """The format by suffix alone, or by the first bytes of a CAN log."""
    try:
        with Path(path).open("rb") as file:
            head = file.read(_SNIFF)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ReadError(
            f"{path}: cannot be read ({reason}); a readable file was expected"
        ) from None
    kind = _SUFFIXES.get(Path(path).suffix.lower())
    return kind or ("can" if any(p.search(head) for k, p in _CONTENTS if k == "can") else None)


def format_of(file: Any) -> str:
    """The format of a drive's file: a key of `_READERS`, or `can`.

    Raises:
        ReadError: The file cannot be opened, is empty or like none of them.
    """
    return _kind(Source.of(file), Reading())


def _kind(source: Source, reading: Reading) -> str:
    where, head = source.name, source.data[:_SNIFF]
    if not head.strip():
        raise ReadError(f"{where}: the file is empty; a log or table was expected")
    if source.suffix in _SUFFIXES:
        return _SUFFIXES[source.suffix]
    kind = next((kind for kind, pattern in _CONTENTS if pattern.search(head)), None)
    strange = next(((s, advice) for s, advice, p in _STRANGERS if p.search(head)), None)
    if kind is None and not strange and b"\0" not in head and layout_of(head, reading):
        kind = "table"
    if source.data.startswith(_ZIP) and _SHAPES.search(source.data):
        return "geo"
    if kind is not None and not (kind == "table" and strange):
        return kind
    seen, advice = strange or ("a file of unknown format", "convert it")
    raise ReadError(
        f"{where}: {seen}; NMEA 0183, a drive table (CSV, Parquet, Arrow), GPX, KML, GeoJSON, "
        f"UBX, RTKLIB .pos or a CAN log was expected; {advice}"
    )


def _recording(folder: Path, vehicle: Vehicle, settings: Settings) -> list[Part]:
    """What the live service recorded; it is on our clock already, its counters are unwrapped."""
    files = [folder / name for name in ("fixes.arrow", "odometry.arrow")]
    if not all(file.is_file() for file in files):
        raise ReadError(
            f"{folder}: cannot be read (a folder without fixes.arrow, odometry.arrow); a file, or "
            "a recording of `whichroad live --record`, was expected"
        )
    straight = replace(vehicle, counter_bits=0)
    parts = []
    for file in [file for file in files if _has_rows(file)]:  # a drive may be without wheels
        drives = read_table(file, Reading(straight, settings))
        drives = [replace(drive, drive_id=folder.name) for drive in drives]
        parts.append(Part(f"{folder.name}/{file.name}", "table", drives, True))
    if not parts:
        raise ReadError(f"{folder}: nothing was recorded; fixes or odometry were expected")
    return parts


def _has_rows(file: Path) -> bool:
    """Whether there is a row in an Arrow stream, or something else that its reader will report."""
    import pyarrow as pa

    try:
        with pa.OSFile(str(file)) as source, pa.ipc.open_stream(source) as batches:
            return any(batch.num_rows for batch in batches)
    except (pa.ArrowException, OSError):
        return True


def _holds_anything(drive: Drive) -> bool:
    return bool(drive.fixes is not None and len(drive.fixes)) or drive.odometry is not None


def _later(log: OdometryLog, seconds: float) -> OdometryLog:
    """Odometry on another clock."""
    if isinstance(log, WithGyro):
        distance = replace(log.distance, time=log.distance.time + seconds)
        return WithGyro(distance, replace(log.gyro, time=log.gyro.time + seconds))
    return replace(log, time=log.time + seconds)


def _on_our_clock(part: Part, vehicle: Vehicle) -> Part:
    """Add the vehicle's clock offsets: that of the file, else that of the role."""
    offsets = vehicle.clock_offset
    moving = "can" if part.kind == "can" and "can" in offsets else "odometry"
    for_fixes = offsets.get(part.name, offsets.get("gnss", 0.0))
    for_odometry = offsets.get(part.name, offsets.get(moving, 0.0))
    if not for_fixes and not for_odometry:
        return part
    drives = []
    for drive in part.drives:
        fixes, odometry = drive.fixes, drive.odometry
        if fixes is not None:
            fixes = replace(fixes, time=fixes.time + for_fixes)
        if odometry is not None:
            odometry = _later(odometry, for_odometry)
        drives.append(replace(drive, fixes=fixes, odometry=odometry))
    return part._replace(drives=drives)
