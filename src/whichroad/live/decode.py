"""Bytes and frames as they arrive to observations, with the least delay.

NMEA and UBX have the parsers of recorded logs.  A CAN log is read as a whole, a bus frame by frame.
"""

import math
import time
from collections import Counter
from dataclasses import replace
from os import PathLike
from typing import Any, NamedTuple

from ..observations import (
    Distance,
    GeoFix,
    Observation,
    SpeedYaw,
    WheelSpeed,
    WheelTicks,
    YawRate,
)
from ..readers.can import Signal, find_signals, si_factor
from ..readers.nmea import NmeaParser
from ..readers.reading import Reading
from ..readers.ubx import UbxParser
from ..readers.wheel_counters import JUMP
from ..sensors.validation import FASTEST
from ..settings import Settings, Vehicle

_JITTER = 0.02  # s, tolerance of time stamps
_STALE = 0.5  # s, largest age of a signal combined with another
_REASONABLE = 1e9  # s since 1970, below which frame times have another origin


class NmeaStream:
    """NMEA or UBX bytes in, fixes on our clock out.

    Once a NAV-PVT has come, the sentences beside it, which say less, are passed over.

    Args:
        settings: Gives the sigma of fixes that report none.
        offset: s added to the receiver's times.
    """

    def __init__(self, settings: Settings | None = None, offset: float = 0.0) -> None:
        self._parser, self._offset = NmeaParser(settings, today=time.time()), offset
        self._ubx = UbxParser(Reading.of(settings=settings))

    @property
    def skipped(self) -> int:
        """What could not be used."""
        return sum(self._parser.skipped.values()) + sum(self._ubx.skipped.values())

    def feed(self, data: bytes) -> list[GeoFix]:
        """Take bytes; returns the fixes that they complete."""
        fixes, sentences = self._ubx.feed(data)
        if self._ubx.seen:
            return self._shifted(fixes)
        return self._shifted(self._parser.feed(sentences))

    def flush(self) -> list[GeoFix]:
        """The line is silent: the fix of the burst that has ended."""
        return self._shifted(self._ubx.pause() if self._ubx.seen else self._parser.pause())

    def _shifted(self, fixes: list[GeoFix]) -> list[GeoFix]:
        if not self._offset:
            return fixes
        return [replace(fix, time=fix.time + self._offset) for fix in fixes]


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


class CanStream:
    """CAN frames in, odometry out.

    The signals that vehicle.toml names choose what comes out: rear wheel counters, else wheel
    speeds, else speed with yaw rate, else an odometer (with a yaw rate if there is one), else the
    speed alone.

    Args:
        dbc: The database of the signals.
        vehicle: Names the signals; wheels give the scales.
        offset: s added to the frames' times.

    Raises:
        ReadError: The .dbc is not one, or does not know a signal.
    """

    def __init__(self, dbc: str | PathLike[str], vehicle: Vehicle, offset: float = 0.0) -> None:
        self.skipped_why: Counter[str] = Counter()
        signals = find_signals(dbc, vehicle, self.skipped_why)
        self._vehicle, self._offset = vehicle, offset
        self._by_frame: dict[int, list[_Bits]] = {}
        for role, signal in signals.items():
            self._by_frame.setdefault(signal.frame, []).append(_bits(role, signal))
        self._roles = set(signals)
        self._reverse_value = _reverse_value(signals, vehicle)
        self._backwards = False
        self._last: dict[str, tuple[float, float]] = {}  # role -> time, value
        self._waiting: tuple[float, float] | None = None  # a left wheel without its right one
        self._distance = 0.0
        bits = vehicle.counter_bits
        about = signals["wheel_rl_ticks"].about if "wheel_rl_ticks" in signals else None
        if about is not None and not bits and not about.is_float:
            bits = about.length
        self._counters = {
            "wheel_rl_ticks": _Unwrapped(bits, vehicle.metres_per_tick_left),
            "wheel_rr_ticks": _Unwrapped(bits, vehicle.metres_per_tick_right),
        }

    @property
    def frames(self) -> set[int]:
        """The ids that are needed, bit 31 marks those of 29 bits."""
        return set(self._by_frame)

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
        wanted = self._by_frame.get(frame)
        if wanted is None:
            return []
        stamp = (stamp if stamp > _REASONABLE else time.time()) + self._offset
        values = []
        for bits in wanted:
            if len(data) < bits.bytes:
                self.skipped_why["frame cut short"] += 1
                continue
            value = _value(bits, data)
            if not math.isfinite(value):
                self.skipped_why["no number"] += 1
            elif bits.role == "reverse":
                wanted_value = self._reverse_value
                self._backwards = value != 0.0 if wanted_value is None else value == wanted_value
            else:
                values.append((bits.role, value))
        return [one for role, value in values for one in self._take(role, stamp, value)]

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
            return [SpeedYaw(stamp, value, turning[1])]
        if "odometer" in self._roles:
            if role == "yaw_rate":
                return [YawRate(stamp, value)]
            return [Distance(stamp, value)] if role == "odometer" else []
        if role == "speed":
            if before is not None:
                self._distance += 0.5 * (value + before[1]) * (stamp - before[0])
            return [Distance(stamp, self._distance)]
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
                return [kind(stamp, value, other[1])]
            if self._waiting is not None:
                self.skipped_why["wheel without the other"] += 1
            self._waiting = (stamp, value)
            return []
        if role != right or self._waiting is None:
            return []
        (at, waiting), self._waiting = self._waiting, None
        if at == stamp or before is None or before[0] > at:
            return [kind(at, waiting, value)] if at == stamp else []
        part = (at - before[0]) / (stamp - before[0])
        return [kind(at, waiting, before[1] + part * (value - before[1]))]


