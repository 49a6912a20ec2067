"""Tables with one row for each trip: what is said so that each fix gets a row."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..errors import ReadError
from .names import Column

if TYPE_CHECKING:
    import pyarrow as pa

_BY_GEOPANDAS = "get_coordinates(include_m=True) of geopandas, which repeats the rows' index"
LINES = (
    "lines, one for each row; one row for each fix, with its time, was expected; make them by "
    f"{_BY_GEOPANDAS}"
)
# columns that may hold all places of a trip, in lower case
_ALL_PLACES = frozenset({
    "polyline", "points", "fixes", "positions", "coordinates", "coords", "path", "route",
    "trajectory", "waypoints", "locations",
})  # fmt: skip
_A_LINE = frozenset({"linestring", "geometry", "geom", "wkt", "wkb"})  # or a point


def refuse_lists(table: "pa.Table", found: Mapping[str, Column], where: str) -> None:
    """Refuse a table whose rows have lists of places or times.

    Raises:
        ReadError: One of them has.
    """
    lists = [
        found[what].name for what in ("time", "lat", "lon")
        if what in found and _is_list(table.schema.field(found[what].place).type)
    ]  # fmt: skip
    if lists:
        raise ReadError(
            f"{where}: column {lists[0]!r} holds lists, one for each row; one row for each fix was "
            f"expected; make them, as by .explode({lists}) of pandas or polars"
        )


def _is_list(kind: "pa.DataType") -> bool:
    import pyarrow as pa

    return bool(
        pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    )


def said_of(names: list[str]) -> str:
    """What to do where a column may hold all places of a trip; empty where none may."""
    for name in names:
        if name.lower() in _A_LINE:
            return f"if {name!r} holds lines, each of their points needs a row: {_BY_GEOPANDAS}; "
        if name.lower() in _ALL_PLACES:
            return (
                f"if {name!r} holds all places of a trip, each of them needs a row: "
                f".explode({name!r}) of pandas or polars, before it json.loads of texts, behind it "
                f".unnest({name!r}) of structs; "
            )
    return ""
