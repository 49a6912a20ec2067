"""Speed and course of a receiver alone: late, and wrong at times."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracles.textbook import condition
from scenes import On, belief_on, context, drive_along, epochs_of, grid_town, network, steps
from scenes import gnss as fixes_of
from strategies import UNITS, gaussians
from whichroad._compile import Records
from whichroad.filter.gnss.position import observe_state
from whichroad.filter.gnss.reported_motion import latency_of, observe_motion
from whichroad.filter.state import CLOCK, WHEELS, H, K, N, new_epochs

TOWN = network(grid_town())
BLOCKS = [(0, 0), (1, 0), (1, 1), (2, 1), (2, 2), (3, 2), (3, 3), (4, 3), (4, 4)]
DRIVE = drive_along([(120 * i, 120 * j) for i, j in BLOCKS])
EVERY = np.arange(0, len(DRIVE.time), round(1.0 / (DRIVE.time[1] - DRIVE.time[0])))
CTX = context(TOWN)


def reports(late: float, sigma: float) -> Records:
    """Fixes with speed and course as they were `late` seconds ago."""
    epochs = epochs_of(DRIVE, fixes_of(DRIVE, sigma=2.0, seed=1), EVERY)[EVERY].copy()
    when = DRIVE.time[EVERY] - late
    heading = np.interp(when, DRIVE.time, np.unwrap(DRIVE.heading))
    epochs.course, epochs.course_sigma = np.angle(np.exp(1j * heading)), 0.05
    speed = np.gradient(DRIVE.s, DRIVE.time)
    epochs.speed, epochs.speed_sigma = np.interp(when, DRIVE.time, speed), sigma
    return epochs


@pytest.mark.parametrize("late", [0.0, 0.5, 1.0, 2.0])
def test_courses_in_turns_show_how_late_they_are(late: float):
    """A corner takes some seconds, so that two seconds show as one at least."""
    *_, (_, belief, _) = steps(TOWN, reports(late, 0.5), mode=CLOCK)
    assert min(late, 1.3) - 0.5 < latency_of(belief.state[0], 0.1) < late + 0.5


@given(gaussians, st.sampled_from([H, K]), st.floats(-3.0, 3.0), st.floats(0.01, 1.0))
def test_a_report_moves_a_hypothesis_unless_chance_explains_it_better(gaussian, index, off, sigma):
    """Where it moves, it does by the Kalman update; the density of wrong reports is added."""
    row = np.zeros((1, N))
    row[0, index] = 1.0
    mean, cov, log_density = condition(
        gaussian.mean, gaussian.cov, row, np.array([off]), np.array([[sigma**2]])
    )
    for wrong in (0.0, 0.05):
        belief = belief_on(TOWN, [On(0, 60.0)])
        hyp = belief.hyp[0]
        hyp["mu"][:], hyp["cov"][:] = gaussian.mean, gaussian.cov
        observe_state(belief, CTX, index, float(gaussian.mean[index]) + off, sigma**2, wrong)
        kept = math.exp(log_density) < wrong
        np.testing.assert_allclose(
            hyp["mu"] / UNITS, (gaussian.mean if kept else mean) / UNITS, atol=1e-9
        )
        np.testing.assert_allclose(hyp["cov"], gaussian.cov if kept else cov, atol=1e-8)
        expected = np.logaddexp(log_density, math.log(wrong)) if wrong else log_density
        assert hyp.log_weight == pytest.approx(expected, abs=1e-9)


def test_a_zero_while_driving_stops_nobody():
    epochs = reports(0.0, 0.5)
    moving = np.flatnonzero(epochs.speed > 8.0)[5::10]
    epochs.speed[moving] = 0.0
    speed = {}
    for k, belief, _ in steps(TOWN, epochs, mode=CLOCK):
        top = belief.hyp[: belief.state[0].count]
        speed[k] = float(top["mu"][np.argmax(top.weight), K])
        assert np.isfinite(top["mu"][:, H]).all()
    assert min(speed[k] for k in moving) > 4.0


@pytest.mark.parametrize("late", [0.0, 2.0])
def test_late_courses_move_a_vehicle_that_turns_by_its_wheels_less(late: float):
    belief = belief_on(TOWN, [On(0, 60.0)])
    state, epoch = belief.state[0], new_epochs(1)[0]
    state.mode, state.speed, state.odometer_speed = WHEELS, 8.0, 8.0
    state.turn_rate[:] = 0.4
    state.reports.latency[:] = 10.0 * late, 10.0
    epoch.time, epoch.has_fix = 100.0, 1
    epoch.speed, epoch.speed_sigma, epoch.course_sigma = 8.0, 0.2, 0.05
    before = float(belief.hyp[0]["mu"][H])
    epoch.course = before + 0.3
    belief.hyp[0]["cov"][H, H] = 0.05**2
    observe_motion(belief, CTX, epoch, 1.0)
    moved = float(belief.hyp[0]["mu"][H]) - before
    assert (moved > 0.05) if late == 0.0 else (0.0 < moved < 0.02)


@pytest.mark.parametrize("interval", [0.1, 1.0])
def test_the_rate_of_a_report_is_that_of_a_second_however_often_it_comes(interval: float):
    belief = belief_on(TOWN, [On(0, 60.0)])
    state, epoch = belief.state[0], new_epochs(1)[0]
    state.mode, state.speed = CLOCK, 8.0
    epoch.has_fix, epoch.speed_sigma, epoch.course_sigma = 1, 0.2, np.inf
    for k in range(round(4.0 / interval)):
        epoch.time = 100.0 + interval * k
        epoch.speed = 5.0 + 3.0 * interval * k
        observe_motion(belief, CTX, epoch, 1.0)
    assert 2.5 < state.reports.speed[2] < 3.1
