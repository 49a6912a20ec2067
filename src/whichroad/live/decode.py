"""Bytes and frames as they arrive to observations, with the least delay.

NMEA and UBX have the parsers of recorded logs.  A CAN log is read as a whole, a bus frame by frame.
"""

import math
import time
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import replace
from os import PathLike
from typing import Any, NamedTuple, TypeVar

from ..observations import (
    Distance,
    GeoFix,
    Observation,
    SensorReading,
    SpeedYaw,
    WheelSpeed,
    WheelTicks,
    YawRate,
)
from ..readers.can import reverse_value, si_factor, unit_factor
from ..readers.can_absent import NOT_AVAILABLE, Absent, absent
from ..readers.can_frames import EXTENDED
from ..readers.can_signals import Signal, find_signals, senders_of
from ..readers.names import SENSED
from ..readers.nmea import NmeaParser
from ..readers.nmea_told import NmeaTold
from ..readers.reading import Reading
from ..readers.reckoned_places import Beside, Stood, never_stood, nothing_beside
from ..readers.ubx import UbxParser
from ..sensors.validation import FASTEST
from ..settings import Settings, Vehicle
from .counter_stream import CounterStream
from .message_types import ReceiverStatus
from .receiver_sensors import ReceiverSensors
from .receiver_status import StatusReader

_STALE = 0.5  # s, largest age of a signal combined with another
_REASONABLE = 1e9  # s since 1970, below which frame times have another origin

_One = TypeVar("_One", bound=Observation)


class NmeaStream:
    """NMEA or UBX bytes in, fixes on our clock out, and what sensors of the receiver measure.

    Once a NAV-PVT has come, the sentences beside it, which say less, are passed over.

    Args:
        settings: Gives the sigma of fixes that report none.
        offset: s added to the receiver's times.
        vehicle: Scales of the wheels that a dead-reckoning receiver reads; None: their ticks and
            the gyro are passed over.
        told: Which of `readers.names.TOLD` sensors ask for.
        beside: Whether odometry that measures turns was heard about a time, on our clock: places
            that the receiver dead-reckoned are left out then.
        stood: For how many s it has read no motion: places that move on meanwhile stay.
    """

    def __init__(
        self, settings: Settings | None = None, offset: float = 0.0,
        vehicle: Vehicle | None = None, told: Collection[str] = (),
        beside: Beside = nothing_beside, stood: Stood = never_stood,
    ) -> None:  # fmt: skip
        self._offset, now = offset, time.time()
        self._parser = NmeaParser(
            settings, now, lambda at: beside(at + offset), lambda at: stood(at + offset)
        )  # fmt: skip
        self._sensors = None if vehicle is None else ReceiverSensors(vehicle)
        asked = {SENSED + name: name for name in told}
        self._ubx = UbxParser(
            Reading.of(settings=settings, columns=asked), self._sensors,
            lambda at: beside(at + offset), lambda at: stood(at + offset),
        )  # fmt: skip
        self._status = StatusReader()
        self._readings: list[SensorReading] = []
        self._told = NmeaTold(now, told) if told else None

    @property
    def skipped(self) -> int:
        """How much could not be used."""
        sensed = 0 if self._sensors is None else sum(self._sensors.skipped.values())
        return sum(self._parser.skipped.values()) + sum(self._ubx.skipped.values()) + sensed

    @property
    def skipped_why(self) -> Counter[str]:
        """The same by reason."""
        sensed = Counter[str]() if self._sensors is None else self._sensors.skipped
        return Counter(self._parser.skipped) + Counter(self._ubx.skipped) + sensed

    def sensed(self) -> list[Observation]:
        """What wheels and gyro have measured since the last call."""
        return [] if self._sensors is None else self._shifted(self._sensors.ready())

    def feed(self, data: bytes) -> list[GeoFix]:
        """Take bytes; returns the fixes that they complete."""
        self._status.feed(data)
        fixes, sentences = self._ubx.feed(data)
        if not self._ubx.seen:
            fixes = self._parser.feed(sentences)
        if self._told is not None:
            said = self._told.feed(sentences)
            self._readings += self._ubx.told if self._ubx.seen else said
            self._ubx.told.clear()
        return self._shifted(fixes)

    def readings(self) -> list[SensorReading]:
        """What the receiver has said for further sensors since the last call."""
        made, self._readings = self._shifted(self._readings), []
        return made

    @property
    def receiver(self) -> ReceiverStatus:
        """What the receiver said last of its satellites and its height."""
        return self._status.now

    def flush(self) -> list[GeoFix]:
        """The line is silent: the fix of the burst that has ended."""
        return self._shifted(self._ubx.pause() if self._ubx.seen else self._parser.pause())

    def _shifted(self, made: list[_One]) -> list[_One]:
        if not self._offset:
            return made
        return [replace(one, time=one.time + self._offset) for one in made]


