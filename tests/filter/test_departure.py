"""Vehicles that are not where their odometer puts them: the level covers it until it is found."""

import numpy as np
import pytest

from scenes import (
    brake,
    columns,
    drive_along,
    epochs_of,
    gnss,
    localize,
    network,
    straight_road,
)
from whichroad.filter.state import DISTANCE, WHEELS

STOP, STOOD = 600, 200  # epochs, ten a second: when it comes to rest, and for how long
OFF = STOP + STOOD  # when it drives off


def at_a_stop(seed: int, *, stuck: bool, speeds: bool, drift: float = 0.0):
    """A vehicle that stands for 20 s at 600 m and drives on; counters may be stuck from there on.

    Args:
        seed: Of the receiver.
        stuck: Whether the counters never move again.
        speeds: Whether the receiver reports speeds.
        drift: m/s, of the fixes, along the road while it stands.
    """
    truth = drive_along([[0.0, -1.75], [1500.0, -1.75]])
    stood, rows = brake(truth, STOP, STOOD, goes_on=True)
    fix = gnss(truth, sigma=3.0, seed=seed)[rows]
    fix[:, :2] += np.random.default_rng(seed).normal(0.0, 0.5, (len(rows), 2))
    standing = np.clip(np.arange(len(rows)) - STOP, 0, STOOD) * 0.1
    fix[:, 0] += drift * standing
    epochs = epochs_of(stood, fix, np.arange(0, len(rows), 10), course=0.1)
    if stuck:
        for name in ("arc", "turn", "forward", "left"):
            epochs[name][STOP + 20 :] = 0.0
    if speeds:
        epochs.speed, epochs.speed_sigma = np.gradient(stood.s, stood.time), 0.2
    return stood, epochs


def beyond(truth, epochs, mode: int, lag: str | None = None):
    """Whether each epoch's error exceeds its level, the levels, and the P of being off the map."""
    output = localize(network(straight_road()), epochs, mode=mode, lag=lag).output
    x, y, level, off = columns(output, "x y protection_level p_off_road").T
    return np.hypot(x - truth.x, y - truth.y) > level, level, off


@pytest.mark.parametrize("speeds", [True, False])
@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
@pytest.mark.parametrize("seed", range(4))
def test_the_level_covers_a_vehicle_that_has_driven_off(mode: int, seed: int, speeds: bool):
    """Counters are found out when it is 70 m away, and 40 m where the receiver's speed is known."""
    exceeded, _, off = beyond(*at_a_stop(seed, stuck=True, speeds=speeds), mode)
    assert exceeded[STOP:].sum() <= 10
    assert off[OFF + (40 if speeds else 60)] > 0.05


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
@pytest.mark.parametrize("seed", range(4))
def test_smoothing_covers_it_too(mode: int, seed: int):
    exceeded, _, off = beyond(*at_a_stop(seed, stuck=True, speeds=True), mode, "full")
    assert exceeded[STOP:].sum() <= 10
    assert off[OFF + 40] > 0.05


@pytest.mark.parametrize("seed", range(4))
def test_a_receiver_that_says_the_vehicle_stands_is_believed_where_its_fixes_drift(seed: int):
    exceeded, level, off = beyond(*at_a_stop(seed, stuck=False, speeds=True, drift=1.5), WHEELS)
    assert not exceeded.any()
    assert level[OFF - 1] < 25.0  # its fixes are 30 m away
    assert off[OFF - 1] < 0.01


@pytest.mark.parametrize("seed", range(4))
def test_nothing_but_fixes_that_drift_says_that_they_may_be_right(seed: int):
    exceeded, level, off = beyond(*at_a_stop(seed, stuck=False, speeds=False, drift=1.5), WHEELS)
    assert level[OFF - 1] > 30.0
    assert 0.01 < off[OFF - 1] < 0.5
    assert off[OFF + 100] < 0.01  # its counters have moved on since
    assert not exceeded.any()


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
@pytest.mark.parametrize("seed", range(3))
def test_columns_of_zeros_hold_a_vehicle_back_for_a_minute_only(mode: int, seed: int):
    """Counters and the receiver's speed are 0 from the start, and the fixes drive off."""
    truth = drive_along([[0.0, -1.75], [2500.0, -1.75]])
    fix = gnss(truth, sigma=3.0, seed=seed)
    epochs = epochs_of(truth, fix, np.arange(0, len(fix), 10), course=0.1)
    for name in ("arc", "turn", "forward", "left"):
        epochs[name] = 0.0
    epochs.speed, epochs.speed_sigma = 0.0, 0.2
    epochs.course_sigma = np.inf
    exceeded, level, off = beyond(truth, epochs, mode)
    assert exceeded[:200].mean() < 0.6  # until the fixes are further away than positions drift
    assert not exceeded[200:].any()
    assert (off[200:600] > 0.2).all()
    assert level[-1] < 30.0
    assert off[-1] < 0.01


@pytest.mark.parametrize("seed", range(6))
def test_who_turns_into_an_unmapped_street_is_not_sure_of_the_road_that_it_has_left(seed: int):
    """By an odometer and positions alone: once 25 m away no road is declared."""
    truth = drive_along([[0.0, -1.75], [600.0, -1.75], [600.0, 300.0]])
    epochs = epochs_of(truth, gnss(truth, sigma=2.0, seed=seed), np.arange(0, len(truth.time), 10))
    exceeded, _, off = beyond(truth, epochs, DISTANCE)
    away = truth.y > 25.0
    assert exceeded[100:].sum() <= 10
    assert (off[away] > 0.001).all()
    assert (off[truth.y > 100.0] > 0.5).all()


@pytest.mark.parametrize("seed", range(6))
def test_an_odometer_on_its_road_is_not_thought_to_have_left_it(seed: int):
    truth = drive_along([[0.0, -1.75], [1500.0, -1.75]])
    epochs = epochs_of(truth, gnss(truth, sigma=3.0, seed=seed), np.arange(0, len(truth.time), 10))
    exceeded, level, off = beyond(truth, epochs, DISTANCE)
    assert not exceeded[100:].any()
    assert (off[300:] < 0.01).all()
    assert level[-1] < 20.0
