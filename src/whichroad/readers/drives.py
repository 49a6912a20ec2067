"""Reading drives: files of any known format, combined on one clock."""

import glob
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import ReadError, SettingError
from ..observations import Drive, OdometryLog, WithGyro
from ..settings import Settings, Vehicle
from ..wording import by_reason
from .can import read_can
from .combining import Part, combined
from .drive_tables import read_table
from .folders import (
    READINGS,
    Folder,
    by_folder,
    described_folders,
    is_geared,
    is_recording,
    named_by,
    sorted_out,
    vehicle_beside,
)
from .formats import kind_of, kind_of_path
from .geo_files import read_geo
from .gnss_logger import read_gnss_logger
from .gpx import read_gpx
from .json_files import read_json
from .kml import read_kml
from .names import SENSED, NoSuchColumn
from .nmea import read_nmea
from .reading import Reading
from .ros import is_bag, read_bag
from .rtklib import read_pos
from .source import STDIN, Source, is_file, is_file_object
from .ubx import read_ubx
from .unread import Unread, check_apart

AnyPath = str | PathLike[str]

IN_A_CRS = frozenset(("table", "geo", "json"))  # formats whose places may be in any system
_READERS: dict[str, Callable[[Source, Reading], list[Drive]]] = {
    "nmea": lambda source, reading: [read_nmea(source, reading.settings, reading.columns)],
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
    dates: str | None = None,
    skip_unreadable: bool = False,
) -> list[Drive]:
    """Read the files of a drive, or of several drives, and put them on one clock.

    The format follows from the suffix, else from the content; docs/formats.md lists all.
    Files that follow each other, or that are at the same places at the same times, are one
    drive; others are drives of their own.  The vehicle's clock offsets, named by file or by
    role (`gnss`, `odometry`, `can`), are added first.

    Args:
        paths: One or several of: a file, a folder, a pattern such as `day1/*.gpx`, `-` for
            standard input, an open file.  Of a folder its CAN logs, its .dbc and its
            vehicle.toml are used; its truth and its answers are left out.  The notes say so.
        vehicle: Wheels, clocks and the names of CAN signals; None: that of the folders.
        dbc: What the CAN frames mean; None: that of the folder.
        can: A CAN log, where its name does not show that it is one.
        settings: Gives the sigma of fixes that report none.
        crs: Reference system of `x, y` columns, and of geometries that name none.
        id: The column of tables whose values tell drives apart.
        columns: Own names of columns in tables: {"time": "ts", "speed_kmh": "v"}; of tables
            without a line of names the numbers of columns, from 1.
        tz: Zone of times in tables that name none, such as Europe/Berlin; None: UTC.
        dates: "mdy", "dmy" or "ymd": the order in dates such as 06/01/2026 and 010626.
        skip_unreadable: Whether a file that cannot be understood, beside files that are drives
            of their own, becomes a drive without contents, whose note says why.

    Returns:
        One drive, or one for each id of a table, track of a GPX file or file of its own.

    Raises:
        ReadError: A file could not be understood and may not be skipped, holds nothing that
            locates a vehicle, or the files share no time.
    """
    if hasattr(paths, "columns") or isinstance(paths, Mapping):
        raise ReadError(
            f"drive: a {type(paths).__name__} in memory was given; paths of files were expected; "
            "give it to whichroad.match, which takes tables too"
        )
    paths = [paths] if is_file(paths) else list(paths)
    vehicle = vehicle_beside(paths) if vehicle is None else vehicle
    reading = Reading.of(vehicle, settings, crs=crs, id=id, columns=columns, tz=tz, dates=dates)
    files, folders, notes, bases = _files(paths, reading.vehicle, dbc, can)
    if not files and not folders and can is None:
        raise ReadError("drive: no file was given; at least one log or table was expected")
    unread: list[Unread] | None = [] if skip_unreadable and len(files) > 1 else None
    parts = _parts(files, reading, dbc, bases, unread)
    if can is not None:
        parts.append(_can_part(can, reading, dbc))
    if not unread:
        _check_used(parts, dbc, crs)
    parts = [_on_our_clock(part, reading.vehicle) for part in parts]
    for folder in folders:
        parts += _recording(folder, reading)
    drives = _drives_of(parts, reading.vehicle)
    if unread:
        check_apart(unread, parts, drives)
    if not any(_holds_anything(drive) for drive in drives):
        reasons = ", ".join(by_reason(d.skipped) for d in drives if d.skipped)
        names = ", ".join(part.name for part in parts)
        raise ReadError(
            f"{names}: neither fixes nor odometry ({reasons or 'nothing was skipped'}); "
            "at least one was expected"
        )
    drives = [replace(d, notes=(*notes, *d.notes)) for d in drives] if notes else drives
    return [*drives, *(file.drive for file in unread or ())]


