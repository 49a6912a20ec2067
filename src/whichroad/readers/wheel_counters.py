"""Wheel counters of a car, unwrapped, signed, and both wheels at the same times.

An impossible step is replaced by one at the speed before it, and counted.
"""

import numpy as np

from ..errors import ReadError
from ..observations import Array, WheelCounts, WheelSpeeds
from ..sensors.validation import BACKS, FASTEST, UNSEEN
from ..settings import Vehicle
from .checks import Bools, Ints, Skipped, in_order, keep

_JITTER = 0.02  # s, by which logged frames come too close together
_GAP = 3.0  # usual intervals, beyond which a short counter may have wrapped more than once
_RECENT = 10  # steps that give the speed across a gap
_LARGEST = 2.0**53  # counts; beyond it floats no longer resolve single counts
_WIDTHS = (8, 10, 12, 14, 15, 16, 20, 24, 32)  # bits that counters have
_WRAPS = 3  # of a counter, the fewest that tell its width
_FULL = 0.9  # share of its range that it then has been through
_CLEAR = 0.4  # share of its range that most steps are below, so that they are told from wraps
JUMP = "wheel counter jumped (bridged)"
NO_COUNT = "wheel counter beyond 2^53"

Reversing = tuple[Array, Bools]  # times, whether the vehicle goes backwards from then on


