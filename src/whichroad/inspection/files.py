"""Files of any kind: what each holds, and the command that would match them."""

import re
import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import ReadError, WhichroadError
from ..observations import Drive
from ..readers import read_drive, read_vehicle
from ..readers.dates import Writing
from ..readers.drives import IN_A_CRS
from ..readers.folders import answer_in, is_recording, sorted_out
from ..readers.formats import format_of
from ..readers.names import Seen
from ..readers.reading import Reading
from ..readers.ros import is_bag
from ..readers.source import Source
from ..readers.table_files import table_of
from ..roadmap import RoadMap, open_map
from ..roadmap.extent import fixes_outside, outside_note
from ..roadmap.lines import NoSystem
from ..roadmap.osm import SUFFIXES as EXTRACTS
from ..roadmap.store import is_compiled
from ..roadmap.sumo import SUFFIXES as NETS
from ..settings import Settings, Vehicle
from .of_drives import columns_section, drive_section
from .of_maps import map_section
from .section import Section

_FORMATS = {
    "nmea": "NMEA 0183", "table": "a table", "gpx": "GPX", "pos": "RTKLIB .pos", "can": "a CAN log",
    "kml": "KML", "json": "JSON", "geo": "a layer of points or lines",
    "gnss_logger": "a log of GnssLogger",
}  # fmt: skip
_EITHER = (".geojson", ".json", ".csv", ".csv.gz", ".tsv", ".parquet", ".geoparquet", ".gpkg",
           ".shp", ".fgb", ".gml", ".zip")  # a drive or a map  # fmt: skip
_LINES = frozenset(("geometry", "geom", "geom_wkt", "wkt", "the_geom", "wkb"))
_MOST = 4  # drives of a file that are described one by one


class Inspected(NamedTuple):
    """What was found in some files."""

    sections: list[Section]
    command: str  # that would match them, with words in capitals for what is missing
    understood: bool  # whether any file was


def inspect_files(
    files: Sequence[Path], *, can: Path | None = None, dbc: Path | None = None,
    vehicle: Path | None = None, settings: Settings | None = None, **reading: Any,
) -> Inspected:  # fmt: skip
    """Say what files hold, as `match` would understand them.

    A file that cannot be understood has a section that says why.

    Args:
        files: Logs and tables of drives and their folders, maps, answers, `vehicle.toml` and
            `.dbc`.
        can: A CAN log, also one whose name or content does not show that it is one.
        dbc: What its frames mean.
        vehicle: The car's `vehicle.toml`.
        settings: The model's numbers; those of sigmas that are not reported are said.
        reading: How tables are to be read, as `read_drive` takes it, such as `crs`.

    Raises:
        ReadError: There is no such zone or order of dates.
    """
    given = {name: value for name, value in reading.items() if value is not None}
    Writing.of(given.get("tz"), given.get("dates"))
    found = _Files(settings or Settings(), given)
    files = [*files, *(file for file in (can, dbc, vehicle) if file is not None)]
    first = [
        path for path in files if path in (dbc, vehicle) or path.suffix.lower() in (".toml", ".dbc")
    ]
    for path in (*first, *(path for path in files if path not in first)):
        found.take(path, about_car=path in (dbc, vehicle))
    found.take_together()
    found.compare()
    understood = any(
        (
            found.vehicle,
            found.dbc,
            found.map,
            found.planar,
            found.answer,
            found.left_out,
            found.read,
        )
    )
    return Inspected(found.sections, found.command(), understood)


