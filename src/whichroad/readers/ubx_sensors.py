"""UBX-ESF-MEAS: what sensors in and about a dead-reckoning receiver measured."""

from typing import NamedTuple

import numpy as np

from ..geodesy.angles import radians, wrap_degrees
from ..observations import Array, Fixes, OdometryLog, WheelCounts
from ..ragged import row_and_place
from ..settings import Vehicle
from .checks import Ints, Skipped, in_order
from .drive_columns import nearby, odometer, speed_yaw_rate
from .ubx_frames import CUT, HEAD, TAIL, Bytes, Frames
from .wheel_counters import Reversing, cumulative, wheel_counts

GYRO_Z, REAR_LEFT, REAR_RIGHT, TICK, SPEED = 5, 8, 9, 10, 11  # types of measurements
GYRO_DEG = 2.0**-12  # deg/s, unit of the gyro
SPEED_MPS = 1e-3  # m/s, unit of the speed
BITS = 23  # of a tick counter; the one above is set where the wheel turns backwards
WRAP = 2.0**32  # ms, at which the tag of a measurement begins again
SPAN = 60.0  # s over which the offset of the sensors' clock is taken as constant
SURE = 0.5  # correlation of gyro and course, from which the gyro's direction is known
TURNS = 5.0  # deg/s, from which a course is turning


class Measurements(NamedTuple):
    """Single measurements in the order of the log, shape (n,) each."""

    byte: Ints  # at which the message begins
    tag: Array  # s, the sensors' own clock
    kind: Ints
    raw: Ints  # 24 bits

    def of(self, kind: int) -> "Measurements":
        """Those of one kind."""
        mine = self.kind == kind
        return Measurements(*(column[mine] for column in self))


def measurements(data: bytes, frames: Frames, skipped: Skipped) -> Measurements:
    """What messages hold.

    Args:
        data: The bytes in which the frames are.
        frames: Those of ESF-MEAS.
        skipped: Counts messages that are shorter than they say.
    """
    values = np.frombuffer(data, np.uint8)
    size = frames.end - frames.start - HEAD - TAIL
    long = size >= 8
    start, size = frames.start[long] + HEAD, size[long]
    flags = values[start + 4].astype(np.int64) | values[start + 5].astype(np.int64) << 8
    calibrated = flags >> 3 & 1
    room = (size - 8) // 4
    n = np.where(flags >> 11 > 0, flags >> 11, room - calibrated)  # old receivers do not count
    fits = (n >= 0) & (n + calibrated <= room)
    if short := int(np.count_nonzero(~fits)) + int(np.count_nonzero(~long)):
        skipped[CUT] += short
    start, n, calibrated = start[fits], n[fits], calibrated[fits]
    tags = np.where(calibrated == 1, start + 8 + 4 * n, start)
    tag = _words(values, tags).astype(np.float64)
    message, number = row_and_place(n)
    word = _words(values, start[message] + 8 + 4 * number)
    # clocks count milliseconds in 32 bits
    tag += WRAP * np.concatenate([[0.0], np.cumsum(np.diff(tag) < -0.5 * WRAP)])[: len(tag)]
    return Measurements(
        start[message] - HEAD, 1e-3 * tag[message], word >> 24 & 63, word & 0xFFFFFF
    )


def _words(values: Bytes, at: Ints) -> Ints:
    """Numbers of four bytes, the least first."""
    word = np.zeros(len(at), np.int64)
    for k in range(4):
        word |= values[at + k].astype(np.int64) << 8 * k
    return word


def signed(raw: Ints | int) -> Array:
    """Numbers of 24 bits with a sign."""
    return np.asarray((raw ^ 0x800000) - 0x800000, np.float64)


def on_utc(found: Measurements, byte: Ints, time: Array) -> Array:
    """Times of measurements, by the epochs between which they stand in the log.

    A message comes a moment after what it tells.  The offset is the least that no epoch
    contradicts, taken anew every minute: clocks of sensors drift.

    Args:
        found: The measurements.
        byte: (n,) where the messages with times begin.
        time: (n,) their times, s since 1970 UTC.

    Returns:
        Times of the measurements, NaN where none can be told.
    """
    before = np.searchsorted(found.byte, byte) - 1
    usable = before >= 0
    if not usable.any():
        return np.full(len(found.tag), np.nan)
    tag = found.tag[before[usable]]
    offset = time[usable] - tag
    span = np.floor((time[usable] - time[usable][0]) / SPAN)
    span = np.cumsum(np.concatenate([[0], np.diff(span) != 0]))
    begin = np.flatnonzero(np.diff(span, prepend=-1))
    least = np.minimum.reduceat(offset, begin)
    return np.asarray(found.tag + np.interp(found.tag, *_rising(tag[begin], least)))


