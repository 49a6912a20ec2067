"""Smoothing is never worse than filtering: later observations only add information."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

import whichroad
from laws.drives import way_through
from laws.public import CAR, DISTANCE, GNSS, MODES, WHEELS, errors_of, geo_fixes, readings, road_map
from scenes import Truth, drive_along, gnss, grid_town

SEEDS = range(32)
SILENCE = 200  # epochs of 0.1 s
SETTLED = 50  # epochs after the start that are left out
HONEST = 1.1  # upper bound of the ANEES of 32 drives by chance; errors last a minute

# odometer after the outage
EXACT, STRETCHED, TAIL = "right afterwards", "20 % too long afterwards", "silent to the end"


def silent(truth: Truth, kind: str) -> tuple[Truth, np.ndarray]:
    """The drive as the odometer measures it, and the epochs with a reading."""
    n = len(truth.time)
    first = n - SILENCE if kind == TAIL else (n - SILENCE) // 2
    spoken = np.ones(n, bool)
    spoken[first : first + SILENCE] = False
    s = truth.s.copy()
    if kind == STRETCHED:
        last = first + SILENCE
        s[last:] += 0.2 * (s[last] - s[first - 1])
    return truth._replace(s=s), spoken


class Driven(NamedTuple):
    """A drive, what was observed of it, and the epochs that are judged."""

    truth: Truth
    observed: list[Any]
    judged: np.ndarray


@cache
def drives(mode: str, silence: str | None) -> list[Driven]:
    """One drive for each seed, made once for all lags."""
    found = []
    for seed in SEEDS:
        truth = drive(seed)
        n = len(truth.time)
        at = np.arange(0, n, 10)
        told, spoken = truth, np.ones(n, bool)
        judged = np.zeros(n, bool)
        judged[at] = True
        judged[:SETTLED] = False
        if silence:
            told, spoken = silent(truth, silence)
            judged &= ~spoken
        observed = geo_fixes(truth, gnss(truth, seed=seed), at, doppler=mode == GNSS)
        found.append(Driven(truth, observed + readings(told, mode, spoken), judged))
    return found


@cache
def town() -> whichroad.RoadMap:
    return road_map(grid_town())


@cache
def drive(seed: int) -> Truth:
    return drive_along(way_through(seed, 8))


@cache
def figures(mode: str, lag: object, silence: str | None = None) -> np.ndarray:
    """RMS of the position (m), ANEES of the position and of the bearing over all drives, (3,)."""
    roads = town()
    found = []
    for truth, observed, judged in drives(mode, silence):
        result = whichroad.match(observed, roads, vehicle=CAR, lag=lag)
        found.append([e.mean() for e in errors_of(result, truth, judged)])
    squared, nees, bearing = np.mean(found, axis=0)
    return np.array([np.sqrt(squared), 0.5 * nees, bearing])


def assert_not_worse(smoothed: np.ndarray, filtered: np.ndarray) -> None:
    """Compare the RMS error and both ANEES."""
    assert smoothed[0] <= filtered[0]
    assert (smoothed[1:] <= HONEST * np.maximum(filtered[1:], 1.0)).all()


@pytest.mark.parametrize("lag", [10, "full"])
@pytest.mark.parametrize("mode", MODES)
def test_smoothing_is_not_worse_than_filtering(mode: str, lag: object):
    assert_not_worse(figures(mode, lag), figures(mode, None))


@pytest.mark.parametrize("lag", [10, "full"])
@pytest.mark.parametrize("silence", [EXACT, STRETCHED, TAIL])
def test_smoothing_is_not_worse_than_filtering_while_the_wheels_are_silent(silence, lag):
    """No odometry for 20 s, fixes at 1 Hz; errors of these 20 s."""
    assert_not_worse(figures(WHEELS, lag, silence), figures(WHEELS, None, silence))


@pytest.mark.parametrize("silence", [EXACT, STRETCHED, TAIL])
def test_smoothing_is_not_worse_than_filtering_while_the_odometer_is_silent(silence):
    """Position only: the bearing is that of the road."""
    smoothed, filtered = (figures(DISTANCE, lag, silence)[:2] for lag in ("full", None))
    assert_not_worse(smoothed, filtered)
