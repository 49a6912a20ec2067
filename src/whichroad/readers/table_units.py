"""The units of a table's times, speeds, odometers and yaw rates, where names leave them open."""

from collections.abc import Sequence
from datetime import tzinfo
from itertools import pairwise

import numpy as np

from ..errors import ReadError
from ..geodesy.angles import DEGREE
from ..observations import Array
from . import units_by_places as fit
from .arrow_columns import Times
from .checks import Bools, Ints
from .dates import EARLIEST, from_serial
from .drive_columns import Columns
from .names import Column
from .table_drives import Trip

_MOST = 50  # drives of a table that are asked for its units
_FEWEST = 5  # steps from place to place that are judged
_JUMPING = 0.3  # share of them that is impossible, from which rows are of several vehicles
_MOVING = 2.0  # in any unit, from which on it matters which one a speed has
_SPEEDS = ("speed", "wheel_rl", "wheel_rr")


def in_seconds(
    read: Times,
    columns: Columns,
    trips: Sequence[Trip],
    zone: tzinfo | None,
    notes: list[str],
    where: str,
) -> Array:
    """Seconds since 1970 of times whose unit and start may be open.

    Args:
        read: The times.
        columns: Gives the places.
        trips: The drives of the table.
        zone: Of a spreadsheet's days; None: UTC.
        notes: Where to say what was decided.
        where: The table, for errors.

    Raises:
        ReadError: Nothing moves from place to place so fast.
    """
    time = read.seconds
    if read.dateless:
        notes.append("no date beside the times of day: days are counted from 1970-01-01")
    if read.counted:
        if fit.are_days(time):
            notes.append("times taken as a spreadsheet's days since 1899-12-30")
            time = from_serial(time, zone)
        else:
            unit = fit.time_unit(_tracks(time, columns, trips)) or "s"
            if unit != "s":
                notes.append(f"times taken as {unit} from a start, which fits the places")
            time = time * fit.TIME_UNITS[unit]
            sizes = np.sort(np.abs(time[np.isfinite(time)]))
            if len(sizes) and sizes[len(sizes) // 2] >= EARLIEST:  # of no plausible year
                time = np.full(len(time), np.nan)
    tracks = _tracks(time, columns, trips)
    if fit.is_impossible(tracks):
        raise ReadError(
            f"{where}: by its times and places it moves at {fit.median_speed(tracks):,.0f} m/s; "
            "a vehicle was expected; are the times in seconds since 1970 or ISO 8601, and "
            "the places in degrees?"
        )
    _check_jumps(time, columns, trips, notes, where)
    return time


def _check_jumps(
    time: Array, columns: Columns, trips: Sequence[Trip], notes: list[str], where: str
) -> None:
    """Refuse rows of several vehicles as one drive; of several drives name those."""
    if not {"lat", "lon"} <= columns.keys():
        return
    for name, rows in trips[:_MOST]:
        found = fit.jumps(time[rows], columns["lat"][rows], columns["lon"][rows])
        if len(found) < _FEWEST or np.mean(found) < _JUMPING:
            continue
        said = (
            f"{np.count_nonzero(found)} of {len(found)} steps from place to place are farther than "
            "any vehicle gets; rows of one vehicle were expected; name the column that tells "
            "vehicles apart (--id COLUMN, id=)"
        )
        if len(trips) == 1:
            raise ReadError(f"{where}: {said}")
        notes.append(f"drive {name}: {said}")


def _tracks(time: Array, columns: Columns, trips: Sequence[Trip]) -> list[fit.Track]:
    if not {"lat", "lon"} <= columns.keys():
        return []
    lat, lon = columns["lat"], columns["lon"]
    return [fit.Track.of(time[t.rows], lat[t.rows], lon[t.rows]) for t in trips[:_MOST]]


def in_si(
    columns: Columns, found: dict[str, Column], trips: Sequence[Trip], notes: list[str]
) -> None:
    """Bring columns whose names say no unit to SI, by what the places and physics allow.

    Args:
        columns: Changed in place.
        found: What the columns are.
        trips: The drives of the table.
        notes: Where to say what was decided.
    """
    bare = [q for q, column in found.items() if column.bare and q in columns]
    if {"lat", "lon"} <= columns.keys() and any(q in (*_SPEEDS, "odometer") for q in bare):
        tracks = _tracks(columns["time"], columns, trips)
        windows = [fit.windows_of(track) for track in tracks]
        for quantity in bare:
            if quantity in _SPEEDS:
                _speed(quantity, columns, found, trips, windows, notes)
            elif quantity == "odometer":
                _odometer(columns, found, trips, windows, notes)
    if "yaw_rate" in columns:
        yaw_rate, said = possible_yaw_rate(
            columns["yaw_rate"], columns.get("speed"), f"column {found['yaw_rate'].name!r}",
            "yaw_rate" in bare,
        )  # fmt: skip
        columns["yaw_rate"] = yaw_rate
        notes += said


def possible_yaw_rate(
    yaw_rate: Array, speed: Array | None, name: str, bare: bool
) -> tuple[Array, list[str]]:
    """A yaw rate in rad/s, and notes on it where no car could turn so.

    Args:
        yaw_rate: (n,) rad/s, as far as is known.
        speed: (n,) m/s, where it is known at the same times.
        name: What it is called, for the notes.
        bare: Whether no unit was named, so that it may be in degrees.
    """
    if not fit.is_in_degrees(yaw_rate, speed):
        return yaw_rate, []
    if bare:
        return yaw_rate * DEGREE, [f"{name} taken in degrees/s: no car turns that fast in rad/s"]
    return yaw_rate, [f"{name} is faster than any car turns; is it in degrees/s?"]


def _speed(
    quantity: str,
    columns: Columns,
    found: dict[str, Column],
    trips: Sequence[Trip],
    windows: Sequence[fit.Windows],
    notes: list[str],
) -> None:
    time, speed, name = columns["time"], columns[quantity], found[quantity].name
    pairs = zip(windows, trips, strict=False)
    each = [fit.speed_ratios(w, time[t.rows], speed[t.rows]) for w, t in pairs]
    ratios = np.concatenate(each) if each else np.empty(0)
    if not fit.is_telling(ratios):
        if _is_moving(speed):
            notes.append(undecided(found[quantity]))
        return
    sparse = any(w.sparse for w in windows)
    ratio = float(np.median(ratios))
    if fit.speed_unit(ratios, sparse) == "m/s":  # as it is, or as its tool writes it
        return
    unit = fit.speed_unit(ratios / found[quantity].factor, sparse)
    if unit is not None:
        columns[quantity] = speed * (fit.SPEED_UNITS[unit] / found[quantity].factor)
        notes.append(f"column {name!r} taken in {unit}, which fits the places")
    elif quantity == "speed" and ratio > 0.0:
        columns[quantity] = np.full(len(speed), np.nan)
        notes.append(
            f"column {name!r} not used: as m/s it is {ratio:.2g} times the speed between places, "
            "which fits no unit for sure; name it in its unit, such as speed_kmh"
        )


def _odometer(
    columns: Columns,
    found: dict[str, Column],
    trips: Sequence[Trip],
    windows: Sequence[fit.Windows],
    notes: list[str],
) -> None:
    time, distance = columns["time"], columns["odometer"]
    for window, trip in zip(windows, trips, strict=False):
        unit = fit.distance_unit(window, time[trip.rows], distance[trip.rows])
        if unit not in (None, "m"):
            columns["odometer"] = distance * fit.DISTANCE_UNITS[unit or "m"]
            notes.append(
                f"column {found['odometer'].name!r} taken in {unit}, which fits the places"
            )
        if unit is not None:
            return


def undecided(column: Column) -> str:
    """That the unit of a speed is not known for sure."""
    unit = next((u for u, f in fit.SPEED_UNITS.items() if f == column.factor), "m/s")
    return (
        f"column {column.name!r} taken in {unit}: it names no unit, and the drive is too short or "
        "too sparse to tell by its places; name it in its unit, such as speed_kmh"
    )


def _is_moving(speed: Array) -> bool:
    """Whether a speed, which may be in any unit, is of something that moves."""
    return bool((np.abs(speed) > _MOVING).any())


def in_metres_per_second(columns: Columns, first: Ints) -> tuple[Bools, Bools]:
    """Whether the speeds of trips, which name no unit, are taken in m/s.

    Args:
        columns: Of all trips, one after the other, by time.
        first: (d,) where each begins.

    Returns:
        (d,) whether they are, and (d,) whether nothing shows that they should be.
    """
    bounds = [*first.tolist(), len(columns["time"])]
    metres, unknown = np.ones(len(first), np.bool_), np.zeros(len(first), np.bool_)
    for trip, (low, high) in enumerate(pairwise(bounds)):
        time = columns["time"][low:high]
        track = fit.Track.of(time, columns["lat"][low:high], columns["lon"][low:high])
        windows = fit.windows_of(track)
        speed = columns["speed"][low:high]
        ratios = fit.speed_ratios(windows, time, speed)
        if fit.is_telling(ratios):
            metres[trip] = fit.speed_unit(ratios, windows.sparse) == "m/s"
        else:
            unknown[trip] = _is_moving(speed)
    return metres, unknown
