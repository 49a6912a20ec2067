"""What passes between modules: columns of a recorded drive, and single observations.

Times are seconds since 1970-01-01 UTC.  Names of what is in degrees end in `_deg`, and it stays
outside the filter.  A quantity that a sensor did not report has an infinite sigma, never a NaN.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from .errors import SettingError
from .geodesy.angles import Array as Array
from .geodesy.angles import degrees
from .named_fields import Record, by_name

FROM_HDOP, ASSUMED = 1, 2  # Fixes.flags: covariance from HDOP times an error; the default
NO_CORRELATION = 4  # the ellipse was not credible, only sigma_lat and sigma_lon were used
FROM_QUALITY, RECKONED_PLACE = 8, 32768  # sigma by the kind of fix; dead-reckoned by the receiver
# few decimals, in the covariance; none: on a line between fixes, out of reach, unknown; with noise
ROUNDED, INTERPOLATED, STRAY, LATE_PLACE, SCATTERED = 16, 32, 2048, 8192, 16384
HELD_SPEED, HELD_COURSE, ZERO_SPEED = 64, 128, 256  # not used: it repeats the row before; is 0
CUT_SPEED, COARSE_COURSE, OTHER_UNIT = 512, 1024, 4096  # half a step added; not used; not used

SIGMA_SPEED = 0.3  # m/s, Doppler speed of a receiver that reports no sigma
MOVING = 1.0  # m/s, below it a course over ground means nothing


@dataclass(frozen=True, slots=True)
class Fixes:
    """GNSS fixes, time-ordered, shape (n,) each."""

    time: Array  # s since 1970 UTC
    lat_deg: Array
    lon_deg: Array
    cov_ee: Array  # m², east-east
    cov_en: Array  # m²
    cov_nn: Array  # m²
    speed: Array  # m/s; meaningless where sigma_speed is inf
    sigma_speed: Array
    bearing_deg: Array  # course over ground, clockwise from north
    sigma_bearing_deg: Array
    flags: NDArray[np.uint16]

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True, slots=True)
class WheelCounts:
    """Cumulative counts of the rear wheels, unwrapped, signed (reverse counts down)."""

    time: Array
    left: Array  # counts
    right: Array


@dataclass(frozen=True, slots=True)
class WheelSpeeds:
    """Speeds of the rear wheels, negative in reverse.

    Without a sign it takes some metres of fixes to tell who backs up (`filter.hypotheses.no_sign`).
    """

    time: Array
    left: Array  # m/s
    right: Array


@dataclass(frozen=True, slots=True)
class Odometer:
    """Cumulative distance, without heading."""

    time: Array
    distance: Array  # m


@dataclass(frozen=True, slots=True)
class SpeedYawRate:
    """Speed of the rear axle's middle and yaw rate, counter-clockwise positive."""

    time: Array
    speed: Array  # m/s
    yaw_rate: Array  # rad/s


@dataclass(frozen=True, slots=True)
class YawRates:
    """Readings of a gyro, counter-clockwise positive."""

    time: Array
    rate: Array  # rad/s


@dataclass(frozen=True, slots=True)
class WithGyro:
    """An odometer or wheels, and a gyro beside them, each at its own times."""

    distance: Odometer | WheelCounts | WheelSpeeds
    gyro: YawRates

    @property
    def time(self) -> Array:
        """Of the readings of distance."""
        return self.distance.time


@by_name
@dataclass(frozen=True, slots=True)
class SensorReading:
    """One reading of a further sensor (`whichroad.sensors`).

    Attributes:
        time: s since 1970 UTC.
        values: Numbers by the names of the sensor's columns, in the units of these.
        sensor: The sensor's name; empty: each that has these columns.
    """

    time: float
    values: Mapping[str, float]
    sensor: str = ""


OdometryLog = WheelCounts | WheelSpeeds | Odometer | SpeedYawRate | WithGyro


@dataclass(frozen=True, slots=True)
class Drive:
    """One recorded drive as the readers give it."""

    drive_id: str
    fixes: Fixes | None = None
    odometry: OdometryLog | None = None
    sources: tuple[str, ...] = ()
    skipped: dict[str, int] = field(default_factory=dict)  # reason -> how many records
    notes: tuple[str, ...] = ()
    sensed: tuple[SensorReading, ...] = ()  # by further sensors, in the order of time
    gyro: YawRates | None = None  # that stands beside no odometry
    geared: bool = False  # a gear, or a flag, tells when the odometry goes backwards


