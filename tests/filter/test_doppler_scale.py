"""The scale of a receiver by its fixes and velocities: no road beside a vehicle makes it worse."""

import math

import numpy as np
import pytest

from whichroad.filter.gnss.doppler_scale import compare_with_velocity, largest_factor
from whichroad.filter.state import new_belief, new_epochs

SIGMA, SPEED, BEGIN = 3.0, 12.0, 1.6e9


def after(drift: float, chi2: float, seconds: int = 180, course: bool = True) -> float:
    """The largest factor after a drive whose fixes drift by so many metres in half a minute."""
    rng = np.random.default_rng(0)
    state = new_belief().state[0]
    state.scale = 1.0
    state.separation.unmapped.chi2 = chi2
    epoch = new_epochs(1)[0]
    epoch.has_fix, epoch.speed, epoch.speed_sigma = 1, SPEED, 0.1
    epoch.course, epoch.course_sigma = 0.0, 0.05 if course else math.inf
    for k in range(seconds):
        state.time = epoch.time = BEGIN + k
        error = rng.normal(0.0, 1.0, 2) + drift * np.sin(k / 30.0 * np.pi + np.arange(2))
        epoch.fix[:2] = SPEED * k + error[0], error[1]
        epoch.fix[2] = epoch.fix[3] = SIGMA
        compare_with_velocity(state, epoch)
    return largest_factor(state)


def test_fixes_that_agree_with_their_velocities_show_that_the_road_beside_is_another_one():
    assert after(1.0, 100.0) < 3.0


def test_fixes_that_drift_against_their_velocities_are_as_bad_as_they_are():
    assert after(15.0, 100.0) > 9.0


@pytest.mark.parametrize(("chi2", "course"), [(10.0, True), (100.0, False)])
def test_near_a_road_and_without_velocities_nothing_limits_the_scale(chi2: float, course: bool):
    assert after(1.0, chi2, course=course) == math.inf


def test_a_minute_later_it_is_forgotten_that_fixes_lay_beside_the_road():
    state = new_belief().state[0]
    state.separation.doppler.until, state.separation.doppler.time = BEGIN, BEGIN + 59.0
    state.time = BEGIN + 60.0
    assert largest_factor(state) == math.inf
