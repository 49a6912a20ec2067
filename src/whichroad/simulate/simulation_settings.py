"""Every number of the simulator in one place: unit, meaning, source.

Sources: the paper (Smaili et al. 2007) gives map errors as 95 % radii, 10 m absolute
(4.1 m per axis) and 1 m relative; the counts are those of a rear-wheel ABS sensor.
The rest are choices of this project, and marked so.
"""

from dataclasses import dataclass, field, fields, replace
from typing import Any

from ..errors import SettingError


def _number(default: float, unit: str, meaning: str, source: str = "choice") -> Any:
    return field(default=default, metadata={"unit": unit, "meaning": meaning, "source": source})


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationSettings:
    """What is wrong with the map, how the car is driven, and what its sensors do."""

    map_sigma: float = _number(4.1, "m", "absolute map error, rms per axis", "paper: 10 m at 95 %")
    map_shortest: float = _number(1500, "m", "its shortest wavelength")
    map_longest: float = _number(4000, "m", "its longest wavelength")
    relative_sigma: float = _number(0.7, "m", "relative map error, rms per axis", "paper, widened")
    relative_shortest: float = _number(60, "m", "its shortest wavelength")
    relative_longest: float = _number(250, "m", "its longest wavelength")

    street_sigma: float = _number(0.6, "m", "a street's own lane against the usual one")
    lane_sigma: float = _number(0.3, "m", "how far the driver strays from the lane's middle")
    lane_length: float = _number(100, "m", "over which distance")
    lane_change_rate: float = _number(2e-4, "1/m", "visits to the next lane, on fast roads only")
    lane_width: float = _number(3.3, "m", "how far away that is")
    corner_smoothing: float = _number(4, "m", "sigma over which corners are cut")
    speed_profile_sigma: float = _number(
        0.1, "", "speed over the road's usual speed, per drive and along it"
    )
    acceleration: float = _number(1.5, "m/s²", "speeding up")
    braking: float = _number(2.0, "m/s²", "slowing down")
    lateral_acceleration: float = _number(2.5, "m/s²", "most that is felt in a bend")
    stop_probability: float = _number(0.15, "", "of having to stop at a junction")
    stop_time: float = _number(15, "s", "mean wait there")
    first_wait: float = _number(3, "s", "standing before the drive begins")

    odometry_rate: float = _number(10, "Hz", "readings of both rear wheel counters")
    metres_per_tick: float = _number(0.0404, "m", "one count", "ABS ring of 48 teeth")
    track_width: float = _number(1.5, "m", "between the rear wheels, as the user believes")
    scale_sigma: float = _number(0.01, "", "both wheels' radius against nominal, per drive")
    differential_sigma: float = _number(3e-4, "", "left against right radius, per drive")
    track_sigma: float = _number(0.007, "", "true track width against nominal, per drive")
    wheel_walk: float = _number(5e-4, "m/√m", "each wheel's own random walk")
    slip_rate: float = _number(0, "1/m", "one wheel slips")
    slip_sigma: float = _number(0.4, "m", "how far it turns too much or too little")

    antenna_forward: float = _number(1.0, "m", "antenna ahead of the rear axle's middle")
    antenna_left: float = _number(0.0, "m", "antenna left of it")
    gnss_rate: float = _number(1, "Hz", "fixes")
    gnss_bias_low: float = _number(2.5, "m", "slow error, rms per axis: drawn per drive from here")
    gnss_bias_high: float = _number(2.5, "m", "to here")
    gnss_time: float = _number(100, "s", "its correlation time; the clock stops with the car")
    gnss_white: float = _number(1.0, "m", "white error, rms per axis")
    gnss_axis_ratio: float = _number(1.4, "", "major over minor axis of the error ellipse")
    gnss_reported: float = _number(2.7, "m", "sigma that the receiver reports, per axis")
    gnss_reported_spread: float = _number(0.05, "", "its relative scatter from fix to fix")
    gnss_speed_sigma: float = _number(0.1, "m/s", "Doppler velocity, per axis")
    multipath_rate: float = _number(0, "1/m", "episodes of a false position, unreported")
    multipath_sigma: float = _number(25, "m", "how false, per axis")
    multipath_time: float = _number(10, "s", "mean length of an episode")

    outage_first: float = _number(1500, "m", "where the first outage begins")
    outage_length: float = _number(0, "m", "0: no outage", "paper: 1.5 km")
    outage_every: float = _number(5000, "m", "from one beginning to the next")

    driving_side: str = "right"

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if f.metadata and not 0 <= value < float("inf"):
                raise SettingError(
                    f"simulation setting {f.name} is {value!r} {f.metadata['unit']}; a finite "
                    f"number of at least 0 was expected ({f.metadata['meaning']})"
                )
        for name in ("odometry_rate", "metres_per_tick", "track_width", "gnss_rate", "gnss_time"):
            if getattr(self, name) == 0:
                raise SettingError(f"simulation setting {name} is 0; more than 0 was expected")
        if self.driving_side not in ("right", "left"):
            raise SettingError(
                f"driving_side is {self.driving_side!r}; 'right' or 'left' was expected"
            )


GOOD = SimulationSettings()
"""A receiver under open sky whose reported sigmas are right."""

URBAN = replace(
    GOOD,
    gnss_bias_low=8.0,
    gnss_bias_high=14.0,
    gnss_time=30.0,
    gnss_white=3.0,
    gnss_reported=6.0,
    multipath_rate=1e-4,
)
"""Street canyons: large errors of short correlation, reported at half their size."""

OUTAGE = replace(GOOD, outage_length=1500.0)
"""As `GOOD`, without any fix for 1.5 km in every 5 km."""

PRESETS = {"good": GOOD, "urban": URBAN, "outage": OUTAGE}