# what receivers call their errors, and what takes them
_ERRORS = ("sigma", "sigma_m", "accuracy", "hacc", "hdop", "quality", "fix_quality", "fix_type")
_INSTEAD = "GeoFix.with_sigma(time, lat_deg, lon_deg, sigma_m) takes the fix's sigma in metres"


def _fix_by_name(cls: Record) -> Record:
    return by_name(cls, dict.fromkeys(_ERRORS, _INSTEAD))


@_fix_by_name
@dataclass(frozen=True, slots=True)
class GeoFix:
    """One GNSS fix for the on-line filter; `with_sigma` makes one of a sigma in metres.

    A speed or course without a sigma gets that of tables: 0.3 m/s, and the angle that this is of
    the speed.  Below 1 m/s, or without a speed, a course without a sigma is not used.  To
    have a speed or course ignored, leave it out or give an infinite sigma.

    Attributes:
        time: s since 1970 UTC.
        lat_deg: WGS 84 latitude of the antenna, degrees.
        lon_deg: WGS 84 longitude of the antenna, degrees.
        cov_ee: Variance of the position eastwards (true east, as in ENU), m²; infinite: not
            reported, `Settings.default_sigma_m` is used.
        cov_en: Covariance of east and north, m².
        cov_nn: Variance northwards, m²; infinite likewise.
        speed: Over ground, m/s, not negative; None: not reported.
        sigma_speed: Its sigma, m/s; None: 0.3 where there is a speed.
        bearing_deg: Course over ground, degrees clockwise from true north; None: not reported.
        sigma_bearing_deg: Its sigma, degrees; None: as said above.
    """

    time: float
    lat_deg: float
    lon_deg: float
    cov_ee: float = np.inf
    cov_en: float = 0.0
    cov_nn: float = np.inf
    # None is never kept: it becomes 0 with an infinite sigma, or a default
    speed: float = None  # type: ignore[assignment]
    sigma_speed: float = None  # type: ignore[assignment]
    bearing_deg: float = None  # type: ignore[assignment]
    sigma_bearing_deg: float = None  # type: ignore[assignment]

    @classmethod
    def with_sigma(
        cls, time: float, lat_deg: float, lon_deg: float, sigma_m: float, **others: float
    ) -> "GeoFix":
        """A fix with the same sigma in all directions.

        Receivers differ in what they report: a 68 % radius is 1.5 sigma, a 95 % one 2.45.

        Args:
            time: s since 1970 UTC.
            lat_deg: WGS 84 latitude of the antenna, degrees.
            lon_deg: WGS 84 longitude of the antenna, degrees.
            sigma_m: Sigma of each axis, m.
            others: Speed and course, and their sigmas, by the names of the fields.

        Raises:
            SettingError: The sigma is not more than 0, or another name is no field.
        """
        if not (isinstance(sigma_m, Real) and sigma_m > 0.0):
            raise SettingError(
                f"GeoFix: sigma_m is {sigma_m!r}; metres, more than 0, were expected; leave it out "
                "where it is not known: GeoFix(time, lat_deg, lon_deg)"
            )
        return cls(time, lat_deg, lon_deg, cov_ee=sigma_m**2, cov_nn=sigma_m**2, **others)

    def __post_init__(self) -> None:
        speed, bearing = self.speed, self.bearing_deg
        if self.sigma_speed is None:
            object.__setattr__(self, "sigma_speed", np.inf if speed is None else SIGMA_SPEED)
        if self.sigma_bearing_deg is None:
            sigma = np.inf if bearing is None or bearing == -1.0 else self._course_sigma()
            object.__setattr__(self, "sigma_bearing_deg", sigma)
        if speed is None:
            object.__setattr__(self, "speed", 0.0)
        if bearing is None:
            object.__setattr__(self, "bearing_deg", 0.0)

    def _course_sigma(self) -> float:
        """Of a course whose sigma was not reported, degrees."""
        try:
            if self.speed > MOVING and self.sigma_speed < np.inf:
                return degrees(math.atan2(self.sigma_speed, self.speed))
        except (TypeError, ValueError):  # no numbers: refused where it is used
            pass
        return np.inf


