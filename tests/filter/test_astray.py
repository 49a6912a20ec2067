"""Fixes that err lead a vehicle off the roads: the level covers where it may be on them."""

import math

import numpy as np
import pytest

from scenes import Truth, brake, context, drive_along, epochs_of, gnss, grid_town, localize, network
from whichroad.filter.gnss.bias import may_lead_astray
from whichroad.filter.state import CLOCK, OFF_ROAD, X, Y, new_belief
from whichroad.filter.summary.estimate import new_output, summarise

TOWN = network(grid_town(9, 9, 110.0))
ROUTE = np.array([[0, 0], [3, 0], [3, 3], [6, 3], [6, 6], [8, 6]], float) * 110.0
DRIVE = drive_along(ROUTE)
RISK = 1e-3


def above(truth: Truth, away: np.ndarray, at: np.ndarray, turned: float, seed: int) -> int:
    """How many epochs of a receiver that measures speed and course are above the level.

    Args:
        truth: The drive.
        away: (n,) m, by which fixes err more than usually,
        turned: and where to, rad.
        at: Epochs with a fix.
        seed: Of the usual error.
    """
    fix = gnss(truth, sigma=2.0, seed=seed)
    fix[:, 0] += away * math.cos(turned)
    fix[:, 1] += away * math.sin(turned)
    speed = np.hypot(np.gradient(truth.x, truth.time), np.gradient(truth.y, truth.time))[at]
    epochs = epochs_of(truth, fix, at)[at].copy()
    epochs.speed, epochs.speed_sigma = speed, 0.3
    epochs.course_sigma = np.where(speed > 1.0, 0.05, np.inf)
    rows = localize(TOWN, epochs, mode=CLOCK).output.rows
    error = np.hypot(rows.x - truth.x[at], rows.y - truth.y[at])
    return int(((error > rows.protection_level) & (speed > 0.5)).sum())


def test_a_receiver_found_again_in_a_wrong_place_stays_below_the_level():
    """Silent for 8 s, then 45 m off and pulled in: it seems to drive off the roads."""
    begin = 70.0
    since = DRIVE.time - begin
    away = np.where(since >= 0.0, 45.0 * np.exp(-since / 15.0), 0.0)
    at = np.arange(0, len(DRIVE.time), 10)
    at = at[(since[at] < -8.0) | (since[at] >= 0.0)]
    assert sum(above(DRIVE, away, at, 4.7, seed) for seed in range(4)) == 0


@pytest.mark.parametrize("turned", [0.5, 2.6, 4.7])
def test_fixes_that_drift_off_while_the_vehicle_stands_stay_below_the_level(turned: float):
    """It is looked for anew at them, while its receiver says that it stands."""
    stood, _ = brake(DRIVE, 700, 600, goes_on=True)
    rests = np.flatnonzero(np.hypot(np.gradient(stood.x), np.gradient(stood.y)) < 0.01)
    since, left = stood.time - stood.time[rests[0]], stood.time - stood.time[rests[-1]]
    away = np.clip(1.4 * since, 0.0, 50.0) * np.exp(-left.clip(0.0) / 6.0)
    at = np.arange(0, len(stood.time), 10)
    assert sum(above(stood, away, at, turned, seed) for seed in range(4)) == 0


@pytest.mark.parametrize("off", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("factor", [1.0, 1e-3])
def test_the_level_covers_as_much_as_is_off_the_roads_and_no_fine_receiver(off, factor):
    belief = new_belief()
    state = belief.state[0]
    state.count, state.scale = 2, 1.0
    belief.hyp["cov"][:2, [X, Y], [X, Y]] = 1.0
    belief.hyp.edge[:2] = 0, OFF_ROAD
    belief.hyp.weight[:2] = 1.0 - off, off
    belief.hyp.log_weight[:2] = np.log(np.maximum(belief.hyp.weight[:2], 1e-300))
    state.bias_root[:] = 3.0 * factor, 0.0, 3.0 * factor
    may_lead_astray(state, 0.2)
    output = new_output(1, False)
    summarise(belief, context(TOWN, protection_risk=RISK), output, 0, 0.0)
    row = output.rows[0]
    usual = math.sqrt(2.0 * math.log(1.0 / RISK))
    far = 30.0 * math.sqrt(2.0 * math.log(0.2 * off / RISK)) if off > 0.0 and factor == 1.0 else 0.0
    assert row.protection_level == pytest.approx(max(usual, far), rel=1e-3)
    assert row.cov[0] == pytest.approx(1.0 + (0.2 * off * 900.0 if far else 0.0))
