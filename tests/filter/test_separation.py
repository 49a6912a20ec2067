"""Odometry and fixes that part: the level covers both, until roads decide."""

import math

import numpy as np
import pytest

from scenes import (
    On,
    Truth,
    belief_on,
    brake,
    context,
    drive_along,
    epochs_of,
    gnss,
    grid_town,
    localize,
    network,
    steps,
)
from whichroad.filter.gnss.separation import cover
from whichroad.filter.gnss.sides import even_out, odds_of_sides
from whichroad.filter.gnss.update import observe_standing
from whichroad.filter.state import MOTION, RECEIVER, WHEELS, Belief, K, X, Y, normalise
from whichroad.filter.summary.estimate import new_output
from whichroad.filter.vetting.motion_sources import ARC

CORNER = [[0.0, -1.75], [301.75, -1.75], [301.75, 900.0]]
ROADS = network(
    [[[-50.0, 0.0], [300.0, 0.0]], [[300.0, 0.0], [300.0, 3000.0]], [[300.0, 0.0], [900.0, 0.0]]]
)
DRIVE = drive_along(CORNER)
AFTER = 600  # epoch at which the pull begins, half a minute after the turn
RISK = 1e-3


def pulled(truth: Truth, begin: int, by: tuple[float, float], seed: int = 0) -> np.ndarray:
    """Fixes that are pulled away at so many metres a second from an epoch on."""
    fix = gnss(truth, sigma=2.0, seed=seed)
    fix[begin:, :2] += np.outer(truth.time[begin:] - truth.time[begin], by)
    return fix


def above(by: tuple[float, float], seed: int) -> float:
    """Share of the epochs of a pull that are above the level."""
    fix = pulled(DRIVE, AFTER, by, seed)
    epochs = epochs_of(DRIVE, fix, range(0, len(DRIVE.time), 10), course=0.1)
    rows = localize(ROADS, epochs).output.rows
    error = np.hypot(rows.x - DRIVE.x, rows.y - DRIVE.y)
    assert np.median(rows.protection_level[:AFTER]) < 12.0
    return float((error > rows.protection_level)[AFTER:].mean())


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("speed", [-0.5, -0.7])
def test_a_slow_pull_along_the_road_is_told_by_odometry_alone(seed: int, speed: float):
    """No fix tells it.  Without copies a quarter to a half of the epochs are above the level."""
    assert above((0.0, speed), seed) < 0.01


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("speed", [-1.2, 1.2, -4.0, 7.0])
def test_a_pull_along_the_road_stays_below_the_level(seed: int, speed: float):
    """To the fixes it is wheels of another size."""
    assert above((0.0, speed), seed) < 0.01


def covered(p: float) -> tuple[float, float]:
    """The level, and the variance along x, where a copy is 30 m ahead with a probability."""
    belief = belief_on(ROADS, [On(0, 200.0, sigma=1.0)])
    state, copy = belief.state[0], belief.state[0].separation.reckoned[0]
    state.mode, copy.live, copy.p = WHEELS, 1, p
    copy.away[0] = 30.0
    copy["cov"][X, X] = copy["cov"][Y, Y] = 4.0
    out = new_output(1, False).rows[0]
    out.x, out.y = belief.hyp[0]["mu"][[X, Y]]
    out.cov[:] = 0.0
    out.protection_level = out.level_along = out.level_across = 5.0
    cover(state, belief.hyp[0], out, RISK)
    assert out.level_across <= out.protection_level
    return float(out.protection_level), float(out.cov[0])


def test_a_place_by_odometry_is_covered_as_far_as_it_is_probable():
    assert covered(0.5 * RISK) == (5.0, 0.0)
    level, variance = covered(0.1)
    assert level == pytest.approx(30.0 + 2.0 * math.sqrt(2.0 * math.log(100.0)))
    assert variance == pytest.approx(0.05 * 900.0)
    assert covered(1.0)[0] > level


def test_copies_are_made_again_and_again_and_moved_by_odometry_alone():
    fix = gnss(DRIVE, sigma=2.0)
    epochs = epochs_of(DRIVE, fix, range(0, len(DRIVE.time), 10), course=0.1)
    begun: set[float] = set()
    for k, belief, _ in steps(ROADS, epochs):
        copies = belief.state[0].separation.reckoned
        begun |= {float(c["begun"]) for c in copies if c["live"]}
        if epochs.has_fix[k]:
            for copy in copies:
                if copy["live"]:
                    place = copy["mu"][[X, Y]] - (DRIVE.x[k], DRIVE.y[k])
                    assert np.hypot(*place) < 12.0
                    assert copy["p"] < 0.05
    assert len(begun) >= 4


