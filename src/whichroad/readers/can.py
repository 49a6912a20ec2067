"""CAN logs to odometry, by the user's .dbc and the signals that vehicle.toml names.

Rear-wheel counters come first, as in the paper; then wheel speeds, speed with yaw rate,
an odometer with yaw rate, an odometer, speed alone.
"""

import math
from collections import Counter
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ReadError
from ..geodesy.angles import DEGREE, degrees
from ..geodesy.units import KMH, KNOT, MPH
from ..observations import Array, Drive, OdometryLog, SensorReading
from ..settings import Vehicle
from ..wording import by_reason
from .can_absent import NOT_AVAILABLE, absent
from .can_frames import Frames, read_frames
from .can_signals import Signal, find_signals, names_of, senders_of
from .checks import LAST, NO_TIME, Skipped, in_order, keep, listed
from .drive_columns import odometer, odometer_from_speed, speed_yaw_rate, steered, unused, yaw_rates
from .j1939 import unmarked
from .names import SENSED
from .table_units import possible_yaw_rate
from .wheel_counters import Reversing, held, wheel_counts, wheel_speeds

SI_UNITS = {
    **dict.fromkeys(("m/s", "m/sec", "mps", "meter/second", "meters/second"), 1.0),
    **dict.fromkeys(("km/h", "kmh", "kph", "km/hr", "kmph"), KMH),
    **dict.fromkeys(("mph", "mi/h", "miles/h"), MPH),
    **dict.fromkeys(("kn", "kt", "knots"), KNOT),
    **dict.fromkeys(("rad/s", "rad/sec"), 1.0),
    **dict.fromkeys(("deg/s", "deg/sec", "degree/s", "degrees/s", "degree/second"), DEGREE),
    **dict.fromkeys(("°/s", "º/s", "°/sec", "dps", "grad/s", "grad/sec", "grad/sek"), DEGREE),
    "m": 1.0,
    "meter": 1.0,
    "cm": 0.01,
    "mm": 1e-3,
    "km": 1e3,
    "mi": 1609.344,
    "miles": 1609.344,
}  # units of a .dbc in lower case, without blanks
_PLAIN = {"wheel_rl_ticks", "wheel_rr_ticks", "reverse"}  # roles without a unit


def si_factor(unit: str) -> float | None:
    """The factor to SI of a unit as a .dbc writes it; None: the unit is not known."""
    # cantools takes a .dbc for cp1252; in those in UTF-8 the degree sign has a letter before it
    return SI_UNITS.get(unit.lower().replace(" ", "").replace("â°", "°"))


Series = tuple[Array, Array]  # times, values


def unit_factor(column: str, unit: str) -> float:
    """The factor from a .dbc's unit to that which the name of a sensor's column ends with."""
    if column.endswith("_deg"):
        return degrees(1.0) if unit.lower() in ("rad", "radian", "radians") else 1.0
    return (si_factor(unit) or 1.0) if column.endswith(("_m", "_mps", "_radps")) else 1.0


def read_can(
    path: str | PathLike[str], dbc: str | PathLike[str] | None, vehicle: Vehicle,
    columns: Iterable[str] = (),
) -> Drive:  # fmt: skip
    """Read a car's odometry, and what further sensors say, from a CAN log.

    Args:
        path: candump text or anything python-can reads.
        dbc: The database of its signals.
        vehicle: `[signals]` names the signals by role; wheels give the scales.  `[sensors]`
            names those of further sensors by column.
        columns: Aliases of columns that further sensors read, as `Sensed.columns` has them.

    Returns:
        A drive without fixes, and what was skipped.

    Raises:
        ReadError: There is no .dbc, a signal is unknown or multiplexed, or nothing that
            moves the vehicle is in the log.
    """
    where = Path(path).name
    if dbc is None:
        raise ReadError(f"{where}: a CAN log needs the .dbc that describes it; give --dbc FILE")
    skipped: Skipped = Counter()
    signals = find_signals(dbc, vehicle, skipped, columns)
    senders = senders_of(signals)
    frames = read_frames(path, names_of(signals), skipped)
    came = {s.frame: s.frame for s in signals.values() if not s.j1939 and s.frame in frames}
    used = reverse_value(signals, vehicle)

    def first(ours: int, frame: int) -> float:
        return _first_value(
            {r: s for r, s in signals.items() if s.frame == ours}, frames[frame], used
        )

    came |= senders.chosen(frames, first)
    missing = [s for s in signals.values() if s.frame not in came]
    notes = [f"frame {one.message}: {one.text}" for one in senders.told()]
    series = {
        role: _series(signal, role, frames[came[signal.frame]], used, skipped, notes)
        for role, signal in signals.items()
        if signal.frame in came
    }
    series = {role: one for role, one in series.items() if len(one[0])}
    sensed = _sensed({r: series.pop(r) for r in list(series) if r.startswith(SENSED)})
    log = _odometry(series, signals, vehicle, skipped, notes)
    if log is None and not sensed:
        silent = sorted(f"{s.name} (frame {s.message.name})" for s in signals.values())
        why = f" ({by_reason(skipped)})" if skipped else ""
        ids = listed(sorted({s.where for s in missing}))
        right = f"no frame {ids} came; " if missing else ""
        right += f"{heard}; " if (heard := senders.heard()) else ""
        right += unmarked(missing, frames) or "is it the right .dbc?"
        raise ReadError(
            f"{where}: none of {', '.join(silent)} moves the vehicle in it{why}; both rear wheels, "
            f"speed with yaw rate, an odometer or a speed were expected; {right}"
        )
    notes += [f"signal {s.name}: no frame {s.where} is in the log" for s in missing]
    if log is not None:
        notes += unused({role for role, (_, values) in series.items() if len(values)}, log)
    return Drive(
        Path(path).stem, None, log, (str(path),), dict(skipped), tuple(notes), sensed,
        geared=log is not None and "reverse" in series,
    )  # fmt: skip


