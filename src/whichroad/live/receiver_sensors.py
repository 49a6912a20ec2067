"""Wheels and gyro of a dead-reckoning receiver as they come in: UBX-ESF-MEAS."""

import math
from collections import Counter, deque

import numpy as np

from ..geodesy.angles import DEGREE, wrap_degrees
from ..observations import Distance, GeoFix, Observation, SpeedYaw, WheelTicks, YawRate
from ..readers.ubx_frames import ESF_MEAS, Frames
from ..readers.ubx_sensors import (
    BITS,
    GYRO_DEG,
    GYRO_Z,
    REAR_LEFT,
    REAR_RIGHT,
    SPAN,
    SPEED,
    SPEED_MPS,
    SURE,
    TICK,
    TURNS,
    WRAP,
    measurements,
    signed,
)
from ..settings import Vehicle
from .counter_stream import CounterStream

_STALE = 0.5  # s, largest age of a turn beside a speed
_PAIR = 3.0  # s, longest time between two courses that show how the gyro is mounted
_TURNED = 60.0  # degrees in turns, after which that is believed
_RESTARTED = 1.0  # s by which a clock is set back where its receiver has started anew
_WAITING = 1000  # readings that wait to be asked for, at most


class ReceiverSensors:
    """Readings of the receiver's sensors on the clock of its fixes.

    Rear wheels, else a speed with the gyro, else a wheel tick, with the gyro once courses have
    shown whether its axis points up.  Before the first epoch the sensors' clock is not known.

    Args:
        vehicle: Scales, width of counters.

    Attributes:
        skipped: What was not used, by reason.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self.skipped: Counter[str] = Counter()
        left, right = vehicle.metres_per_tick_left, vehicle.metres_per_tick_right
        self._scale = 0.5 * (left + right)
        bits = vehicle.counter_bits or BITS
        self._counters = {
            REAR_LEFT: CounterStream(bits, left), REAR_RIGHT: CounterStream(bits, right),
            TICK: CounterStream(bits, self._scale),
        }  # fmt: skip
        self._mounting = _Mounting()
        self._clock = _Clock()
        self._seen: set[int] = set()
        self._turning: tuple[float, float] | None = None  # time, rad/s by its own axis
        self._last = -math.inf
        self._ready: deque[Observation] = deque(maxlen=_WAITING)

    @property
    def useful(self) -> bool:
        """Whether there was a reading: dead-reckoned fixes come from the same wheels."""
        return self._last > -math.inf

    def ready(self) -> list[Observation]:
        """The readings since the last call."""
        found = list(self._ready)
        self._ready.clear()
        return found

    def epoch(self, time: float) -> None:
        """A message with this time (s since 1970) has come."""
        self._clock.epoch(time)

    def fix(self, fix: GeoFix) -> None:
        """A fix has come: its course shows how the gyro is mounted."""
        self._mounting.course(fix)

    def measured(self, frame: bytes) -> None:
        """An ESF-MEAS has come."""
        whole = Frames(*(np.array([n]) for n in (0, len(frame), ESF_MEAS)))
        found = measurements(frame, whole, self.skipped)
        if not len(found.tag):
            return
        time = self._clock.time(float(found.tag[0]))
        if time is None:
            return
        raw = dict(zip(found.kind.tolist(), found.raw.tolist(), strict=True))
        self._seen |= raw.keys()
        if time < self._last:
            self.skipped["time running backwards"] += 1
            return
        if GYRO_Z in raw:
            rate = DEGREE * GYRO_DEG * float(signed(raw[GYRO_Z]))
            self._turning = (time, rate)
            self._mounting.gyro(time, rate)
        made = self._made(time, raw)
        if made:
            self._last = time
            self._ready.extend(made)

    def _made(self, time: float, raw: dict[int, int]) -> list[Observation]:
        if {REAR_LEFT, REAR_RIGHT} <= self._seen:
            if not {REAR_LEFT, REAR_RIGHT} <= raw.keys():
                return []
            left, right = (self._count(k, time, raw) for k in (REAR_LEFT, REAR_RIGHT))
            return [WheelTicks(time, left, right)]
        axis, turning = self._mounting.axis, self._turning
        if {SPEED, GYRO_Z} <= self._seen:
            fresh = turning is not None and time - turning[0] <= _STALE
            if SPEED not in raw or not axis or turning is None or not fresh:
                return []
            speed = SPEED_MPS * float(signed(raw[SPEED]))
            return [SpeedYaw(time, speed, axis * turning[1])]
        made: list[Observation] = []
        if GYRO_Z in raw and axis and turning is not None and TICK in self._seen:
            made.append(YawRate(time, axis * turning[1]))
        if TICK in raw:
            made.append(Distance(time, self._scale * self._count(TICK, time, raw)))
        return made

    def _count(self, kind: int, time: float, raw: dict[int, int]) -> float:
        value = raw[kind]
        backwards = value >> BITS == 1
        ticks = float(value & (1 << BITS) - 1)
        return self._counters[kind].take(time, ticks, backwards, self.skipped)


class _Clock:
    """The sensors' own clock against that of epochs.

    A message comes a moment after what it tells: the offset is the least of the last minute or
    two, as clocks drift.
    """

    def __init__(self) -> None:
        self._tag: float | None = None  # s, the last one
        self._turns = 0.0  # s, by which the tag began again
        self._least = [math.inf, math.inf]  # s, in this span and the one before
        self._until = -math.inf

    def time(self, tag: float) -> float | None:
        """When a measurement was made, s since 1970; None: not known yet."""
        back = 0.0 if self._tag is None else self._tag - tag - self._turns
        if back > 0.5e-3 * WRAP:
            self._turns += 1e-3 * WRAP
        elif back > _RESTARTED:
            self._least, self._until = [math.inf, math.inf], -math.inf
        self._tag = tag + self._turns
        offset = min(self._least)
        return self._tag + offset if offset < math.inf else None

    def epoch(self, time: float) -> None:
        """A message of this time stands behind the last tag."""
        if self._tag is None:
            return
        if time >= self._until:
            self._least = [math.inf, self._least[0]]
            self._until = time + SPAN
        self._least[0] = min(self._least[0], time - self._tag)


class _Mounting:
    """Whether the gyro's axis points up, by the courses of fixes."""

    def __init__(self) -> None:
        self.axis = 0.0  # 1 up, -1 down, 0 not known yet
        self._turned: deque[tuple[float, float]] = deque(maxlen=_WAITING)  # time, rad since a start
        self._rate = 0.0
        self._before: tuple[float, float, float] | None = None  # time, course, rad by the gyro
        self._sums = np.zeros(3)  # products and squares of turns, rad²

    def gyro(self, time: float, rate: float) -> None:
        """A reading, rad/s about its own axis."""
        last, angle = self._turned[-1] if self._turned else (time, 0.0)
        self._turned.append((time, angle + 0.5 * (rate + self._rate) * (time - last)))
        self._rate = rate

    def course(self, fix: GeoFix) -> None:
        """A fix; one without a course tells nothing."""
        if not self._turned or not math.isfinite(fix.sigma_bearing_deg):
            return
        times, angles = zip(*self._turned, strict=True)
        now = fix.time, fix.bearing_deg, float(np.interp(fix.time, times, angles))
        before, self._before = self._before, now
        if before is None or not 0.0 < now[0] - before[0] < _PAIR:
            return
        turned = -float(wrap_degrees(now[1] - before[1]))
        if abs(turned) <= TURNS * (now[0] - before[0]):
            return
        a, b = DEGREE * turned, now[2] - before[2]
        self._sums += (a * b, a * a, b * b)
        product, course, gyro = self._sums.tolist()
        size = math.sqrt(course * gyro)
        if course >= (DEGREE * _TURNED) ** 2 / 4.0 and size > 0.0 and abs(product) >= SURE * size:
            self.axis = math.copysign(1.0, product)
