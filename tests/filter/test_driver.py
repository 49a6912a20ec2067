"""How fast a vehicle drives, learnt between sparse fixes."""

import numpy as np
import pytest

from whichroad.filter.sparse.driver import PACE, SPEED_SIGMA, begin_driver, learn_leg
from whichroad.filter.speed_process import speed_process
from whichroad.filter.state import new_belief


def learnt(
    pace: float, sigma: float, legs: int = 40, seconds: float = 30.0, stops: int = 0,
    leads: bool = True,
):  # fmt: skip
    """The driver that is learnt from legs on roads of 15 m/s."""
    return way_learnt(pace, sigma, legs, seconds, stops, leads)[0]


def way_learnt(pace: float, sigma: float, legs: int, seconds: float, stops: int, leads: bool):
    """That driver, and the hypothesis that drove the legs."""
    belief = new_belief()
    driver, hyp = belief.state[0].driver, belief.hyp[0]
    begin_driver(driver)
    unit = speed_process(seconds, 1.0)
    random = np.random.default_rng(1)
    hyp.weight, hyp.along_sigma, hyp.leg.seconds, hyp.leg.free = 1.0, 3.0, seconds, 15.0
    hyp.leg.variance = 9.0
    for k in range(legs):
        metres = pace * 15.0 * (seconds - unit.distance_by_speed)
        metres += sigma * np.sqrt(unit.variance) * random.normal()
        hyp.along = metres if k >= stops else 0.0
        learn_leg(driver, hyp, unit.distance_by_speed, unit.variance, leads)
    return driver, hyp


def test_nothing_is_known_of_a_driver_at_first():
    driver = learnt(1.0, 1.0, legs=0)
    assert (driver.pace, driver.speed_sigma) == (PACE, SPEED_SIGMA)


@pytest.mark.parametrize("pace", [0.5, 0.9, 1.3])
def test_the_pace_of_an_even_driver_is_learnt(pace: float):
    driver = learnt(pace, 2.0)
    assert driver.pace == pytest.approx(pace, abs=0.07)
    assert driver.speed_sigma < 0.6 * SPEED_SIGMA


def test_an_uneven_driver_stays_uneven():
    assert learnt(0.8, 6.0).speed_sigma > 4.0


def test_a_few_stops_do_not_make_a_driver_slow():
    assert learnt(0.9, 2.0, stops=3).pace == pytest.approx(0.9, abs=0.1)


def test_a_hypothesis_has_a_pace_of_its_own():
    driver, hyp = way_learnt(0.4, 2.0, 40, 30.0, 0, leads=False)
    assert hyp.leg.pace == pytest.approx(0.4, abs=0.07)
    assert (driver.pace, driver.speed_sigma) == (PACE, SPEED_SIGMA)
