"""Folders of drives: which files are the drive, which describe the car, which are left out."""

import glob
import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import ReadError
from ..observations import Drive
from ..settings import Vehicle
from .checks import listed
from .combining import Part, has_fixes
from .formats import format_of
from .source import STDIN, is_file, is_file_object
from .vehicle import read_vehicle

VEHICLE = "vehicle.toml"  # name of a car's description in the folder of its drives
READINGS = "readings.arrow"  # of further sensors, in a recording of `whichroad live`
ABOUT = "recording.json"  # what it tells of itself
_DBC = ".dbc"
_TABLES = (".parquet", ".geoparquet", ".pq", ".arrow", ".feather", ".csv")
_SUMMARY = "summary.json"  # of `whichroad demo`
_HEAD = 1 << 16  # bytes of a table in text within which its line of names ends
_ANSWERS = (  # columns that show what a table is, and what it is
    (frozenset(("travelled_m", "outage")), "the truth of a simulated drive"),
    (frozenset(("p_road", "status")), "points of `whichroad match`"),
    (frozenset(("broken_rule", "enter_time")), "a path of `whichroad match`"),
)
_OVERLAP = 5.0  # s, by which logs of consecutive drives may overlap


class Folder(NamedTuple):
    """What the files of one folder are to a drive."""

    files: list[Path]  # the drive's
    vehicle: Path | None  # what describes the car
    dbc: Path | None  # what describes its CAN signals
    left_out: list[tuple[str, str]]  # names of other files, and what each is ("": not known)

    def notes(self, folder: str, vehicle: Vehicle | None) -> list[str]:
        """What was used and what was left out, a sentence each.

        Args:
            folder: Its name.
            vehicle: The car that the drive is read with.
        """
        said = []
        used = [self.dbc.name] if self.dbc and any(map(_is_can, self.files)) else []
        if self.vehicle is not None:
            if read_vehicle(self.vehicle) == vehicle:
                used.insert(0, self.vehicle.name)
            else:
                said.append(f"{folder}: {self.vehicle.name} is not used; another vehicle was given")
        if used:
            said.insert(0, f"{folder}: {' and '.join(used)} of this folder used")
        said += [f"{folder}: {name} left out: {what}" for name, what in self.left_out if what]
        others = [name for name, what in self.left_out if not what]
        return said + ([f"{folder}: not read: {listed(others, 5)}"] if others else [])


def answer_in(path: Path) -> str | None:
    """What a table is that holds an answer or a truth rather than a drive; None: neither."""
    if path.suffix.lower() not in _TABLES:
        return None
    names = _names(path)
    return next((what for columns, what in _ANSWERS if columns <= names), None)