def _drives_of(parts: Sequence[Part], vehicle: Vehicle) -> list[Drive]:
    """The drives, those of folders with a recording each under the folders' names."""
    taken: set[str] = set()
    drives: list[Drive] = []
    for folder, mine in by_folder(parts):
        found = combined(mine, vehicle)
        drives += named_by(folder, found, taken) if folder else found
        taken |= {drive.drive_id for drive in found}
    return drives


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
    if crs is not None and not kinds & IN_A_CRS:
        raise SettingError(
            f"crs (--crs) is {crs}, and {names} is not a table; a table with columns x, y was "
            "expected with it; leave it out"
        )


class _Given(NamedTuple):
    """What the caller's paths name."""

    files: list[Any]
    recordings: list[Path]  # folders of `whichroad live`
    notes: list[str]  # on what was used and left out
    bases: dict[Path, Path]  # CAN log -> the .dbc of its folder


def _files(
    given: Sequence[Any], vehicle: Vehicle, dbc: AnyPath | None, can: AnyPath | None
) -> _Given:
    """Single files, those of folders, and folders that are recordings."""
    all_given = _Given([], [], [], {})
    described = described_folders(given)
    for folder, paths in described.items():
        _take(all_given, sorted_out(paths, dbc, can), folder.name or str(folder), vehicle, can)
    taken = {path for paths in described.values() for path in paths}
    for one in (one for one in given if is_file_object(one) or Path(one) not in taken):
        single = is_file_object(one) or str(one) == STDIN
        if single or Path(one).is_file() or is_bag(Path(one)):
            all_given.files.append(one)
        elif Path(one).is_dir():
            if is_recording(Path(one)):
                all_given.recordings.append(Path(one))
                continue
            paths = [path for path in Path(one).iterdir() if path.is_file()]
            inside = sorted_out(paths, dbc, can)
            if not inside.files and not any(what for _, what in inside.left_out):
                all_given.recordings.append(Path(one))  # which says what is missing
                continue
            _take(all_given, inside, Path(one).name or str(one), vehicle, can)
        elif glob.has_magic(str(one)):
            found = sorted(glob.glob(str(one), recursive=True))
            if not found:
                raise ReadError(
                    f"{one}: no file matches; a pattern such as day1/*.gpx was expected"
                )
            more = _files(found, vehicle, dbc, can)
            all_given.files.extend(more.files)
            all_given.recordings.extend(more.recordings)
            all_given.notes.extend(more.notes)
            all_given.bases.update(more.bases)
        else:
            all_given.files.append(one)
    return all_given


def _take(given: _Given, inside: Folder, name: str, vehicle: Vehicle, can: AnyPath | None) -> None:
    """Add the files of a folder, and notes on the others.

    Raises:
        ReadError: None of them is of a drive.
    """
    if not inside.files and can is None:
        others = "; ".join(f"{file}: {what}" if what else file for file, what in inside.left_out)
        others = others or ", ".join(p.name for p in (inside.vehicle, inside.dbc) if p is not None)
        raise ReadError(f"{name}: no file of a drive ({others}); a log or table was expected")
    given.files.extend(inside.files)
    given.notes.extend(inside.notes(name, vehicle))
    if inside.dbc is not None:
        given.bases.update(dict.fromkeys(inside.files, inside.dbc))


