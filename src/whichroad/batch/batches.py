"""Many trips: Arrow in, Arrow out, threads over chunks of trips."""

import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa

from ..errors import SettingError
from ..lookback.smoothing import Lag
from ..readers import read_vehicle
from ..readers.dates import Writing
from ..readers.many_trips import TripBatch, own_names, trip_batches
from ..readers.ordered_trips import ordered_batches
from ..readers.splitting import seconds_of
from ..readers.trip_units import KnownUnits, with_units
from ..roadmap import RoadMap, RoadMaps, shared_map, shared_maps
from ..sensors import Sensor
from ..settings import Settings, Vehicle
from ..tables.schema import DRIVES, MAP, PATH, POINTS, SLIM
from .by_map import MapsJob
from .trips import ALL, Job, Tables, joined

_NONE: KnownUnits = {}
Progress = Callable[[str, int, int], None]
Give = Literal["path", "points", "slim", "drives"]

SCHEMAS: dict[str, pa.Schema] = {"points": POINTS, "slim": SLIM, "path": PATH, "drives": DRIVES}
"""Of what `match_batches` gives."""

MAPS_SCHEMAS: dict[str, pa.Schema] = {name: one.append(MAP) for name, one in SCHEMAS.items()}
"""The same where the map is a folder: the column `map` names the file of each row."""


