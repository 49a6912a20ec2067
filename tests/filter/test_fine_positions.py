"""Positions to a few centimetres, five a second, and nothing else: roads must fit them, too."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

import whichroad
from laws.public import CAR, START, geo_fixes, road_map
from scenes import Truth

Array = NDArray[np.float64]

SIGMA = 0.02  # m
LANE = 1.75  # m right of a centre line
SIDE_STREETS = [[[x, 0.0], [x, -80.0]] for x in np.arange(60.0, 540.0, 60.0)]
MAIN_STREET = [[x, 0.0] for x in np.arange(0.0, 601.0, 60.0)]


def drive(line: ArrayLike, stops: ArrayLike = ()) -> Truth:
    """Along a line at up to 8 m/s, with 10 s of standing at each stop (m); ten epochs a second."""
    x, y = np.asarray(line, float).T
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    ends = [0.0, *np.asarray(stops, float), along[-1] - 1.0]
    s, speed = [0.0], 0.0
    for end in ends[1:]:
        while end - s[-1] > 0.05:
            fastest = np.sqrt(2.0 * 1.2 * (end - s[-1]))
            speed = min(speed + 0.1, fastest, 8.0)
            s.append(s[-1] + 0.1 * max(speed, 0.1))
        s.extend([s[-1]] * 100)
        speed = 0.0
    way = np.array(s)
    ahead, behind = way + 0.5, way - 0.5
    heading = np.arctan2(
        np.interp(ahead, along, y) - np.interp(behind, along, y),
        np.interp(ahead, along, x) - np.interp(behind, along, x),
    )
    time = 0.1 * np.arange(len(way))
    return Truth(time, np.interp(way, along, x), np.interp(way, along, y), heading, way)


def said(
    truth: Truth, roads: whichroad.RoadMap, *, ahead: float = 0.0
) -> tuple[Array, Array, Array]:
    """P(off the roads), the road and its probability behind each fix, on line.

    Args:
        truth: The drive of M.
        roads: The map.
        ahead: How far the antenna is ahead of M, m.
    """
    rng = np.random.default_rng(3)
    n = len(truth.time)
    fixes = np.column_stack([
        truth.x + ahead * np.cos(truth.heading) + rng.normal(0.0, 0.5 * SIGMA, n),
        truth.y + ahead * np.sin(truth.heading) + rng.normal(0.0, 0.5 * SIGMA, n),
        np.full((n, 2), SIGMA), np.zeros(n),
    ])  # fmt: skip
    car = whichroad.Vehicle(track_width=CAR.track_width, antenna_forward=ahead)
    localizer = whichroad.Localizer(roads, vehicle=car)
    streets = roads.edges_table().source_id.to_numpy()
    off, street, p = [], [], []
    for fix in geo_fixes(truth, fixes, np.arange(0, n, 2)):
        estimate = localizer.update(fix)
        if fix.time > START + 10.0:
            off.append(estimate.p_off_road)
            street.append(-1 if estimate.edge is None else int(streets[estimate.edge]))
            p.append(estimate.p_road)
    return np.array(off), np.array(street), np.array(p)


def test_a_lane_that_begins_beside_the_line_is_driven_into():
    """A one-way street is driven along its line, a two-way one right of it."""
    lines = [[[-200.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [400.0, 30.0]], [[0.0, 0.0], [60.0, -80.0]]]
    roads = road_map(lines, oneway=["yes", "no", "no"])
    x = np.arange(-200.0, 390.0, 5.0)
    beside = LANE * np.clip((x + 5.0) / 15.0, 0.0, 1.0)
    truth = drive(np.column_stack([x, np.maximum(0.075 * x, 0.0) - beside]))
    off, street, _ = said(truth, roads)
    assert off.max() < 0.1
    assert set(street) == {0, 1}


def test_who_drives_slowly_and_stands_with_an_antenna_ahead_stays_on_its_road():
    truth = drive([[5.0, -LANE], [590.0, -LANE]], stops=[100.0, 220.0, 300.0, 460.0])
    off, _, _ = said(truth, road_map([MAIN_STREET, *SIDE_STREETS]), ahead=1.5)
    assert off.mean() < 0.01


def test_headings_about_nodes_do_not_count_for_a_road_without_them():
    """A road without a node runs 7 m beside one with many."""
    truth = drive([[5.0, -LANE], [590.0, -LANE]], stops=[58.0, 118.0, 178.0, 298.0])
    lines = [MAIN_STREET, [[0.0, 7.0], [600.0, 7.0]], *SIDE_STREETS]
    _, street, p = said(truth, road_map(lines), ahead=1.5)
    assert not (p[street == 1] >= 0.9).any()
    assert (street == 0).mean() > 0.95
