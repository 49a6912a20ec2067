"""Drive tables: CSV, Parquet and Arrow files, and tables in memory, by the names of their columns.

One table may hold fixes, odometry or both, of one drive or of many.  Empty cells hold
no value; what cannot be understood is skipped and counted.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta, timezone
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from ..errors import ReadError
from ..observations import Array, Drive, SensorReading
from ..settings import Settings, Vehicle
from .arrow_columns import Times, numbers, strings, times
from .checks import Skipped, is_place
from .clock_change import put_apart
from .coarse_times import spread
from .csv_text import no_column
from .dates import Writing, taken_as_utc
from .drive_columns import MOTION, WHEELS, Columns, drive_of
from .gears import reversing
from .geometries import places_of, said_of_degrees, unproject
from .gpx import read_gpx
from .names import SENSED, Seen, normal
from .odometry_fit import with_fit_notes
from .reading import Reading
from .reckoned_places import without_reckoned
from .source import Source
from .table_drives import Trip, trips_of
from .table_files import table_of
from .table_units import Units, check_motion, in_seconds, units_of
from .tables_in_memory import frames_of, in_memory, is_gpx
from .unread_times import mixed_note, no_time, unlikely_notes, with_time
from .without_times import invented_times

_NO_VALUES = ("time", "date", "gear", "drive_id", "vehicle_id", "row_id", "geometry",
              "north_south", "east_west")  # fmt: skip
_FAR = timedelta(hours=23)  # offset that no zone has: it tells rows that name theirs
_NO_TIMES = frozenset(
    (
        *("", "index", "unnamed_0", "id", "fid", "n", "no", "nr", "number", "seq", "order"),
        *("point", "name", "alt", "altitude", "altitude_m", "ele", "elevation", "elevation_m"),
        *("height", "height_m", "z", "sat", "satellites", "layer", "track_seg_id"),
        "track_seg_point_id",
    )
)  # columns that hold no times, whatever the table


def read_table(file: Any, reading: Reading | None = None) -> list[Drive]:
    """Read a drive table: .csv, .tsv, .txt, .parquet, .geoparquet, .arrow or .feather.

    Args:
        file: A path or a source.
        reading: What the caller says of it.

    Returns:
        One drive, or one for each value of the columns that tell drives apart, in the order
        of the file.

    Raises:
        ReadError: The file is no table, or holds nothing that locates a drive.
    """
    source, reading = Source.of(file), reading or Reading()
    skipped: Skipped = Counter()
    seen = table_of(source, skipped, reading)
    return drives_of(seen, reading, skipped, source.name, source.stem, (source.path,))


def drive_from_table(
    table: Any,
    *,
    vehicle: Vehicle | None = None,
    settings: Settings | None = None,
    crs: Any = None,
    id: str | None = None,
    columns: Any = None,
    tz: str | None = None,
    dates: str | None = None,
    units: Units | None = None,
) -> list[Drive]:
    """The drives of a table in memory.

    Args:
        table: A DataFrame, a GeoDataFrame of points, an Arrow table or anything with
            `__arrow_c_stream__`, a dict of columns, a list of dicts, rows (time, lat, lon) or
            (lat, lon) as tuples or an array, trajectories of movingpandas, or a GPX of gpxpy.
        vehicle: Gives the scale and width of wheel counters.
        settings: Gives the sigma of fixes that report none.
        crs: Reference system of `x, y` columns, anything that pyproj takes.
        id: The column whose values tell drives apart.
        columns: Own names of columns: {"time": "ts", "speed_kmh": "v"}.
        tz: Zone of times that name none; None: UTC.
        dates: "mdy", "dmy" or "ymd": the order in dates such as 06/01/2026 and 010626.
        units: Of columns that name none, where a table that this is a part of has told them.

    Returns:
        One drive, or one for each value of the columns that tell drives apart.

    Raises:
        ReadError: It is no table, or holds nothing that locates a drive.
    """
    reading = Reading.of(
        vehicle, settings, crs=crs, id=id, columns=columns, tz=tz, dates=dates, units=units
    )
    frames = frames_of(table)
    if is_gpx(table):
        drives = read_gpx(Source("drive", "", table.to_xml().encode()), reading.settings)
        drives = [replace(drive, sources=()) for drive in drives]
    elif frames is None:
        drives = drives_of(in_memory(table, reading), reading, Counter(), "table", "drive")
    else:
        drives = [
            drive
            for name, frame in frames
            for drive in drives_of(in_memory(frame, reading), reading, Counter(), name, name)
        ]
    return [
        with_fit_notes(without_reckoned(drive, reading.vehicle), reading.vehicle)
        for drive in drives
    ]


def drives_of(
    seen: Seen,
    reading: Reading,
    skipped: Skipped,
    where: str,
    stem: str,
    paths: tuple[str, ...] = (),
) -> list[Drive]:
    """Each drive of a table; what is skipped before the split counts with the first.

    Args:
        seen: The table.
        reading: What the caller says of it.
        skipped: What was skipped so far.
        where: The table, in messages.
        stem: The drive's name, if the table has none.
        paths: The files, for `Drive.sources`; empty: it was in memory.
    """
    if seen.table.num_rows == 0:
        if seen.names and "time" not in seen.found:
            raise ReadError(no_column(where, "no time", seen.names, ("time",)))
        raise ReadError(f"{where}: no rows; at least one fix or odometry reading was expected")
    notes: list[str] = []
    trips = trips_of(seen, np.arange(seen.table.num_rows), stem, reading.id is not None)
    columns, said = _placed(seen, trips, reading, skipped, notes, where, paths)
    with np.errstate(over="ignore", invalid="ignore"):
        units = reading.units or units_of(columns, seen.found, trips)
    units.in_si(columns)
    good = with_time(seen, columns, skipped, notes)
    if not good.any():
        raise ReadError(no_time(seen, where, reading.dates))
    trips = [Trip(t.name, t.rows[good[t.rows]]) for t in trips]
    trips = sorted((t for t in trips if len(t.rows)), key=lambda t: int(t.rows[0]))
    if {"x", "y"} <= columns.keys() and "lat" not in columns:
        notes.append("columns x, y not used: no crs (--crs) was given for them")
    drives: list[Drive] = []
    for name, rows in trips:
        part = {quantity: values[rows] for quantity, values in columns.items()}
        here: Skipped = skipped if not drives else Counter()
        drive = drive_of(part, reading.vehicle, reading.settings, here, units.grid)
        apart = (one[name] for one in said if name in one)
        told = (*notes, *units.notes_on(part), *apart, *drive.notes)
        sensed = sensed_by(part)
        drives.append(
            replace(
                drive, drive_id=name, sources=paths, skipped=dict(here), notes=told, sensed=sensed
            )
        )
    return drives


def units_in(table: Any, first: Sequence[int], reading: Reading) -> Units:
    """The units of columns of many trips whose names say none, by the first trips.

    Args:
        table: In memory, trip after trip.
        first: Where each begins, and the number of rows.
        reading: What the caller says of it.
    """
    seen = in_memory(table, reading)
    trips = [Trip("", np.arange(low, high)) for low, high in pairwise(first)]
    try:
        columns, _ = _placed(seen, trips, reading, Counter(), [], "table", ())
    except ReadError:  # each trip will say why
        return Units()
    with np.errstate(over="ignore", invalid="ignore"):
        return units_of(columns, seen.found, trips)


def _placed(
    seen: Seen, trips: list[Trip], reading: Reading, skipped: Skipped, notes: list[str],
    where: str, paths: tuple[str, ...],
) -> tuple[Columns, list[dict[str, str]]]:  # fmt: skip
    """All quantities, in the units of the columns' names, with places in degrees and times in s.

    Also what is said of the times of some drives, by name.
    """
    columns = _values(seen, skipped, notes)
    if reading.crs is not None and {"lat", "lon"} <= columns.keys():
        notes.append(
            f"crs (--crs) {reading.crs} not used: columns lat, lon give the places, in degrees"
        )
    _locate(seen, columns, reading.crs, where)
    _usable(columns, seen, where, reading.crs)
    _check_places(columns, seen, where)
    if "time" in seen.found:
        read, zone = _times(seen, reading, skipped, where, notes, paths), reading.written.zone
        with np.errstate(over="ignore", invalid="ignore"):  # cells may hold anything
            columns["time"] = in_seconds(read, columns, trips, zone, notes)
            local = zone if read.zoneless or read.counted else None
            shown = partial(_on_clocks, seen, columns, trips, reading.written, where)
            said = [put_apart(columns, trips, local, shown), spread(columns, trips)]
            check_motion(columns, trips, notes, where)
    else:
        columns["time"], said = _invented(seen, columns, trips, notes, where), []
    return columns, said


def sensed_by(columns: Columns) -> tuple[SensorReading, ...]:
    """What further sensors say in rows of a table: those of their cells that hold a number."""
    own = {name.removeprefix(SENSED): v for name, v in columns.items() if name.startswith(SENSED)}
    if not own:
        return ()
    values = np.column_stack(list(own.values()))
    told = np.flatnonzero(np.isfinite(values).any(axis=1))
    told = told[np.argsort(columns["time"][told], kind="stable")]
    rows = zip(columns["time"][told].tolist(), values[told].tolist(), strict=True)
    return tuple(
        SensorReading(time, {n: v for n, v in zip(own, row, strict=True) if math.isfinite(v)})
        for time, row in rows
    )


def _values(seen: Seen, skipped: Skipped, notes: list[str]) -> Columns:
    """The numbers of all quantities, in the units of the columns' names."""
    columns: Columns = {}
    for quantity, column in seen.found.items():
        if quantity not in _NO_VALUES:
            values = numbers(seen.table.column(column.place), column.name, skipped)
            columns[quantity] = values * column.factor
    for quantity, letters, negative in (("lat", "north_south", "S"), ("lon", "east_west", "W")):
        if quantity in columns and letters in seen.found:
            cells = strings(seen.table.column(seen.found[letters].place))
            south = np.array([(cell or "").strip().upper() == negative for cell in cells])
            columns[quantity] = np.where(south, -np.abs(columns[quantity]), columns[quantity])
    if "gear" in seen.found and "reverse" not in columns and _is_signed(columns):
        gear = seen.found["gear"]
        cells = strings(seen.table.column(gear.place))
        columns["reverse"] = reversing(cells, gear.name, notes)
    empty = [
        name for name in (MOTION - {"speed"}) & columns.keys() if np.isnan(columns[name]).all()
    ]
    return {name: values for name, values in columns.items() if name not in empty}