class _Bits(NamedTuple):
    """Where a signal is in its frame, for one frame at a time."""

    role: str
    start: int  # bits to shift right, the frame read as one number
    mask: int
    sign: int  # bit that makes it negative; 0: unsigned
    little: bool
    bytes: int  # that the frame must have
    scale: float
    offset: float
    slow: Signal | None  # floats are left to cantools
    absent: Absent


class CanStream:
    """CAN frames in, odometry out.

    The signals that vehicle.toml names choose what comes out: rear wheel counters, else wheel
    speeds, else speed with yaw rate, else an odometer (with a yaw rate if there is one), else the
    speed alone.

    Args:
        dbc: The database of the signals.
        vehicle: Names the signals; wheels give the scales.
        offset: s added to the frames' times.
        columns: Aliases of columns that further sensors read, as `Sensed.columns` has them.

    Attributes:
        signals: Those that are needed.
        senders: Who sends the messages of J1939.
        came: Frames that came, as the signals name them, until somebody empties it.

    Raises:
        ReadError: The .dbc is not one, or does not know a signal.
    """

    def __init__(
        self, dbc: str | PathLike[str], vehicle: Vehicle, offset: float = 0.0,
        columns: Iterable[str] = (),
    ) -> None:  # fmt: skip
        self.skipped_why: Counter[str] = Counter()
        signals = find_signals(dbc, vehicle, self.skipped_why, columns)
        self._vehicle, self._offset = vehicle, offset
        self._reverse_value = reverse_value(signals, vehicle)
        self.signals = tuple(signals.values())
        self.senders, self.came = senders_of(signals), set[int]()
        self._exact: dict[int, list[_Bits]] = {}  # id -> signals in its frames
        self._by_group: dict[int, list[_Bits]] = {}  # of J1939
        for role, signal in signals.items():
            used = self._reverse_value if role == "reverse" else None
            frames = self._by_group if signal.j1939 else self._exact
            frames.setdefault(signal.frame, []).append(_bits(role, signal, used))
        self._roles = {role for role in signals if not role.startswith(SENSED)}
        self._backwards = self._geared = False
        self._last: dict[str, tuple[float, float]] = {}  # role -> time, value
        self._waiting: tuple[float, float] | None = None  # a left wheel without its right one
        self._distance = 0.0
        bits = vehicle.counter_bits
        about = signals["wheel_rl_ticks"].about if "wheel_rl_ticks" in signals else None
        if about is not None and not bits and not about.is_float:
            bits = about.length
        self._counters = {
            "wheel_rl_ticks": CounterStream(bits, vehicle.metres_per_tick_left),
            "wheel_rr_ticks": CounterStream(bits, vehicle.metres_per_tick_right),
        }

    @property
    def frames(self) -> set[int]:
        """The ids that are needed, bit 31 marks those of 29 bits; but those of J1939."""
        return set(self._exact)

    @property
    def skipped(self) -> int:
        """Frames and readings that could not be used."""
        return sum(self.skipped_why.values())

    def feed(self, frame: int, stamp: float, data: bytes) -> list[Observation]:
        """Take one frame.

        Args:
            frame: Its id, bit 31 marks those of 29 bits.
            stamp: When it came, s since 1970; another clock is taken as now.
            data: Payload.
        """
        wanted = self._exact.get(frame)
        if wanted is None:
            wanted = self._of_group(frame, data)
        else:
            self.came.add(frame)
        stamp = (stamp if stamp > _REASONABLE else time.time()) + self._offset
        values, sensed = [], dict[str, float]()
        for bits in wanted:
            value = _value(bits, data)
            if isinstance(value, str):
                self.skipped_why[value] += 1
            elif bits.role == "reverse":
                wanted_value, self._geared = self._reverse_value, True
                self._backwards = value != 0.0 if wanted_value is None else value == wanted_value
            elif bits.role.startswith(SENSED):
                sensed[bits.role.removeprefix(SENSED)] = value
            else:
                values.append((bits.role, value))
        told: list[Observation] = [SensorReading(stamp, sensed)] if sensed else []
        return told + [one for role, value in values for one in self._take(role, stamp, value)]

    def _of_group(self, frame: int, data: bytes) -> list[_Bits]:
        """The signals in a frame of J1939."""
        if not (self._by_group and frame & EXTENDED):
            return []

        def gives(message: int) -> bool:
            return any(isinstance(_value(one, data), float) for one in self._by_group[message])

        messages = self.senders.take(frame, gives)
        self.came.update(messages)
        return [bits for one in messages for bits in self._by_group[one]]

    def counted(self) -> dict[str, list[float]]:
        """What `resume` takes, to go on counting after a crash; JSON can hold it."""
        return {
            role: counter.state for role, counter in self._counters.items() if counter.begun
        }  # fmt: skip

    def resume(self, counted: dict[str, list[float]]) -> None:
        """Go on from the counts of a stream that was before: a wrap while asleep is seen.

        Args:
            counted: As `counted` gave it.
        """
        for role, state in counted.items():
            if role in self._counters:
                self._counters[role].state = state

    def _take(self, role: str, stamp: float, value: float) -> list[Observation]:
        """One reading of one role."""
        before = self._last.get(role)
        if before is not None and stamp <= before[0]:
            self.skipped_why["repeated time"] += 1
            return []
        if role in self._counters:
            value = self._counters[role].take(stamp, value, self._backwards, self.skipped_why)
        elif role in ("wheel_rl", "wheel_rr", "speed"):
            if abs(value) > FASTEST:
                self.skipped_why[f"speed beyond {FASTEST:g} m/s"] += 1
                return []
            value = -abs(value) if self._backwards else value
        self._last[role] = (stamp, value)
        if {"wheel_rl_ticks", "wheel_rr_ticks"} <= self._roles:
            return self._pair(role, "wheel_rl_ticks", "wheel_rr_ticks", before, WheelTicks)
        if {"wheel_rl", "wheel_rr"} <= self._roles:
            return self._pair(role, "wheel_rl", "wheel_rr", before, WheelSpeed)
        if {"speed", "yaw_rate"} <= self._roles:
            turning = self._last.get("yaw_rate")
            if role != "speed" or turning is None or abs(stamp - turning[0]) > _STALE:
                return []
            return [SpeedYaw(stamp, value, turning[1], self._geared)]
        if "odometer" in self._roles:
            if role == "yaw_rate":
                return [YawRate(stamp, value)]
            return [Distance(stamp, value)] if role == "odometer" else []
        if role == "speed":
            if before is not None:
                self._distance += 0.5 * (value + before[1]) * (stamp - before[0])
            return [Distance(stamp, self._distance, self._geared)]
        return []

    def _pair(
        self, role: str, left: str, right: str, before: tuple[float, float] | None, kind: Any
    ) -> list[Observation]:
        """Both wheels at the left one's time, the right one between its readings."""
        stamp, value = self._last[role]
        if role == left:
            other = self._last.get(right)
            if other is not None and other[0] == stamp:
                self._waiting = None
                return [kind(stamp, value, other[1], self._geared)]
            if self._waiting is not None:
                self.skipped_why["wheel without the other"] += 1
            self._waiting = (stamp, value)
            return []
        if role != right or self._waiting is None:
            return []
        (at, waiting), self._waiting = self._waiting, None
        if at == stamp or before is None or before[0] > at:
            return [kind(at, waiting, value, self._geared)] if at == stamp else []
        part = (at - before[0]) / (stamp - before[0])
        between = before[1] + part * (value - before[1])
        return [kind(at, waiting, between, self._geared)]