def match_many(
    table: Any,
    roads: RoadMap | RoadMaps | str | Path,
    *,
    drive_id: str = "drive_id",
    vehicle: Vehicle | str | Path | None = None,
    settings: Settings | None = None,
    lag: Any = None,
    attributes: bool = False,
    crs: Any = None,
    columns: Mapping[str, str] | None = None,
    tz: str | None = None,
    dates: str | None = None,
    sensors: Sequence[Sensor] = (),
    places: Any = None,
    split: str | float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Tables:
    """Match every trip of a table; the results of all trips are held in memory.

    `match_stream` gives the same a few trips at a time.  One call has a cost of some
    milliseconds: give it many trips.

    Args:
        table: A table with `time, lat, lon` and a column that names the trip: an Arrow table,
            a DataFrame, a list of dicts, records of NumPy, anything with `__arrow_c_stream__`, the
            path of a Parquet or Arrow file or a folder of them, a dataset or its Scanner, or an
            iterator of record batches.  Rows of a trip lie together, in a table in memory in any
            order.
        roads: A `RoadMap`, or the path of one, which a process opens once.  Or a folder of
            compiled maps: each trip takes the one that holds it, which the column `map` names.
        drive_id: The column that names the trip; the default also finds its usual aliases, and
            those of vehicles where no column names trips.
        vehicle: Of all trips.
        settings: The model's numbers.
        lag: As in `match`.
        attributes: Whether the road's name, class and speed limit are added to the points.
        crs: Reference system of `x, y` columns, as in `match`.
        columns: Own names of columns, e.g. {"time": "ts", "speed_kmh": "v"}.
        tz: Zone of times that name none, e.g. "Europe/Berlin"; None: UTC.
        dates: "mdy", "dmy" or "ymd": the order in dates such as 06/01/2026 and 010626.
        sensors: Further sensors (`whichroad.sensors`), whose columns are in the table.
        places: Point objects, as `match` takes them.  The tables `ahead` and `nearby` then have
            those within 500 m ahead and within 50 m of each epoch.
        split: Cut the rows of each name at pauses and stops of so long ("5min", or s), and at
            jumps that no car makes, into trips called `name/1`, `name/2`, ...
        threads: How many trips side by side; None: one for each core this process may use.
        progress: Called with ("trips", trips done, 0).

    Returns:
        Points, path, and one row for every trip in the order in which trips begin.

    Raises:
        ReadError: It is no table of trips.
        MapError: The map is not one.
        SettingError: A setting is out of bounds.
    """
    parts = list(
        match_stream(
            table, roads, drive_id=drive_id, vehicle=vehicle, settings=settings, lag=lag,
            attributes=attributes, crs=crs, columns=columns, tz=tz, dates=dates,
            sensors=sensors,
            places=places, split=split, threads=threads, progress=progress,
        )
    )  # fmt: skip
    return joined(parts)


def match_stream(
    table: Any,
    roads: RoadMap | RoadMaps | str | Path,
    *,
    drive_id: str = "drive_id",
    vehicle: Vehicle | str | Path | None = None,
    settings: Settings | None = None,
    lag: Any = None,
    attributes: bool = False,
    crs: Any = None,
    columns: Mapping[str, str] | None = None,
    tz: str | None = None,
    dates: str | None = None,
    sensors: Sequence[Sensor] = (),
    places: Any = None,
    split: str | float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Iterator[Tables]:
    """Match every trip of a table or stream, some trips at a time, in order.

    Takes and raises what `match_many` does.  However long the stream is, the rows of about
    two chunks per thread are in memory, and of trips that are not whole yet.

    Yields:
        Tables of some whole trips.
    """
    if threads is not None and threads < 1:
        raise SettingError(f"threads is {threads}; at least 1 was expected")
    workers = threads or cores()
    own, drive_id = own_names(columns, drive_id)
    job = job_of(
        roads,
        vehicle,
        settings,
        lag,
        attributes,
        crs,
        split=split is not None,
        columns=own,
        tz=tz,
        dates=dates,
    ).with_more(sensors, places)
    own = job.own_columns()
    done = 0
    with ThreadPoolExecutor(workers, thread_name_prefix="whichroad") as pool:
        chunks = trip_batches(
            table, drive_id, split=seconds_of(split), own=own, written=job.written
        )
        chunks = with_units(chunks, job.reading)
        for tables in _in_order(pool, job.tables, chunks, 2 * workers):
            done += tables.drives.num_rows
            if progress:
                progress("trips", done, 0)
            yield tables


def match_batches(
    batches: Any,
    map: RoadMap | RoadMaps | str | Path,
    *,
    give: Give = "path",
    trip_id: str = "drive_id",
    vehicle: Vehicle | str | Path | None = None,
    settings: Settings | None = None,
    lag: Any = None,
    attributes: bool = False,
    crs: Any = None,
    columns: Mapping[str, str] | None = None,
    tz: str | None = None,
    dates: str | None = None,
    sensors: Sequence[Sensor] = (),
    split: str | float | None = None,
    ordered: bool = False,
) -> Iterator[pa.RecordBatch]:
    """Match whole trips that come in batches, in this thread: what engines call on a partition.

    It depends on its arguments alone, and can be pickled with a path as the map.

    Args:
        batches: As the table of `match_many`; batches may end within trips.  All rows of a trip
            are in it, together.
        map: The path of a map, or of a folder of maps, that the process sees; it is opened
            once.  Or a `RoadMap`.
        give: Which table.  `slim` are points without poses: `SCHEMAS` has the columns of each.
        trip_id: The column that names the trip, as `drive_id` of `match_many`.
        vehicle: Of all trips.
        settings: The model's numbers.
        lag: As in `match`.
        attributes: Whether the road's name, class and speed limit are added to points.
        crs: Reference system of `x, y` columns.
        columns: Own names of columns, as in `match_many`.
        tz: Likewise.
        dates: Likewise.
        sensors: Further sensors (`whichroad.sensors`), whose columns are in the batches.
        split: As in `match_many`.
        ordered: The batches are an iterator in which the rows of each trip follow each other,
            as behind a sort: reading them takes less time.

    Yields:
        Record batches of `SCHEMAS[give]`, of some whole trips each.

    Raises:
        ReadError: It is no table of trips, or the rows of a trip do not lie together.
        MapError: The map is not one.
        SettingError: A setting is out of bounds.
    """
    if give not in SCHEMAS:
        raise SettingError(f"give is {give!r}; one of {', '.join(SCHEMAS)} was expected")
    wanted = frozenset(("points" if give == "slim" else give,))
    own, trip_id = own_names(columns, trip_id)
    points = attributes and give == "points"
    job = job_of(
        map, vehicle, settings, lag, points, crs, wanted, split=split is not None, columns=own,
        tz=tz, dates=dates,
    ).with_more(sensors, None)  # fmt: skip
    for tables in match_tables(batches, job, trip_id, seconds_of(split), ordered=ordered):
        table = slim(tables.points) if give == "slim" else getattr(tables, give)
        for batch in table.combine_chunks().to_batches():
            if batch.num_rows:
                yield batch


def match_tables(
    batches: Any, job: Job | MapsJob, trip_id: str, split: float | None, *, ordered: bool,
    units: KnownUnits = _NONE,
) -> Iterator[Tables]:  # fmt: skip
    """As `match_batches`, but all tables of the same trips that the job gives.

    `units` are those that a larger table has told.
    """
    own, written = job.own_columns(), job.written
    if ordered:
        chunks = ordered_batches(batches, trip_id, split=split, own=own, written=written)
    else:
        chunks = trip_batches(batches, trip_id, split=split, strict=True, own=own, written=written)
    for chunk in with_units(chunks, job.reading, units):
        yield job.tables(chunk)


def slim(points: pa.Table) -> pa.Table:
    """Points without poses: time, road, place on it and probabilities."""
    return points.select([*SLIM.names, *({MAP.name} & set(points.column_names))])


def job_of(
    roads: Any, vehicle: Any, settings: Settings | None, lag: Any, attributes: bool, crs: Any,
    give: frozenset[str] = ALL, *, split: bool = False,
    columns: Mapping[str, str | int] | None = None, tz: str | None = None,
    dates: str | None = None,
) -> Job | MapsJob:  # fmt: skip
    """What all trips share; `split`: they are parts already.

    Raises:
        ReadError: There is no such zone or order of dates.
        MapError: The map is not one.
        SettingError: A setting is out of bounds.
    """
    if isinstance(vehicle, str | Path):
        vehicle = read_vehicle(vehicle)
    Writing.of(tz, dates)
    maps = shared_maps(Path(roads)) if is_folder(roads) else roads
    one = next(iter(maps.values())) if isinstance(maps, RoadMaps) else shared_map(maps, crs)
    job = Job(
        one,
        vehicle,
        settings,
        Lag.of(lag),
        attributes,
        crs,
        give,
        columns=columns or {},
        tz=tz,
        dates=dates,
    )
    return MapsJob(maps, job, split) if isinstance(maps, RoadMaps) else job


def is_folder(roads: Any) -> bool:
    """Whether this names a folder of maps."""
    return isinstance(roads, str | Path) and Path(roads).is_dir()


def _in_order(
    pool: ThreadPoolExecutor,
    work: Callable[[TripBatch], Tables],
    chunks: Iterator[TripBatch],
    ahead: int,
) -> Iterator[Tables]:
    """Results in the order of the chunks, of which only so many are begun ahead."""
    running: deque[Future[Tables]] = deque()
    try:
        for chunk in chunks:
            running.append(pool.submit(work, chunk))
            if len(running) > ahead:
                yield running.popleft().result()
        while running:
            yield running.popleft().result()
    finally:  # the caller may have stopped asking
        for future in running:
            future.cancel()


def cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