@by_name
@dataclass(frozen=True, slots=True)
class WheelTicks:
    """One reading of both rear wheel counters.

    Attributes:
        time: s since 1970 UTC.
        left: Counts of the left rear wheel since any moment; fewer in reverse.  Metres are
            `Vehicle.metres_per_tick_left` times it.  Unwrapped, or up to `Vehicle.counter_bits`.
        right: Counts of the right rear wheel.
        geared: Whether a gear tells when it goes backwards, which is believed then.
    """

    time: float
    left: float
    right: float
    geared: bool = False


@by_name
@dataclass(frozen=True, slots=True)
class WheelSpeed:
    """One reading of both rear wheel speeds.

    Attributes:
        time: s since 1970 UTC.
        left: Of the left rear wheel, m/s, negative in reverse.
        right: Of the right rear wheel, m/s.
        geared: Whether a gear tells when it goes backwards, which is believed then.
    """

    time: float
    left: float
    right: float
    geared: bool = False


@by_name
@dataclass(frozen=True, slots=True)
class Distance:
    """One reading of a cumulative odometer.

    Attributes:
        time: s since 1970 UTC.
        distance: Driven since any moment, m.
        geared: Whether a gear tells when it goes backwards, which is believed then.
    """

    time: float
    distance: float
    geared: bool = False


@by_name
@dataclass(frozen=True, slots=True)
class SpeedYaw:
    """One reading of speed and yaw rate.

    Attributes:
        time: s since 1970 UTC.
        speed: Of the rear axle's middle, m/s, negative in reverse.
        yaw_rate: rad/s, counter-clockwise seen from above: positive in a left turn.
        geared: Whether a gear tells when it goes backwards, which is believed then.
    """

    time: float
    speed: float
    yaw_rate: float
    geared: bool = False


@by_name
@dataclass(frozen=True, slots=True)
class YawRate:
    """One reading of a gyro, beside an odometer.

    Attributes:
        time: s since 1970 UTC.
        yaw_rate: rad/s, counter-clockwise seen from above: positive in a left turn.
    """

    time: float
    yaw_rate: float


Observation = GeoFix | WheelTicks | WheelSpeed | Distance | SpeedYaw | YawRate | SensorReading


@by_name
@dataclass(frozen=True, slots=True)
class StartPose:
    """A known pose to start from: of M, the middle of the rear axle.

    Attributes:
        lat_deg: WGS 84 latitude, degrees.
        lon_deg: WGS 84 longitude, degrees.
        bearing_deg: Where the vehicle's front points, degrees clockwise from true north.
        sigma_m: Sigma of the place for each axis, m.
        sigma_bearing_deg: Sigma of the bearing, degrees.
    """

    lat_deg: float
    lon_deg: float
    bearing_deg: float
    sigma_m: float = 5.0
    sigma_bearing_deg: float = 10.0

    @classmethod
    def of(cls, start: "StartPose | tuple[float, float, float] | None") -> "StartPose | None":
        """A start pose from itself, from (lat, lon, bearing) in degrees, or none.

        Raises:
            SettingError: It is something else.
        """
        if isinstance(start, str):
            raise SettingError(
                f"start is {start!r}; a pose or (lat, lon, bearing) was expected: only a recorded "
                "drive can start from the map"
            )
        if start is None or isinstance(start, StartPose):
            return start
        try:
            lat, lon, bearing = map(float, start)
        except (TypeError, ValueError):
            raise SettingError(
                f"start is {start!r}; a StartPose or (lat, lon, bearing) in degrees was expected; "
                "where the bearing is not known, leave start out"
            ) from None
        return cls(lat, lon, bearing)


@dataclass(frozen=True, slots=True)
class Pose:
    """Where M, the middle of the rear axle, is.

    The plane is the map's own: stereographic about the map's middle.  It is neither UTM nor ENU.
    Its y axis is off true north by the convergence, 0.2 degrees some 20 km east of the middle.

    Attributes:
        x: m, in the plane, about eastwards.
        y: m, in the plane, about northwards.
        heading: Where the front points, rad, counter-clockwise from the plane's x axis.
        lat: WGS 84 latitude, degrees.
        lon: WGS 84 longitude, degrees.
        bearing_deg: Where the front points, degrees clockwise from true north.
    """

    x: float
    y: float
    heading: float
    lat: float
    lon: float
    bearing_deg: float
