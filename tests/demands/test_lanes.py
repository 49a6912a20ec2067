"""Tags of lanes beside each other: a number on the map does not decide the road."""

import numpy as np
import pytest

import whichroad
from demands.town import along, fixes
from whichroad.simulate import MapBuilder

SPLIT, END = 600.0, 2100.0  # m


def map_of(lanes: tuple[int, int], apart: float) -> whichroad.RoadMap:
    """A common road, and two of it that run beside each other."""
    builder = MapBuilder()
    for name, x, y in (
        ("begin", 0.0, 0.0), ("node", SPLIT, 0.0), ("end", END, 0.0),
        ("merge", SPLIT + 5.0 * apart, -apart), ("side end", END, -apart),
    ):  # fmt: skip
        builder.node(name, x, y)
    for name, nodes, count in (
        ("Common", ("begin", "node"), max(lanes)),
        ("Main", ("node", "end"), lanes[0]),
        ("Side", ("node", "merge", "side end"), lanes[1]),
    ):
        builder.way(nodes, "primary", name=name, oneway="yes", lanes=str(count))
    return builder.compiled()


@pytest.mark.parametrize("lanes", [(3, 1), (2, 1), (1, 3)])
@pytest.mark.parametrize("seed", range(5))
def test_a_car_that_keeps_its_lane_is_never_surely_on_the_road_beside(lanes, seed):
    roads = map_of(lanes, 10.0)
    lane = 3.3 * (seed % lanes[0] - 0.5 * (lanes[0] - 1))
    line = [[0.0, lane], [END - 50.0, lane]]
    drive = fixes(line, speed=20.0, sigma=4.0, seed=seed)
    points = whichroad.match(drive, roads).points
    side = np.isin(np.array([n or "" for n in roads.column("name")]), ["Side"])
    behind = along(line, 20.0)[0] * 20.0 > SPLIT
    p = np.array(
        [sum(a["p"] for a in row if a["edge_id"] >= 0 and side[a["edge_id"]])
         for row in points.alternatives]
    )  # fmt: skip
    assert p[behind].max() < 0.999
    assert not side[points.edge_id.iloc[-1]]