class _Files:
    """The files by kind, as they are found out one by one."""

    def __init__(self, settings: Settings, reading: dict[str, Any]) -> None:
        self.settings, self.reading = settings, reading
        self.sections: list[Section] = []
        self.drives: list[Path] = []
        self.tables = False  # whether one of them is a table
        self.can: Path | None = None
        self.dbc: Path | None = None
        self.vehicle: tuple[Path, Vehicle] | None = None
        self.map: tuple[Path, RoadMap] | None = None
        self.planar: dict[str, Path] = {}  # drive and map that need a system, and have none
        self.answer: Path | None = None
        self.left_out = False  # whether one of them is a truth or a path
        self.read: list[Drive] = []
        self.alone = 0  # drives of single files
        self.noted: set[str] = set()

    def take(self, path: Path, *, about_car: bool = False) -> None:
        """Find out what a file is, and say what it holds or why it cannot be understood."""
        name = path.name.lower()
        try:
            if path.is_dir() and not is_recording(path) and not is_bag(path):
                self._take_folder(path)
            elif about_car or name.endswith((".toml", ".dbc")):
                self._take_car(path)
            elif name.endswith((*EXTRACTS, *NETS, ".graphml")) or is_compiled(path):
                self._take_map(path)
            elif name.endswith(_EITHER):
                self._take_either(path)
            else:
                self._take_drive(path)
        except WhichroadError as error:
            self.sections.append(Section(str(path), [], (f"error: {error}",)))

    def _take_car(self, path: Path) -> None:
        if path.suffix.lower() == ".toml":
            self.vehicle = path, read_vehicle(path)
            title = "a vehicle"
        elif path.is_file():
            self.dbc, title = path, "what CAN signals mean"
        else:
            raise ReadError(f"{path}: the file does not exist; a .dbc was expected; check the name")
        self.sections.append(Section(f"{path}: {title}", []))

    def _take_folder(self, path: Path) -> None:
        """A folder of a drive: what is read, what describes the car, what is left out."""
        inside = sorted_out([one for one in path.iterdir() if one.is_file()], self.dbc)
        with_can = any(format_of(one) == "can" for one in inside.files)
        drives = read_drive(
            [path], vehicle=self.car, dbc=self.dbc if with_can else None,
            settings=self.settings, skip_unreadable=True, **self.reading,
        )  # fmt: skip
        self.drives.append(path)
        files = ", ".join(one.name for one in inside.files)
        self.sections.append(Section(f"{path}: a folder of a drive", [("files", files)]))
        self._describe(drives)

    def _take_map(self, path: Path) -> None:
        try:
            roads = open_map(path, crs=self.reading.get("crs"))
        except NoSystem:
            self.planar["map"] = path
            raise
        self.map = path, roads
        self.sections.append(map_section(str(path), roads))

    def _take_either(self, path: Path) -> None:
        """A table of a drive or of roads: what it looks like, else the other."""
        takes = [self._take_drive, self._take_map]
        try:
            takes[_looks_like_roads(path)](path)
        except WhichroadError as error:
            try:
                takes[not _looks_like_roads(path)](path)
            except WhichroadError:
                raise error from None

    def _take_drive(self, path: Path) -> None:
        kind = "recording" if path.is_dir() else format_of(path)
        seen = _seen(path, self.reading) if kind == "table" else None
        what = answer_in(path) if kind == "table" else None
        if seen is not None and what is not None and "p_road" not in seen.names:
            self.left_out = True
            title = f"{path}: {what}, and no part of a drive"
            self.sections.append(Section(title, [("columns", ", ".join(seen.names))]))
            return
        if seen is not None and "p_road" in seen.names:
            self.answer = path
            title = f"{path}: points that `whichroad match` wrote"
            self.sections.append(Section(title, [("columns", ", ".join(seen.names))]))
            return
        if seen is not None and _lacks_system(seen, self.reading):
            self.planar["drive"] = path
        drives = read_drive(
            [path], vehicle=self.car, dbc=self.dbc if kind == "can" else None,
            settings=self.settings, **(self.reading if kind in IN_A_CRS else {}),
        )  # fmt: skip
        title = _FORMATS.get(kind, "a recording of `whichroad live`")
        self.sections.append(Section(f"{path}: {title}", []))
        if kind == "can":
            self.can = path
        else:
            self.drives.append(path)
        self.tables |= kind in IN_A_CRS
        if seen is not None:
            self.sections.append(columns_section(path.name, seen))
        self._describe(drives)

    def take_together(self) -> None:
        """Say what the files of a drive are together."""
        if len(self.drives) + (self.can is not None) < 2:
            return
        try:
            drives = read_drive(
                self.drives, vehicle=self.car, can=self.can, dbc=self.dbc if self.can else None,
                settings=self.settings, **(self.reading if self.tables else {}),
            )  # fmt: skip
        except WhichroadError as error:
            self.sections.append(Section("all files together", [], (f"error: {error}",)))
            return
        if len(drives) == self.alone:  # each was described
            notes = dict.fromkeys(
                note for d in drives for note in d.notes if note not in self.noted
            )
            said = tuple(f"note: {note}" for note in notes)
            self.sections.append(Section(f"all files together: {len(drives):,} drives", [], said))
            self.read = drives
            return
        self.sections.append(Section("all files together", [("drives", f"{len(drives):,}")]))
        self._describe(drives)

    @property
    def car(self) -> Vehicle | None:
        """The car, if one was among the files."""
        return None if self.vehicle is None else self.vehicle[1]

    def _describe(self, drives: list[Drive]) -> None:
        self.read, self.alone = drives, self.alone + len(drives)
        self.noted |= {note for drive in drives for note in drive.notes}
        self.sections += [drive_section(drive, self.settings) for drive in drives[:_MOST]]
        if len(drives) > _MOST:
            self.sections.append(Section(f"and {len(drives) - _MOST:,} more drives", []))

    def compare(self) -> None:
        """Say whether the drives lie on the map; one that holds none of them is forgotten."""
        if self.map is None:
            return
        path, roads = self.map
        for drive in self.read[:_MOST]:
            fixes = drive.fixes
            if fixes is None or not len(fixes):
                continue
            said = "all fixes lie on the map"
            try:
                outside = fixes_outside(drive.drive_id, fixes.lat_deg, fixes.lon_deg, roads)
                if outside:
                    said = f"note: {outside_note(outside, len(fixes))}"
            except WhichroadError as error:
                said, self.map = f"error: {error}", None
            self.sections.append(Section(f"drive {drive.drive_id} on {path}", [], (said,)))

    def command(self) -> str:
        """The command that would match the files, or show the answer that one of them is."""
        roads = str(self.map[0] if self.map else self.planar.get("map", "MAP"))
        if self.answer is not None and not self.drives:
            crs = self.reading.get("crs", "CRS" if self.planar else None)
            parts = ["whichroad", "report", str(self.answer), "--map", roads]
            parts += [] if crs is None else ["--crs", str(crs)]
            return shlex.join([*parts, "-o", "report.html"])
        drives = self.drives or [self.planar.get("drive", Path("DRIVE"))]
        parts = ["whichroad", "match", *map(str, drives)]
        options: dict[str, Any] = {"--map": roads}
        if self.can:
            options |= {"--can": self.can, "--dbc": self.dbc or "DBC"}
        if self.vehicle:
            options["--vehicle"] = self.vehicle[0]
        options |= {f"--{name}": _option(value) for name, value in self.reading.items()}
        if self.planar:
            options.setdefault("--crs", "CRS")
        options |= {"-o": "points.parquet", "--path-out": "path.parquet"}
        return shlex.join([*parts, *(str(word) for item in options.items() for word in item)])


