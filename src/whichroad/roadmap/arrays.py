"""A map as JSON and named arrays, and back: what a compiled map holds."""

from typing import TYPE_CHECKING, Any

from ..geodesy.plane import Plane
from ..graph.network import Roads
from .compile import plane_record
from .laid_out import Pieces
from .store import Arrays
from .streets import Column, Texts

if TYPE_CHECKING:
    from .roadmap import RoadMap

_TABLES = [name for name in Roads._fields if name != "plane"]
_TEXTS = ("code", "offset", "utf8")


def to_arrays(roads: "RoadMap") -> tuple[dict[str, Any], Arrays]:
    """A map as JSON and named arrays."""
    arrays: Arrays = {f"roads.{n}": getattr(roads.arrays, n) for n in _TABLES}
    arrays |= {f"pieces.{n}": getattr(roads.pieces, n) for n in Pieces._fields}
    arrays["way"] = roads.way
    for name, column in {"node_id": roads.node_id, **roads.ways}.items():
        if isinstance(column, Texts):
            arrays |= {f"{name}.{part}": getattr(column, part) for part in _TEXTS}
        else:
            arrays[name] = column
    about = {
        "about": roads._about,
        "origin_deg": [roads.plane.lat0_deg, roads.plane.lon0_deg],
        "cell_size": float(roads.arrays.plane.cell_size[0]),
        "columns": list(roads.ways),
    }
    return about, arrays


def from_arrays(about: dict[str, Any], arrays: Arrays) -> tuple[Any, ...]:
    """What `RoadMap` is made of, from JSON and named arrays.

    Raises:
        KeyError: An array is missing.
        MapError: The plane's origin is none.
    """
    plane = Plane(*about["origin_deg"])
    roads = Roads(
        **{n: arrays[f"roads.{n}"] for n in _TABLES},
        plane=plane_record(plane.curvature, float(about["cell_size"])),
    )
    pieces = Pieces(*(arrays[f"pieces.{n}"] for n in Pieces._fields))
    columns: dict[str, Column] = {}
    for name in ("node_id", *about["columns"]):
        columns[name] = (
            arrays[name] if name in arrays else Texts(*(arrays[f"{name}.{p}"] for p in _TEXTS))
        )
    node_id = columns.pop("node_id")
    return roads, plane, pieces, arrays["way"], node_id, columns, about["about"]
