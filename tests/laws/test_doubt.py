"""What has not been measured is not known: doubt falls only by a measurement of it."""

import functools
import math

import numpy as np
import pytest
from hypothesis import given

from laws.drives import law, said, sensed, way_through
from scenes import (
    Town,
    column,
    columns,
    drive_along,
    epochs_of,
    gnss,
    grid_town,
    living,
    network,
    parallel_roads,
    steps,
    straight_road,
)
from strategies import seeds
from whichroad._compile import Records
from whichroad.epochs import Timeline
from whichroad.filter.state import CLOCK, DISTANCE, WHEELS, K
from whichroad.geodesy.plane import Plane
from whichroad.observations import StartPose
from whichroad.recorded import localize_recorded
from whichroad.settings import Settings

MOVING = pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
# nothing but the roads, and every fix taken at its word: all but linear
ALONE = Settings(
    off_road_start=0.0, off_road_leave=0.0, off_road_return=0.0, u_turn_rate=0.0, prune=1e-6,
    gnss_gate=1e6, gnss_adapt_time=1e12, gnss_lost=0.0, gnss_start=1.0,
)  # fmt: skip
ROUNDING = 1e-9
SECOND_ORDER = 1e-6  # of a variance: a milliradian squared
TOWN = grid_town()


@MOVING
@given(seed=seeds)
@law
def test_along_a_straight_road_the_map_makes_no_hypothesis_surer(mode: int, seed: int):
    """Two roads side by side in any direction, half a minute of fixes, then a kilometre of none.

    Moving on by δ alone makes it var s + 2 δ cov(s, κ) + δ² var κ; a look at the map may take
    from that only what a heading of a milliradian beside the road's tells of the way along.
    """
    rng = np.random.default_rng(seed)
    a = rng.uniform(-math.pi, math.pi)
    along = np.array([math.cos(a), math.sin(a)])
    turn = np.array([along, [-along[1], along[0]]])  # rows: along, left
    truth = drive_along(np.array([[300.0, -1.75], [1600.0, -1.75]]) @ turn)
    fix = gnss(truth, sigma=rng.uniform(2.0, 6.0), seed=seed)
    last = 300
    epochs = sensed(truth, fix, np.arange(0, last, 10), mode)
    roads = network([line @ turn for line in parallel_roads(rng.uniform(8.0, 30.0))])
    before: dict[int, tuple[float, float]] = {}
    first: dict[int, float] = {}
    for k, belief, _ in steps(roads, epochs, mode=mode, settings=ALONE):
        alive = living(belief)
        if k < last:
            continue
        now = {}
        for edge, cov in zip(alive.edge.tolist(), alive["cov"], strict=True):
            driven = float(along @ cov[:2, K] * epochs.arc[k]), float(cov[K, K])
            now[edge] = float(along @ cov[:2, :2] @ along), 2.0 * driven[0] + driven[1]
        assert len(now) == len(alive)
        for edge in now.keys() & before.keys():
            moved = sum(before[edge])  # by the odometer's scale, arcs being 1 m
            assert now[edge][0] >= moved * (1.0 - SECOND_ORDER), (k, edge)
        first = first or {edge: v for edge, (v, _) in now.items()}
        before = now
    assert before
    for edge in before.keys() & first.keys():
        assert before[edge][0] > first[edge]


@functools.cache  # the same ones with wheels and without
def floor(looks: int, start: float, par: Settings) -> float:
    """Least variance across a straight road after some looks at it, odometry without an error.

    The looks tell the way across as y = p + mₖ − dₖ − eₖ, with m and d Gauss-Markov over
    distance.  Of an unknown p the best that can be made is generalised least squares,

        var p = 1 / (1/σ₀² + 1ᵀ C⁻¹ 1)
    """
    apart = par.map_spacing * np.abs(np.subtract.outer(np.arange(looks), np.arange(looks)))
    c = par.map_sigma**2 * np.exp(-apart / par.map_length)
    c += par.lane_sigma**2 * np.exp(-apart / par.lane_length)
    c += par.relative_sigma**2 * np.eye(looks)
    return 1.0 / (1.0 / start**2 + float(np.linalg.solve(c, np.ones(looks)).sum()))


