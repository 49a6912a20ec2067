"""Looking more often at the same thing teaches (nearly) nothing more."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given

from laws.drives import (
    AS_REPORTED,
    LEARNT,
    Said,
    between_parallels,
    law,
    said,
    sensed,
    way_through,
)
from scenes import (
    Truth,
    drive_along,
    grid_town,
    network,
    parallel_roads,
    straight_road,
    wandering,
)
from strategies import seeds
from whichroad.filter.state import CLOCK, DISTANCE, WHEELS, new_epochs
from whichroad.settings import Settings

EACH = [[0], [1], [2], [3]]  # both roads, both ways
MOVING = pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
A_HUNDREDTH = 0.01  # what the model promises
TWO_PERCENT = 0.02
TOWN = grid_town()

# reported sigmas taken at their word, and every fix: the filter is all but linear
LINEAR = Settings(gnss_adapt_time=1e12, gnss_gate=1e6, gnss_lost=0.0)


def second(truth: Truth, every: int = 10) -> np.ndarray:
    return np.arange(0, len(truth.time), every)


def assert_same(one: Said, other: Said, rows: tuple, p: float, sigma: float) -> None:
    """P of every road, P off the roads, and sigma."""
    a, b = rows
    np.testing.assert_allclose(other.p[b], one.p[a], rtol=0.0, atol=p)
    np.testing.assert_allclose(other.off[b], one.off[a], rtol=0.0, atol=p)
    np.testing.assert_allclose(other.sigma[b], one.sigma[a], rtol=sigma)


@pytest.mark.parametrize(
    ("mode", "par"),
    [(WHEELS, AS_REPORTED), (DISTANCE, AS_REPORTED), (DISTANCE, LEARNT), (WHEELS, LEARNT)],
)
@example(seed=20)  # with wheels, a scale that moves in steps of 3 % steps at different fixes
@given(seed=seeds)
@law
def test_the_map_looked_at_every_4_m_or_every_8_says_the_same(mode: int, par: Settings, seed: int):
    """Compared where both have just looked, once the start is 50 m behind."""
    gap = np.random.default_rng(seed).uniform(8.0, 30.0)
    truth, fix = between_parallels(seed, gap)
    roads, epochs = network(parallel_roads(gap)), sensed(truth, fix, second(truth), mode)
    often, seldom = (
        said(roads, epochs, EACH, mode=mode, settings=replace(par, map_spacing=spacing))
        for spacing in (4.0, 8.0)
    )
    at = slice(48, None, 8)
    assert_same(often, seldom, (at, at), A_HUNDREDTH, TWO_PERCENT)


def slow_error(truth: Truth, seed: int, sigma: float, white: float = 0.0) -> np.ndarray:
    """Fixes (n, 5) with an error that wanders over a minute, and fresh noise (in sigmas)."""
    rng = np.random.default_rng(seed)
    n = len(truth.time)
    keep = math.exp(-(truth.time[1] - truth.time[0]) / 60.0)
    error = wandering(rng.normal(size=(n, 2)), keep)
    error = sigma * (error + white * rng.normal(size=(n, 2)))
    fix = np.column_stack([truth.x, truth.y, np.full((n, 2), sigma), np.zeros(n)])
    fix[:, :2] += error
    return fix


@MOVING
@pytest.mark.parametrize("par", [AS_REPORTED, LEARNT])
@example(seed=38)  # the worst of 40 with wheels
@example(seed=25)  # with an odometer
@given(seed=seeds)
@law
def test_a_receiver_without_an_error_asked_ten_times_as_often_teaches_nothing_more(mode, par, seed):
    """What it says is the same thing; only how sure one is of it could differ."""
    rng = np.random.default_rng(seed)
    gap = rng.uniform(8.0, 30.0)
    truth, _ = between_parallels(seed, gap)
    fix = slow_error(truth, seed, 0.0)
    fix[:, 2:4] = rng.uniform(2.0, 6.0)
    slow, fast = (
        said(network(parallel_roads(gap)), sensed(truth, fix, second(truth, n), mode), EACH,
             mode=mode, settings=par)
        for n in (10, 1)
    )  # fmt: skip
    at = second(truth)[1:]
    assert_same(slow, fast, (at, at), TWO_PERCENT, TWO_PERCENT)


@MOVING
@given(seed=seeds)
@law
def test_on_one_road_a_receiver_asked_ten_times_as_often_leaves_sigma_as_it_is(mode, seed):
    """Whatever it says, where the scale of its sigmas is not learnt from what it says."""
    truth = drive_along([[300.0, -1.75], [1300.0, -1.75]])
    fix = slow_error(truth, seed, np.random.default_rng(seed).uniform(2.0, 6.0), white=0.5)
    slow, fast = (
        said(
            network(straight_road()), sensed(truth, fix, second(truth, n), mode), mode=mode,
            settings=LINEAR,
        )
        for n in (10, 1)
    )  # fmt: skip
    at = second(truth)[1:]
    np.testing.assert_allclose(fast.sigma[at], slow.sigma[at], rtol=TWO_PERCENT)


@MOVING
def test_over_many_drives_ten_times_as_many_fixes_tell_parallel_roads_apart_as_often(mode: int):
    """One drive may differ: its ten samples of fresh noise are not its one.

    Over 40 drives these differences, 0.06 each in P and in sigma, average out to 0.01.
    """
    gain, wider = [], []
    for seed in range(40):
        truth, _ = between_parallels(seed, 12.0, length=400.0, offset=-1.75)
        fix = slow_error(truth, seed, 3.0, white=0.5)
        slow, fast = (
            said(network(parallel_roads(12.0)), sensed(truth, fix, second(truth, n), mode), EACH,
                 mode=mode)
            for n in (10, 1)
        )  # fmt: skip
        at = second(truth)[1:]
        gain.append((fast.p[at, 0] - slow.p[at, 0]).mean())
        wider.append(np.log(fast.sigma[at] / slow.sigma[at]).mean())
    assert abs(np.mean(gain)) <= TWO_PERCENT
    assert abs(np.mean(wider)) <= TWO_PERCENT


def at_both_rates(seed: int, way: np.ndarray, speed: float, mode: int):
    """One drive with odometry at 10 and at 50 Hz, the fixes the same, and rows to compare."""
    rng = np.random.default_rng(seed)
    slow, fast = (drive_along(way, speed=speed, interval=dt) for dt in (0.1, 0.02))
    n = min(len(slow.time), len(fast.time) // 5)
    rows = np.arange(n)
    sigma = rng.uniform(2.0, 6.0)
    seldom = slow_error(slow, seed, sigma, white=0.5)
    often = np.ones((len(fast.time), 5))
    often[5 * rows] = seldom[:n]
    at = second(slow)[: (n - 1) // 10 + 1]
    return sensed(slow, seldom, at, mode), sensed(fast, often, 5 * at, mode), (rows, 5 * rows)


@MOVING
@given(seed=seeds)
@law
def test_odometry_read_five_times_as_often_says_the_same_beside_a_parallel_road(mode, seed):
    rng = np.random.default_rng(seed)
    gap = rng.uniform(8.0, 30.0)
    y = rng.uniform(-1.75, gap - 1.75)
    slow, fast, rows = at_both_rates(seed, np.array([[300.0, y], [1000.0, y]]), 10.0, mode)
    roads = network(parallel_roads(gap))
    one, other = (said(roads, e, EACH, mode=mode) for e in (slow, fast))
    assert_same(one, other, rows, A_HUNDREDTH, 0.05)


def in_a_town(seed: int, mode: int, settings: Settings | None = None) -> tuple[float, float]:
    """By how much two rates differ: P of the edges on average, and nine tenths of the sigmas."""
    slow, fast, (a, b) = at_both_rates(seed, way_through(seed, 6), 9.7, mode)
    each = [[e] for e in range(2 * len(TOWN))]
    roads = network(TOWN)
    one, other = (said(roads, e, each, mode=mode, settings=settings) for e in (slow, fast))
    apart = 0.5 * np.abs(other.p[b] - one.p[a]).sum(axis=1)
    return apart.mean(), np.quantile(np.abs(other.sigma[b] / one.sigma[a] - 1.0), 0.9)


BELIEVED = Settings(gnss_inflation=1.0)


@pytest.mark.parametrize("settings", [BELIEVED, None])
@pytest.mark.parametrize(
    "seed",
    [
        13,
        pytest.param(7, marks=pytest.mark.xfail(
            strict=True, reason="read at 10 Hz, sigma is 6 % larger than on one road without "
            "junctions, read at 50 Hz it is not: 6.6 and 11.6 % between them (5 asked)")),
    ],
)  # fmt: skip
def test_a_junction_cuts_as_often_however_often_the_odometer_is_read(
    seed: int, settings: Settings | None
):
    """Cut at every reading, sigma differs by 7 % in these two drives."""
    assert in_a_town(seed, DISTANCE, settings)[1] <= 0.05


def test_a_junction_is_passed_by_as_much_however_often_the_odometer_is_read():
    """Ten drives: were what is left truncated, P would differ by 0.014."""
    assert np.mean([in_a_town(seed, DISTANCE)[0] for seed in range(10)]) <= 0.006


def test_a_junction_is_passed_by_as_much_at_1_hz_as_at_10_hz_by_fixes_alone():
    """Eight drives, the speed reported: were what is left truncated, P would differ by 0.03."""
    apart, each, roads = [], [[e] for e in range(2 * len(TOWN))], network(TOWN)
    for seed in range(8):
        truth = drive_along(way_through(seed, 6), speed=9.7)
        sigma = np.random.default_rng(seed).uniform(2.0, 6.0)
        fix = slow_error(truth, seed, sigma, white=0.5)
        at = second(truth)
        one, ten = (
            said(roads, sensed(truth, fix, rows, CLOCK), each, mode=CLOCK)
            for rows in (at, np.arange(len(truth.time)))
        )
        apart.append(0.5 * np.abs(ten.p[at] - one.p).sum(axis=1).mean())
    assert np.mean(apart) <= 0.022


@pytest.mark.parametrize(
    "mode",
    [
        WHEELS,
        pytest.param(DISTANCE, marks=pytest.mark.xfail(
            strict=True, reason="sigma differs by 2 % in most drives, and by more than 5 in a "
            "twelfth of them (up to 12; P by 0.003 on average)")),
    ],
)  # fmt: skip
@example(seed=7)  # the worst of 60
@given(seed=seeds)
@law
def test_odometry_read_five_times_as_often_says_the_same_in_a_town(mode: int, seed: int):
    """The map is looked at every 5.8 m or every 5.0.

    A turn may so be told one look sooner or later: at 6 crossings over 700 m that is 5 % of
    the way, were every one of them a surprise.
    """
    apart, sigma = in_a_town(seed, mode)
    assert apart <= 0.05
    assert sigma <= 0.05


def test_gnss_alone_is_a_clock_whose_epochs_are_its_fixes():
    """So that none of the above applies to it: there is nothing to be read more often."""
    truth, fix = between_parallels(0, 12.0)
    assert len(sensed(truth, fix, second(truth), CLOCK).time) == len(second(truth))


@pytest.mark.parametrize("mode", [DISTANCE, CLOCK])
@pytest.mark.parametrize("rate", [1, 2, 5, 10])
def test_a_receiver_with_course_and_speed_stays_on_the_roads_at_any_rate(mode: int, rate: int):
    """A heading drawn anew for every fix would let each of them cost the roads something.

    At 10 Hz they lost in a fifth of the epochs, beginning in bends and at corners.
    """
    right = off = 0.0
    for seed in range(6):
        truth = drive_along(way_through(seed, 6), speed=9.7)
        every = second(truth, 10 // rate)
        rng = np.random.default_rng(seed)
        fix = slow_error(truth, seed, 2.5, white=0.4)
        epochs = sensed(truth, fix, every, mode)
        rows = np.arange(len(every)) if mode == CLOCK else every
        epochs.course[rows] = truth.heading[every] + rng.normal(0.0, 0.02, len(every))
        epochs.course_sigma[rows] = 0.02
        if mode == DISTANCE:
            epochs.speed[rows], epochs.speed_sigma[rows] = 9.7, 0.3
        answer = said(network(TOWN), epochs, [range(2 * len(TOWN))], mode=mode)
        right += answer.p[rows, 0].mean() / 6
        off += (answer.off[rows] > 0.5).mean() / 6
    assert right >= 0.99
    assert off <= 0.005


def test_a_standing_receiver_asked_ten_times_as_often_does_not_creep():
    """Each truncation to forward speeds moves the mean of a speed that walks about zero."""
    n = 600
    fix = np.column_stack([np.full((n, 2), [500.0, -1.75]), np.full((n, 2), 3.0), np.zeros(n)])
    moved = []
    for every in (10, 1):  # tenths of a second
        epochs = new_epochs(n // every)
        epochs.time, epochs.fix = 0.1 * np.arange(n)[::every], fix[::every]
        epochs.speed_sigma = epochs.course_sigma = np.inf
        epochs.has_fix = 1
        moved.append(said(network(straight_road()), epochs, mode=CLOCK).place[-1, 0] - 500.0)
    assert abs(moved[1] - moved[0]) <= 0.5
    assert abs(moved[1]) <= 2.0


@pytest.mark.parametrize("every", [10, 1])  # tenths of a second
def test_a_standing_receiver_whose_error_changes_slowly_creeps_no_way(every: int):
    """Errors and their mirror images lead as far ahead as behind, though no vehicle reverses."""
    n, keep, ahead = 3000, np.exp(-0.1 / 30.0), []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        slow = np.zeros((n, 2))
        slow[1:] = rng.normal(0.0, 2.5, (n - 1, 2))
        slow = wandering(slow, keep)
        error = slow + rng.normal(0.0, 1.0, (n, 2))
        for side in (error, -error):
            epochs = new_epochs(n // every)
            epochs.time = 0.1 * np.arange(n)[::every]
            epochs.fix[:, :2] = (side + np.array([500.0, -1.75]))[::every]
            epochs.fix[:, 2:4] = 3.0
            epochs.speed_sigma = epochs.course_sigma = np.inf
            epochs.has_fix = 1
            place = said(network(straight_road()), epochs, mode=CLOCK).place[:, 0]
            ahead.append(np.mean(place[len(place) // 2 :]) - 500.0)
    assert abs(np.mean(ahead)) <= 0.3
