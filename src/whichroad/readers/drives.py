"""Reading drives: files of any known format, combined on one clock."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import fields, replace
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import ReadError, SettingError
from ..observations import (
    Drive,
    Fixes,
    Odometer,
    OdometryLog,
    SpeedYawRate,
    WheelCounts,
    WheelSpeeds,
)
from ..settings import Settings, Vehicle
from .can import read_can
from .checks import Skipped, in_order
from .drive_tables import read_table
from .gpx import read_gpx
from .nmea import read_nmea
from .rtklib import read_pos
from .wheel_counters import cumulative

AnyPath = str | PathLike[str]

_SUFFIXES = {
    **dict.fromkeys((".parquet", ".geoparquet", ".pq", ".arrow", ".feather", ".ipc"), "table"),
    **dict.fromkeys((".tsv", ".tab"), "table"),
    **dict.fromkeys((".nmea", ".nma"), "nmea"),
    **dict.fromkeys((".blf", ".asc", ".trc", ".mf4", ".candump"), "can"),
    ".gpx": "gpx",
    ".pos": "pos",
}
_CONTENTS = (  # first bytes of each format
    ("table", re.compile(rb"\A(PAR1|ARROW1|FEA1)")),
    ("can", re.compile(rb"^\s*\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]{3,8}(#|\s+\[)", re.MULTILINE)),
    ("can", re.compile(rb"\Atimestamp,arbitration_id,extended,remote,error,dlc,data")),
    ("nmea", re.compile(rb"\$[A-Z]{2}(GGA|RMC|GST|ZDA|VTG|GLL|GSA|GSV),")),
    ("gpx", re.compile(rb"<gpx[\s>]")),
    ("pos", re.compile(rb"\A(%[^\n]*\n)*%\s+(GPST|UTC|JST)\s", re.MULTILINE)),
    ("table", re.compile(rb"\A\s*[^\n,;\t\x00]+[,;\t][^\n\x00]*(\n|\Z)")),
)
_STRANGERS = (  # what is not read: what it is, what to do, what it begins with
    ("JSON", "write a CSV or Parquet with columns time, lat, lon", re.compile(rb"\A\s*[{\[]")),
    ("XML, but no GPX", "export GPX", re.compile(rb"\A(\xef\xbb\xbf)?\s*<")),
    ("compressed or a spreadsheet", "unpack it, or save it as CSV",
     re.compile(rb"\A(\x1f\x8b|PK\x03\x04|BZh|\x28\xb5\x2f\xfd)")),
    ("text in UTF-16", "save it in UTF-8", re.compile(rb"\A(\xff\xfe|\xfe\xff)")),
)  # fmt: skip
_SNIFF = 1 << 16  # bytes read to recognise a format
_APART = 600.0  # s between odometry and fixes that imply different clocks
_PREFERRED = (WheelCounts, WheelSpeeds, SpeedYawRate, Odometer)


class _Part(NamedTuple):
    name: str  # of the file
    kind: str
    drives: list[Drive]


def read_drive(
    paths: AnyPath | Sequence[AnyPath],
    *,
    vehicle: Vehicle | None = None,
    dbc: AnyPath | None = None,
    can: AnyPath | None = None,
    settings: Settings | None = None,
    crs: Any = None,
) -> list[Drive]:
    """Read the files of a drive, or of several drives, and put them on one clock.

    The format follows from the suffix, else from the content: NMEA, drive tables, GPX,
    RTKLIB, CAN logs.  Files of one drive are merged by time after the vehicle's clock
    offsets, named by file or by role (`gnss`, `odometry`, `can`), are added.

    Args:
        paths: One file or several.
        vehicle: Wheels, clocks and the names of CAN signals.
        dbc: What the CAN frames mean.
        can: A CAN log, where its name does not show that it is one.
        settings: Gives the sigma of fixes that report none.
        crs: Reference system of `x, y` columns in tables.

    Returns:
        One drive, or one for each `drive_id` of a table or track of a GPX file.

    Raises:
        ReadError: A file could not be understood, holds nothing that locates a vehicle, or
            the files share no time.
    """
    vehicle, settings = vehicle or Vehicle(), settings or Settings()
    files = [paths] if isinstance(paths, str | PathLike) else list(paths)
    if not files and can is None:
        raise ReadError("drive: no file was given; at least one log or table was expected")
    parts = []
    recorded = [path for path in files if Path(path).is_dir()]
    files = [path for path in files if path not in recorded]
    for path in files:
        kind = format_of(path)
        drives = _read(path, kind, vehicle, settings, dbc, crs)
        parts.append(_Part(Path(path).name, kind, drives))
    if can is not None:
        parts.append(_Part(Path(can).name, "can", _read(can, "can", vehicle, settings, dbc, crs)))
    _check_used(parts, dbc, crs)
    parts = [_on_our_clock(part, vehicle) for part in parts]
    for path in recorded:
        parts += _recording(Path(path), vehicle, settings)
    drives = _merge(parts, vehicle)
    if not any(_holds_anything(drive) for drive in drives):
        reasons = ", ".join(f"{n} {why}" for d in drives for why, n in d.skipped.items())
        names = ", ".join(part.name for part in parts)
        raise ReadError(
            f"{names}: neither a fix nor odometry ({reasons or 'nothing was skipped'}); "
            "at least one was expected"
        )
    return drives


def _check_used(parts: list[_Part], dbc: AnyPath | None, crs: Any) -> None:
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
    if crs is not None and "table" not in kinds:
        raise SettingError(
            f"crs (--crs) is {crs}, and {names} is no table; a table with columns x, y was "
            "expected with it; leave it out"
        )


def format_of(path: AnyPath) -> str:
    """The format of a drive's file: `nmea`, `table`, `gpx`, `pos` or `can`.

    Raises:
        ReadError: The file cannot be opened, is empty or like none of them.
    """
    try:
        with Path(path).open("rb") as file:
            head = file.read(_SNIFF)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ReadError(
            f"{path}: cannot be read ({reason}); a readable file was expected"
        ) from None
    where = Path(path).name
    if not head.strip():
        raise ReadError(f"{where}: the file is empty; a log or table was expected")
    suffix = Path(path).suffix.lower()
    if suffix in _SUFFIXES:
        return _SUFFIXES[suffix]
    kind = next((kind for kind, pattern in _CONTENTS if pattern.search(head)), None)
    strange = next(((s, advice) for s, advice, p in _STRANGERS if p.search(head)), None)
    if kind is not None and not (kind == "table" and strange):
        return kind
    seen, advice = strange or ("a file of unknown format", "convert it")
    raise ReadError(
        f"{where}: {seen}; NMEA 0183, a drive table (CSV, Parquet, Arrow), GPX, RTKLIB .pos or a "
        f"CAN log was expected; {advice}"
    )


def _recording(folder: Path, vehicle: Vehicle, settings: Settings) -> list[_Part]:
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
        drives = read_table(file, vehicle=straight, settings=settings)
        drives = [replace(drive, drive_id=folder.name) for drive in drives]
        parts.append(_Part(f"{folder.name}/{file.name}", "table", drives))
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


def _read(
    path: AnyPath,
    kind: str,
    vehicle: Vehicle,
    settings: Settings,
    dbc: AnyPath | None,
    crs: Any,
) -> list[Drive]:
    if kind == "nmea":
        return [read_nmea(path, settings)]
    if kind == "gpx":
        return read_gpx(path, settings)
    if kind == "pos":
        return [read_pos(path, settings)]
    if kind == "can":
        return [read_can(path, dbc, vehicle)]
    return read_table(path, vehicle=vehicle, settings=settings, crs=crs)


def _holds_anything(drive: Drive) -> bool:
    return bool(drive.fixes is not None and len(drive.fixes)) or drive.odometry is not None


def _on_our_clock(part: _Part, vehicle: Vehicle) -> _Part:
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
            odometry = replace(odometry, time=odometry.time + for_odometry)
        drives.append(replace(drive, fixes=fixes, odometry=odometry))
    return part._replace(drives=drives)


def _merge(parts: list[_Part], vehicle: Vehicle) -> list[Drive]:
    """Drives of several files: all one, or matched by their ids."""
    if all(len(part.drives) == 1 for part in parts):
        return [_one([part.drives[0] for part in parts], vehicle)]
    by_drive: dict[str, list[Drive]] = {}
    for part in parts:
        for drive in part.drives:
            by_drive.setdefault(drive.drive_id, []).append(drive)
    if len(parts) > 1 and all(len(drives) == 1 for drives in by_drive.values()):
        counts = ", ".join(f"{part.name}: {len(part.drives)}" for part in parts)
        raise ReadError(
            f"files of several drives ({counts}) share no drive_id; one drive per file, or a "
            "column drive_id in each, was expected"
        )
    return [_one(drives, vehicle) for drives in by_drive.values()]


def _one(drives: list[Drive], vehicle: Vehicle) -> Drive:
    """One drive out of its files."""
    if len(drives) == 1:
        return drives[0]
    skipped: Skipped = Counter()
    for drive in drives:
        skipped.update(drive.skipped)
    notes = [note for drive in drives for note in drive.notes]
    fixes = _join_fixes([d.fixes for d in drives if d.fixes is not None], skipped)
    odometry = _join_odometry(
        [d.odometry for d in drives if d.odometry is not None], vehicle, skipped, notes
    )
    _same_clock(drives[0].drive_id, fixes, odometry)
    return Drive(
        drive_id=drives[0].drive_id,
        fixes=fixes,
        odometry=odometry,
        sources=tuple(source for drive in drives for source in drive.sources),
        skipped=dict(skipped),
        notes=tuple(dict.fromkeys(notes)),
    )


def _same_clock(name: str, fixes: Fixes | None, odometry: OdometryLog | None) -> None:
    if fixes is None or odometry is None or not len(fixes) or not len(odometry.time):
        return
    a, b = fixes.time, odometry.time
    if max(b[0] - a[-1], a[0] - b[-1]) > _APART:
        raise ReadError(
            f"{name}: fixes from {a[0]:.1f} to {a[-1]:.1f} s and odometry from {b[0]:.1f} to "
            f"{b[-1]:.1f} s share no time; one clock was expected; give the offset under [clock] "
            "in vehicle.toml"
        )


def _join_fixes(logs: list[Fixes], skipped: Skipped) -> Fixes | None:
    if len(logs) < 2:
        return logs[0] if logs else None
    logs = sorted(logs, key=lambda log: log.time[0] if len(log) else np.inf)
    columns = {
        f.name: np.concatenate([getattr(log, f.name) for log in logs]) for f in fields(Fixes)
    }
    rows = in_order(columns["time"], skipped)
    return Fixes(**{name: values[rows] for name, values in columns.items()})


def _join_odometry(
    logs: list[OdometryLog], vehicle: Vehicle, skipped: Skipped, notes: list[str]
) -> OdometryLog | None:
    """Logs of the best kind, one behind the other; other kinds are left out and noted."""
    if len(logs) < 2:
        return logs[0] if logs else None
    kind = next(k for k in _PREFERRED if any(isinstance(log, k) for log in logs))
    others = sorted({type(log).__name__ for log in logs if not isinstance(log, kind)})
    if others:
        notes.append(f"{kind.__name__} used, {' and '.join(others)} left out")
    mine = sorted((log for log in logs if isinstance(log, kind)), key=lambda log: log.time[0])
    columns: dict[str, Any] = {
        f.name: np.concatenate([getattr(log, f.name) for log in mine]) for f in fields(kind)
    }
    if len(mine) > 1:
        rows = in_order(columns["time"], skipped)
        columns = {name: values[rows] for name, values in columns.items()}
        if kind is WheelCounts:
            for side in ("left", "right"):
                columns[side] = cumulative(
                    columns["time"],
                    columns[side],
                    bits=vehicle.counter_bits,
                    metres_per_tick=getattr(vehicle, f"metres_per_tick_{side}"),
                    skipped=skipped,
                )
    return kind(**columns)
