"""Delays that are tried by the steps between fixes, beside the one that is learnt."""

import math

import numpy as np
import pytest

from whichroad.filter.vetting.delay_filter import DELAY
from whichroad.filter.vetting.delays_tried import TRIED, delay_of, forget_tried, refuted_by, score
from whichroad.filter.vetting.latency import (
    FIXES,
    LATENCY,
    PUNCTUAL,
    clear_latency,
    decide,
    p_late,
)
from whichroad.graph.network import records


def braking(delay: float, seed: int):
    """A latency whose delays were tried: from 20 m/s to rest at 5 m/s², fixes late by so much."""
    rng = np.random.default_rng(seed)
    latency = records(1, LATENCY)[0]
    clear_latency(latency)
    time = np.arange(0.0, 20.0)

    def place(t: np.ndarray) -> np.ndarray:
        braked = np.clip(t - 8.0, 0.0, 4.0)
        return 20.0 * np.minimum(t, 12.0) - 2.5 * braked**2

    fixes = place(time - delay) + rng.normal(0.0, 1.0, len(time))
    for k in range(5, len(time)):
        for j in range(TRIED):
            then = place(time[k - 1 : k + 1] - delay_of(j))
            step = float(fixes[k] - fixes[k - 1]), 0.0
            score(latency.tried, j, step, (float(then[1] - then[0]), 0.0), 2.0)
    return latency


@pytest.mark.parametrize("seed", range(4))
def test_one_brake_tells_which_delay_it_is(seed: int):
    for delay in (0.0, 1.0, 2.0):
        tried = braking(delay, seed).tried
        best = delay_of(int(np.argmax(tried.score)))
        assert abs(best - delay) <= 0.5
        if delay != 1.0:
            assert (refuted_by(tried, 2.0) > 5.0) == (delay == 0.0)
    assert refuted_by(tried, 0.3) == -math.inf  # it is not told from none
    forget_tried(tried)
    assert refuted_by(tried, 2.0) == 0.0


def test_a_delay_that_the_steps_refute_is_forgotten_however_sure_it_is():
    """It was learnt while the vehicle braked, about one that was wrong by as much as that took."""
    for delay, late in ((0.0, PUNCTUAL), (1.5, FIXES)):
        latency = braking(delay, 1)
        latency.estimate.state[DELAY], latency.estimate.cov[DELAY, DELAY] = 1.6, 0.01
        latency.turns.state[DELAY], latency.turns.cov[DELAY, DELAY] = 1.6, 0.01
        latency.estimate.misfit, latency.late, latency.time = 1.0, FIXES, 100.0
        assert (p_late(latency) < 0.01) == (late == PUNCTUAL)
        decide(latency)
        assert latency.late == late
        assert (latency.estimate.state[DELAY] == 0.0) == (late == PUNCTUAL)
