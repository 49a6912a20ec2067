"""A road map out of whatever names one."""

from pathlib import Path
from typing import Any

from ..errors import MapError
from .graphs import is_graph
from .lines import NoSystem
from .osm import SUFFIXES
from .roadmap import RoadMap
from .store import is_compiled
from .sumo import is_net

# what is not among these, and no extract, is a compiled map, whatever it is called
_TABLES = (".geojson", ".geojsonl", ".geojsonseq", ".json", ".csv", ".csv.gz", ".tsv",
           ".parquet", ".geoparquet", ".gpkg", ".graphml", ".shp", ".fgb",
           ".gml", ".zip", ".net.xml")  # fmt: skip
_DRIVES = (".gpx", ".nmea", ".nma", ".pos", ".log", ".asc", ".blf", ".trc", ".mf4", ".dbc")


def open_map(roads: Any, *, crs: Any = None, check: bool | None = None) -> RoadMap:
    """A road map: itself, or of a compiled file, an OpenStreetMap extract or a table of edges.

    Args:
        roads: A `RoadMap`, the path of a map, or a table or graph of edges.
        crs: Coordinate system of a table in a plane that names none, such as that of the drive.
        check: Of a compiled file, as `RoadMap.open` takes it.

    Raises:
        MapError: It is no map, nor the path of one.
    """
    if isinstance(roads, str | Path):
        path, name = Path(roads), str(roads).lower()
        if path.is_dir():
            raise MapError(
                f"{path}: it is a folder; one map was expected; name one of its files "
                "(`whichroad fleet` and `match_many` take folders of compiled maps)"
            )
        if is_compiled(path):
            return RoadMap.open(path, check=check)
        if is_net(path):
            return _of_edges(path, crs)
        if name.endswith(SUFFIXES):
            return RoadMap.from_osm(roads)
        if name.endswith(_TABLES):
            return _of_edges(roads, crs)
        if path.is_file() and path.stat().st_size:
            raise MapError(_refusal(path))
        return RoadMap.open(path)
    if hasattr(roads, "arrays"):
        opened: RoadMap = roads
        return opened
    if hasattr(roads, "columns") or is_graph(roads):  # a table of pandas or Arrow, or OSMnx's
        return _of_edges(roads, crs)
    raise MapError(
        f"roads: {type(roads).__name__} was given; a RoadMap, the path of a map or a table of "
        "edges was expected; RoadMap.from_osm(path) makes one"
    )


def left_out(path: str | Path, roads: RoadMap) -> dict[str, int]:
    """What was left out of a table of roads that was just read, by reason.

    Of a compiled map `map build` has said so, and of an extract it is what cars do not use.

    Args:
        path: Where the map was read.
        roads: What was read.
    """
    if is_compiled(Path(path)) or str(path).lower().endswith(SUFFIXES):
        return {}
    return dict(roads.info()["skipped"])


def _of_edges(table: Any, crs: Any) -> RoadMap:
    try:
        return RoadMap.from_edges(table)
    except NoSystem:
        if crs is None:
            raise
        return RoadMap.from_edges(table, crs)


def _refusal(path: Path) -> str:
    """What to say of a file that is no map."""
    drive = path.suffix.lower() in _DRIVES
    hint = "this seems to belong to a drive" if drive else "the suffix of the name says which it is"
    return (
        f"{path}: not a compiled map, and its suffix names no other kind; an OpenStreetMap extract "
        f"({', '.join(SUFFIXES)}) or a table of edges ({', '.join(_TABLES)}) was expected; {hint}"
    )
