"""Names and units of the columns of drive tables, as the usual tools write them.

Each quantity has its names with the factor that brings them to SI units (degrees stay
degrees).  Names are compared in lower case, with `_` for everything but letters and
digits.  Of several names of one quantity the first listed wins.
"""

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from ..geodesy.angles import DEGREE
from ..geodesy.units import KMH, KNOT, MPH


class Column(NamedTuple):
    """Where a quantity stands in a table."""

    place: int  # counted from 0
    name: str
    factor: float  # to SI; 0: a time whose unit follows from its size


def _names(text: str, factor: float = 1.0) -> dict[str, float]:
    return dict.fromkeys(text.split(), factor)


def _speeds(stem: str, bare: str = "") -> dict[str, float]:
    """Names of a speed in all units, `bare` ones being m/s."""
    units = {"mps": 1.0, "ms": 1.0, "m_s": 1.0, "kmh": KMH, "kph": KMH, "km_h": KMH}
    units |= {"kn": KNOT, "knots": KNOT, "kt": KNOT, "mph": MPH}
    names = {f"{word}_{unit}": f for word in stem.split() for unit, f in units.items()}
    return {**names, **_names(bare)}


NAMES: dict[str, dict[str, float]] = {
    "time": {
        **_names(
            "time timestamp t datetime date_time time_utc utc_time utc gps_time gpstime tst "
            "point_time fix_time fixtime epoch unix unix_time unixtime posix_time ts time_stamp "
            "recorded_at timestamp_utc datetime_utc",
            0.0,
        ),
        **_names("time_s t_s timestamp_s epoch_s utc_s unix_s seconds time_sec timestamp_sec"),
        **_names("time_ms t_ms timestamp_ms epoch_ms utc_ms unix_ms", 1e-3),
        **_names("time_us t_us timestamp_us epoch_us utc_us unix_us", 1e-6),
        **_names("time_ns t_ns timestamp_ns epoch_ns utc_ns unix_ns", 1e-9),
    },
    "lat": _names("lat latitude lat_deg latitude_deg gps_lat gps_latitude location_lat point_lat"),
    "lon": _names(
        "lon lng long longitude lon_deg longitude_deg gps_lon gps_lng gps_longitude "
        "location_lon location_lng location_long point_lon point_lng"
    ),
    "x": _names("x easting x_m easting_m east_m"),
    "y": _names("y northing y_m northing_m north_m"),
    "geometry": _names("geometry geom"),
    "cov_ee": _names("cov_ee_m2 cov_ee cov_e_e position_covariance_0"),
    "cov_en": _names("cov_en_m2 cov_en cov_e_n cov_ne_m2 cov_ne position_covariance_1"),
    "cov_nn": _names("cov_nn_m2 cov_nn cov_n_n position_covariance_4"),
    "sigma_e": _names("sigma_e_m sigma_east_m sigma_e sde sde_m std_e std_lon sigma_lon_m"),
    "sigma_n": _names("sigma_n_m sigma_north_m sigma_n sdn sdn_m std_n std_lat sigma_lat_m"),
    "sigma_major": _names("sigma_major_m sigma_major std_major semi_major_m"),
    "sigma_minor": _names("sigma_minor_m sigma_minor std_minor semi_minor_m"),
    "sigma_bearing": _names("sigma_bearing_deg sigma_bearing ellipse_bearing_deg orientation_deg"),
    "sigma": _names("sigma_m sigma gps_sigma gps_sigma_m"),
    "accuracy": _names(
        "accuracy accuracy_m hacc hacc_m h_acc horizontal_accuracy horizontal_accuracy_m "
        "gps_accuracy location_accuracy"
    ),
    "hdop": _names("hdop gps_hdop"),
    "speed": _speeds(
        "speed gps_speed velocity vehicle_speed ground_speed",
        "speed gps_speed velocity vehicle_speed ground_speed v spd",
    ),
    "bearing": _names(
        "bearing_deg bearing heading_deg heading course_deg course course_over_ground cog "
        "azimuth_deg azimuth gps_bearing track_deg"
    ),
    "yaw_rate": {
        **_names("yaw_rate_radps yaw_rate_rad_s yaw_rate yawrate gyro_z"),
        **_names("yaw_rate_degps yaw_rate_deg_s", DEGREE),
    },
    "odometer": {
        **_names("odometer_m odo_m odometer odo distance_m travelled_m mileage_m"),
        **_names("odometer_km odo_km mileage_km", 1e3),
    },
    "reverse": _names("reverse reversing is_reverse backwards"),
    "drive_id": _names(
        "drive_id trip_id tripid trip jrnid journey_id agent_id track_id traj_id trajectory_id "
        "traj drive"
    ),
}
for _side, _long, _word in (("rl", "rear_left", "left"), ("rr", "rear_right", "right")):
    NAMES[f"wheel_{_side}"] = _speeds(
        f"wheel_{_side} wheel_speed_{_side} {_side} {_long} wheel_{_long} speed_{_side}",
        f"wheel_{_side} wheel_speed_{_side} {_side} {_long} wheel_{_long} speed_{_side}",
    )
    NAMES[f"wheel_{_side}_ticks"] = _names(
        f"wheel_{_side}_ticks {_side}_ticks ticks_{_side} wheel_{_side}_count {_side}_count "
        f"{_long}_ticks wheel_{_long}_ticks ticks_{_word} {_word}_ticks ticks_{_long}"
    )


def normal(name: str) -> str:
    """A column's name as it is compared: `Latitude (deg)` is `latitude_deg`."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def find(names: Sequence[str]) -> dict[str, Column]:
    """The quantities that a table with these column names holds."""
    return dict(_found(tuple(names)))


@lru_cache(maxsize=64)  # trips of one table come one by one
def _found(names: tuple[str, ...]) -> dict[str, Column]:
    places: dict[str, int] = {}
    for index, name in enumerate(names):
        places.setdefault(normal(name), index)
    found = {}
    for quantity, aliases in NAMES.items():
        for alias, factor in aliases.items():
            if alias in places:
                place = places[alias]
                found[quantity] = Column(place, names[place], factor)
                break
    return found
