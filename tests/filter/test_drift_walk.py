"""How fast the drift of wheels changes, as learnt."""

import numpy as np

from whichroad.filter.vetting.drift_walk import WALK, forget_walk, learn_walk
from whichroad.graph.network import records

USUAL = 2e-6**2  # rad²/m³
VARIANCE = 3e-5**2  # rad²/m²


def learnt(drifts: np.ndarray, every: float = 5.0) -> np.ndarray:
    """What is added to the walk after each estimate of the drift."""
    walk = records(1, WALK)
    more = []
    for k, drift in enumerate(drifts):
        learn_walk(walk[0], float(drift), VARIANCE, k * every, USUAL)
        more.append(float(walk[0]["more"]))
    return np.array(more)


def test_sound_wheels_walk_as_usual():
    steps = np.random.default_rng(1).normal(0.0, 2e-6 * np.sqrt(5.0), 2000)
    assert np.mean(learnt(1e-3 + np.cumsum(steps))) < USUAL


def test_a_drift_that_changes_is_followed_and_believed_again():
    more = learnt(np.concatenate([np.zeros(100), np.linspace(0.0, 4e-3, 200), np.full(1000, 4e-3)]))
    assert more[99] == 0.0
    assert (np.sqrt(more[120:300]) > 5e-6).all()
    assert more[-1] < 0.02 * more[300]


def test_what_is_drawn_anew_is_not_compared():
    walk = records(1, WALK)
    learn_walk(walk[0], 0.0, VARIANCE, 0.0, USUAL)
    forget_walk(walk[0])
    learn_walk(walk[0], 1e-2, VARIANCE, 60.0, USUAL)
    assert walk[0]["more"] == 0.0
    learn_walk(walk[0], 0.0, VARIANCE, 3000.0, USUAL)  # as where the odometer begins anew
    assert walk[0]["more"] == 0.0
