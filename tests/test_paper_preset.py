"""The paper's method as printed: what it promises, and what follows from it beside ours."""

import math

import numpy as np
import pytest
import shapely

import whichroad
from scenes import (
    Town,
    brake,
    column,
    drive_along,
    epochs_of,
    gnss,
    localize,
    network,
    parallel_roads,
    straight_road,
)  # fmt: skip
from whichroad.epochs import Timeline
from whichroad.errors import DriveError
from whichroad.filter.state import CLOCK, DISTANCE, NO_EDGE, WHEELS
from whichroad.filter.summary.estimate import LOST, OUTAGE
from whichroad.geodesy.plane import Plane
from whichroad.observations import StartPose
from whichroad.recorded import localize_by_paper

PLANE = Plane(49.4, 8.7)


def literal(roads, epochs, *, mode=WHEELS, start=None, poses=False):
    return localize_by_paper(
        Town(roads, PLANE), Timeline(epochs, mode, 0), start=start, poses=poses
    )  # fmt: skip


def straight_drive(length=2000.0, *, y=0.0, fixes=slice(None, None, 10), noise=True, course=0.05):
    """A drive along x, a fix a second; without noise the fixes are true."""
    truth = drive_along([(0.0, y), (length, y)])
    fix = gnss(truth, seed=3)
    if not noise:
        fix[:, 0], fix[:, 1] = truth.x, truth.y
    return truth, epochs_of(truth, fix, np.arange(len(truth.time))[fixes], course=course)


def p_of(recorded, edge):
    """P(edge) at the last epoch."""
    out = recorded.output
    return float(out.rows.alt_p[-1][out.rows.alt_edge[-1] == edge].sum())


# What it promises


def test_a_straight_road_is_followed():
    truth, epochs = straight_drive()
    out = literal(network(straight_road(2000.0, 20)), epochs).output
    assert (out.rows.edge == 0).all()
    assert np.hypot(out.rows.x - truth.x, out.rows.y - truth.y).max() < 3 * 3.0
    assert np.abs(out.rows.heading).max() < 0.1


