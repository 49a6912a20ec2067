"""How late fixes are against the odometry of a recorded drive, by the distances that both tell.

Where the vehicle brakes or accelerates, distances that are late differ from those of the other
clock.  On line this is learnt while driving (`filter.vetting.latency`); of a whole drive it is
known before it begins, and delays of up to a minute are found as well.
"""

from typing import NamedTuple

import numpy as np

from ..geodesy.plane import Plane
from ..observations import Array, Fixes
from .odometry import Motion

_FEWEST, _MOST = 30, 300  # pairs of fixes
_APART, _PAIR, _LONGEST = 1.0, 2.0, 4.0  # s: between fixes that are used; of a pair
_FIRST: Array = np.array([-0.7, 0.0, 0.7])  # s, delays that are tried first,
_SOME = 3  # every so many pairs, by these,
_NEAR: Array = np.linspace(-6.0, 6.0, 49)  # then,
_FAR: Array = np.arange(-60.0, 61.0)  # and where none of these fits
_PACE = 0.5  # s over which a speed is taken,
_CHANGE, _CHANGES = (2.0,), (1.0, 2.0, 4.0)  # s, and its changes: usually; of short delays
_SHORT = 0.6  # s, below which receivers that smooth look alike
_OUTLIERS = 3.0  # sigmas, at which a difference counts no more
_FITS = 0.1  # share of the variance of distances that is left where a delay fits
_ALIKE, _BETTER = 2.5, 0.5  # s to either side; share of what is left by delays beyond
_WORTH = 0.35  # s
_SURE, _VERY_SURE = 60.0, 2500.0  # mean squares by which a delay reduces their sum; more where
_LOOSE = 3.0  # these are larger than the variance of fixes, times this at most
_PARTS, _OF_PARTS = 8, (-0.01, 0.8)  # of the drive; least and largest share of that reduction
_STEP, _STEADY, _SLIPS = 0.5, 0.1, 0.5  # s; m/s², from which on wheels may slip, and then do
_TRIED: Array = np.linspace(0.0, 1.5, 31)  # of a delay, tried beside slip;
_BESIDE_SLIP = 0.85  # of it, which must be found so,
_OF_SLIP = 5.0  # s, where it is shorter than slip can feign


class _Pairs(NamedTuple):
    """Pairs of fixes a few seconds apart, evenly over the drive, (n,) each."""

    distance: Array  # m
    begin: Array  # s
    end: Array
    variance: float  # of a fix, as reported, m²


class _Slip(NamedTuple):
    """Way while the speed changed, (n,) each: wheels may have slipped on it."""

    time: Array  # s
    faster: Array  # m, driven until then while it grew,
    slower: Array  # and while it fell


def delay_of(motion: Motion, fixes: Fixes | None, plane: Plane) -> float:
    """How late fixes are, s; negative: the odometry is; 0.0 where they agree, or nothing tells.

    Args:
        motion: Of the whole drive.
        fixes: Of the same drive.
        plane: The map's.
    """
    if fixes is None or min(len(fixes), len(motion.time)) < _FEWEST:
        return 0.0
    pairs = _pairs(fixes, plane)
    if len(pairs.distance) < _FEWEST or _is_punctual(motion, pairs):
        return 0.0
    delays = _NEAR
    left = _left(motion, pairs, delays)
    if not _is_clear(left, delays, pairs):
        far = _left(motion, pairs, _FAR)
        if not _is_clear(far, _FAR, pairs):
            return 0.0
        delays = _FAR[far.argmin()] + _NEAR
        left = _left(motion, pairs, delays)
        if not _is_clear(left, delays, pairs):
            return 0.0
    k = int(left.argmin())
    if not _is_told(motion, pairs, float(delays[k])):
        return 0.0
    a, b, c = left[k - 1 : k + 2]
    delay = float(delays[k] + 0.5 * (delays[1] - delays[0]) * (a - c) / (a - 2.0 * b + c))
    if abs(delay) <= _WORTH or (0.0 < delay < _OF_SLIP and _is_slip(motion, pairs, delay)):
        return 0.0
    return delay


