"""Fixes that fit nothing: the receiver is wrong, or the motion, until roads and fixes decide."""

import math

import numpy as np
import pytest

from scenes import (
    On,
    Truth,
    belief_on,
    context,
    drive_along,
    epochs_of,
    gnss,
    localize,
    network,
    straight_road,
)
from whichroad.filter.gnss.position import Axes, innovations, observe_given
from whichroad.filter.gnss.sides import take_sides
from whichroad.filter.state import CLOCK, GX, MOTION, RECEIVER, B, Belief, H, X, Y, normalise
from whichroad.filter.summary.estimate import Output

ROAD = network(straight_road())
CTX = context(ROAD)
GATE, SHARE, SIGMA = 14.4, 0.1, 3.0
AXES = Axes(1.0, 0.0, (0.5 * SIGMA) ** 2, (0.5 * SIGMA) ** 2)


def met(belief: Belief, away: float) -> tuple[bool, bool]:
    """A fix so many metres ahead of where the vehicle is thought to be (at 500 m) is observed."""
    fix = np.array([500.0 + away, 0.0, SIGMA, SIGMA, 0.0])
    innovations(belief, CTX, fix, AXES)
    told = take_sides(belief, AXES, GATE, SHARE, 0.0)
    innovations(belief, CTX, fix, AXES)
    observe_given(belief, CTX, fix, AXES, 9.0, True, 0.0)
    normalise(belief)
    return told


def believing() -> Belief:
    """A vehicle at 500 m, known to a metre, and its receiver."""
    belief = belief_on(ROAD, [On(0, 500.0, sigma=1.0)])
    belief.state.bias_root[0] = SIGMA, 0.0, SIGMA
    normalise(belief)
    return belief


def test_a_fix_that_fits_leaves_one_hypothesis():
    belief = believing()
    assert met(belief, 3.0) == (False, False)
    assert belief.state[0].count == 1


def test_a_fix_that_fits_nothing_makes_three_of_which_one_keeps_its_place():
    belief = believing()
    assert met(belief, 40.0) == (True, True)
    state, hyp = belief.state[0], belief.hyp[:3]
    assert state.count == 3
    assert hyp.blames.tolist() == [RECEIVER, MOTION, MOTION]
    assert hyp.weight.sum() == pytest.approx(1.0)
    assert abs(hyp["mu"][0, X] - 500.0) < 3.0
    assert hyp["mu"][0, GX] > 10.0
    assert hyp.freed[0] > 50.0  # sigmas², for the smoother
    assert hyp.freed[1] == 0.0
    assert (np.abs(hyp["mu"][1:, X] - 540.0) < 6.0).all()
    assert hyp["cov"][2, H, H] > hyp["cov"][1, H, H] + 0.05
    assert hyp["cov"][2, B, B] > hyp["cov"][1, B, B]
    assert hyp["cov"][1, X, X] < 0.1 * 40.0**2
    assert hyp["cov"][1, Y, Y] < 0.1 * 40.0**2


def test_while_both_sides_live_each_explains_what_comes_and_nothing_is_forked():
    belief = believing()
    met(belief, 40.0)
    assert met(belief, 80.0) == (True, True)
    assert belief.state[0].count == 3
    assert abs(belief.hyp["mu"][0, X] - 500.0) < 3.0
    assert (np.abs(belief.hyp["mu"][1:3, X] - 580.0) < 8.0).all()


def away(output: Output, truth: Truth) -> np.ndarray:
    return np.hypot(output.rows.x - truth.x, output.rows.y - truth.y)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("larger", [0.03, -0.03])
def test_a_wheel_that_becomes_larger_is_learnt_within_a_hundred_metres(seed: int, larger: float):
    """From 45 s on turns are wrong by 0.3 rad a second; ten seconds later all is well again."""
    road = drive_along([[500.0, -1.75], [2500.0, -1.75]])
    fix = gnss(road, sigma=2.0, seed=seed)
    epochs = epochs_of(road, fix, np.arange(0, len(road.time), 10), course=0.1)
    epochs.course_sigma = math.inf
    epochs.turn[450:] += larger * epochs.arc[450:]
    output = localize(network(straight_road(9000.0)), epochs).output
    assert away(output, road)[550:].max() < 12.0
    assert (away(output, road)[550:] <= output.rows.protection_level[550:]).mean() > 0.99
    assert (output.rows.p_off_road[600:] < 0.5).all()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("pull", [3.0, 8.0])
