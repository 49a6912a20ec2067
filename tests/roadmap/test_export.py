"""A path by the roads of the source: nothing is lost, nothing is told twice."""

import geopandas
import numpy as np
import pyarrow as pa
import pytest

from whichroad.batch import match_many
from whichroad.errors import MapError
from whichroad.roadmap import RoadMap

TIME = pa.timestamp("us", tz="UTC")


@pytest.fixture
def roads(line):
    """A street of three rows without a junction between, the middle one drawn westward."""
    return RoadMap.from_edges(
        geopandas.GeoDataFrame(
            {"id": [10, 11, 12, 20, 21]},
            geometry=[
                line((0, 0), (100, 0)),
                line((180, 0), (100, 0)),
                line((180, 0), (200, 0)),
                line((200, 0), (200, 90)),
                line((200, 0), (200, -90)),
            ],
            crs="EPSG:4326",
        )
    )


def eastward(roads) -> int:
    """The edge of all three rows, driven east."""
    [edge] = [
        e for e in range(len(roads)) if roads.source(e, 1.0) == (10, True) and roads.way[e] >= 0
    ]
    return edge


def path_of(rows) -> pa.Table:
    """A path table of (edge, seconds in, seconds out, from, to)."""
    edge, begin, end, enter, leave = zip(*rows, strict=True) if rows else ([], [], [], [], [])
    return pa.table(
        {
            "drive_id": pa.array(["d"] * len(edge), pa.string()),
            "seq": pa.array(range(len(edge)), pa.int64()),
            "edge_id": pa.array(edge, pa.int64()),
            "source_id": pa.array(["?"] * len(edge), pa.string()),
            "from_node": pa.array([0] * len(edge), pa.int64()),
            "to_node": pa.array([0] * len(edge), pa.int64()),
            "forward": pa.array([True] * len(edge), pa.bool_()),
            "enter_time": pa.array([int(1e6 * t) for t in begin], TIME),
            "exit_time": pa.array([int(1e6 * t) for t in end], TIME),
            "enter_m": pa.array(enter, pa.float64()),
            "exit_m": pa.array(leave, pa.float64()),
            "mean_speed_mps": pa.array([0.0] * len(edge), pa.float64()),
        }
    )


def test_an_edge_of_several_source_roads_is_one_row_for_each_with_its_share_of_time(roads):
    got = roads.by_source(path_of([(eastward(roads), 0.0, 20.0, 0.0, 200.0)]))
    assert got["source_id"].to_pylist() == ["10", "11", "12"]
    assert got["forward"].to_pylist() == [True, False, True]
    assert got["seq"].to_pylist() == [0, 0, 0]
    np.testing.assert_allclose(got["enter_m"], [0.0, 100.0, 180.0], atol=0.5)
    seconds = [t.timestamp() for t in got["enter_time"].to_pylist()]
    np.testing.assert_allclose(seconds, [0.0, 10.0, 18.0], atol=0.05)
    assert got["exit_time"].to_pylist()[:-1] == got["enter_time"].to_pylist()[1:]
    np.testing.assert_allclose(got["mean_speed_mps"], 10.0, rtol=0.01)
    assert not {"from_node", "to_node"} & set(got.column_names)


def test_each_source_road_has_its_own_range_from_its_own_start(roads):
    got = roads.by_source(path_of([(eastward(roads), 0.0, 20.0, 20.0, 190.0)]))
    np.testing.assert_allclose(got["source_enter_m"], [20.0, 80.0, 0.0], atol=0.5)
    np.testing.assert_allclose(got["source_exit_m"], [100.0, 0.0, 10.0], atol=0.5)
    np.testing.assert_allclose(got["source_enter_share"], [0.2, 1.0, 0.0], atol=0.01)
    np.testing.assert_allclose(got["source_exit_share"], [1.0, 0.0, 0.5], atol=0.03)


def test_a_stretch_of_an_edge_has_the_source_roads_of_that_stretch_alone(roads):
    edge = eastward(roads)
    rows = [
        (edge, 0.0, 5.0, 120.0, 190.0),
        (edge, 5.0, 9.0, 20.0, 60.0),
        (edge, 9.0, 9.0, 150, 150),
    ]
    got = roads.by_source(path_of(rows))
    assert got["source_id"].to_pylist() == ["11", "12", "10", "11"]
    assert got["seq"].to_pylist() == [0, 0, 1, 2]
    np.testing.assert_allclose(got["exit_m"], [180.0, 190.0, 60.0, 150.0], atol=0.5)


def test_metres_and_seconds_of_a_path_are_those_of_its_source_roads(roads):
    edge = eastward(roads)
    path = path_of(
        [(edge, 0.0, 9.0, 3.0, 191.0), (int(roads.arrays.edges.opposite[edge]), 9, 30, 0, 200)]
    )
    got = roads.by_source(path).to_pandas()
    whole = path.to_pandas()
    metres = (got.exit_m - got.enter_m).groupby(got.seq).sum()
    np.testing.assert_allclose(metres, whole.exit_m - whole.enter_m, atol=1e-9)
    seconds = (got.exit_time - got.enter_time).groupby(got.seq).sum()
    np.testing.assert_array_equal(seconds, whole.exit_time - whole.enter_time)


def test_a_frame_in_is_a_frame_with_lines_out(roads):
    frame = path_of([(eastward(roads), 0.0, 20.0, 0.0, 200.0)]).to_pandas()
    got = roads.by_source(frame)
    assert got.crs == "EPSG:4326"
    assert [len(line.coords) for line in got.geometry] == [2, 2, 2]
    assert got.geometry.iloc[0].coords[-1] == got.geometry.iloc[1].coords[0]


def test_the_path_of_an_answer_stays_one_that_geopandas_takes(roads):
    lat, lon = roads.plane.to_geodetic(
        *np.array([roads.at(eastward(roads), s)[:2] for s in (5, 195)]).T
    )
    trip = {"drive_id": ["a", "a"], "time": [0.0, 15.0], "lat": lat, "lon": lon}
    path = match_many(trip, roads).path
    assert geopandas.GeoDataFrame.from_arrow(path).crs == "EPSG:4326"
    ways = geopandas.GeoDataFrame.from_arrow(roads.by_source(path))
    assert ways.source_id.tolist() == ["10", "11", "12"]
    degrees = ways.geometry.iloc[1].length
    assert degrees * 72_500 == pytest.approx(80.0, rel=0.01)  # m, along a parallel


def test_an_empty_path_stays_empty(roads):
    assert roads.by_source(path_of([])).num_rows == 0


def test_what_is_no_path_or_of_another_map_is_refused(roads):
    with pytest.raises(MapError, match=r"no column 'enter_time'.*match_many was expected"):
        roads.by_source(pa.table({"edge_id": [1]}))
    with pytest.raises(MapError, match=r"beyond the \d+ of this map"):
        roads.by_source(path_of([(10_000, 0.0, 1.0, 0.0, 1.0)]))
