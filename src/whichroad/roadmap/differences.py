"""What the edges of an old map are in a new one: by the source's ids, and by position."""

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..geodesy.angles import wrap

if TYPE_CHECKING:
    import pyarrow as pa

    from .roadmap import RoadMap

NEAR = 10.0  # m about the middle of an old edge, within which it is looked for
_ALIKE = 0.5  # rad between headings of what may be the same edge
SAME, OTHER_SOURCE, GONE = "same source", "other source", "gone"


class Difference(NamedTuple):
    """What an old edge is now."""

    old_edge: int
    new_edge: int | None
    found: str  # same source, other source (by position alone), gone
    distance_m: float | None  # of the middle of the old edge from the new one


def differences(old: "RoadMap", new: "RoadMap") -> "pa.Table":
    """Each edge of an old map, and the edge of a new one that lies where its middle lay.

    Of the edges within 10 m that run the same way, those of the same road of the source come
    first, then the nearest.  An old edge may be a part of a new one, or have become several.

    Args:
        old: The map that results were matched on.
        new: Another of the same region.

    Returns:
        A row for each edge of the old map, with the fields of `Difference`.
    """
    import pyarrow as pa

    edges = np.arange(len(old))
    middle = old.arrays.edges.length / 2.0
    places = [old.at(int(edge), float(s)) for edge, s in zip(edges, middle, strict=True)]
    x, y, heading = (np.array(column) for column in zip(*places, strict=True))
    lat, lon, bearing = old.plane.pose(x, y, heading)
    there_x, there_y = new.plane.from_geodetic(lat, lon)
    there_heading = new.plane.heading(bearing, there_x, there_y)
    sources = list(zip(*old.sources(edges, middle), strict=True))
    rows = [
        _row(new, int(edge), (float(there_x[edge]), float(there_y[edge])),
             float(there_heading[edge]), sources[edge])
        for edge in edges
    ]  # fmt: skip
    kinds = [pa.int64(), pa.int64(), pa.string(), pa.float64()]
    schema = pa.schema(list(zip(Difference._fields, kinds, strict=True)))
    return pa.Table.from_pylist([row._asdict() for row in rows], schema=schema)


def _row(
    new: "RoadMap", edge: int, place: tuple[float, float], heading: float,
    source: tuple[int | str, bool],
) -> Difference:  # fmt: skip
    """What one edge is now."""
    near = new.near(*place, NEAR)
    nearest = None
    for one, s, away in zip(
        near.edge.tolist(), near.s.tolist(), near.distance.tolist(), strict=True
    ):
        if abs(wrap(new.at(one, s)[2] - heading)) > _ALIKE:
            continue
        if new.source(one, s) == source:
            return Difference(edge, one, SAME, away)
        nearest = nearest or Difference(edge, one, OTHER_SOURCE, away)
    return nearest or Difference(edge, None, GONE, None)


def counts(table: "pa.Table") -> Counter[str]:
    """How many edges kept their number, have another, or are gone."""
    found: Counter[str] = Counter()
    for row in table.to_pylist():
        kept = row["found"] == SAME and row["old_edge"] == row["new_edge"]
        found["same number" if kept else row["found"]] += 1
    return found