def _option(value: Any) -> str:
    """A value as the command line takes it."""
    if isinstance(value, dict):
        return ",".join(f"{name}={column}" for name, column in value.items())
    return str(value)


def _lacks_system(seen: Seen, reading: dict[str, Any]) -> bool:
    """Whether the only places of a table are in a plane that nobody named."""
    found = seen.found.keys()
    places = {"lat", "lon"} <= found or "geometry" in found
    return {"x", "y"} <= found and not places and "crs" not in reading


def _seen(path: Path, reading: dict[str, Any]) -> Seen:
    """The columns of a table, and what they are."""
    return table_of(Source.of(path), Counter(), Reading.of(**reading))


def _first_names(path: Path) -> set[str]:
    """What may be the names of the columns of a text."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            line = file.readline(1 << 16)
    except OSError:
        return set()
    return {word.strip(' "\n').lower() for word in re.split(r"[,;\t|]", line)}


def _looks_like_roads(path: Path) -> bool:
    """Whether a table seems to be one of roads: its geometries are lines, and it has no times."""
    name = path.name.lower()
    if name.endswith((".csv", ".tsv", ".parquet", ".geoparquet")):
        try:
            seen = _seen(path, {})
        except WhichroadError:  # none of its columns is one of a drive
            return name.endswith((".csv", ".tsv")) and bool(_first_names(path) & _LINES)
        return bool({name.lower() for name in seen.names} & _LINES) and "time" not in seen.found
    if not name.endswith((".geojson", ".json")):
        return True
    try:
        with path.open("rb") as file:
            head = file.read(1 << 16)
    except OSError:
        return False
    # one line, or lines with times, are tracks
    return head.count(b"LineString") > 1 and b'"time' not in head.lower()
