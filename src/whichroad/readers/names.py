"""Names and units of the columns of drive tables, as the usual tools write them.

Each quantity has its names with the factor that brings them to SI units (degrees stay
degrees).  Names are compared in lower case, with `_` for everything but letters and
digits.  Of several names of one quantity the first listed wins.
"""

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

from ..errors import ReadError
from ..geodesy.angles import DEGREE
from ..geodesy.units import KMH, KNOT, MPH
from .checks import listed
from .profiles import units_of

if TYPE_CHECKING:
    import pyarrow as pa


class Column(NamedTuple):
    """Where a quantity stands in a table."""

    place: int  # counted from 0
    name: str
    factor: float  # to SI; 0: a time whose unit follows from its size
    bare: bool = False  # the name has no unit, and the quantity has several usual ones


class NoSuchColumn(ReadError):
    """A table lacks the column that its caller named."""

    def __init__(self, alias: str, message: str) -> None:
        super().__init__(message)
        self.alias = alias  # what the column was to be


class Seen(NamedTuple):
    """A table as it was read: the columns that are used, and what they are."""

    table: "pa.Table"
    names: list[str]  # of all columns, also of those that are not used
    found: dict[str, Column]  # by quantity; places are those in `table`

    @classmethod
    def of(cls, table: "pa.Table", names: Sequence[str], found: Mapping[str, Column]) -> "Seen":
        """A table whose columns bear the names of `found`."""
        at = {name: place for place, name in reversed(list(enumerate(table.column_names)))}
        return cls(table, list(names), {q: c._replace(place=at[c.name]) for q, c in found.items()})


def _names(text: str, factor: float = 1.0) -> dict[str, float]:
    return dict.fromkeys(text.split(), factor)


def _speeds(stem: str, bare: str = "") -> dict[str, float]:
    """Names of a speed in all units, `bare` ones being m/s unless the places say otherwise."""
    units = {"mps": 1.0, "ms": 1.0, "m_s": 1.0, "meters_second": 1.0, "meterspersecond": 1.0}
    units |= {"kmh": KMH, "kph": KMH, "km_h": KMH, "km_hr": KMH}
    units |= {"kn": KNOT, "knots": KNOT, "kt": KNOT, "mph": MPH, "mi_h": MPH}
    names = {f"{word}_{unit}": f for word in stem.split() for unit, f in units.items()}
    return {**names, **_names(bare)}


