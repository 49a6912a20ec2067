"""Wheels, gyro, antenna, clocks and the receiver's errors by the statistics of `diagnose`.

The statistics of all drives of a car are summed.  What they say is put into the car, and its
drives are filtered anew, until nothing changes beyond its error.  Intervals are by leaving out
one drive at a time, so that what is common to a drive (its route, its sky) is in them, and by what
the method errs by on simulated cars: track width and antenna are told apart by bends alone.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from ..diagnosis.statistics import ConsistencyStatistics
from ..errors import DriveError
from ..settings import Settings, Vehicle
from .across import across_of
from .drives_run import Answer, Bench
from .quantities import (
    ACROSS,
    CLOCK,
    GNSS_SIGMA,
    GNSS_TIME,
    GNSS_WHITE,
    METHOD,
    SCALE,
    stepped,
    untold,
    values_of,
    with_values,
)

_MOST = 8  # rounds
_LITTLE = 0.1  # of the standard error, below which a change is none
_ANSWERED = 0.85  # share of a change that one round usually finds
_BOTH = 1.96  # sigmas of a 95 % interval
_GRID_ERROR = 0.025  # log, of the grid in which errors are sought

Values = dict[str, float]
One = TypeVar("One")


class Found(NamedTuple):
    """Estimates and half of their 95 % intervals."""

    values: Values
    half: Values
    rounds: int


def settle(
    bench: Bench, start: Vehicle, chosen: Sequence[int], names: Sequence[str],
    tell: Callable[[str], None],
) -> Found:  # fmt: skip
    """Filter and correct a car in turns until its numbers rest.

    Args:
        bench: Of its drives.
        start: The car as it was thought to be.
        chosen: Drives that are used.
        names: What their odometry can tell of.
        tell: Called with what is done.

    Raises:
        DriveError: Too little was driven with wheels and fixes.
    """
    log = bench.drives[chosen[0]].odometry
    assert log is not None
    known = values_of(start, start)
    values = {name: known[name] for name in known}
    values[CLOCK] -= bench.delay(chosen)
    first: Values = {}
    answered = dict.fromkeys(names, _ANSWERED)
    for number in range(_MOST):
        tell(f"round {number + 1}")
        answers = bench.run(with_values(start, values, log), chosen)
        if number == 0:
            values, again = _from_far(values, answers)
            if again:
                continue
        sums = [answer.statistics for answer in answers]
        whole = _pooled(sums)
        if sum(one.moving for one in sums) < 600.0 or not math.isfinite(whole.shift()[2]):
            driven = sum(one.moving for one in sums) / 60.0
            raise DriveError(
                f"calibrate: too little was driven with fixes and odometry ({driven:.1f} min, "
                "turns among them); ten minutes of driving with both were expected; give more "
                "drives of the car"
            )
        now = stepped(values, whole)
        parts = [_pooled(part) for part in _left_out(sums)]
        apart = [stepped(values, part) for part in parts]
        blind = untold(whole).union(*map(untold, parts))  # what does not move is not known
        sigma = {
            name: math.inf if name in blind else _spread([one[name] for one in apart])
            for name in names
        }
        step = {name: now[name] - values[name] for name in names}
        for name in names:
            if name in first and abs(first[name]) > 4.0 * sigma[name]:
                answered[name] = min(max(1.0 - step[name] / first[name], 0.5), 1.0)
        first = first or step
        values |= {name: now[name] for name in names}
        if all(abs(step[name]) <= _LITTLE * sigma[name] for name in names):
            break
    wide = student_t(max(len(chosen) - 1, 1))
    half = {
        name: math.hypot(wide * sigma[name] / answered[name], _BOTH * METHOD[name])
        for name in names
    }
    noise, noise_half = _noise(answers, wide)
    return Found({name: values[name] for name in names} | noise, half | noise_half, number + 1)


def _from_far(values: Values, answers: Sequence[Answer]) -> tuple[Values, bool]:
    """The scale, where most drives say that the odometry was withheld for its distance."""
    found = [
        finding.statistic
        for answer in answers
        for finding in answer.findings
        if finding.what == "odometry: distance" and finding.statistic > 0.0
    ]
    if 2 * len(found) <= len(answers):
        return values, False
    return values | {SCALE: values[SCALE] / float(np.median(found))}, True


def _pooled(sums: Sequence[ConsistencyStatistics]) -> ConsistencyStatistics:
    return sums[0].together(sums[1:])


def _left_out(drives: Sequence[One]) -> list[list[One]]:
    """All but one, for each of them."""
    n = len(drives)
    return [[*drives[:k], *drives[k + 1 :]] for k in range(n)] if n > 1 else [list(drives)]


def _spread(values: Sequence[float]) -> float:
    """Standard error by leaving one out; infinite of a single drive."""
    n = len(values)
    return math.sqrt((n - 1) * float(np.var(values))) if n > 1 else math.inf


def student_t(freedom: int) -> float:
    """What |t| stays below with P = 0.95; the whole degrees of freedom make it a finite sum.

    Abramowitz and Stegun, 26.7.3 and 26.7.4, in the angle atan(t / sqrt(freedom)).
    """
    below, above = 0.0, 0.5 * math.pi
    while True:
        angle = 0.5 * (below + above)
        if not below < angle < above:
            return math.sqrt(freedom) * math.tan(angle)
        if _within(angle, freedom) < 0.95:
            below = angle
        else:
            above = angle


def _within(angle: float, freedom: int) -> float:
    odd = freedom % 2
    term, total = (math.cos(angle) if odd else 1.0), 0.0
    for k in range(2 + odd, freedom + 1, 2):
        total += term
        term *= math.cos(angle) ** 2 * (k - 1) / k
    total *= math.sin(angle)
    return 2.0 / math.pi * (angle + total) if odd else total


def _noise(answers: Sequence[Answer], wide: float) -> tuple[Values, Values]:
    """Errors of the receiver and of the map; none where the wheels hide them."""
    if _pooled([answer.statistics for answer in answers]).hidden:
        return {}, {}
    found = _errors(answers)
    apart = [_errors(part) for part in _left_out(answers)]
    half = {
        name: wide * math.hypot(_spread([one[name] for one in apart]), _GRID_ERROR * value)
        for name, value in found.items()
    }
    return found, {name: value for name, value in half.items() if value == value}


def _errors(answers: Sequence[Answer]) -> Values:
    sums = _pooled([answer.statistics for answer in answers])
    errors = sums.errors()
    return {
        GNSS_SIGMA: math.sqrt(errors.size),
        GNSS_TIME: errors.time * sums.settings.gnss_time,
        GNSS_WHITE: math.sqrt(errors.white),
        ACROSS: across_of([answer.across for answer in answers], sums),
    }


def noise_of(values: Mapping[str, float], settings: Settings) -> dict[str, float]:
    """Settings for the errors of receiver and map, as far as they were found."""
    noise: dict[str, float] = {}
    if GNSS_TIME in values:
        noise["gnss_time"] = values[GNSS_TIME]
    if GNSS_SIGMA in values and GNSS_WHITE in values:
        noise["gnss_white_ratio"] = min(max(values[GNSS_WHITE] / values[GNSS_SIGMA], 0.01), 10.0)
    if GNSS_SIGMA in values:
        noise["gnss_start"] = min(max(values[GNSS_SIGMA], 1.0), 100.0)
    if ACROSS in values:
        rest = values[ACROSS] ** 2 - settings.relative_sigma**2 - settings.lane_sigma**2
        noise["map_sigma"] = math.sqrt(max(rest, 0.25 * values[ACROSS] ** 2))
    return noise
