"""`vehicle.toml`: one car's wheels, antenna, clocks, signals and noise."""

import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import Any

from ..errors import ReadError, SettingError
from ..named_fields import likely_names
from ..settings import Settings, Vehicle
from .checks import read_bytes

ROLES = {  # role of a CAN signal -> what it is
    "wheel_rl_ticks": "counter of the left rear wheel",
    "wheel_rr_ticks": "counter of the right rear wheel",
    "wheel_rl": "speed of the left rear wheel",
    "wheel_rr": "speed of the right rear wheel",
    "reverse": "reverse gear: a flag, or the gear",
    "reverse_value": "the value of `reverse` that means backwards",
    "speed": "vehicle speed",
    "yaw_rate": "yaw rate, counter-clockwise positive",
    "odometer": "cumulative distance",
}
_WHEELS = {
    "track_width_m": ("track_width",),
    "metres_per_tick": ("metres_per_tick_left", "metres_per_tick_right"),
    "metres_per_tick_left": ("metres_per_tick_left",),
    "metres_per_tick_right": ("metres_per_tick_right",),
    "counter_bits": ("counter_bits",),
    "odometer_scale": ("odometer_scale",),
    "right_over_left": ("right_over_left",),
    "least_speed_mps": ("least_speed",),
}
_GYRO = {"scale": ("gyro_scale",), "bias_rad_s": ("gyro_bias",)}
_ANTENNA = {"forward_m": ("antenna_forward",), "left_m": ("antenna_left",)}
_SECTIONS = ("wheels", "gyro", "antenna", "clock", "signals", "sensors", "noise", "driving_side")


def read_vehicle(path: str | PathLike[str]) -> Vehicle:
    """Read one car's `vehicle.toml`.

    Args:
        path: The file; its sections are described in docs/formats.md.

    Raises:
        ReadError: The file is not TOML, a key is unknown (the closest known names are
            offered) or a value is not of the expected kind.
    """
    where = Path(path).name
    try:
        content = tomllib.loads(read_bytes(path).decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ReadError(f"{where}: not TOML ({error}); see docs/formats.md, vehicle.toml") from None
    return vehicle_from(content, where)


def vehicle_from(content: Mapping[str, Any], where: str = "vehicle") -> Vehicle:
    """The car that parsed TOML describes; `where` names the source in errors."""
    _known(content, _SECTIONS, where)
    given: dict[str, Any] = {}
    for name, meaning in (("wheels", _WHEELS), ("gyro", _GYRO), ("antenna", _ANTENNA)):
        for key, value in _section(content, name, meaning, where).items():
            for target in meaning[key]:
                given[target] = _number(value, f"{where}: [{name}] {key}")
    bits = given.get("counter_bits", 0)
    if bits != int(bits) or not 0 <= bits <= 64:
        raise ReadError(f"{where}: [wheels] counter_bits is {bits}; 0 to 64 was expected")
    given["counter_bits"] = int(bits)
    clock = _section(content, "clock", None, where)
    given["clock_offset"] = {k: _number(v, f"{where}: [clock] {k}") for k, v in clock.items()}
    signals = _section(content, "signals", ROLES, where)
    given["signals"] = {k: _text(v, f"{where}: [signals] {k}") for k, v in signals.items()}
    sensors = _section(content, "sensors", None, where)
    given["sensors"] = {k: _text(v, f"{where}: [sensors] {k}") for k, v in sensors.items()}
    noise = _section(content, "noise", [f.name for f in fields(Settings)], where)
    given["noise"] = {k: _number(v, f"{where}: [noise] {k}") for k, v in noise.items()}
    if "driving_side" in content:
        given["driving_side"] = content["driving_side"]
    for side in ("metres_per_tick_left", "metres_per_tick_right"):
        if given.get(side, 1.0) <= 0.0:
            raise ReadError(f"{where}: {side} is {given[side]} m; more than 0 was expected")
    try:
        Settings(**given["noise"])
        return Vehicle(**given)
    except SettingError as error:
        raise ReadError(f"{where}: {error}") from None


def _section(
    content: Mapping[str, Any], name: str, known: Iterable[str] | None, where: str
) -> dict[str, Any]:
    section = content.get(name, {})
    if not isinstance(section, dict):
        raise ReadError(f"{where}: {name} is {section!r}; a section [{name}] was expected")
    if known is not None:
        _known(section, known, f"{where}: [{name}]")
    return section


def _known(keys: Iterable[str], known: Iterable[str], where: str) -> None:
    known = list(known)
    for key in keys:
        if key not in known:
            raise ReadError(
                f"{where}: unknown key {key!r}; known are {', '.join(known)}; "
                f"{likely_names(key, known)}"
            )


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ReadError(f"{where} is {value!r}; a finite number was expected")
    return float(value)


def _text(value: Any, where: str) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ReadError(f"{where} is {value!r}; the name of a signal was expected")
    return str(value)