def test_the_probabilities_of_the_roads_sum_to_one_and_none_is_off_them():
    _, epochs = straight_drive()
    out = literal(network(parallel_roads(12.0)), epochs).output
    np.testing.assert_allclose(out.rows.alt_p.sum(axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(out.rows.p_edge, out.rows.alt_p[:, 0], atol=1e-6)
    assert (out.rows.p_off_road == 0.0).all()


def test_both_parallel_roads_stay_in_play_and_the_right_one_ends_ahead():
    _, epochs = straight_drive()
    recorded = literal(network(parallel_roads(12.0)), epochs)
    assert {0, 2} <= set(recorded.output.rows.alt_edge[-1].tolist())
    assert p_of(recorded, 0) > p_of(recorded, 2) > 0.0


def test_at_a_fork_in_an_outage_two_roads_are_managed_until_one_is_eliminated():
    fork = network(
        [[(0.0, 0.0), (200.0, 0.0)], [(200.0, 0.0), (600.0, 60.0)], [(200.0, 0.0), (600.0, -60.0)]]
    )
    truth = drive_along([(0.0, 0.0), (200.0, 0.0), (600.0, 60.0)], radius=40.0)
    epochs = epochs_of(truth, gnss(truth, sigma=1.0), np.arange(0, 100, 10), course=0.05)
    out = literal(fork, epochs).output
    doubted = out.rows.p_edge < 0.9
    assert doubted[(truth.x > 200.0) & (truth.x < 300.0)].any()
    assert not doubted[truth.x > 450.0].any()
    assert out.rows.edge[-1] == 2
    assert out.rows.status[-1] == OUTAGE


@pytest.mark.parametrize("mode", [DISTANCE, CLOCK])
def test_without_wheels_a_drive_is_followed_as_well(mode):
    truth, epochs = straight_drive()
    if mode == CLOCK:
        keep = epochs.has_fix == 1
        epochs = epochs[keep]
        truth = type(truth)._make(column[keep] for column in truth)
        epochs.arc[:] = epochs.turn[:] = 0.0
    out = literal(network(straight_road(2000.0)), epochs, mode=mode).output
    error = np.hypot(out.rows.x - truth.x, out.rows.y - truth.y)
    assert error[10:].max() < 3 * 3.0
    assert (out.rows.edge[10:] == 0).all()


def test_without_a_course_both_directions_start_equal_and_wheels_and_fixes_tell_them_apart():
    _, epochs = straight_drive(course=math.inf)
    recorded = literal(network(straight_road(2000.0)), epochs)
    out = recorded.output
    np.testing.assert_allclose(out.rows.alt_p[0, :2], 0.5)
    assert p_of(recorded, 0) > 0.999


def test_a_start_pose_needs_no_fix():
    truth, epochs = straight_drive(300.0, fixes=slice(0, 1))
    epochs.has_fix[:] = 0
    lat, lon, bearing = PLANE.pose(truth.x[0], truth.y[0], truth.heading[0])
    start = StartPose(lat, lon, bearing)
    out = literal(network(straight_road(300.0)), epochs, start=start).output
    assert (out.rows.edge == 0).all()
    assert abs(out.rows.x[-1] - truth.x[-1]) < 1.0


def test_with_neither_fix_nor_start_it_refuses():
    _, epochs = straight_drive(300.0)
    epochs.has_fix[:] = 0
    with pytest.raises(DriveError, match="start pose"):
        literal(network(straight_road(300.0)), epochs)


def test_beyond_the_map_dead_reckoning_goes_on_without_a_road():
    truth, epochs = straight_drive(600.0, fixes=slice(0, 450, 10))
    out = literal(network(straight_road(300.0)), epochs).output
    gone = truth.x > 340.0
    assert (out.rows.edge[gone] == NO_EDGE).all()
    assert (out.rows.p_edge[gone] == 0.0).all()
    assert (out.rows.alt_p[gone] == 0.0).all()
    assert set(out.rows.status[gone].tolist()) == {LOST, OUTAGE}
    assert abs(out.rows.x[-1] - truth.x[-1]) < 10.0


def test_a_first_fix_far_from_every_road_and_without_a_course_waits_for_a_better_one():
    _, epochs = straight_drive(300.0, course=math.inf)
    epochs.fix[:50, 1] += 500.0
    out = literal(network(straight_road(300.0)), epochs).output
    assert (out.rows.live[:50] == 0).all()
    assert (out.rows.live[50:] > 0).all()


def test_fixes_that_fit_nothing_for_long_start_it_anew():
    _, epochs = straight_drive()
    epochs.fix[500:, 1] += 200.0
    roads = network(parallel_roads(200.0))
    out = literal(roads, epochs).output
    assert out.rows.edge[400] == 0
    assert out.rows.edge[-1] in (2, 3)


def test_the_route_is_the_most_probable_edges_in_turn():
    pieces = [[(x, 0.0), (x + 200.0, 0.0)] for x in np.arange(0.0, 1000.0, 200.0)]
    _, epochs = straight_drive(1000.0)
    recorded = literal(network(pieces), epochs)
    assert recorded.chain.edge.tolist() == [0, 2, 4, 6, 8]
    assert (np.diff(recorded.chain.time) > 0.0).all()
    assert (recorded.chain.along[1:] < 60.0).all()  # late: the end behind still draws


def test_the_poses_of_alternatives_are_kept_when_asked_for():
    _, epochs = straight_drive(300.0)
    recorded = literal(network(parallel_roads(12.0)), epochs, poses=True)
    assert recorded.output.alt_pose[-1, 0, 1] < recorded.output.alt_pose[-1, 1, 1]


def test_a_table_of_fixes_is_matched_by_name_of_the_model():
    geopandas = pytest.importorskip("geopandas")
    street = shapely.LineString([(8.70, 49.4), (8.72, 49.4)])
    roads = whichroad.RoadMap.from_edges(geopandas.GeoDataFrame(geometry=[street], crs=4326))
    n = 60
    drive = geopandas.pd.DataFrame(
        {"time": np.arange(float(n)), "lat": 49.40001, "lon": 8.705 + 1e-4 * np.arange(n)}
    )
    result = whichroad.match(drive, roads, model="paper")
    points = result.to_arrow()
    assert points.num_rows == n
    assert set(points["edge_id"].to_pylist()[10:]) == {0}
    assert result.path_arrow().num_rows == 1


# What follows from it, and not from ours (docs/model.md, section 11)


def test_its_sigma_along_the_road_shrinks_without_information_and_ours_does_not():
    roads = network(straight_road(2000.0, 100))
    _, epochs = straight_drive(fixes=slice(0, 100, 10))
    theirs = literal(roads, epochs).output.rows.cov[:, 0]
    ours = localize(roads, epochs).output.rows.cov[:, 0]
    assert theirs[-1] < 0.9 * theirs[100]
    assert ours[-1] > 1.1 * ours[100]


def test_its_probability_of_a_road_depends_on_how_it_is_drawn_and_ours_does_not():
    _, epochs = straight_drive(y=6.0, noise=False)
    ends = [(0.0, 12.0), (2000.0, 12.0)]
    cut = [(x, 12.0) for x in np.linspace(0.0, 2000.0, 11)]
    maps = [network([*straight_road(2000.0), line]) for line in (ends, cut)]
    theirs = [p_of(literal(roads, epochs), 2) for roads in maps]
    ours = [p_of(localize(roads, epochs), 2) for roads in maps]
    assert theirs[0] == pytest.approx(0.5, abs=0.01)
    assert theirs[1] > 0.95
    assert ours[0] == pytest.approx(ours[1], abs=0.01)


def test_standing_still_makes_it_surer_and_not_ours():
    roads = network(parallel_roads(12.0))
    truth = drive_along([(0.0, 0.0), (400.0, 0.0)])
    stood, rows = brake(truth, 190, 190)
    fix = gnss(truth, seed=3)[rows]
    epochs = epochs_of(stood, fix, np.arange(len(rows))[::10], course=0.05)
    theirs, ours = literal(roads, epochs).output, localize(roads, epochs).output
    trace = [column(output, "xx") + column(output, "yy") for output in (theirs, ours)]
    assert trace[0][-1] < 0.7 * trace[0][210]
    assert trace[1][-1] == pytest.approx(trace[1][210], rel=0.1)