def two_sides() -> Belief:
    belief = belief_on(ROADS, [On(0, 200.0, p=0.9), On(0, 230.0, p=0.1)])
    normalise(belief)
    belief.hyp.blames[:2] = RECEIVER, MOTION
    return belief


def test_a_fix_counts_little_between_two_sides():
    belief = two_sides()
    before = odds_of_sides(belief)
    assert before == pytest.approx(math.log(9.0))
    belief.hyp.log_weight[0] -= 5.0
    even_out(belief, before, 1.0)
    assert odds_of_sides(belief) == pytest.approx(before - 1.0)


def test_wheels_do_not_err_by_a_third_for_long():
    belief = two_sides()
    before = odds_of_sides(belief)
    belief.hyp["mu"][1, K] -= 0.3
    even_out(belief, before, 1.0)
    assert odds_of_sides(belief) == pytest.approx(before + 0.45)


def test_fixes_that_ran_away_before_say_nothing_of_wheels_that_stand():
    """The car brakes and stands for ten seconds, the fixes run on."""
    stood, rows = brake(DRIVE, 750, 100)
    fix = pulled(stood, 700, (6.0, 0.0))
    epochs = epochs_of(stood, fix, range(0, len(rows), 10), course=0.1)
    for k, belief, output in steps(ROADS, epochs):
        row = output.rows[k]
        assert not belief.state[0].vetting.refused[ARC]
        assert np.hypot(row.x - stood.x[k], row.y - stood.y[k]) < 15.0


def test_a_fix_beside_wheels_that_may_be_wrong_is_smoothed_once():
    belief = belief_on(ROADS, [On(0, 200.0, sigma=1.0)])
    state = belief.state[0]
    state.gnss_factor, state.vetting.runs, state.mode = 1.0, 1, WHEELS
    state.bias_root[:] = state.gnss_cov[:] = 2.0, 0.0, 2.0
    normalise(belief)
    epochs = epochs_of(DRIVE, gnss(DRIVE), [50])
    epochs.fix[50] = 300.0, 0.0, 9.0, 9.0, 0.0
    assert not observe_standing(belief, context(ROADS), epochs[50])
    assert state.gnss_cov.tolist() == [2.0, 0.0, 2.0]


def test_wheels_found_impossible_soon_after_a_misfit_have_caused_it():
    """They turn the car round and round, and for seconds the receiver seems to be wrong."""
    fix = gnss(DRIVE, sigma=2.0)
    epochs = epochs_of(DRIVE, fix, range(0, len(DRIVE.time), 10), course=0.1)
    epochs.turn[700:730] += 0.1
    epochs.turn[730:760] += 0.8
    for k, belief, output in steps(ROADS, epochs):
        if 690 <= k < 729:
            belief.state[0].vetting.tried = 0
        row = output.rows[k]
        if k > 760:
            assert np.hypot(row.x - DRIVE.x[k], row.y - DRIVE.y[k]) < 15.0


@pytest.mark.parametrize("seed", range(3))
def test_fixes_that_ran_away_are_not_believed_alone_once_wheels_are_again(seed: int):
    """They run away from a car that stands, at a car's speed, and its wheels are refused."""
    truth = drive_along(np.array([[0, 0], [3, 0], [3, 3], [6, 3], [6, 6], [8, 6]]) * 110.0)
    stood, _ = brake(truth, 700, 300, goes_on=True)
    begin = int(np.flatnonzero(np.hypot(np.gradient(stood.x), np.gradient(stood.y)) < 0.01)[0])
    fix = gnss(stood, sigma=2.0, seed=seed)
    since = stood.time - stood.time[begin + 100]
    away = np.where((since > 0.0) & (since < 60.0), 4.0 * since, 0.0)
    fix[:, :2] += np.outer(away, [np.cos(4.7), np.sin(4.7)])
    epochs = epochs_of(stood, fix, range(0, len(stood.time), 10), course=0.1)
    rows = localize(network(grid_town(9, 9, 110.0)), epochs).output.rows
    error = np.hypot(rows.x - stood.x, rows.y - stood.y)
    assert (error > rows.protection_level).sum() < 10
    assert np.all(error[-100:] < 15.0)
