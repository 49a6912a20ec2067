"""A road map out of whatever names one."""

from pathlib import Path
from typing import Any

from ..errors import MapError
from .roadmap import RoadMap

# what is not among these is a compiled map, whatever it is called
_TABLES = (".geojson", ".json", ".csv", ".csv.gz", ".tsv", ".parquet", ".geoparquet", ".gpkg",
           ".shp", ".fgb", ".gml", ".zip")  # fmt: skip


def open_map(roads: Any) -> RoadMap:
    """A road map: itself, or of a compiled file, an OpenStreetMap extract or a table of edges.

    Raises:
        MapError: It is no map, nor the path of one.
    """
    if isinstance(roads, str | Path):
        name = str(roads).lower()
        if name.endswith((".pbf", ".osm", ".osm.gz", ".osm.bz2")):
            return RoadMap.from_osm(roads)
        if name.endswith(_TABLES):
            return RoadMap.from_edges(roads)
        return RoadMap.open(roads)
    if hasattr(roads, "arrays"):
        opened: RoadMap = roads
        return opened
    if hasattr(roads, "columns"):  # a table of pandas or Arrow
        return RoadMap.from_edges(roads)
    raise MapError(
        f"roads: {type(roads).__name__} was given; a RoadMap, the path of a map or a table of "
        "edges was expected; RoadMap.from_osm(path) makes one"
    )
