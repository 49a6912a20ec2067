"""A vehicle among fixes alone: they say that it stands, or nothing."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from scenes import localize, network, straight_road
from whichroad._compile import Records
from whichroad.filter.gnss.standstill import is_still
from whichroad.filter.records import new_epochs
from whichroad.filter.state import CLOCK, new_belief

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


@pytest.mark.parametrize("seconds", [1, 4])
@pytest.mark.parametrize("metres", [60.0, 300.0])
def test_fixes_where_no_car_can_have_come_to_do_not_end_a_stop(seconds: int, metres: float):
    path = along(STOP)
    path[80 : 80 + seconds, 1] += metres
    said = stood(path, 1.0)
    assert said[70:100].all()
    assert not said[104:].any()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("harder", [1.0, 3.0, 4.0])
@pytest.mark.parametrize("white", [0.5, 1.5, 3.0])
def test_who_drives_off_briskly_is_not_held(white: float, harder: float, seed: int):
    leaves = np.minimum(harder * np.arange(0.5, 30.0), 20.0)
    said = stood(along(np.concatenate([STOP[:100], leaves])), white, seed)
    shows = 3.5 * max(white, 0.5 * SIGMA) + 1.0 + 2.0 * white  # m
    late = math.ceil(math.sqrt(2.0 * shows / harder)) + 2
    assert not said[100 + late :].any()


def waiting(wrong: int, seed: int) -> tuple[Records, NDArray[np.float64]]:
    """Positions alone once a second: 40 s along a road, 60 s at rest, some wrong from 70 s on."""
    x = np.concatenate([np.arange(0.0, 400.0, 10.0), np.full(60, 400.0)])
    random = np.random.default_rng(seed)
    epochs = new_epochs(len(x))
    epochs.time[:] = np.arange(len(x))
    epochs.has_fix[:] = 1
    epochs.fix[:, 0] = x + random.normal(0.0, 1.0, len(x))
    epochs.fix[:, 1] = random.normal(0.0, 1.0, len(x))
    epochs.fix[70 : 70 + wrong, :2] += [180.0, 240.0]
    epochs.fix[:, 2:4] = SIGMA
    epochs.speed_sigma[:] = epochs.course_sigma[:] = np.inf
    return epochs, x


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("wrong", [1, 4])
@pytest.mark.parametrize("lag", [None, "full"])
def test_fixes_300_m_away_leave_a_waiting_vehicle_where_it_is(wrong: int, seed: int, lag: str):
    epochs, x = waiting(wrong, seed)
    rows = localize(network(straight_road()), epochs, mode=CLOCK, lag=lag).output.rows
    assert np.hypot(rows.x - x, rows.y).max() < 15.0


def test_beside_fixes_far_away_the_level_grows_and_then_they_are_believed():
    epochs, _ = waiting(30, 0)
    rows = localize(network(straight_road()), epochs, mode=CLOCK).output.rows
    away = np.hypot(rows.x - epochs.fix[:, 0], rows.y - epochs.fix[:, 1])
    assert (rows.protection_level[73:77] > 300.0).all()
    assert away[76] > 280.0
    assert away[80:].max() < 30.0


def test_misfits_of_a_waiting_vehicle_are_counted_in_a_row():
    """Four wrong fixes, a right one, and so on."""
    epochs, x = waiting(0, 0)
    for k in (75, 80, 85, 90):
        epochs.fix[k : k + 4, 1] += 300.0
    rows = localize(network(straight_road()), epochs, mode=CLOCK).output.rows
    assert np.hypot(rows.x - x, rows.y).max() < 15.0


@pytest.mark.parametrize("held", [4, 6])
def test_who_leaves_while_its_receiver_holds_the_place_is_followed_at_once(held: int):
    epochs, _ = waiting(0, 0)
    seconds = np.arange(0.5, 40.0)
    way = np.concatenate([np.full(60, 0.0), np.cumsum(np.minimum(2.5 * seconds, 14.0))])
    x = np.concatenate([np.arange(0.0, 400.0, 10.0), 400.0 + way])
    random = np.random.default_rng(held)
    epochs = np.rec.array(np.resize(epochs, len(x)))
    epochs.time[:] = np.arange(len(x))
    epochs.fix[:, 0] = x + random.normal(0.0, 1.0, len(x))
    epochs.fix[100 : 100 + held, 0] = epochs.fix[99, 0]
    rows = localize(network(straight_road()), epochs, mode=CLOCK).output.rows
    assert np.hypot(rows.x - x, rows.y)[102 + held :].max() < 15.0


def test_while_it_stands_the_receiver_s_error_goes_on():
    state, epoch = new_belief().state[0], new_epochs(1)[0]
    state.scale = 1.0
    for k in range(60):
        epoch.time, epoch.has_fix = float(k), True
        epoch.fix[:] = [5.0, 5.0, SIGMA, SIGMA, 0.0]
        is_still(state, epoch, 1.0, 2.5)
    assert 30.0 < state.moving < 60.0