_SPEEDS = "speed gps_speed velocity vehicle_speed ground_speed speed_over_ground sog vel speed_obd"
_BARE_ODOMETERS = "odometer odo mileage"
_BARE_YAW_RATES = "yaw_rate yawrate gyro_z"
NAMES: dict[str, dict[str, float]] = {
    "time": {
        **_names(
            "time timestamp datetime date_time time_utc utc_time utc gps_time gpstime tst "
            "point_time fix_time fixtime epoch unix unix_time unixtime posix_time ts time_stamp "
            "recorded_at timestamp_utc datetime_utc tracked_at captured_at captured_timestamp "
            "capturedtimestamp logged_at event_time eventtime isotst position_time "
            "t local_time localtime time_local device_time devicetime server_time servertime",
            0.0,
        ),
        **_names("time_s t_s timestamp_s epoch_s utc_s unix_s seconds time_sec timestamp_sec"),
        **_names("time_ms t_ms timestamp_ms epoch_ms utc_ms unix_ms", 1e-3),
        **_names("timestampms unixtimemillis utctimemillis utc_timeinms", 1e-3),
        **_names("time_us t_us timestamp_us epoch_us utc_us unix_us", 1e-6),
        **_names("time_ns t_ns timestamp_ns epoch_ns utc_ns unix_ns", 1e-9),
    },
    "date": _names("date utc_date date_utc gps_date local_date date_local day", 0.0),
    "lat": {
        **_names(
            "lat latitude lat_deg latitude_deg gps_lat gps_latitude location_lat point_lat "
            "latitudedegrees latitude_degrees location_latitude"
        ),
        **_names("latitudee7 latitude_e7 lat_e7", 1e-7),
        **_names("latitudee6 latitude_e6 lat_e6", 1e-6),
    },
    "lon": {
        **_names(
            "lon lng long longitude lon_deg longitude_deg gps_lon gps_lng gps_longitude "
            "location_lon location_lng location_long point_lon point_lng "
            "longitudedegrees longitude_degrees location_longitude"
        ),
        **_names("longitudee7 longitude_e7 lon_e7 lng_e7", 1e-7),
        **_names("longitudee6 longitude_e6 lon_e6 lng_e6", 1e-6),
    },
    "north_south": _names("n_s ns lat_hemisphere"),
    "east_west": _names("e_w ew lon_hemisphere"),
    "x": _names("x easting x_m easting_m east_m"),
    "y": _names("y northing y_m northing_m north_m"),
    "geometry": _names("geometry geom wkt the_geom"),
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
        "gps_accuracy location_accuracy horizontalaccuracy accuracymeters accuracy_meters acc"
    ),
    "hdop": _names("hdop gps_hdop horizontal_dilution_of_precision"),
    "quality": _names("fix_quality gga_quality nmea_quality gps_qual gps_quality_indicator"),
    "speed": {**_speeds(_SPEEDS, f"{_SPEEDS} v spd"), **_names("speedmps")},
    "bearing": _names(
        "bearing_deg bearing heading_deg heading course_deg course course_over_ground cog "
        "azimuth_deg azimuth gps_bearing track_deg bearingdegrees bearing_degrees direction_deg "
        "direction"
    ),
    "yaw_rate": {
        **_names("yaw_rate_radps yaw_rate_rad_s"),
        **_names(_BARE_YAW_RATES),
        **_names(
            "yaw_rate_degps yaw_rate_deg_s yaw_rate_dps yaw_rate_grad_s yawrate_deg_s "
            "yawrate_grad_s gyro_z_deg_s gyro_z_dps",
            DEGREE,
        ),
    },
    "odometer": {
        **_names("odometer_m odo_m"),
        **_names(_BARE_ODOMETERS),
        **_names("distance_m travelled_m mileage_m"),
        **_names("odometer_km odo_km mileage_km", 1e3),
        **_names("odometer_mi odometer_miles mileage_mi", 1609.344),
    },
    "reverse": _names("reverse reversing is_reverse backwards"),
    "gear": _names(
        "gear gear_position gearposition selected_gear gear_selected gearshifter "
        "gear_shifter gear_selector gear_lever transmission_gear prnd prndl"
    ),
    "drive_id": _names(
        "drive_id trip_id tripid trip jrnid journey_id journeyid agent_id track_id trackid "
        "traj_id trajectory_id trajid traj drive tid trip_no ride_id session_id track_fid"
    ),
    "vehicle_id": _names(
        "vehicle_id vehicleid vehicle veh_id device_id deviceid device imei vin uid user_id "
        "userid user driver_id car_id taxi_id bus_id unit_id asset_id tracker_id mover_id "
        "individual_local_identifier tag_local_identifier"
    ),
    "row_id": _names("id"),
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


BARE = {
    "speed": frozenset(f"{_SPEEDS} v spd".split()),
    "odometer": frozenset(_BARE_ODOMETERS.split()),
    "yaw_rate": frozenset(_BARE_YAW_RATES.split()),
    **{
        wheel: frozenset(
            n
            for n in NAMES[wheel]
            if NAMES[wheel][n] == 1.0 and not n.endswith(("mps", "_ms", "m_s", "second"))
        )
        for wheel in ("wheel_rl", "wheel_rr")
    },
}  # names that say no unit, of quantities that have several usual ones
SENSED = "+"  # begins the alias of a column that a further sensor reads
TOLD = ("satellites", "height_m", "cn0_dbhz", "antennas_deg", "compass_deg", "antennas_sigma_deg")
"""What receivers say beside fixes: `nmea_told`, `ubx_told`."""

DRIVES = ("drive_id", "vehicle_id", "row_id")  # what may tell drives apart, the surest first


def told_of(columns: Iterable[str]) -> frozenset[str]:
    """Which of `TOLD` are among the columns that a caller gave readers to keep."""
    return frozenset(name.removeprefix(SENSED) for name in columns) & frozenset(TOLD)