def cumulative(
    time: Array,
    raw: Array,
    *,
    bits: int,
    metres_per_tick: float,
    skipped: Skipped,
    reversing: Reversing | None = None,
) -> Array:
    """Unwrap one counter and sign it.

    A step is the shortest that the counter's bits allow; after a gap, the one nearest to
    the speed before.  Steps faster than 90 m/s are jumps, and falls after a gap.

    Args:
        time: Increasing times of the readings, s, shape (n,).
        raw: The readings, counts.
        bits: Width of the counter; 0: it does not wrap.
        metres_per_tick: Limits the possible steps.
        skipped: Counts the jumps.
        reversing: Where the counter only counts up and a flag gives the direction.

    Returns:
        Cumulative counts, beginning at the first reading.

    Raises:
        ReadError: Most steps are impossible: it is not a counter, or its scale is wrong.
    """
    if len(time) < 2:
        return raw.astype(np.float64)
    step, interval = np.diff(raw), np.diff(time)
    gap = interval > _GAP * np.median(interval)
    if bits:
        step = _nearest(step, 2.0**bits, np.zeros(len(step)))
        step = np.where(gap, _nearest(step, 2.0**bits, _bridge(step, interval, ~gap)), step)
    jump = np.abs(step) * metres_per_tick > FASTEST * (interval + _JITTER)
    fell = gap & (interval > UNSEEN) & (step * metres_per_tick < -BACKS * interval)
    if fell.any():
        jump |= fell & (_bridge(step, interval, ~gap) >= 0.0)
    if np.count_nonzero(jump) > max(len(step) // 2, 3):
        speed = float(np.median(np.abs(step) / interval)) * metres_per_tick
        raise ReadError(
            f"wheel counters: {np.count_nonzero(jump)} of {len(step)} steps are faster than "
            f"{FASTEST:g} m/s (median {speed:.3g} m/s at {metres_per_tick:g} m per tick); a rising "
            "counter was expected; are metres_per_tick and counter_bits of vehicle.toml right?"
        )
    if jump.any():
        skipped[JUMP] += int(np.count_nonzero(jump))
        step = np.where(jump, _bridge(step, interval, ~gap & ~jump), step)
    if reversing is not None:
        step = np.where(held(reversing, time[1:]), -np.abs(step), step)
    return float(raw[0]) + np.concatenate([[0.0], np.cumsum(step)])


def shown_width(raw: Array) -> int:
    """Bits of a counter that is seen to wrap; 0: it is not.

    Such a counter rises through its range and falls by more than half of it, again and again.

    Args:
        raw: Its readings in order, counts, shape (n,).
    """
    most = float(raw.max(initial=0.0))
    bits = next((b for b in _WIDTHS if most < 2.0**b), 0)
    if len(raw) < 2 or not bits or raw.min() < 0.0 or most < _FULL * 2.0**bits:
        return 0
    step = np.diff(raw)
    falls = np.count_nonzero(step < -0.5 * 2.0**bits)
    rises = np.count_nonzero(step > 0.5 * 2.0**bits)
    usual = np.quantile(np.abs(_nearest(step, 2.0**bits, np.zeros(len(step)))), 0.95)
    return bits if falls - rises >= _WRAPS and usual < _CLEAR * 2.0**bits else 0


def _nearest(step: Array, modulus: float, expected: Array) -> Array:
    """The step nearest to the expected one among those that the counter cannot distinguish."""
    return np.asarray(step + modulus * np.round((expected - step) / modulus))


def _bridge(step: Array, interval: Array, good: Bools) -> Array:
    """Each step as the last good ones before it (else the first after it) suggest."""
    index = np.flatnonzero(good)
    if len(index) == 0:
        return np.zeros(len(step))
    travelled = np.concatenate([[0.0], np.cumsum(step[index])])
    elapsed = np.concatenate([[0.0], np.cumsum(interval[index])])
    stop = np.searchsorted(index, np.arange(len(step)))
    stop = np.where(stop == 0, min(_RECENT, len(index)), stop)
    begin = np.maximum(stop - _RECENT, 0)
    rate = (travelled[stop] - travelled[begin]) / (elapsed[stop] - elapsed[begin])
    return np.asarray(rate * interval)


def held(reversing: Reversing, time: Array) -> Bools:
    """Whether the vehicle goes backwards at each time, as last reported; forwards before."""
    flag_time, flag = reversing
    if len(flag_time) == 0:
        return np.zeros(len(time), np.bool_)
    index = np.searchsorted(flag_time, time, side="right") - 1
    return np.asarray((index >= 0) & flag[np.maximum(index, 0)])


def _known(time: Array, value: Array, skipped: Skipped) -> tuple[Array, Array]:
    """The readings that are not empty, by increasing time."""
    known = np.isfinite(time) & np.isfinite(value)
    time, value = time[known], value[known]
    rows: Ints = in_order(time, skipped)
    return time[rows], value[rows]


def _same_times(
    left: tuple[Array, Array], right: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Both wheels at the left one's times, where the right one is known on both sides."""
    (time, a), (right_time, b) = left, right
    if len(time) == len(right_time) and np.array_equal(time, right_time):
        return time, a, b
    if len(right_time) == 0 or len(time) == 0:
        return time[:0], a[:0], b[:0]
    both = (time >= right_time[0]) & (time <= right_time[-1])
    return time[both], a[both], np.interp(time[both], right_time, b)


def wheel_counts(
    left: tuple[Array, Array],
    right: tuple[Array, Array],
    vehicle: Vehicle,
    skipped: Skipped,
    *,
    bits: int | None = None,
    reversing: Reversing | None = None,
    notes: list[str] | None = None,
) -> WheelCounts:
    """Both rear counters, each given as (times, readings), unwrapped and at the same times.

    Wheels that report in different frames are brought to the left one's times by
    interpolation of the counts.

    Args:
        left: Times in s and readings of the left wheel; NaN readings are left out.
        right: Those of the right wheel.
        vehicle: Gives the scales and, where `bits` is None, the width.
        skipped: Where to count.
        bits: Width of the counters; 0: they do not wrap.
        reversing: Where they only count up and a flag gives the direction.
        notes: Where to say that both are seen to wrap at another width, which is then taken;
            None: they are not looked at.
    """
    bits = vehicle.counter_bits if bits is None else bits
    if notes is not None:
        bits = _checked_width(bits, left[1], right[1], notes)
    wheels = []
    scales = (vehicle.metres_per_tick_left, vehicle.metres_per_tick_right)
    for (time, raw), scale in zip((left, right), scales, strict=True):
        countable = keep(~(np.abs(raw) > _LARGEST), NO_COUNT, skipped)
        time, raw = _known(time[countable], raw[countable], skipped)
        counts = cumulative(
            time,
            raw,
            bits=bits,
            metres_per_tick=scale,
            skipped=skipped,
            reversing=reversing,
        )
        wheels.append((time, counts))
    return WheelCounts(*_same_times(*wheels))


def _checked_width(bits: int, left: Array, right: Array, notes: list[str]) -> int:
    """The width at which both counters wrap, else the one that was given."""
    shown, other = (shown_width(raw[np.isfinite(raw)]) for raw in (left, right))
    if not shown or shown != other or shown == bits:
        return bits
    given = f"not at 2^{bits}" if bits else "though no counter_bits were given"
    notes.append(f"wheel counters wrap at 2^{shown}, {given}: taken as {shown} bits")
    return shown


def wheel_speeds(
    left: tuple[Array, Array],
    right: tuple[Array, Array],
    skipped: Skipped,
    *,
    reversing: Reversing | None = None,
) -> WheelSpeeds:
    """Both rear wheels' speeds in m/s at the same times, negative in reverse."""
    wheels = []
    for time, speed in (left, right):
        time, speed = _known(time, speed, skipped)
        possible = keep(np.abs(speed) <= FASTEST, f"wheel speed beyond {FASTEST:g} m/s", skipped)
        time, speed = time[possible], speed[possible]
        if reversing is not None:
            speed = np.where(held(reversing, time), -np.abs(speed), speed)
        wheels.append((time, speed))
    return WheelSpeeds(*_same_times(*wheels))