class _Unwrapped:
    """One wheel counter: unwrapped, signed, jumps bridged at the speed before."""

    def __init__(self, bits: int, metres_per_tick: float) -> None:
        self._modulus, self._scale = 2.0**bits if bits else 0.0, metres_per_tick
        self._time, self._raw = -math.inf, 0.0
        self._rate = 0.0  # counts a second, of the last readings
        self._usual = 0.0  # s between readings
        self._total = 0.0

    @property
    def begun(self) -> bool:
        """Whether there was a reading."""
        return self._time > -math.inf

    @property
    def state(self) -> list[float]:
        """Its whole state."""
        return [self._time, self._raw, self._rate, self._usual, self._total]

    @state.setter
    def state(self, values: list[float]) -> None:
        self._time, self._raw, self._rate, self._usual, self._total = values

    def take(self, stamp: float, raw: float, backwards: bool, skipped: Counter[str]) -> float:
        """The cumulative count at a new reading."""
        if not self.begun:
            self._time, self._raw, self._total = stamp, raw, raw
            return self._total
        if stamp <= self._time:  # taken up by another clock: as if no time had passed
            self._time, self._raw = stamp, raw
            return self._total
        since = stamp - self._time
        gap = self._usual > 0.0 and since > 3.0 * self._usual
        step = raw - self._raw
        expected = abs(self._rate) * since
        if self._modulus:
            near = (expected if gap else 0.0) - step
            step += self._modulus * round(near / self._modulus)
        if abs(step) * self._scale > FASTEST * (since + _JITTER):
            skipped[JUMP] += 1
            step = expected if self._rate >= 0.0 else -expected
        elif backwards:
            step = -abs(step)
        if not gap:
            self._usual += 0.1 * (since - self._usual) if self._usual else since
            self._rate += 0.3 * (step / since - self._rate)
        self._time, self._raw = stamp, raw
        self._total += step
        return self._total


def _bits(role: str, signal: Signal) -> _Bits:
    """Where the bits of a signal are; the .dbc counts those of big endian from the left."""
    about = signal.about
    plain = role.endswith("_ticks") or role == "reverse"
    factor = 1.0 if plain else si_factor((about.unit or "").strip()) or 1.0
    scale, offset = factor * float(about.scale), factor * float(about.offset)
    little = about.byte_order == "little_endian"
    start = about.start if little else 8 * (about.start // 8) + 7 - about.start % 8
    needed = (start + about.length - 1) // 8 + 1
    shift = start if little else 8 * needed - start - about.length
    sign = 1 << (about.length - 1) if about.is_signed else 0
    return _Bits(
        role, shift, (1 << about.length) - 1, sign, little, needed, scale, offset,
        signal if about.is_float else None,
    )  # fmt: skip


def _value(bits: _Bits, data: bytes) -> float:
    """The physical value of a signal, SI."""
    if bits.slow is not None:
        raw = bits.slow.message.decode(
            data, decode_choices=False, scaling=False, allow_truncated=True
        )[bits.slow.name]
        return float(raw) * bits.scale + bits.offset
    number = int.from_bytes(data[: bits.bytes], "little" if bits.little else "big")
    number = number >> bits.start & bits.mask
    if number & bits.sign:
        number -= bits.mask + 1
    return number * bits.scale + bits.offset


def _reverse_value(signals: dict[str, Signal], vehicle: Vehicle) -> float | None:
    """The value of the `reverse` signal that means backwards; None: any but zero."""
    wanted = vehicle.signals.get("reverse_value")
    if wanted is None or "reverse" not in signals:
        return None
    choices = {str(n): float(v) for v, n in (signals["reverse"].about.choices or {}).items()}
    return choices[wanted] if wanted in choices else float(wanted)
