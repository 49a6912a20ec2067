"""Kinds of evidence that a sensor can give, and what a sensor is.

A sensor is any class with a `name`, the `columns` that it reads, and a method `rows` that turns one
reading into evidence.  It touches neither the filter nor its kernels:

    class Compass:
        name, columns = "compass", ("compass_deg",)

        def rows(self, reading):
            return [Heading(reading["compass_deg"], sigma_deg=5.0, lasts_s=60.0)]

Every kind has the sigma of its error, and the time or the distance over which the error lasts: a
reading soon after another one says little that is new.  Of one sensor, the first that is heard with
one, the error that stays is learnt; for others it widens the error that lasts.  Angles are in
degrees here, bearings clockwise from true north.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable


@dataclass(frozen=True, slots=True, kw_only=True)
class _Evidence:
    lasts_s: float = 0.0  # s over which the error lasts; 0: each reading errs anew
    lasts_m: float = 0.0  # m driven over which it lasts


@dataclass(frozen=True, slots=True, kw_only=True)
class _Biased(_Evidence):
    bias_sigma: float = 0.0  # sigma of an error that stays, in the value's unit; 0: there is none


@dataclass(frozen=True, slots=True)
class Heading(_Biased):
    """Where the vehicle points: a compass, two antennas.  In reverse it points backwards."""

    bearing_deg: float  # clockwise from true north
    sigma_deg: float


@dataclass(frozen=True, slots=True)
class Speed(_Evidence):
    """Speed of the vehicle over ground, negative in reverse."""

    speed_mps: float
    sigma_mps: float


@dataclass(frozen=True, slots=True)
class Lateral(_Biased):
    """Offset from the road's centre line on the map, right of the driving direction positive."""

    offset_m: float
    sigma_m: float


@dataclass(frozen=True, slots=True)
class Position(_Evidence):
    """Where a point of the vehicle is, by what is not the drive's own receiver."""

    lat_deg: float
    lon_deg: float
    sigma_m: float = 0.0  # of each axis, where there is no covariance
    cov_m2: tuple[float, float, float] | None = None  # east-east, east-north, north-north
    forward_m: float = 0.0  # of the sensor, from the middle of the rear axle
    left_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Range(_Biased):
    """Horizontal distance to a place that is known."""

    lat_deg: float  # of the place
    lon_deg: float
    distance_m: float
    sigma_m: float
    on_map: bool = False  # whether the place was drawn with the roads, and shares their error
    forward_m: float = 0.0
    left_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Bearing(_Biased):
    """Direction in which a known place is seen."""

    lat_deg: float
    lon_deg: float
    bearing_deg: float  # clockwise, from the vehicle's axis or from true north
    sigma_deg: float
    relative: bool = True  # whether from the vehicle's axis
    on_map: bool = False
    forward_m: float = 0.0
    left_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Attribute(_Evidence):
    """How likely a reading is on roads with a value of an attribute, and on all others.

    Only ratios count.  Off the roads the likelihood of `otherwise` holds.
    """

    name: str  # of the attribute, as `RoadMap.attributes` and `Result.attribute` have it
    likelihoods: Mapping[Any, float]  # of values, such as {True: 0.9}
    otherwise: float  # of every other value, and where there is none


@dataclass(frozen=True, slots=True)
class Elevation(_Evidence):
    """Height over anything that stays, against the levels of roads: bridges, tunnels, ramps."""

    height_m: float
    sigma_m: float  # of what each reading draws anew
    drift_m: float  # of its error that lasts,
    drift_s: float  # for so long


Evidence = Heading | Speed | Lateral | Position | Range | Bearing | Attribute | Elevation


@runtime_checkable
class Sensor(Protocol):
    """What reads the columns of a sensor.

    Attributes:
        name: What the sensor is called, once in a drive.
        columns: Names of the columns that it reads.
    """

    name: str
    columns: Sequence[str]

    def rows(self, reading: Mapping[str, float]) -> Iterable[Evidence]:
        """The evidence of one reading.

        Args:
            reading: `time` (s since 1970 UTC) and those columns that have a number.
        """
        ...
