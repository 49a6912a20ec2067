"""A vehicle among fixes alone: they say that it stands, or nothing."""

import numpy as np
import pytest
from numpy.typing import NDArray

from whichroad.filter.gnss.standstill import is_still
from whichroad.filter.records import new_epochs
from whichroad.filter.state import new_belief

SIGMA = 3.0  # m, reported


def stood(path: NDArray[np.float64], white: float, seed: int = 0) -> NDArray[np.bool_]:
    """What is said at each fix of a path (n, 2), one a second, by its fixes and their noise."""
    state, epoch = new_belief().state[0], new_epochs(1)[0]
    state.scale = 1.0
    state.white_factor = (white / SIGMA) ** 2
    noise = white * np.random.default_rng(seed).normal(size=path.shape)
    said = []
    for k, at in enumerate(path + noise):
        epoch.time, epoch.has_fix = 100.0 + k, True
        epoch.fix[:] = [*at, SIGMA, SIGMA, 0.0]
        said.append(is_still(state, epoch, 1.0, 2.5))
    return np.array(said)


def along(speed: NDArray[np.float64]) -> NDArray[np.float64]:
    x = np.cumsum(speed)
    return np.column_stack([x, 0.0 * x])


STOP = np.concatenate([np.full(40, 10.0), np.zeros(60), np.arange(1.0, 11.0), np.full(30, 10.0)])


@pytest.mark.parametrize("white", [0.0, 1.0])
def test_a_stop_is_seen_and_so_is_its_end(white: float):
    said = stood(along(STOP), white)
    assert not said[:45].any()
    assert said[70:100].all()
    assert not said[104:].any()


@pytest.mark.parametrize("speed", [0.8, 2.0, 10.0])
@pytest.mark.parametrize("white", [0.5, 3.0])
def test_who_drives_does_not_stand(speed: float, white: float):
    assert not any(stood(along(np.full(300, speed)), white, seed).any() for seed in range(5))


def test_who_creeps_is_not_held_for_long():
    said = stood(along(np.full(600, 0.3)), 0.5)
    held = np.diff(np.flatnonzero(~said))
    assert held.max() <= 2.0 * SIGMA / 0.3 + 15.0


def test_while_it_stands_the_receiver_s_error_goes_on():
    state, epoch = new_belief().state[0], new_epochs(1)[0]
    state.scale = 1.0
    for k in range(60):
        epoch.time, epoch.has_fix = float(k), True
        epoch.fix[:] = [5.0, 5.0, SIGMA, SIGMA, 0.0]
        is_still(state, epoch, 1.0, 2.5)
    assert 30.0 < state.moving < 60.0
