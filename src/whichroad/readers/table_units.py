"""The units of a table's times, speeds, odometers and yaw rates, where names leave them open.

Those of all but times are decided once for a table, by its first drives.
"""

import math
from collections.abc import Mapping, Sequence
from datetime import tzinfo
from typing import NamedTuple

import numpy as np

from ..errors import ReadError
from ..geodesy.angles import DEGREE
from ..observations import Array
from . import units_by_places as fit
from .arrow_columns import Times
from .checks import LAST, is_place
from .dates import DAY, EARLIEST, from_serial
from .drive_columns import Columns
from .known_grids import Lattice
from .mixed_rows import REFUSED, alternating, said_of
from .names import Column
from .rounded_places import lattice_of
from .table_drives import Trip

MOST = 50  # drives of a table that are asked for its units
MOST_ROWS = 1 << 14  # of these drives, unless the first has more
_FEWEST = 5  # steps from place to place that are judged
_JUMPING = 0.3  # share of them that is impossible, from which rows are of several vehicles
_MOVING = 2.0  # in any unit, from which on it matters which one a speed has
_SPEEDS = ("speed", "wheel_rl", "wheel_rr")


class Units(NamedTuple):
    """What the columns of a table are in that name no unit."""

    factors: Mapping[str, float] = {}  # to SI, by quantity; NaN: not used
    notes: tuple[str, ...] = ()  # on what was decided
    unsure: Mapping[str, str] = {}  # quantity -> note on drives that move
    grid: Lattice | None = None  # on which the places of the first drives are

    def in_si(self, columns: Columns) -> None:
        """Bring columns, in the units of their names, to SI in place."""
        with np.errstate(over="ignore", invalid="ignore"):  # cells may hold anything
            for quantity in self.factors.keys() & columns.keys():
                columns[quantity] = columns[quantity] * self.factors[quantity]

    def notes_on(self, columns: Columns) -> tuple[str, ...]:
        """What is said of a drive with these columns."""
        more = [note for q, note in self.unsure.items() if q in columns and is_moving(columns[q])]
        return (*self.notes, *more)


def open_columns(found: Mapping[str, Column]) -> tuple[str, ...]:
    """Names of the columns whose unit the values are asked for, or that are checked by them."""
    asked = (*_SPEEDS, "odometer")
    checked = ("speed", "yaw_rate")
    names = [c.name for q, c in found.items() if (c.bare and q in asked) or q in checked]
    return tuple(sorted(names))


