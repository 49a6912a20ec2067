"""Drives whose fixes are far apart: the way between them, and what is worth a look."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from whichroad import match
from whichroad.errors import ReadError
from whichroad.replay.drive_report import report_data
from whichroad.replay.driven_path import Route
from whichroad.replay.open_replay import Remaking
from whichroad.replay.points import read_points
from whichroad.replay.recorded_messages import RecordedMessages
from whichroad.replay.timeline import timeline
from whichroad.roadmap import RoadMap
from whichroad.tables.result import Result


@pytest.fixture(scope="module")
def sparse(remaking: Remaking) -> Result:
    """The paper's drive as a tracker saw it: a fix every fifteen seconds, no wheels."""
    fixes = remaking.drive.fixes
    assert fixes is not None
    rows = [0]
    for i in range(len(fixes)):
        if fixes.time[i] >= fixes.time[rows[-1]] + 15.0:
            rows.append(i)
    drive = {"time": fixes.time[rows], "lat": fixes.lat_deg[rows], "lon": fixes.lon_deg[rows]}
    return match(drive, remaking.roads, lag="full")


def away_from_roads(roads: RoadMap, lat: float, lon: float) -> float:
    """How far a place is from the nearest road, m."""
    x, y = roads.plane.from_geodetic(lat, lon)
    return float(roads.near(x, y, 500.0).distance[0])


def test_the_way_between_far_fixes_runs_along_the_roads(sparse: Result, roads: RoadMap):
    recorded = RecordedMessages(sparse, roads)
    ways = timeline(recorded)["ways"]
    assert len(ways) > 0.5 * len(recorded)
    assert max(away_from_roads(roads, *at) for way in ways.values() for at in way) < 0.5
    assert recorded.driven == pytest.approx(sparse.summary["path_m"], rel=1e-6)


def test_a_way_is_the_shape_of_its_edges_from_point_to_point(roads: RoadMap):
    edge = int(np.argmax(roads.arrays.edges.last_vertex - roads.arrays.edges.first_vertex))
    length = float(roads.arrays.edges.length[edge])
    once = np.ones(1)
    route = Route(np.array([edge]), 0.0 * once, 60.0 * once, 0.0 * once, length * once, [None])
    time, on = np.array([10.0, 50.0]), np.array([edge, edge])
    (way,) = route.between(time, on, np.array([0.2, 0.9]) * length, roads).values()
    line = roads.edge_line(edge, 0.2 * length, 0.9 * length)[1:-1]
    lat, lon = roads.plane.to_geodetic(line[:, 0], line[:, 1])
    assert np.allclose(way, np.column_stack([lat, lon]), atol=1e-6)
    assert route.between(np.array([10.0, 12.0]), on, time, roads) == {}  # near enough: straight


def test_a_route_that_breaks_off_is_drawn_straight_there(roads: RoadMap):
    length = roads.arrays.edges.length[:1].astype(float)
    route = Route(np.array([0]), np.zeros(1), np.ones(1), 0.0 * length, length, [None])
    nowhere = np.array([np.nan, np.nan])
    assert route.between(np.array([5.0, 50.0]), np.array([-2, -2]), nowhere, roads) == {}


def test_a_dense_drive_needs_no_ways(recorded: RecordedMessages):
    assert recorded.route is not None
    assert timeline(recorded)["ways"] == {}


def test_a_doubt_at_one_of_many_far_fixes_is_listed_for_as_long_as_it_held(
    sparse: Result, roads: RoadMap
):
    recorded = RecordedMessages(sparse, roads)
    recorded.status[:] = 0
    recorded.status[4] = 2
    (place,) = [p for p in report_data(recorded, roads)["places"] if p["kind"] == "off_road"]
    assert place["begin"] == pytest.approx(recorded.time[4] - recorded.time[0], abs=0.01)
    assert place["end"] == pytest.approx(recorded.time[5] - recorded.time[0], abs=0.01)