@MOVING
@pytest.mark.parametrize("sigma", [2.0, 10.0])
def test_across_a_straight_road_the_map_makes_nobody_surer_than_lane_and_map_allow(mode, sigma):
    """From a given pose, without a fix.  A look each 5 m, the first one at the start.

    Without wheels the heading is the road's and what is known of the way across turns with it.
    """
    truth = drive_along([[300.0, -1.75], [1300.0, -1.75]])
    plane = Plane(49.4, 8.7)
    lat, lon = plane.to_geodetic(float(truth.x[0]), float(truth.y[0]))
    epochs = epochs_of(truth, np.zeros((len(truth.time), 5)), [0])
    epochs.has_fix = 0
    output = localize_recorded(
        Town(network(straight_road()), plane), Timeline(epochs, mode, 0), settings=ALONE,
        start=StartPose(lat, lon, 90.0, sigma, 5.0),
    ).output  # fmt: skip
    at = np.arange(5, len(truth.time), 5)  # where a look has just been taken
    allowed = [floor(1 + k // 5, sigma, ALONE) for k in at]
    assert (column(output, "yy")[at] >= np.array(allowed) * (1.0 - ROUNDING)).all()


def without(epochs: Records, gone: np.ndarray) -> Records:
    """The same drive, some fixes of which never came."""
    kept = epochs.copy()
    kept.has_fix[gone] = 0
    return kept


@MOVING
@given(seed=seeds)
@law
def test_on_one_road_a_fix_less_never_makes_the_position_surer(mode: int, seed: int):
    """Neither along the road nor across it, at any epoch; of a half, a half is taken again."""
    rng = np.random.default_rng(seed)
    truth = drive_along([[300.0, -1.75], [1300.0, -1.75]])
    fix = gnss(truth, sigma=rng.uniform(2.0, 6.0), seed=seed)
    fix[:, 2:4] *= 2.0  # better than it says: its error never looks like a fault
    epochs = sensed(truth, fix, np.arange(0, len(truth.time), 10), mode)
    gone = np.zeros(len(truth.time), bool)
    before = np.zeros((len(truth.time), 2))
    for _ in range(4):
        told = said(network(straight_road()), without(epochs, gone), mode=mode, settings=ALONE)
        now = columns(told.output, "xx yy")
        assert (now >= before * (1.0 - SECOND_ORDER)).all()
        before = now
        gone |= rng.random(len(gone)) < 0.5
        gone[0] = False


@pytest.mark.parametrize("every", [10, 20])
@given(seed=seeds)
@law
def test_on_one_road_a_car_without_wheels_is_never_surer_than_one_with_them(every, seed):
    """Along the road; the receiver alone reports no speed either."""
    rng = np.random.default_rng(seed)
    truth = drive_along([[300.0, -1.75], [1300.0, -1.75]], speed=rng.uniform(3.0, 25.0))
    fix = gnss(truth, sigma=rng.uniform(2.0, 6.0), seed=seed)
    at = np.arange(0, len(truth.time), every)
    along = []
    for mode, rows in ((WHEELS, at), (DISTANCE, at), (CLOCK, slice(None))):
        epochs = sensed(truth, fix, at, mode)
        epochs.speed_sigma = np.inf
        told = said(network(straight_road()), epochs, mode=mode, settings=ALONE)
        along.append(column(told.output, "xx")[rows])
    assert (along[1] >= along[0] * (1.0 - ROUNDING)).all()
    assert (along[2] >= along[1] * (1.0 - ROUNDING)).all()


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
def test_over_many_drives_through_a_town_half_a_minute_without_fixes_leaves_less_sure(mode: int):
    """Of one drive it may be otherwise: a junction told early may tell the way along."""
    wider, doubted = [], []
    for seed in range(20):
        truth = drive_along(way_through(seed, 4))
        fix = gnss(truth, sigma=4.0, seed=seed)
        epochs = sensed(truth, fix, np.arange(0, len(truth.time), 10), mode)
        dark = (epochs.time > 10.0) & (epochs.time <= 40.0)
        each = [[e] for e in range(2 * len(TOWN))]
        lit = said(network(TOWN), epochs, each, mode=mode)
        unlit = said(network(TOWN), without(epochs, dark), each, mode=mode)
        wider.append(np.log(unlit.sigma[dark] / lit.sigma[dark]).mean())
        doubted.append((lit.p[dark].max(axis=1) - unlit.p[dark].max(axis=1)).mean())
    assert np.mean(wider) > 0.0
    assert np.mean(doubted) > 0.0
