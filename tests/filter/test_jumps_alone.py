"""A receiver that is alone: its error is another one from one fix to the next."""

import numpy as np
import pytest

from scenes import column, drive_along, epochs_of, gnss, localize, network, parallel_roads
from whichroad._compile import Records
from whichroad.filter.state import CLOCK, DISTANCE
from whichroad.filter.summary.estimate import Output

ROADS = network(parallel_roads(20.0, 5000.0))
DRIVE = drive_along([[200.0, -1.75], [4200.0, -1.75]])
EVERY = np.arange(0, len(DRIVE.time), round(1.0 / (DRIVE.time[1] - DRIVE.time[0])))
FROM, TO = 100, 130  # fixes in which the receiver is 20 m off


def answer(mode: int, seed: int) -> Output:
    """Fixes of 3 m once a second; for half a minute they are on the other road."""
    fix = gnss(DRIVE, sigma=3.0, seed=seed, constant=30.0)
    fix[EVERY[FROM] : EVERY[TO], 1] += 20.0
    epochs = epochs_of(DRIVE, fix, EVERY)
    given: Records = epochs[EVERY].copy() if mode == CLOCK else epochs
    return localize(ROADS, given, mode=mode).output


def rows_at_fixes(output: Output) -> slice | np.ndarray:
    return slice(None) if len(output.rows.x) == len(EVERY) else EVERY


@pytest.mark.parametrize("mode", [CLOCK, DISTANCE])
def test_half_a_minute_of_reflections_beside_another_road_declares_nothing_wrong(mode):
    declared = back = 0
    for seed in range(8):
        output = answer(mode, seed)
        at = rows_at_fixes(output)
        y, p = output.rows.y[at], column(output, "p_edge")[at]
        wrong = (np.abs(y - DRIVE.y[EVERY]) > 10.0) & (p >= 0.999)
        declared += wrong.any()
        back += bool(np.all(np.abs(y[TO + 60 :] - DRIVE.y[EVERY][TO + 60 :]) < 10.0))
    assert declared == 0
    assert back == 8


def test_what_was_sound_stays_declared():
    """Before the reflections, and long after them."""
    for seed in range(4):
        output = answer(CLOCK, seed)
        p = column(output, "p_edge")
        assert np.median(p[60:FROM]) > 0.999
        assert np.median(p[TO + 120 :]) > 0.99
