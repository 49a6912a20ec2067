"""What is calibrated: its names and units, how it is read from a car and put into one."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..diagnosis.statistics import ConsistencyStatistics
from ..observations import OdometryLog, SpeedYawRate, WheelCounts, WheelSpeeds, WithGyro
from ..settings import Vehicle
from .drives_run import GNSS, clock_of

SCALE, RATIO, TRACK = "odometer scale", "right over left", "track width"
GYRO_SCALE, GYRO_BIAS = "gyro scale", "gyro bias"
FORWARD, LEFT, CLOCK = "antenna forward", "antenna left", "gnss clock offset"
GNSS_SIGMA, GNSS_TIME, GNSS_WHITE = "gnss sigma", "gnss duration", "gnss white"
ACROSS = "errors across the road"  # of map and lane together

UNITS = {
    SCALE: "of the start", RATIO: "", TRACK: "m", GYRO_SCALE: "", GYRO_BIAS: "rad/s",
    FORWARD: "m", LEFT: "m", CLOCK: "s", GNSS_SIGMA: "of the reported", GNSS_TIME: "s",
    GNSS_WHITE: "of the reported", ACROSS: "m",
}  # fmt: skip
METHOD = {  # sigma of what the method itself errs by, on simulated cars of 12 drives
    SCALE: 6e-4, RATIO: 0.0, TRACK: 0.008, GYRO_SCALE: 5e-3, GYRO_BIAS: 1e-4, FORWARD: 0.25,
    LEFT: 0.1, CLOCK: 5e-3,
}  # fmt: skip
SIGMAS = frozenset((GNSS_SIGMA, GNSS_TIME, GNSS_WHITE, ACROSS))
WIDEST = {  # half of a 95 % interval beyond which the data say nothing of use
    SCALE: 0.01, RATIO: 0.003, TRACK: 0.1, GYRO_SCALE: 0.05, GYRO_BIAS: 0.003,
    FORWARD: 1.0, LEFT: 1.0, CLOCK: 0.2, GNSS_SIGMA: 0.5, GNSS_TIME: 80.0, GNSS_WHITE: 0.3,
    ACROSS: 2.0,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Quantity:
    """One number of a car, as its drives tell it."""

    name: str
    unit: str
    start: float  # as it was thought to be
    value: float  # as it goes into the car: the start's where the data cannot tell
    estimate: float  # by the drives
    low: float  # 95 % interval of the estimate
    high: float
    told: bool  # whether the data can tell
    gain: float  # nats a held-out drive, against the value at the start; nan: not measured
    gain_sigma: float  # its standard error

    def __str__(self) -> str:
        text = f"{self.name}: {self.value:.6g} {self.unit}".rstrip()
        if not self.told:
            text += " as before; the data cannot tell"
        text += f" (95 %: {self.low:.5g} to {self.high:.5g})"
        if self.gain == self.gain:
            text += f"; held-out evidence {self.gain:+.2f} ± {self.gain_sigma:.2f} nats a drive"
        return text


def named(log: OdometryLog) -> tuple[str, ...]:
    """The quantities of odometry that a log can tell of."""
    match log:
        case WheelCounts() | WheelSpeeds() | WithGyro(distance=WheelCounts() | WheelSpeeds()):
            return (SCALE, RATIO, TRACK, FORWARD, LEFT, CLOCK)
        case SpeedYawRate() | WithGyro():
            return (SCALE, GYRO_SCALE, GYRO_BIAS, FORWARD, LEFT, CLOCK)
    return (SCALE, FORWARD, LEFT, CLOCK)


def values_of(vehicle: Vehicle, start: Vehicle) -> dict[str, float]:
    """The numbers of a car by their names; its scale is over that of the start."""
    ticks = vehicle.metres_per_tick_left + vehicle.metres_per_tick_right
    before = start.metres_per_tick_left + start.metres_per_tick_right
    return {
        SCALE: ticks / before * vehicle.odometer_scale / start.odometer_scale,
        RATIO: vehicle.metres_per_tick_right / vehicle.metres_per_tick_left
        * vehicle.right_over_left,
        TRACK: vehicle.track_width,
        GYRO_SCALE: vehicle.gyro_scale,
        GYRO_BIAS: vehicle.gyro_bias,
        FORWARD: vehicle.antenna_forward,
        LEFT: vehicle.antenna_left,
        CLOCK: clock_of(vehicle),
    }  # fmt: skip


def with_values(start: Vehicle, values: Mapping[str, float], log: OdometryLog) -> Vehicle:
    """A car with these numbers, put where its odometry takes them from."""
    log = log.distance if isinstance(log, WithGyro) else log
    now = values_of(start, start) | dict(values)
    scale, ratio = now[SCALE], now[RATIO]
    fields: dict[str, float] = {
        "track_width": now[TRACK], "gyro_scale": now[GYRO_SCALE], "gyro_bias": now[GYRO_BIAS],
        "antenna_forward": now[FORWARD], "antenna_left": now[LEFT],
    }  # fmt: skip
    if isinstance(log, WheelCounts):
        both = scale * (start.metres_per_tick_left + start.metres_per_tick_right)
        left = both / (1.0 + ratio / start.right_over_left)
        fields |= {"metres_per_tick_left": left, "metres_per_tick_right": both - left}
    else:
        fields["odometer_scale"] = scale * start.odometer_scale
        by_ticks = start.metres_per_tick_right / start.metres_per_tick_left
        fields["right_over_left"] = ratio / by_ticks
    clock = dict(start.clock_offset)
    if now[CLOCK] != clock_of(start):
        clock[GNSS] = now[CLOCK]
    return replace(start, **fields, clock_offset=clock)  # type: ignore[arg-type]


def untold(sums: ConsistencyStatistics) -> frozenset[str]:
    """What the statistics of some drives tell nothing of: they would leave it as it is."""
    names: set[str] = set()
    if not sums.turned:
        names |= {RATIO, TRACK, GYRO_SCALE, GYRO_BIAS}
    if not sums.counted > 0.0:
        names |= {SCALE}
    if not sums.shift()[2] < math.inf:
        names |= {FORWARD, LEFT, CLOCK}
    return frozenset(names)


def stepped(values: Mapping[str, float], sums: ConsistencyStatistics) -> dict[str, float]:
    """Where the statistics of some drives say that the numbers are, as filtered with `values`."""
    now = dict(values)
    gain, drift = sums.turns()
    late, antenna, sigma_late, _ = sums.shift()
    now[SCALE] *= sums.scale
    if sums.by_time:
        now[GYRO_BIAS] -= drift / (gain * now[GYRO_SCALE])
        now[GYRO_SCALE] *= gain
    else:
        half = 0.5 * drift * now[TRACK] / gain
        now[RATIO] *= (1.0 + half) / (1.0 - half)
        now[TRACK] *= sums.scale / gain
    if sigma_late < math.inf:
        now[FORWARD] += antenna.real
        now[LEFT] += antenna.imag
        now[CLOCK] -= late
    return now
