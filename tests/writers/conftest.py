"""A points table and a path table, small and with everything absent once."""

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from whichroad.tables import schema


def _row(**values: Any) -> dict[str, Any]:
    return {name: values.get(name) for name in schema.POINTS.names}


@pytest.fixture
def points() -> pa.Table:
    """Two positions and an epoch before the first fix, which has none."""
    first = _row(
        drive_id="a <b> & c",
        time=0,
        lat=49.41,
        lon=8.68,
        bearing_deg=359.5,
        edge_id=7,
        source_id="4711",
        forward=True,
        p_road=0.8,
        p_way=0.9,
        p_off_road=0.05,
        status="ambiguous",
        reason="two roads",
        alternatives=[{"edge_id": 7, "p": 0.8}, {"edge_id": 9, "p": 0.15}],
    )
    second = _row(
        drive_id="a <b> & c", time=100_000, lat=49.42, lon=8.69, status="off_road", alternatives=[]
    )
    third = _row(drive_id="a <b> & c", time=200_000, status="lost")
    return pa.Table.from_pylist([first, second, third], schema=schema.POINTS)


@pytest.fixture
def path() -> pa.Table:
    """Two edges that share a node."""
    lon, lat = np.array([8.0, 8.1, 8.1, 8.2, 8.3]), np.array([49.0, 49.1, 49.1, 49.2, 49.3])
    rows = [
        {"drive_id": "a", "seq": 0, "edge_id": 7, "from_node": 1, "to_node": 2, "forward": True}
        | {"enter_time": 0, "exit_time": 1_500_000, "enter_m": 12.5, "exit_m": 80.0, "p": 0.99},
        {"drive_id": "a", "seq": 1, "edge_id": 9, "from_node": 2, "to_node": 3, "forward": False}
        | {"enter_time": 1_500_000, "exit_time": 3_000_000, "broken_rule": "against one-way"},
    ]
    wkb = schema.line_wkb(lon, lat, np.array([0, 2, 5])).to_pylist()
    rows = [
        {name: (row | {"geometry": shape}).get(name) for name in schema.PATH.names}
        for row, shape in zip(rows, wkb, strict=True)
    ]
    return pa.Table.from_pylist(rows, schema=schema.PATH)