def _parts(
    files: Sequence[Any],
    reading: Reading,
    dbc: AnyPath | None,
    bases: Mapping[Path, Path],
    unread: list[Unread] | None = None,
) -> list[Part]:
    """What the files hold; own names of columns are those of at least one of several tables.

    Args:
        files: Paths, sources and open files.
        reading: What the caller says of them.
        dbc: What CAN frames mean.
        bases: The same of some logs.
        unread: Where files are put that cannot be understood; None: they are refused.
    """
    parts, found, missing = [], set[str](), dict[str, NoSuchColumn]()
    for file in files:
        here, file = reading, _kept(file)
        while True:
            try:
                base = bases.get(file, dbc) if isinstance(file, Path) else dbc
                parts.append(_part(file, here, base))
                if parts[-1].kind == "table":
                    found |= here.columns.keys()
                break
            except NoSuchColumn as error:
                if len(files) == 1:
                    name = file.name if isinstance(file, Source) else Path(file).name
                    said = str(error).replace("table:", f"{name}:", 1)
                    raise NoSuchColumn(error.alias, said) from None
                missing[error.alias] = error
                own = {name: column for name, column in here.columns.items() if name != error.alias}
                here = replace(here, columns=own, id=here.id if "drive_id" in own else None)
            except ReadError as error:
                if unread is None or not (isinstance(file, Source) or Path(file).exists()):
                    raise
                unread.append(Unread.of(file, here, error))
                break
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
    if not isinstance(file, Source) and kind_of_path(file) == "can":
        return _can_part(file, reading, dbc)
    source = Source.of(file)
    kind = kind_of(source, reading)
    if kind == "can":
        raise ReadError(f"{source.name}: a CAN log; give the path of an unpacked file (--can)")
    drives = _READERS[kind](source, reading)
    named = len(drives) > 1 or drives[0].drive_id != source.stem
    return Part(source.name, kind, drives, named, str(Path(source.path).parent))


def _can_part(path: AnyPath, reading: Reading, dbc: AnyPath | None) -> Part:
    drives = [read_can(path, dbc, reading.vehicle, reading.columns)]
    return Part(Path(path).name, "can", drives, False, str(Path(path).parent))


def _recording(folder: Path, reading: Reading) -> list[Part]:
    """What the live service recorded; it is on our clock already, its counters are unwrapped."""
    files = [folder / name for name in ("fixes.arrow", "odometry.arrow")]
    if not all(file.is_file() for file in files):
        raise ReadError(
            f"{folder}: cannot be read (a folder without fixes.arrow, odometry.arrow); a file, or "
            "a recording of `whichroad live --record`, was expected"
        )
    straight = replace(reading.vehicle, counter_bits=0)
    further = {k: v for k, v in reading.columns.items() if k.startswith(SENSED)}
    if further and (folder / READINGS).is_file():
        files.append(folder / READINGS)
    parts, geared = [], is_geared(folder)
    for file in [file for file in files if _has_rows(file)]:  # a drive may be without wheels
        own = further if file.name == READINGS else {}
        drives = read_table(file, Reading(straight, reading.settings, columns=own))
        drives = [
            replace(drive, drive_id=folder.name, geared=geared and drive.odometry is not None)
            for drive in drives
        ]
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
    has_fixes = drive.fixes is not None and len(drive.fixes) > 0
    return has_fixes or drive.odometry is not None or drive.gyro is not None


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
        fixes, odometry, gyro = drive.fixes, drive.odometry, drive.gyro
        if gyro is not None:
            gyro = replace(gyro, time=gyro.time + for_odometry)
        if fixes is not None:
            fixes = replace(fixes, time=fixes.time + for_fixes)
        if odometry is not None:
            odometry = _later(odometry, for_odometry)
        more = for_odometry if part.kind == "can" or fixes is None else for_fixes
        sensed = tuple(replace(one, time=one.time + more) for one in drive.sensed)
        drives.append(replace(drive, fixes=fixes, odometry=odometry, sensed=sensed, gyro=gyro))
    return part._replace(drives=drives)