def _times(
    seen: Seen,
    reading: Reading,
    skipped: Skipped,
    where: str,
    notes: list[str],
    paths: tuple[str, ...],
) -> Times:
    """The times of all rows, and what is to be said of their zone."""
    column, written = seen.found["time"], reading.written
    day = seen.found.get("date")
    read = times(
        seen.table.column(column.place), column, where, skipped, written=written,
        date=None if day is None else (day.name, seen.table.column(day.place)),
    )  # fmt: skip
    notes += [*mixed_note(read, column.name), *unlikely_notes(read, seen)]
    if read.zoneless:
        utc = any(word in normal(column.name).split("_") for word in ("utc", "gps", "gmt"))
        if written.zone is None and not utc and (paths or "local" in normal(column.name)):
            notes.append(taken_as_utc(column.name))
    elif written.zone is not None and not read.counted:
        notes.append(f"tz {reading.tz} not used: times in column {column.name!r} name their zone")
    return read


def _on_clocks(
    seen: Seen, columns: Columns, trips: list[Trip], written: Writing, where: str
) -> Array:
    """The times on the clocks of the zone, s, and others for rows that name theirs."""
    column, day = seen.found["time"], seen.found.get("date")
    zone = timezone(_FAR)
    read = times(
        seen.table.column(column.place), column, where, Counter(),
        written=written._replace(zone=zone),
        date=None if day is None else (day.name, seen.table.column(day.place)),
    )  # fmt: skip
    return in_seconds(read, columns, trips, zone, []) + _FAR.total_seconds()


