"""An attribute of the road at every epoch: its values, each with its probability."""

from typing import TYPE_CHECKING

import pyarrow as pa

from ..roadmap.attribute_names import known_name
from ..roadmap.attribute_shares import shares_by_value

if TYPE_CHECKING:
    from ..roadmap import RoadMap


def attribute_table(points: pa.Table, roads: "RoadMap", name: str) -> pa.Table:
    """Values and their probabilities; see `Result.attribute`.

    Args:
        points: Columns of `tables.schema.POINTS`.
        roads: The map that they are of.
        name: Of the attribute.

    Returns:
        Columns `drive_id, time, value, p`.
    """
    column = known_name(roads.ways, name)
    names = ("edge_id", "abscissa_m", "alternatives")
    rows, values, shares = [], [], []
    for k, (edge, s, roads_there) in enumerate(
        zip(*(points.column(n).to_pylist() for n in names), strict=True)
    ):
        places = (
            (road["edge_id"], s if road["edge_id"] == edge else None, road["p"])
            for road in roads_there
        )
        for value, p in shares_by_value(roads, column, places):
            rows.append(k)
            values.append(value)
            shares.append(p)
    at = pa.array(rows, pa.int64())
    columns = {name: points.column(name).take(at) for name in ("drive_id", "time")}
    return pa.table(columns | {"value": pa.array(values), "p": pa.array(shares, pa.float64())})