def normal(name: str) -> str:
    """A column's name as it is compared: `Latitude (deg)` is `latitude_deg`."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def find(names: Sequence[str], own: Mapping[str, str | int] | None = None) -> dict[str, Column]:
    """The quantities that a table with these column names holds.

    Args:
        names: Of all columns.
        own: Names of this module, and the names (or numbers, from 1) of the columns that
            they stand for.

    Raises:
        ReadError: A name of `own` is unknown, or the table has no such column.
    """
    return dict(_found(tuple(names), tuple((own or {}).items())))


@lru_cache(maxsize=64)  # trips of one table come one by one
def _found(names: tuple[str, ...], own: tuple[tuple[str, str | int], ...]) -> dict[str, Column]:
    places: dict[str, int] = {}
    for index, name in enumerate(names):
        places.setdefault(normal(name), index)
    units = units_of(places.keys())
    given = {}
    for alias, column in own:
        if alias.startswith(SENSED):
            continue
        quantity = quantity_of(alias)
        place = _place(names, alias, column)
        given[quantity] = _column(quantity, normal(alias), place, names[place], {})
    found = {}
    for quantity, aliases in NAMES.items():
        if quantity in given:
            found[quantity] = given[quantity]
            continue
        for name in (name for name in aliases if name in places):
            place = places[name]
            if all(place != column.place for column in given.values()):
                found[quantity] = _column(quantity, name, place, names[place], units)
                break
    for alias, column in own:  # of further sensors: where the table has them
        place = places.get(normal(str(column)), -1)
        if alias.startswith(SENSED) and place >= 0:
            found[alias] = Column(place, names[place], 1.0)
    if "time" not in found and "date" in found:  # a column `date` with the time of day in it
        found["time"] = found.pop("date")
    return found


def _column(quantity: str, alias: str, place: int, name: str, units: Mapping[str, float]) -> Column:
    bare = alias in BARE.get(quantity, ())
    return Column(place, name, units.get(alias, NAMES[quantity][alias]), bare)


def column_called(names: Iterable[str], wanted: str) -> str:
    """The column of a name, else the one that has it but for case and punctuation, else it."""
    names = list(names)
    alike = [name for name in names if normal(name) == normal(wanted) != ""]
    return alike[0] if wanted not in names and len(alike) == 1 else wanted


def quantity_of(alias: str) -> str:
    """What an own column is to be.

    Raises:
        ReadError: The alias is not the name of a quantity; the closest are offered.
    """
    for quantity, aliases in NAMES.items():
        if normal(alias) in aliases:
            return quantity
    known = [alias for aliases in NAMES.values() for alias in aliases]
    close = difflib.get_close_matches(normal(alias), known, 3, 0.5)
    hint = f"did you mean {' or '.join(close)}?" if close else "for example time, lat, lon, speed"
    raise ReadError(
        f"columns: {alias!r} is not the name of a quantity; one of docs/formats.md was expected; "
        f"{hint}"
    )


def _place(names: Sequence[str], alias: str, column: str | int) -> int:
    """Where an own column is: by its name, else by its number."""
    if str(column) in names:
        return names.index(str(column))
    alike = [i for i, name in enumerate(names) if normal(name) == normal(str(column)) != ""]
    if alike:
        return alike[0]
    if str(column).isdecimal() and 1 <= int(column) <= len(names):
        return int(column) - 1
    close = difflib.get_close_matches(str(column), [name for name in names if name], 2, 0.6)
    hint = f"; did you mean {' or '.join(close)}?" if close else ""
    raise NoSuchColumn(
        alias,
        f"table: no column {column!r} for {alias} among {listed(name for name in names if name)}; "
        "the name of a column, or its number from 1, was expected by columns= or id= (--columns, "
        f"--id){hint}",
    )


def with_unit(quantity: str, column: Column, unit: str) -> Column:
    """The column in a unit that stands elsewhere than in its name, where both are understood."""
    factor = NAMES[quantity].get(f"{quantity}_{normal(unit)}") if column.bare and unit else None
    return column if factor is None else column._replace(factor=factor, bare=False)
