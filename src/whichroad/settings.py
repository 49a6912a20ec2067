"""Every number a user may turn: unit, default, bounds, reason, source.

`Settings` are the model's, `Vehicle` describes one car.  Sources: the paper
(Smaili et al. 2007) gives map errors as 95 % radii, 10 m absolute and 1 m relative;
the rest was measured on simulated and real drives (docs/experiments-log.md).
"""

import json
from dataclasses import dataclass, field, fields, replace
from operator import attrgetter
from typing import Any

from ._compile import Records
from .errors import SettingError
from .filter.state import PARAMETERS, new_parameters
from .named_fields import by_name

_OF_THE_DRIVE = ("lever", "side", "mode", "paper")
_NAMES = tuple(name for name in PARAMETERS.names or () if name not in _OF_THE_DRIVE)
_SUFFIXED = {"outage_after": "outage_after_s"}
_read = attrgetter(*(_SUFFIXED.get(name, name) for name in _NAMES))


def _number(default: float, low: float, high: float, unit: str, why: str) -> Any:
    return field(default=default, metadata={"low": low, "high": high, "unit": unit, "why": why})


@by_name
@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """The model's numbers.  The defaults serve cars on OpenStreetMap roads."""

    heading_noise: float = _number(8e-4, 0, 0.1, "rad/√m", "heading random walk of wheel odometry")
    turn_noise: float = _number(0.012, 0, 0.5, "", "heading error per radian turned")
    along_noise: float = _number(0.01, 0, 1, "m/√m", "along-road random walk of wheel odometry")
    lateral_noise: float = _number(0.02, 0, 1, "m/√m", "cross-road random walk of wheel odometry")
    yaw_bias_noise: float = _number(2e-6, 0, 0.1, "rad/m/√m", "random walk of the heading drift")
    acceleration_noise: float = _number(
        1.5,
        0.01,
        20,
        "m/s/√s",
        "speed random walk where there is no odometry, and a speed every second",
    )
    scale_sigma: float = _number(
        0.012, 1e-5, 0.5, "", "sigma of the odometer scale, before it is learnt"
    )
    drift_sigma: float = _number(
        3e-4, 0, 0.1, "rad/m", "sigma of the heading drift, before it is learnt"
    )
    lane_sigma: float = _number(
        0.6, 0.01, 50, "m", "offset from the usual lane; more where there are several"
    )
    lane_length: float = _number(150, 1, 1e5, "m", "distance over which that offset persists")
    map_sigma: float = _number(
        4.6, 0.01, 100, "m", "absolute map error per axis (paper: 10 m, 95 %: 4.1; erring large)"
    )
    map_length: float = _number(1000, 10, 1e6, "m", "distance over which the map error persists")
    relative_sigma: float = _number(0.7, 0.01, 20, "m", "relative map error (paper: 1 m, 95 %)")
    edge_heading_sigma: float = _number(
        0.095, 0.001, 1, "rad", "chord heading against the vehicle's"
    )
    node_radius: float = _number(
        12, 0, 100, "m", "radius about a junction where the line is not driven"
    )
    node_sigma: float = _number(1.5, 0, 20, "m", "extra lateral error there")
    node_heading_sigma: float = _number(0.5, 0, 3, "rad", "extra heading error there")
    map_spacing: float = _number(5, 0.5, 50, "m", "distance between map observations")
    gnss_white_ratio: float = _number(
        0.5, 0.01, 10, "", "ratio of white to correlated GNSS error, at one fix a second"
    )
    gnss_time: float = _number(80, 0.1, 1e5, "s", "how long the GNSS error lasts while moving")
    gnss_gate: float = _number(9, 1, 1e6, "", "chi-square beyond which a fix is down-weighted")
    gnss_adapt_time: float = _number(
        40,
        1,
        1e12,
        "s",
        "time in which the scale of reported sigmas is learnt; 1e10: never, nor the map's error",
    )
    gnss_start: float = _number(
        1.5, 1, 100, "", "initial ratio of GNSS sigmas to the reported ones"
    )
    gnss_inflation: float = _number(
        2.0, 1, 100, "", "initial ratio of GNSS sigmas where only roads can check them; 1: none"
    )
    gnss_fault_time: float = _number(
        60, 1, 1e9, "s", "mean duration of gross errors of the receiver"
    )
    gnss_lost: float = _number(
        0.02, 0, 0.5, "", "P(the estimate was wrong) when a fix is far from it"
    )
    off_road_leave: float = _number(2e-5, 0, 0.1, "1/m", "rate of leaving the mapped roads")
    off_road_return: float = _number(0.01, 0, 1, "1/m", "rate of coming back to one")
    off_road_cost: float = _number(
        0.1, 0, 10, "nats/m", "what following a road by chance costs an off-road vehicle"
    )
    off_road_start: float = _number(0.05, 0, 1, "", "probability of starting off the roads")
    wrong_way: float = _number(2e-4, 0, 1, "", "weight of driving against a one-way or a ban")
    u_turn_rate: float = _number(1e-3, 0, 0.1, "1/s", "rate of U-turns of a slow vehicle")
    search_radius: float = _number(30, 1, 5000, "m", "smallest candidate radius (paper: 30 m)")
    prune: float = _number(1e-4, 0, 0.1, "", "hypotheses below this probability are dropped")
    merge: float = _number(1e-4, 0, 100, "nats", "Runnalls cost below which two are merged")
    components: float = _number(4, 1, 8, "", "Gaussians kept per directed edge")
    lost_after: float = _number(
        8, 1, 1e4, "", "consecutive fixes that fit nothing, until a new start"
    )

    protection_risk: float = _number(
        1e-3, 1e-12, 0.5, "", "risk of a position error beyond the protection level"
    )
    unknown: float = _number(
        7e-4, 0, 0.1, "", "P(none of what the model knows), measured on roads 8 m apart"
    )

    default_sigma_m: float = _number(5.0, 0.01, 500, "m", "sigma of single fixes that report none")
    user_range_error_m: float = _number(4.0, 0.1, 100, "m", "sigma per HDOP of single fixes")
    outage_after_s: float = _number(
        3.0, 0.1, 1e4, "s", "time without a fix until the status is outage"
    )
    ambiguous_below: float = _number(0.95, 0.5, 1, "", "P(way) below which the status is ambiguous")

    # model="paper" only; the paper gives the radius and leaves the rest open
    paper_stay: float = _number(0.9, 0.01, 0.9999, "", "B(i, i): P(the same road) at the next step")
    paper_radius: float = _number(30, 1, 1000, "m", "candidate radius (paper: 30 m)")
    paper_width: float = _number(3.5, 0.1, 100, "m", "the road's width, sigma across it")
    paper_heading_sigma: float = _number(0.1, 0.001, 3, "rad", "sigma of the segment's heading")
    paper_step: float = _number(1, 0, 1e4, "s", "time between map observations; 0: every epoch")

    def __post_init__(self) -> None:
        for f in fields(self):
            value, meta = getattr(self, f.name), f.metadata
            if not meta["low"] <= value <= meta["high"]:
                raise SettingError(
                    f"{f.name} is {value!r} {meta['unit']}; between {meta['low']:g} and "
                    f"{meta['high']:g} was expected ({meta['why']})"
                )


