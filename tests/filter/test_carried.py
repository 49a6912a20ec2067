"""A vehicle that is carried while its wheels stand and it sees no satellites."""

import numpy as np
import pytest

from scenes import Truth, epochs_of, gnss, localize, network, straight_road
from whichroad._compile import Records
from whichroad.filter.state import DISTANCE, WHEELS

ROADS = network(straight_road(6000.0))
ABOARD, ASHORE = 400, 3000  # epochs, 10 a second: it stands from here, and drives off


def crossing(carried: float, back: int, wrong: float = 0.0) -> tuple[Truth, Records]:
    """30 s along a road, carried along it while no fix comes, and on.

    Args:
        carried: m.
        back: Epochs before it drives off when fixes come again.
        wrong: m, by which the fixes of the first 10 s are off then.
    """
    speed = np.zeros(ASHORE + 900)
    speed[:300] = speed[ASHORE:] = 10.0
    ramp = np.arange(30) / 30.0
    speed[270:300], speed[ASHORE : ASHORE + 30] = 10.0 * ramp[::-1], 10.0 * ramp
    s = np.cumsum(0.1 * speed)
    x = 500.0 + s + carried * (np.arange(len(s)) >= 1500)
    n = len(s)
    truth = Truth(0.1 * np.arange(n), x, np.full(n, -1.75), np.zeros(n), s)
    at = np.concatenate([np.arange(0, ABOARD, 10), np.arange(ASHORE - back, n, 10)])
    fix = gnss(truth, sigma=2.0, seed=3)
    fix[ASHORE - back : ASHORE - back + 100, 1] += wrong
    epochs = epochs_of(truth, fix, at)
    epochs.forward = epochs.arc
    return truth, epochs


def wrong_by(rows: Records, truth: Truth) -> np.ndarray:
    return np.hypot(rows.x - truth.x, rows.y - truth.y)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
@pytest.mark.parametrize("carried", [400.0, 1500.0])
@pytest.mark.parametrize("back", [400, 20])
def test_it_is_found_where_its_fixes_are(mode: int, carried: float, back: int):
    truth, epochs = crossing(carried, back)
    rows = localize(ROADS, epochs, mode=mode).output.rows
    seen = np.arange(len(truth.time)) >= ASHORE - back
    assert (wrong_by(rows, truth) < rows.protection_level)[seen].all()
    assert wrong_by(rows, truth)[ASHORE + 100 :].max() < 10.0


def test_wrong_fixes_after_a_garage_do_not_carry_it():
    truth, epochs = crossing(0.0, 400, wrong=300.0)
    rows = localize(ROADS, epochs).output.rows
    assert wrong_by(rows, truth)[ABOARD:].max() < 10.0
    assert rows.protection_level[ASHORE - 350] > 200.0  # either may be
    assert rows.protection_level[ASHORE - 200] < 30.0