def _names(path: Path) -> frozenset[str]:
    """The columns of a table, without its rows; none where it cannot be read."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from ..tables.schema import read_arrow

    try:
        match path.suffix.lower():
            case ".csv":
                with path.open("rb") as file:
                    line = file.readline(_HEAD).decode("utf-8", "replace")
                return frozenset(cell.strip(' "\r\n') for cell in line.split(","))
            case ".arrow" | ".feather":
                return frozenset(read_arrow(path.read_bytes())[0].column_names)
            case _:
                return frozenset(pq.read_schema(path).names)
    except (pa.ArrowException, OSError, ValueError, KeyError):
        return frozenset()


def sorted_out(paths: Sequence[Path], dbc: Any = None, can: Any = None) -> Folder:
    """What each of some files is to the drive that they are of.

    Args:
        paths: All files of one folder.
        dbc: That of the caller, where there is one; else one among the files serves.
        can: A CAN log that the caller names, which is read already.
    """
    cars = [path for path in paths if path.name.lower() == VEHICLE]
    bases = [path for path in paths if path.suffix.lower() == _DBC]
    base = bases[0] if len(bases) == 1 else None
    files, left_out = [], [(path.name, "") for path in bases if base is None or dbc is not None]
    if dbc is not None:
        base = None
    for path in sorted(set(paths) - set(cars) - set(bases)):
        kind = _format(path)
        if can is not None and path.resolve() == Path(can).resolve():
            continue
        if kind is None:
            left_out.append((path.name, ""))
        elif kind == "can" and base is None and dbc is None:
            why = "several .dbc are there" if bases else "no .dbc is there"
            left_out.append((path.name, f"a CAN log, and {why}; name one by dbc= (--dbc FILE)"))
        elif (what := answer_in(path)) is not None:
            left_out.append((path.name, what))
        elif path.name == _SUMMARY:
            left_out.append((path.name, ""))
        else:
            files.append(path)
    return Folder(files, cars[0] if cars else None, base, left_out)


def _format(path: Path) -> str | None:
    try:
        return format_of(path)
    except ReadError:
        return None


def _is_can(path: Path) -> bool:
    return _format(path) == "can"


def described_folders(given: Sequence[Any]) -> dict[Path, list[Any]]:
    """Files given with the .dbc or the vehicle.toml beside them, as a shell's `drive/*` gives.

    Args:
        given: What `read_drive` takes as paths.

    Returns:
        The folders of such a file, and all files that were given of each.
    """
    folders: dict[Path, list[Any]] = {}
    for one in given:
        if not is_file_object(one) and str(one) != STDIN and Path(one).is_file():
            folders.setdefault(Path(one).parent, []).append(Path(one))
    return {
        folder: paths for folder, paths in folders.items()
        if any(path.suffix.lower() == _DBC or path.name.lower() == VEHICLE for path in paths)
    }  # fmt: skip


def is_recording(folder: Path) -> bool:
    """Whether `whichroad live --record` wrote this folder."""
    return any((folder / name).is_file() for name in ("fixes.arrow", "odometry.arrow"))


def is_geared(folder: Path) -> bool:
    """Whether a recording tells that its odometry has the sign of a gear."""
    try:
        return bool(json.loads((folder / ABOUT).read_bytes()).get("geared", False))
    except (OSError, ValueError, AttributeError):  # it is not there, torn, or something else
        return False


def vehicle_beside(given: Any) -> Vehicle | None:
    """The car that `vehicle.toml` in the folders of drives describes; None: there is none.

    Args:
        given: What `read_drive` takes as paths, or anything else.

    Raises:
        ReadError: Folders hold different cars, or a file is no description of one.
    """
    all_given = [given] if is_file(given) else given
    if not isinstance(all_given, list | tuple):
        return None
    named = [str(one) for one in all_given if is_file(one) and not is_file_object(one)]
    found = [path for one in named for path in (glob.glob(one) if glob.has_magic(one) else [one])]
    paths = [path for one in found for path in (Path(one), Path(one) / VEHICLE)]
    paths = [path for path in paths if path.name.lower() == VEHICLE and str(path) != STDIN]
    cars = [(path, read_vehicle(path)) for path in dict.fromkeys(paths) if path.is_file()]
    for path, car in cars[1:]:
        if car != cars[0][1]:
            raise ReadError(
                f"{path}: another car than {cars[0][0]}; drives of one car were expected; give one "
                "file for all by vehicle= (--vehicle FILE)"
            )
    return cars[0][1] if cars else None


def by_folder(parts: Sequence[Part]) -> list[tuple[str, list[Part]]]:
    """Parts that are put together: those of folders that are drives of their own apart.

    A folder is a drive of its own if it holds fixes and odometry in separate files, and another
    such folder covers the same time.

    Returns:
        The folder's name and its parts; the name is empty for all other parts together.
    """
    placed = sorted((part for part in parts if part.folder), key=lambda part: part.folder)
    folders = {key: list(group) for key, group in groupby(placed, key=lambda part: part.folder)}
    spans = {key: span for key, group in folders.items() if (span := _span(group)) is not None}
    alone = {
        key for key, (begin, end) in spans.items()
        if any(key != other and begin < e - _OVERLAP and b < end - _OVERLAP
               for other, (b, e) in spans.items())
    }  # fmt: skip
    rest = [part for part in parts if part.folder not in alone]
    order = dict.fromkeys(part.folder for part in parts if part.folder in alone)
    found = [(Path(key).name, folders[key]) for key in order]
    return [*found, *([("", rest)] if rest else [])]


def _span(parts: Sequence[Part]) -> tuple[float, float] | None:
    """The time of odometry that has no fixes in its own file; None: no such, or no fixes."""
    drives = [drive for part in parts for drive in part.drives]
    logs = [d.odometry for d in drives if d.odometry is not None and not has_fixes(d)]
    logs = [log for log in logs if len(log.time)]
    if not logs or not any(map(has_fixes, drives)):
        return None
    return min(float(log.time[0]) for log in logs), max(float(log.time[-1]) for log in logs)


def named_by(folder: str, drives: Sequence[Drive], taken: set[str]) -> list[Drive]:
    """The drives of a folder under its name, where it holds one; with a number if it is taken."""
    named = []
    for drive in drives:
        stem = folder if len(drives) == 1 else drive.drive_id
        name, number = stem, 2
        while name in taken:
            name, number = f"{stem}-{number}", number + 1
        taken.add(name)
        named.append(replace(drive, drive_id=name))
    return named