def _invented(
    seen: Seen, columns: Columns, trips: list[Trip], notes: list[str], where: str
) -> Array:
    """Times of a table of places that has none, and no column that may hold them either."""
    used = {column.name for column in seen.found.values()}
    others = [name for name in seen.names if name not in used and normal(name) not in _NO_TIMES]
    if not {"lat", "lon"} <= columns.keys() or others or seen.table.num_rows < 2:
        raise ReadError(no_column(where, "no time", seen.names, ("time",)))
    return invented_times(columns["lat"], columns["lon"], [t.rows for t in trips], notes)


def _locate(seen: Seen, columns: Columns, crs: Any, where: str) -> None:
    """Fill `lat` and `lon` from a geometry column or from x and y in `crs`."""
    if {"lat", "lon"} <= columns.keys():
        return
    if "geometry" in seen.found:
        columns["lon"], columns["lat"] = places_of(seen.table, seen.found["geometry"], crs, where)
    elif crs is not None and {"x", "y"} <= columns.keys():
        columns["lon"], columns["lat"] = unproject(columns["x"], columns["y"], crs, where)


def _check_places(columns: Columns, seen: Seen, where: str) -> None:
    """Raise where no place of a table can be understood, and nothing else is in it."""
    if not {"lat", "lon"} <= columns.keys() & seen.found.keys():
        return
    lat, lon = columns["lat"], columns["lon"]
    moving = MOTION - {"speed"} if np.isfinite(lat).any() else MOTION  # beside places: a receiver's
    others = [q for q in columns if q in moving or q.startswith(SENSED)]
    if is_place(lat, lon).any() or any(np.isfinite(columns[q]).any() for q in others):
        return
    cells = [strings(seen.table.column(seen.found[q].place)) for q in ("lat", "lon")]
    told = zip(*cells, ~((lat == 0.0) & (lon == 0.0)), strict=True)  # zeros stand for no fix
    first = next(((a, b) for a, b, other in told if a and b and other), None)
    if first is None:
        return
    raise ReadError(
        f"{where}: no row has both a latitude and a longitude that can be understood, for example "
        f"{first[0][:40]!r} and {first[1][:40]!r}; degrees, such as 49.4093 and 8.6937, were "
        f"expected; {said_of_degrees(lat, lon)}"
    )