def _rising(tag: Array, offset: Array) -> tuple[Array, Array]:
    """Offsets by increasing tag."""
    order = np.argsort(tag, kind="stable")
    return tag[order], offset[order]


def odometry(
    found: Measurements, time: Array, fixes: Fixes, vehicle: Vehicle, skipped: Skipped
) -> tuple[OdometryLog | None, list[str]]:
    """The best odometry among what was measured.

    Rear wheels, else a speed with the gyro, else one wheel tick with the gyro, else one alone.

    Args:
        found: The measurements.
        time: Their times, s since 1970 UTC.
        fixes: Those of the log, which show how the gyro is mounted.
        vehicle: Scales, width of counters, track width.
        skipped: Where to count.

    Returns:
        The odometry, and what its reader should know.
    """
    series = {}
    for kind in (GYRO_Z, REAR_LEFT, REAR_RIGHT, TICK, SPEED):
        mine = (found.kind == kind) & np.isfinite(time)
        rows = in_order(time[mine], skipped)
        series[kind] = time[mine][rows], found.raw[mine][rows]
    notes: list[str] = []
    if len(series[REAR_LEFT][0]) and len(series[REAR_RIGHT][0]):
        wheels = [
            _signed_counts(series[kind], vehicle, skipped) for kind in (REAR_LEFT, REAR_RIGHT)
        ]
        counts = wheel_counts(wheels[0], wheels[1], vehicle, skipped, bits=0)
        return (counts if len(counts.time) else None), notes
    gyro = series[GYRO_Z][0], radians(GYRO_DEG * signed(series[GYRO_Z][1]))
    rate = _mounted(*gyro, fixes, notes) if len(gyro[0]) else None
    if len(series[SPEED][0]):
        at, raw = series[SPEED]
        speed = SPEED_MPS * signed(raw)
        if rate is not None:
            return speed_yaw_rate(at, speed, nearby(at, gyro[0], rate), skipped), notes
    if not len(series[TICK][0]):
        return None, notes
    at, count = _signed_counts(series[TICK], vehicle, skipped)
    scale = 0.5 * (vehicle.metres_per_tick_left + vehicle.metres_per_tick_right)
    if rate is None or len(at) < 2:
        return odometer(at, scale * count, skipped), notes
    return _as_wheels(at, scale * count, gyro[0], rate, vehicle), notes


def _signed_counts(
    series: tuple[Array, Ints], vehicle: Vehicle, skipped: Skipped
) -> tuple[Array, Array]:
    """One counter, unwrapped, falling where its wheel turns backwards."""
    time, raw = series
    reversing: Reversing = time, raw >> BITS == 1
    counts = (raw & (1 << BITS) - 1).astype(np.float64)
    return time, cumulative(
        time,
        counts,
        bits=vehicle.counter_bits or BITS,
        metres_per_tick=vehicle.metres_per_tick_left,
        skipped=skipped,
        reversing=reversing,
    )


def _as_wheels(
    time: Array, distance: Array, gyro_time: Array, rate: Array, vehicle: Vehicle
) -> WheelCounts:
    """Wheel counts with this distance and the gyro's turn: both stay exactly cumulative."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(gyro_time)
    turn = np.interp(time, gyro_time, np.concatenate([[0.0], np.cumsum(steps)]))
    half = 0.5 * vehicle.track_width * turn
    left, right = vehicle.metres_per_tick_left, vehicle.metres_per_tick_right
    return WheelCounts(time, (distance - half) / left, (distance + half) / right)


def _mounted(time: Array, rate: Array, fixes: Fixes, notes: list[str]) -> Array:
    """The yaw rate, counter-clockwise, of a gyro whose axis may point up or down."""
    known = np.isfinite(fixes.sigma_bearing_deg)
    at = fixes.time[known]
    if len(at) > 2 and len(time) > 1:
        turned = -wrap_degrees(np.diff(fixes.bearing_deg[known]))
        lasting = np.diff(at)
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)
        turn = np.diff(np.interp(at, time, np.concatenate([[0.0], np.cumsum(steps)])))
        telling = (np.abs(turned) > TURNS * lasting) & (lasting < 3.0)
        product = float(np.sum(radians(turned[telling]) * turn[telling]))
        size = float(np.sqrt(np.sum(radians(turned[telling]) ** 2) * np.sum(turn[telling] ** 2)))
        if size > 0.0 and abs(product) >= SURE * size:
            if product < 0.0:
                notes.append("the gyro's z axis points down, as the courses of the fixes show")
                return -rate
            return rate
    notes.append("no course shows whether the gyro's z axis points up: it is taken so")
    return rate