def test_fixes_that_are_pulled_away_take_nobody_with_them(seed: int, pull: float):
    """From 45 s on, by so many metres a second, across a road that the wheels know well."""
    road = drive_along([[500.0, -1.75], [1400.0, -1.75]])
    fix = gnss(road, sigma=2.0, seed=seed)
    fix[450:, 1] += pull * (road.time[450:] - road.time[450])
    epochs = epochs_of(road, fix, np.arange(0, len(road.time), 10), course=0.1)
    epochs.course_sigma = math.inf
    epochs.turn[1] = 1e-5  # wheels that never turned at all would not be believed
    output = localize(network(straight_road(9000.0)), epochs).output
    error = away(output, road)
    assert (error <= output.rows.protection_level).mean() > 0.99
    assert np.median(error[450:]) < 10.0


T_JUNCTION = network(
    [
        *([[100.0 * k, 0.0], [100.0 * k + 100.0, 0.0]] for k in range(8)),
        [[800.0, 0.0], [800.0, 900.0]],
        [[800.0, 0.0], [800.0, -900.0]],
    ]
)
OTHER = 18  # the edge down, where the vehicle drives up


@pytest.mark.parametrize("seed", range(4))
def test_turns_that_go_the_other_way_lead_nowhere(seed: int):
    """At the first turn the gyro says right where the car turns left, into the other road."""
    road = drive_along([[10.0, -1.75], [801.75, -1.75], [801.75, 800.0]])
    fix = gnss(road, sigma=2.0, seed=seed)
    epochs = epochs_of(road, fix, np.arange(0, len(road.time), 10), course=0.1)
    epochs.course_sigma = math.inf
    epochs.turn *= -1.0
    epochs.left *= -1.0
    output = localize(T_JUNCTION, epochs).output
    error = away(output, road)
    assert (error <= output.rows.protection_level).mean() > 0.97
    assert error[-100:].max() < 12.0
    assert (output.rows.p_edge[output.rows.edge == OTHER] < 0.999).all()


def found_again(
    road: Truth, seed: int, biased: tuple[float, float], back: float
) -> tuple[np.ndarray, np.ndarray]:
    """Fixes of a receiver that was silent for 8 s and is then drawn in, and which are heard."""
    fix = gnss(road, sigma=2.0, seed=seed)
    faded = np.where(road.time > back, np.exp((back - road.time) / 12.0), 0.0)
    fix[:, :2] += np.outer(faded, biased)
    return fix, np.flatnonzero((road.time < back - 8.0) | (road.time > back))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("biased", [(40.0, 0.0), (-40.0, 0.0), (15.0, 25.0)])
def test_satellites_found_again_in_a_wrong_place_are_doubted(
    seed: int, biased: tuple[float, float]
):
    """A receiver alone is silent for eight seconds.  For half a minute it is then drawn in."""
    road = drive_along([[500.0, -1.75], [1600.0, -1.75]])
    every = np.arange(0, len(road.time), 10)
    road = Truth(*(column[every] for column in road))
    fix, heard = found_again(road, seed, biased, 45.0)
    epochs = epochs_of(road, fix, heard)[heard]
    epochs.odometry_valid = 0
    output = localize(network(straight_road(9000.0)), epochs, mode=CLOCK).output
    error = np.hypot(output.rows.x - road.x[heard], output.rows.y - road.y[heard])
    assert (error <= output.rows.protection_level).mean() > 0.97


def beside_speeds(
    seed: int, biased: tuple[float, float], every: int, lag: str | None
) -> tuple[Output, np.ndarray]:
    """The same with reported speeds, in the main road and round a corner; errors, m."""
    road = drive_along([[500.0, -1.75], [801.75, -1.75], [801.75, 850.0]])
    fix, heard = found_again(road, seed, biased, 22.0)
    heard = heard[heard % every == 0]
    epochs = epochs_of(road, fix, heard)[heard]
    epochs.odometry_valid = 0
    epochs.speed, epochs.speed_sigma = 10.0, 0.1
    epochs.course_sigma = 0.02
    output = localize(T_JUNCTION, epochs, mode=CLOCK, lag=lag).output
    return output, np.hypot(output.rows.x - road.x[heard], output.rows.y - road.y[heard])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("biased", [(0.0, 50.0), (35.0, -35.0)])
def test_satellites_found_in_a_wrong_place_are_doubted_where_speeds_are_reported_too(
    seed: int, biased: tuple[float, float]
):
    """Ten fixes a second; the map is not to blame."""
    output, error = beside_speeds(seed, biased, 1, None)
    assert (error <= output.rows.protection_level).mean() > 0.97
    assert not ((output.rows.edge == OTHER) & (output.rows.p_edge >= 0.999)).any()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("biased", [(60.0, 0.0), (35.0, -35.0)])
def test_the_smoother_knows_that_the_error_was_another_one(seed: int, biased: tuple[float, float]):
    output, error = beside_speeds(seed, biased, 10, "full")
    assert (error <= output.rows.protection_level).mean() > 0.98
    assert np.sqrt((error**2).mean()) < 5.0