def _bits(role: str, signal: Signal, used: float | None) -> _Bits:
    """Where the bits of a signal are; the .dbc counts those of big endian from the left."""
    about = signal.about
    plain, unit = role.endswith("_ticks") or role == "reverse", (about.unit or "").strip()
    factor = 1.0 if plain else si_factor(unit) or 1.0
    if role.startswith(SENSED):
        factor = unit_factor(role.removeprefix(SENSED), unit)
    scale, offset = factor * float(about.scale), factor * float(about.offset)
    little = about.byte_order == "little_endian"
    start = about.start if little else 8 * (about.start // 8) + 7 - about.start % 8
    needed = (start + about.length - 1) // 8 + 1
    shift = start if little else 8 * needed - start - about.length
    sign = 1 << (about.length - 1) if about.is_signed else 0
    return _Bits(
        role, shift, (1 << about.length) - 1, sign, little, needed, scale, offset,
        signal if about.is_float else None,
        absent(about, counter=role.endswith("_ticks"), used=used),
    )  # fmt: skip


def _value(bits: _Bits, data: bytes) -> float | str:
    """The value of a signal in a frame, or why there is none."""
    if len(data) < bits.bytes:
        return "frame cut short"
    number = _number(bits, data)
    if bits.absent.holds(number):
        return NOT_AVAILABLE
    value = number * bits.scale + bits.offset
    return value if math.isfinite(value) else "no number"


def _number(bits: _Bits, data: bytes) -> float:
    """What the bits of a signal say, before scale and offset."""
    if bits.slow is not None:
        raw = bits.slow.message.decode(
            data, decode_choices=False, scaling=False, allow_truncated=True
        )[bits.slow.name]
        return float(raw)
    number = int.from_bytes(data[: bits.bytes], "little" if bits.little else "big")
    number = number >> bits.start & bits.mask
    return number - bits.mask - 1 if number & bits.sign else number