def _pairs(fixes: Fixes, plane: Plane) -> _Pairs:
    chosen = np.flatnonzero(np.diff(np.floor(fixes.time / _APART), prepend=-1.0) > 0)
    time = fixes.time[chosen]
    x, y = plane.from_geodetic(fixes.lat_deg[chosen], fixes.lon_deg[chosen])
    place = np.asarray(x + 1j * y)
    second = np.searchsorted(time, time + _PAIR - 1e-3)
    first = np.flatnonzero(second < len(time))
    first = first[time[second[first]] - time[first] <= _LONGEST]
    first = first[:: max(1, -(-len(first) // _MOST))]
    second = second[first]
    variance = 0.5 * float(np.median(fixes.cov_ee + fixes.cov_nn))
    return _Pairs(np.abs(place[second] - place[first]), time[first], time[second], variance)


def _is_punctual(motion: Motion, pairs: _Pairs) -> bool:
    """Whether the fixes fit best as they are, by some of the pairs."""
    distance, begin, end = (column[::_SOME] for column in pairs[:3])
    some = _Pairs(distance, begin, end, pairs.variance)
    left = _left(motion, some, _FIRST)
    return bool(left[1] == left.min() and left[1] < _FITS * np.var(some.distance))


def _left(motion: Motion, pairs: _Pairs, delays: Array) -> Array:
    """Mean square of what each delay does not explain, m²; infinite where too few pairs tell."""
    squares = _squares(motion, pairs, delays)
    if squares.shape[1] < _FEWEST:
        return np.full(len(delays), np.inf)
    return np.asarray(np.maximum(squares.mean(axis=1), 1e-6))


def _squares(
    motion: Motion,
    pairs: _Pairs,
    delays: Array,
    changes: tuple[float, ...] = _CHANGE,
    slip: _Slip | None = None,
) -> Array:
    """Squares of what each delay does not explain, outliers cut, (delays, pairs), m².

    With `slip`, wheels may have turned too much or too little while the speed changed.
    """
    longest = delays.max() + _PACE + changes[-1]
    inside = (pairs.begin - longest > motion.time[0]) & (pairs.end - delays.min() < motion.time[-1])
    n = int(inside.sum())
    out = np.empty((len(delays), n))
    if not n:
        return out
    distance = pairs.distance[inside]
    fixes = np.concatenate([pairs.begin[inside], pairs.end[inside]])
    before = np.array([0.0, *changes])
    before = np.concatenate([before, before + _PACE])[:, None]
    for k, delay in enumerate(delays):
        ways = np.interp(fixes - delay - before, motion.time, motion.distance)
        way = np.abs(ways[0, n:] - ways[0, :n])
        off = distance - way * (distance @ way) / max(way @ way, 1e-9)
        pace = (ways[: len(before) // 2] - ways[len(before) // 2 :]) / _PACE
        change = pace[0] - pace[1:]
        changed = change[:, n:] - change[:, :n]  # receivers that smooth lag then
        if slip is not None:
            ways = [np.interp(fixes - delay, slip.time, one) for one in (slip.faster, slip.slower)]
            changed = np.array([*changed, *(one[n:] - one[:n] for one in ways), way])
        square = changed @ changed.T + 1e-6 * np.eye(len(changed))
        off -= np.linalg.solve(square, changed @ off) @ changed
        most = _OUTLIERS * 1.4826 * float(np.median(np.abs(off)))
        out[k] = np.minimum(off * off, most * most)
    return out


def _is_clear(left: Array, delays: Array, pairs: _Pairs) -> bool:
    """Whether one delay fits, and no other than those about it."""
    k = int(left.argmin())
    others = left[np.abs(delays - delays[k]) > _ALIKE]
    return bool(
        0 < k < len(left) - 1
        and left[k] < _FITS * np.var(pairs.distance)
        and left[k] < _BETTER * others.min(initial=np.inf)
    )


def _is_told(motion: Motion, pairs: _Pairs, delay: float) -> bool:
    """Whether the whole drive tells a delay, and not one part of it, where something failed."""
    changes = _CHANGES if abs(delay) < _SHORT else _CHANGE
    without, left = _squares(motion, pairs, np.array([0.0, delay]), changes)
    gain = without - left
    least, most = (share * gain.sum() for share in _OF_PARTS)
    parts = [part.sum() for part in np.array_split(gain, _PARTS)]
    rest = float(left.mean())
    if rest > _LOOSE * pairs.variance:
        return False
    sure = _SURE if rest < pairs.variance else _VERY_SURE
    return bool(gain.sum() > sure * rest and min(parts) > least and max(parts) < most)


def _slip(motion: Motion) -> _Slip:
    time = np.arange(motion.time[0], motion.time[-1], _STEP)
    metres = np.interp(time, motion.time, motion.distance)
    way = np.abs(np.diff(metres, append=metres[-1]))
    change = np.gradient(np.gradient(metres, time), time)
    faster, slower = (
        np.cumsum(np.clip((side * change - _STEADY) / _SLIPS, 0.0, 1.0) * way)
        for side in (1.0, -1.0)
    )
    return _Slip(time, faster, slower)


def _is_slip(motion: Motion, pairs: _Pairs, delay: float) -> bool:
    """Whether a delay of fixes becomes less where wheels may slip.

    Wheels that slip run ahead of the vehicle while it becomes faster, and fall behind while it
    brakes, as if fixes were late.
    """
    delays = _TRIED * delay
    left = _squares(motion, pairs, delays, slip=_slip(motion)).mean(axis=1)
    return bool(delays[left.argmin()] < _BESIDE_SLIP * delay)