def _sensed(series: dict[str, Series]) -> tuple[SensorReading, ...]:
    """What further sensors say: one reading for all of their signals of one time."""
    at: dict[float, dict[str, float]] = {}
    for role, (time, values) in series.items():
        for when, value in zip(time.tolist(), values.tolist(), strict=True):
            if math.isfinite(value):
                at.setdefault(when, {})[role.removeprefix(SENSED)] = value
    return tuple(SensorReading(when, at[when]) for when in sorted(at))


def decode(signal: Any, data: Any) -> Array:
    """Physical values of one signal in many frames.

    Args:
        signal: cantools' description: start, length, byte order, sign, scale, offset.
        data: Payloads, (n, bytes) of uint8.

    Returns:
        (n,) values; the same as cantools' own, frame by frame.  The signal lies in at most
        eight bytes that are all there.
    """
    return _scaled(_numbers(signal, data), signal)


def _scaled(numbers: Array, signal: Any) -> Array:
    """Physical values of numbers."""
    with np.errstate(invalid="ignore", over="ignore"):  # floats may hold anything
        return np.asarray(numbers * float(signal.scale) + float(signal.offset))


def _numbers(signal: Any, data: Any) -> Array:
    """What `decode` scales."""
    start, length = signal.start, signal.length
    if signal.byte_order == "little_endian":
        first, shift = divmod(start, 8)
        columns = range(first, (start + length - 1) // 8 + 1)
    else:  # the dbc names the most significant bit, counted from each byte's right end
        first, left = divmod(8 * (start // 8) + 7 - start % 8, 8)
        columns = range(first, first + -(-(left + length) // 8))[::-1]
        shift = 8 * len(columns) - left - length
    raw = np.zeros(len(data), np.uint64)
    for place, column in enumerate(columns):
        raw |= data[:, column].astype(np.uint64) << np.uint64(8 * place)
    raw = (raw >> np.uint64(shift)) & np.uint64((1 << length) - 1)
    return _number(raw, signal)


def _number(raw: NDArray[np.uint64], signal: Any) -> Array:
    """The number that a signal's bits, right-aligned, stand for."""
    if signal.is_float:
        kind = {16: np.float16, 32: np.float32, 64: np.float64}[signal.length]
        with np.errstate(invalid="ignore"):  # bits that are no number
            return raw.astype(f"<u{signal.length // 8}").view(kind).astype(np.float64)
    if signal.is_signed:
        spare = np.int64(64 - signal.length)  # shifting there and back repeats the sign's bit
        return ((raw.view(np.int64) << spare) >> spare).astype(np.float64)
    return raw.astype(np.float64)


def _given(
    signal: Signal, role: str, frames: Frames, used: float | None, skipped: Skipped
) -> Series:
    """Times and numbers, before scale and offset, where frames have a value of one signal."""
    about = signal.about
    first, last = _bytes(about)
    whole = keep(frames.length > last, "frame cut short", skipped)
    whole &= keep((np.abs(frames.time) < LAST) | ~whole, NO_TIME, skipped)
    time, data = frames.time[whole], frames.data[whole]
    if last - first < 8:
        numbers = _numbers(about, data)
    else:
        numbers = np.array([_slow(signal, bytes(row)) for row in data], np.float64)
    used = used if role == "reverse" else None
    none = absent(about, counter=role.endswith("_ticks"), used=used).among(numbers)
    there = keep(~none, NOT_AVAILABLE, skipped)
    return time[there], numbers[there]


def _first_value(signals: dict[str, Signal], frames: Frames, used: float | None) -> float:
    """When frames have a value of any of the signals first, s; inf: never."""
    at = [math.inf]
    for role, signal in signals.items():
        time, numbers = _given(signal, role, frames, used, Counter())
        at += time[np.isfinite(numbers)][:1].tolist()
    return min(at)


def _series(
    signal: Signal,
    role: str,
    frames: Frames,
    used: float | None,
    skipped: Skipped,
    notes: list[str],
) -> Series:
    """Times and SI values of one signal."""
    about = signal.about
    time, numbers = _given(signal, role, frames, used, skipped)
    values = _scaled(numbers, about)
    unit = (about.unit or "").strip()
    if role.startswith(SENSED):
        values = values * unit_factor(role.removeprefix(SENSED), unit)
    elif role not in _PLAIN:
        factor = si_factor(unit)
        values = values * (factor or 1.0)
        if role == "yaw_rate":
            said = f"signal {signal.name} (unit {unit!r})"
            turns, more = possible_yaw_rate(values, None, said, factor is None)
            values = values * turns
            notes += more
            factor = 1.0 if more or factor else None
        if factor is None:
            notes.append(f"signal {signal.name}: unit {unit!r} taken as SI")
    order = in_order(time, skipped)
    return time[order], values[order]


def _bytes(about: Any) -> tuple[int, int]:
    """The first and the last byte of a frame that a signal touches."""
    start = about.start
    if about.byte_order == "big_endian":
        start = 8 * (start // 8) + 7 - start % 8
    return start // 8, (start + about.length - 1) // 8


def _slow(signal: Signal, data: bytes) -> float:
    decoded = signal.message.decode(data, decode_choices=False, scaling=False, allow_truncated=True)
    return float(decoded[signal.name])


def _reversing(
    series: dict[str, Series], signals: dict[str, Signal], vehicle: Vehicle
) -> Reversing | None:
    """When the vehicle goes backwards, where a signal reports it."""
    if "reverse" not in series:
        return None
    time, value = series["reverse"]
    wanted = reverse_value(signals, vehicle)
    return time, np.asarray(value != 0 if wanted is None else value == wanted)


def reverse_value(signals: dict[str, Signal], vehicle: Vehicle) -> float | None:
    """The value of the signal `reverse` that means backwards; None: any but zero.

    Raises:
        ReadError: The vehicle names a value that the signal does not have.
    """
    wanted = vehicle.signals.get("reverse_value")
    if wanted is None or "reverse" not in signals:
        return None
    choices = {str(n): float(v) for v, n in (signals["reverse"].about.choices or {}).items()}
    try:
        return choices[wanted] if wanted in choices else float(wanted)
    except ValueError:
        raise ReadError(
            f"vehicle: [signals] reverse_value is {wanted!r}; a number or one of "
            f"its named values ({listed(sorted(choices))}) was expected"
        ) from None


def _odometry(
    series: dict[str, Series],
    signals: dict[str, Signal],
    vehicle: Vehicle,
    skipped: Skipped,
    notes: list[str],
) -> OdometryLog | None:
    """The best odometry among the signals that came."""
    reversing = _reversing(series, signals, vehicle)
    if {"wheel_rl_ticks", "wheel_rr_ticks"} <= series.keys():
        left, right = series["wheel_rl_ticks"], series["wheel_rr_ticks"]
        about = signals["wheel_rl_ticks"].about
        bits = vehicle.counter_bits or (0 if about.is_float else about.length)
        counts = wheel_counts(
            left, right, vehicle, skipped, bits=bits, reversing=reversing, notes=notes
        )
        return counts if len(counts.time) else None
    if {"wheel_rl", "wheel_rr"} <= series.keys():
        left, right = series["wheel_rl"], series["wheel_rr"]
        speeds = wheel_speeds(left, right, skipped, reversing=reversing)
        return speeds if len(speeds.time) else None
    if "speed" in series:
        time, speed = series["speed"]
        if reversing is not None:
            speed = np.where(held(reversing, time), -np.abs(speed), speed)
        if "yaw_rate" in series:
            return speed_yaw_rate(time, speed, _at(time, *series["yaw_rate"]), skipped)
    if "odometer" in series:
        gyro = yaw_rates(*series["yaw_rate"], skipped) if "yaw_rate" in series else None
        return steered(odometer(*series["odometer"], skipped), gyro)
    return odometer_from_speed(time, speed, skipped) if "speed" in series else None


def _at(time: Array, known_at: Array, values: Array) -> Array:
    """Values between readings; NaN before the first and after the last."""
    if len(known_at) == 0:
        return np.full(len(time), np.nan)
    return np.interp(time, known_at, values, left=np.nan, right=np.nan)