def _usable(columns: Columns, seen: Seen, where: str, crs: Any) -> None:
    """Raise where a table neither locates nor moves a vehicle."""
    has = columns.keys()
    fixes = {"lat", "lon"} <= has
    wheels = {"wheel_rl", "wheel_rr"} <= has or {"wheel_rl_ticks", "wheel_rr_ticks"} <= has
    if fixes or wheels or has & {"odometer", "speed"}:
        return
    if "time" in seen.found and "yaw_rate" in has:  # to stand beside the odometry of another file
        return
    if "time" in seen.found and any(name.startswith(SENSED) for name in has):
        return
    if {"x", "y"} <= has and crs is None:
        raise ReadError(
            f"{where}: columns x and y without a reference system; latitude and longitude, or "
            "crs= (--crs) for x and y were expected"
        )
    if "time" not in seen.found:
        raise ReadError(no_column(where, "no time", seen.names, ("time",)))
    wanted = ("lat", "lon", "wheel_rl", "odometer", "speed")
    raise ReadError(no_column(where, "neither position nor odometry", seen.names, wanted))


def _is_signed(columns: Columns) -> bool:
    """Whether there is odometry that a gear gives a sign."""
    return bool(columns.keys() & WHEELS) or {"speed", "yaw_rate"} <= columns.keys()
