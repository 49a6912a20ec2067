"""Parts of many edges at once are the parts of each."""

import numpy as np
import pytest

from whichroad.geodesy.plane import Plane
from whichroad.roadmap import RoadMap


@pytest.fixture(scope="module")
def roads() -> RoadMap:
    import geopandas
    import shapely

    rng = np.random.default_rng(1)
    plane = Plane(49.4, 8.7)
    lines = []
    for i in range(12):
        steps = rng.normal([30.0, 0.0], 20.0, (rng.integers(1, 9), 2))
        xy = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
        xy[:, 1] += 400.0 * i
        lat, lon = plane.to_geodetic(*xy.T)
        lines.append(shapely.LineString(np.column_stack([lon, lat])))
    table = geopandas.GeoDataFrame({"id": np.arange(12)}, geometry=lines, crs="EPSG:4326")
    return RoadMap.from_edges(table)


def test_parts_of_edges_are_what_each_edge_gives(roads):
    rng = np.random.default_rng(2)
    edge = rng.integers(0, len(roads), 300)
    length = roads.arrays.edges.length[edge]
    start = np.where(rng.random(300) < 0.3, 0.0, rng.uniform(-0.2, 1.0, 300) * length)
    end = np.where(rng.random(300) < 0.3, length, start + rng.random(300) * (length - start))
    end[:20] = start[:20]  # parts of no length
    start[20:40], end[20:40] = length[20:40], length[20:40]  # at the end
    x, y, first = roads.edge_lines(edge, start, end)
    assert first[0] == 0
    assert first[-1] == len(x) == len(y)
    for i, e in enumerate(edge):
        line = roads.edge_line(int(e), start[i], end[i])
        got = np.column_stack([x, y])[first[i] : first[i + 1]]
        assert got == pytest.approx(line, abs=1e-6)


def test_no_parts_are_no_lines(roads):
    none = np.zeros(0)
    x, y, first = roads.edge_lines(none.astype(np.int64), none, none)
    assert (len(x), len(y), first.tolist()) == (0, 0, [0])


def test_an_edge_is_called_what_its_attributes_say(roads):
    assert [roads.name(e) for e in range(4)] == [roads.attributes(e)["name"] for e in range(4)]


def test_no_vertex_is_beyond_the_reach(roads):
    away = np.hypot(roads.arrays.vertices.x, roads.arrays.vertices.y)
    assert roads.reach == pytest.approx(away.max())