@by_name
@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """One car: wheels, antenna, clocks, signals; `vehicle.toml` in Python."""

    track_width: float = 1.5  # m, between the rear wheels
    metres_per_tick_left: float = 0.0404
    metres_per_tick_right: float = 0.0404
    counter_bits: int = 0  # 0: counters do not wrap
    odometer_scale: float = 1.0  # metres for each metre of speeds and odometers; not of counts
    right_over_left: float = 1.0  # true metres for each metre of wheel speeds, right over left
    least_speed: float = 0.0  # m/s, below which odometry reads 0; 0: found by its readings
    gyro_scale: float = 1.0  # radians for each radian of a yaw rate
    gyro_bias: float = 0.0  # rad/s of a yaw rate while the vehicle does not turn
    antenna_forward: float = 0.0  # m, antenna ahead of the rear axle's middle
    antenna_left: float = 0.0  # m
    clock_offset: dict[str, float] = field(default_factory=dict)  # s added to a source's times
    signals: dict[str, str] = field(default_factory=dict)  # role -> signal name in the .dbc
    sensors: dict[str, str] = field(default_factory=dict)  # column of a sensor -> signal name
    noise: dict[str, float] = field(default_factory=dict)  # settings that this car overrides
    driving_side: str = "right"

    def __post_init__(self) -> None:
        if not 0.0 < self.track_width <= 5.0:
            hint = "; is it in millimetres?" if self.track_width > 5.0 else ""
            raise SettingError(
                f"track_width is {self.track_width} m; more than 0, at most 5 m was expected{hint}"
            )
        for name in ("odometer_scale", "right_over_left", "gyro_scale"):
            value = getattr(self, name)
            if not 0.1 <= abs(value) <= 10.0 or (value < 0.0 and name != "gyro_scale"):
                raise SettingError(f"{name} is {value}; 0.1 to 10 was expected")
        if not 0.0 <= self.least_speed <= 3.0:
            raise SettingError(
                f"least_speed is {self.least_speed} m/s; 0 to 3 m/s was expected; is it in km/h?"
            )
        if not abs(self.gyro_bias) <= 1.0:
            raise SettingError(
                f"gyro_bias is {self.gyro_bias} rad/s; within 1 rad/s was expected; is it in "
                "degrees a second?"
            )
        for name in ("antenna_forward", "antenna_left"):
            value = getattr(self, name)
            if not abs(value) <= 30.0:
                raise SettingError(
                    f"{name} is {value} m; within 30 m was expected; is it in millimetres?"
                )
        if self.driving_side not in ("right", "left"):
            raise SettingError(
                f"driving_side is {self.driving_side!r}; 'right' or 'left' was expected"
            )


