"""The filter's kernels and the exact posterior describe one model."""

import numpy as np
import pytest

from oracles.reduced import SUITES, exact_modes, fork, model_of, reduced_modes, window_of
from whichroad.settings import Settings

NOTHING = Settings(prune=0.0, merge=0.0, components=8)
STEPS = 4  # the eight sequences that end on a road are all kept


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("fixes", [False, True])
@pytest.mark.parametrize("degrees", [5.0, 15.0])
def test_without_reduction_the_kernels_are_exact(degrees: float, fixes: bool, seed: int):
    suite = fork(degrees, seed, fixes=fixes)
    models = model_of(suite)[:STEPS]
    window = window_of(suite, models, seed)
    p, kept = reduced_modes(suite, models, window, NOTHING)
    assert kept[:3].tolist() == [2, 4, 8]
    assert kept[3] == 16 or p[3].max() > 1.0 - 1e-4  # where all is clear it merges anyway
    assert np.allclose(p, exact_modes(models, window), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("fixes", [False, True])
@pytest.mark.parametrize("name", SUITES)
def test_the_reduced_probabilities_are_probabilities(name: str, fixes: bool):
    suite = SUITES[name](0, fixes)
    models = model_of(suite)
    p, _ = reduced_modes(suite, models, window_of(suite, models, 0), Settings())
    assert np.allclose(p.sum(axis=1), 1.0, rtol=0.0, atol=1e-12)
    assert (p >= 0.0).all()
