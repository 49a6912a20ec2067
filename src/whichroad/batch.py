"""Many trips in one process: Arrow in, Arrow out, threads over trips.

A trip that cannot be matched gets a row that says why, and the others go on.  Trips are
worked on in parcels of some thousand rows, and only a few parcels are held at a time.
"""

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from .errors import SettingError
from .parcel import Job, Tables, joined
from .readers import read_vehicle
from .readers.many_trips import TripBatch, trip_batches
from .roadmap import RoadMap, open_map
from .settings import Settings, Vehicle
from .smoother import Lag

Progress = Callable[[str, int, int], None]


def match_many(
    table: Any,
    roads: RoadMap | str | Path,
    *,
    drive_id: str = "drive_id",
    vehicle: Vehicle | str | Path | None = None,
    settings: Settings | None = None,
    lag: Any = None,
    attributes: bool = False,
    crs: Any = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Tables:
    """Match every trip of a table; the answers of all trips are held in memory.

    `match_stream` gives the same a few trips at a time.

    Args:
        table: A table with `time, lat, lon` and a column that names the trip: an Arrow table,
            a DataFrame, the path of a Parquet or Arrow file or a folder of them, a dataset,
            or an iterator of record batches.  Rows of a trip lie together, in a table in
            memory in any order.
        roads: A `RoadMap`, or the path of one.
        drive_id: The column that names the trip; the default also finds its usual aliases.
        vehicle: Of all trips.
        settings: The model's numbers.
        lag: As in `match`.
        attributes: Whether the road's name, class and speed limit are added to the points.
        crs: Reference system of `x, y` columns, as in `match`.
        threads: How many trips side by side; None: one for each core this process may use.
        progress: Told ("trips", trips done, 0).

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
            attributes=attributes, crs=crs, threads=threads, progress=progress,
        )
    )  # fmt: skip
    return joined(parts)


def match_stream(
    table: Any,
    roads: RoadMap | str | Path,
    *,
    drive_id: str = "drive_id",
    vehicle: Vehicle | str | Path | None = None,
    settings: Settings | None = None,
    lag: Any = None,
    attributes: bool = False,
    crs: Any = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Iterator[Tables]:
    """Match every trip of a table or stream, some trips at a time, in order.

    Takes and raises what `match_many` does.  However long the stream is, the rows of about
    two parcels per thread are in memory, and of trips that are not whole yet.

    Yields:
        Tables of some whole trips.
    """
    if threads is not None and threads < 1:
        raise SettingError(f"threads is {threads}; at least 1 was expected")
    if isinstance(vehicle, str | Path):
        vehicle = read_vehicle(vehicle)
    workers = threads or _cores()
    job = Job(open_map(roads), vehicle, settings, Lag.of(lag), attributes, crs)
    done = 0
    with ThreadPoolExecutor(workers, thread_name_prefix="whichroad") as pool:
        for tables in _in_order(pool, job.tables, trip_batches(table, drive_id), 2 * workers):
            done += tables.drives.num_rows
            if progress:
                progress("trips", done, 0)
            yield tables


def _in_order(
    pool: ThreadPoolExecutor,
    work: Callable[[TripBatch], Tables],
    todo: Iterator[TripBatch],
    ahead: int,
) -> Iterator[Tables]:
    """Results in the order of the work, of which only so much is begun ahead."""
    running: deque[Future[Tables]] = deque()
    try:
        for parcel in todo:
            running.append(pool.submit(work, parcel))
            if len(running) > ahead:
                yield running.popleft().result()
        while running:
            yield running.popleft().result()
    finally:  # nobody asks for the rest
        for future in running:
            future.cancel()


def _cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