def in_seconds(
    read: Times,
    columns: Columns,
    trips: Sequence[Trip],
    zone: tzinfo | None,
    notes: list[str],
) -> Array:
    """Seconds since 1970 of times whose unit and start may be open.

    Args:
        read: The times.
        columns: Gives the places.
        trips: The drives of the table.
        zone: Of a spreadsheet's days; None: UTC.
        notes: Where to say what was decided.
    """
    time = read.seconds
    if read.dateless:
        notes.append("no date beside the times of day: days are counted from 1970-01-01")
    if read.counted:
        if fit.are_days(time):
            notes.append("times taken as a spreadsheet's days since 1899-12-30")
            time = from_serial(time, zone)
        else:
            unit = fit.time_unit(_apart(_tracks(time, columns, trips))) or "s"
            if unit != "s":
                notes.append(f"times taken as {unit} from a start, which fits the places")
            time = time * fit.TIME_UNITS[unit]
            sizes = np.sort(np.abs(time[np.isfinite(time)]))
            if len(sizes) and sizes[len(sizes) // 2] >= EARLIEST:  # of no plausible year
                time = np.full(len(time), np.nan)
            elif len(sizes) and sizes[0] >= DAY:  # such as seconds of the GPS week
                notes.append(
                    f"times count from a start that is not known, {sizes[0] / DAY:,.1f} "
                    "days before the first; 1970-01-01 was taken"
                )
    return time


def check_motion(columns: Columns, trips: Sequence[Trip], notes: list[str], where: str) -> None:
    """Refuse times and places that no vehicle has, and rows of several vehicles as one drive.

    Args:
        columns: Gives the times, s, and the places.
        trips: The drives of the table.
        notes: Names drives of several that are rows of several vehicles.
        where: The table, for errors.

    Raises:
        ReadError: It is so.
    """
    each = _tracks(columns["time"], columns, trips)
    tracks = _apart(each)
    if fit.is_impossible(tracks):
        raise ReadError(
            f"{where}: by its times and places it moves at {fit.median_speed(tracks):,.0f} m/s; "
            "a vehicle was expected; are the times in seconds since 1970 or ISO 8601, and "
            "the places in degrees?"
        )
    _check_jumps(each, trips, notes, where)
    _check_mixed(tracks, where)


def _check_jumps(
    tracks: Sequence[fit.Track], trips: Sequence[Trip], notes: list[str], where: str
) -> None:
    """Refuse rows of several vehicles as one drive; of several drives name those."""
    for track, (name, _) in zip(tracks, trips, strict=False):  # as many as are looked at
        found = fit.jumps(track)
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


def _check_mixed(tracks: Sequence[fit.Track], where: str) -> None:
    """Refuse rows of two vehicles near each other as one drive; of several, each gets a note."""
    for track in tracks if len(tracks) == 1 else ():
        found = alternating(track.lat_deg, track.lon_deg)
        if len(found) and np.mean(found) >= REFUSED:
            raise ReadError(f"{where}: {said_of(found)}")


def _apart(tracks: Sequence[fit.Track]) -> list[fit.Track]:
    return [track.apart() for track in tracks]


def _tracks(time: Array, columns: Columns, trips: Sequence[Trip]) -> list[fit.Track]:
    if not {"lat", "lon"} <= columns.keys():
        return []
    lat, lon = columns["lat"], columns["lon"]
    return [fit.Track.of(time[t.rows], lat[t.rows], lon[t.rows]) for t in trips[:MOST]]


def units_of(columns: Columns, found: Mapping[str, Column], trips: Sequence[Trip]) -> Units:
    """The units of columns whose names say none, by what the places and physics allow; their grid.

    Args:
        columns: In the units of their names, with times.
        found: What the columns are.
        trips: The drives of the table; the first `MOST`, as far as they have `MOST_ROWS`, decide.
    """
    ends = np.cumsum([len(trip.rows) for trip in trips[:MOST]])
    few = trips[: max(int(np.searchsorted(ends, MOST_ROWS, "right")), 1)]
    few = [Trip(t.name, t.rows[np.abs(columns["time"][t.rows]) < LAST]) for t in few]
    asked = _Asked(columns, found, few)
    bare = [q for q, column in found.items() if column.bare and q in columns]
    named = "speed" in columns and "speed" not in bare and "yaw_rate" not in columns
    if {"lat", "lon"} <= columns.keys() and (
        named or any(q in (*_SPEEDS, "odometer") for q in bare)
    ):
        tracks = _apart(_tracks(columns["time"], columns, few))
        windows = [fit.windows_of(track) for track in tracks]
        if named:
            asked.named_speed([w.short() for w in windows])
        for quantity in bare:
            if quantity in _SPEEDS:
                asked.speed(quantity, windows)
            elif quantity == "odometer":
                asked.odometer(windows)
    if "yaw_rate" in columns:
        asked.yaw_rate("yaw_rate" in bare)
    return Units(asked.factors, tuple(asked.notes), asked.unsure, _grid(columns, few))


def _grid(columns: Columns, trips: Sequence[Trip]) -> Lattice | None:
    """The grid on which the places of several drives are."""
    if len(trips) < 2 or not {"lat", "lon"} <= columns.keys():
        return None
    rows = np.concatenate([trip.rows for trip in trips])
    lat, lon = columns["lat"][rows], columns["lon"][rows]
    known = is_place(lat, lon)
    return lattice_of(lat[known], lon[known]) if known.any() else None


class _Asked:
    """The first drives of a table, and what they tell of its units."""

    def __init__(
        self, columns: Columns, found: Mapping[str, Column], trips: Sequence[Trip]
    ) -> None:
        self.columns, self.found, self.trips = columns, found, trips
        self.factors: dict[str, float] = {}
        self.notes: list[str] = []
        self.unsure: dict[str, str] = {}

    def _ratios(self, quantity: str, windows: Sequence[fit.Windows]) -> Array:
        """Ways by a speed over those between places, of all drives."""
        time, speed = self.columns["time"], self.columns[quantity]
        pairs = zip(windows, self.trips, strict=True)
        each = [fit.speed_ratios(w, time[t.rows], speed[t.rows]) for w, t in pairs]
        return np.concatenate(each) if each else np.empty(0)

    def named_speed(self, windows: Sequence[fit.Windows]) -> None:
        """See that a receiver's speed is not in km/h where its column says m/s."""
        ratios, column = self._ratios("speed", windows), self.found["speed"]
        if column.factor == 1.0 and fit.is_in_kmh(ratios):
            self.factors["speed"] = math.nan
            self.notes.append(
                f"column {column.name!r} not used: as m/s it is {float(np.median(ratios)):.2g} "
                "times the speed between places, as one in km/h is; name it in its unit, such as "
                "speed_kmh"
            )

    def speed(self, quantity: str, windows: Sequence[fit.Windows]) -> None:
        """The unit of a speed, by the ways between places."""
        ratios, column = self._ratios(quantity, windows), self.found[quantity]
        if not fit.is_telling(ratios):
            self.unsure[quantity] = _undecided(column)
            return
        sparse = any(w.sparse for w in windows)
        ratio = float(np.median(ratios))
        if fit.speed_unit(ratios, sparse) == "m/s":  # as it is, or as its tool writes it
            return
        unit = fit.speed_unit(ratios / column.factor, sparse)
        if unit is not None:
            self.factors[quantity] = fit.SPEED_UNITS[unit] / column.factor
            self.notes.append(f"column {column.name!r} taken in {unit}, which fits the places")
        elif quantity == "speed" and ratio > 0.0:
            self.factors[quantity] = math.nan
            self.notes.append(
                f"column {column.name!r} not used: as m/s it is {ratio:.2g} times the speed "
                "between places, which fits no unit for sure; name it in its unit, such as "
                "speed_kmh"
            )

    def odometer(self, windows: Sequence[fit.Windows]) -> None:
        """The unit of an odometer, by the first drive that tells it."""
        time, distance = self.columns["time"], self.columns["odometer"]
        for window, trip in zip(windows, self.trips, strict=True):
            unit = fit.distance_unit(window, time[trip.rows], distance[trip.rows])
            if unit is None:
                continue
            if unit != "m":
                self.factors["odometer"] = fit.DISTANCE_UNITS[unit]
                name = self.found["odometer"].name
                self.notes.append(f"column {name!r} taken in {unit}, which fits the places")
            return

    def yaw_rate(self, bare: bool) -> None:
        """The unit of a yaw rate, by what cars and their tyres reach."""
        rows = np.concatenate([trip.rows for trip in self.trips])
        speed = self.columns.get("speed")
        if speed is not None:
            speed = speed[rows] * self.factors.get("speed", 1.0)
        name = f"column {self.found['yaw_rate'].name!r}"
        factor, said = possible_yaw_rate(self.columns["yaw_rate"][rows], speed, name, bare)
        if factor != 1.0:
            self.factors["yaw_rate"] = factor
        self.notes += said


def possible_yaw_rate(
    yaw_rate: Array, speed: Array | None, name: str, bare: bool
) -> tuple[float, list[str]]:
    """What brings a yaw rate to rad/s, and notes on it where no car could turn so.

    Args:
        yaw_rate: (n,) rad/s, as far as is known.
        speed: (n,) m/s, where it is known at the same times.
        name: What it is called, for the notes.
        bare: Whether no unit was named, so that it may be in degrees.
    """
    if not fit.is_in_degrees(yaw_rate, speed):
        return 1.0, []
    if bare:
        return DEGREE, [f"{name} taken in degrees/s: no car turns that fast in rad/s"]
    return 1.0, [f"{name} is faster than any car turns; is it in degrees/s?"]


def _undecided(column: Column) -> str:
    """That the unit of a speed is not known for sure."""
    unit = next((u for u, f in fit.SPEED_UNITS.items() if f == column.factor), "m/s")
    return (
        f"column {column.name!r} taken in {unit}: it names no unit, and the drive is too short or "
        "too sparse to tell by its places; name it in its unit, such as speed_kmh"
    )


def is_moving(speed: Array) -> bool:
    """Whether a speed, which may be in any unit, is of something that moves."""
    return bool((np.abs(speed) > _MOVING).any())