def doubted(recorded: RecordedMessages, k: int, edges: list[int], p: list[float]) -> list[str]:
    """Kinds of the places of a film that at epoch k doubts between some edges."""
    recorded.status[:] = 0
    recorded.status[k] = 1
    recorded.choices.edge[k], recorded.choices.p[k] = -2, 0.0
    recorded.choices.edge[k, : len(edges)], recorded.choices.p[k, : len(p)] = edges, p
    return [p["kind"] for p in report_data(recorded)["places"] if p["kind"] == "ambiguous"]


def test_a_doubt_between_edges_in_a_row_on_the_route_is_not_listed(sparse: Result, roads: RoadMap):
    recorded = RecordedMessages(sparse, roads)
    assert recorded.route is not None
    recorded.has_way = False  # a table of an earlier version: P of the edge is all that is known
    recorded.columns["p_way"] = np.full(len(recorded), 0.55)
    route, k = recorded.route, 4
    at = int(np.searchsorted(route.exit, recorded.time[k]))
    here, after = int(route.edge[at]), int(route.edge[at + 1])
    beside = next(e for e in range(len(roads)) if e not in set(route.edge.tolist()))
    assert doubted(recorded, k, [here, after], [0.55, 0.45]) == []
    assert doubted(recorded, k, [after, here], [0.55, 0.45]) == []
    assert doubted(recorded, k, [here, beside], [0.55, 0.45]) == ["ambiguous"]
    assert doubted(recorded, k, [here, after, beside], [0.5, 0.3, 0.2]) == ["ambiguous"]
    assert doubted(recorded, k, [beside, here], [0.55, 0.45]) == ["ambiguous"]


def test_rules_that_the_route_breaks_are_listed_once_for_edges_in_a_row(
    sparse: Result, roads: RoadMap
):
    recorded = RecordedMessages(sparse, roads)
    assert recorded.route is not None
    broken: list[str | None] = [None] * len(recorded.route.edge)
    broken[2] = broken[3] = "against_one_way"
    broken[5] = "gap"
    recorded.route = replace(recorded.route, broken=broken)
    said = [
        p for p in report_data(recorded, roads)["places"] if p["kind"] in ("against_one_way", "gap")
    ]
    assert [p["kind"] for p in said] == ["against_one_way", "gap"]
    assert said[0]["begin"] == pytest.approx(recorded.route.enter[2] - recorded.time[0], abs=0.01)
    assert said[0]["end"] == pytest.approx(recorded.route.exit[3] - recorded.time[0], abs=0.01)


@pytest.mark.parametrize("suffix", ["parquet", "csv", "arrow"])
def test_points_and_path_from_files_make_the_same_ways(
    sparse: Result, roads: RoadMap, tmp_path: Path, suffix: str
):
    points, path = tmp_path / f"points.{suffix}", tmp_path / f"path.{suffix}"
    sparse.write(points)
    sparse.write_path(path)
    recorded = RecordedMessages(read_points(points, None, path), roads)
    written = json.loads(json.dumps(timeline(recorded)["ways"]))
    assert written.keys() == {str(k) for k in timeline(RecordedMessages(sparse, roads))["ways"]}
    assert timeline(RecordedMessages(read_points(points), roads))["ways"] == {}


@pytest.mark.parametrize("column", ["edge_id", "enter_time"])
def test_what_is_no_path_is_refused_by_what_it_lacks(sparse: Result, tmp_path: Path, column: str):
    from whichroad.writers import write_table

    write_table(sparse.path_arrow().drop_columns([column]), tmp_path / "path.parquet")
    sparse.write(tmp_path / "points.parquet")
    with pytest.raises(ReadError, match=f"no column '{column}'.*--path-out"):
        read_points(tmp_path / "points.parquet", None, tmp_path / "path.parquet")


def test_a_path_of_another_map_is_left_alone(sparse: Result, roads: RoadMap):
    path = sparse.path_arrow()
    far = path.set_column(
        path.column_names.index("edge_id"), "edge_id", [np.full(len(path), len(roads) + 5)]
    )
    other = Result(sparse.to_arrow(), far, {})
    assert RecordedMessages(other, roads).route is None