_USUAL, _A_CAR = Settings(), Vehicle()  # checking their numbers takes as long as some fixes


def tuned_by(settings: Settings | None, vehicle: Vehicle | None) -> Settings:
    """The settings with what the vehicle's `[noise]` overrides.

    Raises:
        SettingError: One of them is of another type.
    """
    settings = _USUAL if settings is None else settings
    vehicle = _A_CAR if vehicle is None else vehicle
    for given, kind in ((settings, Settings), (vehicle, Vehicle)):
        if not isinstance(given, kind):
            name = kind.__name__
            raise SettingError(
                f"{name.lower()} is a {type(given).__name__}; whichroad.{name}(...) was expected, "
                "its fields by name"
            )
    return replace(settings, **vehicle.noise) if vehicle.noise else settings


def parameters(settings: Settings, vehicle: Vehicle, mode: int, *, paper: bool = False) -> Records:
    """The numbers as the kernels take them.

    Args:
        settings: The model's.
        vehicle: For its antenna and the side on which it is driven.
        mode: WHEELS, DISTANCE or CLOCK, see `filter.state`.
        paper: Whether the filter is the paper's own.

    Returns:
        (1,) `filter.state.PARAMETERS`.
    """
    par = new_parameters()
    lever = (vehicle.antenna_forward, vehicle.antenna_left)
    side = 1.0 if vehicle.driving_side == "right" else -1.0
    values = dict(zip(_NAMES, _read(settings), strict=True))
    values |= {"lever": lever, "side": side, "mode": mode, "paper": paper}
    if paper:  # it knows no "none of these"
        values["unknown"] = 0.0
    par[0] = tuple(values[name] for name in PARAMETERS.names or ())
    return par


def to_toml(vehicle: Vehicle) -> str:
    """`vehicle.toml` of one car, as `whichroad.readers.read_vehicle` reads it."""

    def text(value: float | str) -> str:
        # a TOML basic string is a JSON string, up to DEL
        return (
            json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
            if isinstance(value, str)
            else repr(value)
        )

    def section(name: str, items: dict[str, Any]) -> list[str]:
        lines = [f"{text(key)} = {text(value)}" for key, value in items.items()]
        return ["", f"[{name}]", *lines] if lines else []

    wheels = {
        "track_width_m": vehicle.track_width,
        "metres_per_tick_left": vehicle.metres_per_tick_left,
        "metres_per_tick_right": vehicle.metres_per_tick_right,
        "counter_bits": vehicle.counter_bits,
    }
    for name in ("odometer_scale", "right_over_left"):
        if getattr(vehicle, name) != 1.0:
            wheels[name] = getattr(vehicle, name)
    if vehicle.least_speed:
        wheels["least_speed_mps"] = vehicle.least_speed
    gyro = {}
    if (vehicle.gyro_scale, vehicle.gyro_bias) != (1.0, 0.0):
        gyro = {"scale": vehicle.gyro_scale, "bias_rad_s": vehicle.gyro_bias}
    antenna = {"forward_m": vehicle.antenna_forward, "left_m": vehicle.antenna_left}
    lines = [f"driving_side = {text(vehicle.driving_side)}"]
    lines += section("wheels", wheels) + section("gyro", gyro)
    lines += section("antenna", antenna)
    lines += section("clock", vehicle.clock_offset) + section("signals", vehicle.signals)
    lines += section("sensors", vehicle.sensors)
    lines += section("noise", vehicle.noise)
    return "\n".join(lines) + "\n"
