"""Many trips in one process: Arrow in, Arrow out, threads over trips.

A trip that cannot be matched gets a row that says why, and the others go on.  Trips are
worked on in parcels of some thousand rows, and only a few parcels are held at a time.
"""

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from .columns import path_table, points_table
from .core.epoch import Epochs
from .core.output import Output
from .errors import SettingError, WhichroadError
from .readers import drive_from_table, read_vehicle
from .readers.trips import Parcel, parcels
from .records import Drive
from .result import Result
from .roadmap import RoadMap
from .session import match, open_map
from .settings import Settings, Vehicle
from .tables import DRIVES, PATH, POINTS

Progress = Callable[[str, int, int], None]


class Tables(NamedTuple):
    """What many trips say."""

    points: pa.Table  # one row per epoch, `tables.POINTS`
    path: pa.Table  # one row per edge driven, `tables.PATH`
    drives: pa.Table  # one row per trip, `tables.DRIVES`, also where there is no answer


def match_many(
    table: Any,
    roads: RoadMap | str | Path,
    *,
    drive_id: str = "drive_id",
    vehicle: Vehicle | str | Path | None = None,
    settings: Settings | None = None,
    lag: Any = None,
    attributes: bool = False,
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
            attributes=attributes, threads=threads, progress=progress,
        )
    )  # fmt: skip
    if not parts:
        return Tables(POINTS.empty_table(), PATH.empty_table(), DRIVES.empty_table())
    return Tables(*(pa.concat_tables(column) for column in zip(*parts, strict=True)))


def match_stream(
    table: Any,
    roads: RoadMap | str | Path,
    *,
    drive_id: str = "drive_id",
    vehicle: Vehicle | str | Path | None = None,
    settings: Settings | None = None,
    lag: Any = None,
    attributes: bool = False,
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
    job = _Job(open_map(roads), vehicle, settings, lag, attributes)
    done = 0
    with ThreadPoolExecutor(workers, thread_name_prefix="whichroad") as pool:
        for tables in _in_order(pool, job.tables, parcels(table, drive_id), 2 * workers):
            done += tables.drives.num_rows
            if progress:
                progress("trips", done, 0)
            yield tables


def _in_order(
    pool: ThreadPoolExecutor,
    work: Callable[[Parcel], Tables],
    todo: Iterator[Parcel],
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


class _Job(NamedTuple):
    """What all trips share."""

    roads: RoadMap
    vehicle: Vehicle | None
    settings: Settings | None
    lag: Any
    attributes: bool

    def tables(self, parcel: Parcel) -> Tables:
        """The answers to the trips of a parcel."""
        results: list[Result] = []
        rows: list[dict[str, Any]] = []
        for name, (low, high) in zip(parcel.names, pairwise(parcel.first), strict=True):
            answer = self._answer(name, parcel.table.slice(low, high - low))
            if isinstance(answer, str):
                rows.append(_failed(name, answer))
            else:
                results.append(answer)
                rows.append(_row(name, answer))
        names = [row["drive_id"] for row in rows if "duration_s" in row]
        return Tables(*self._together(names, results), pa.Table.from_pylist(rows, DRIVES))

    def _together(self, names: list[str], results: list[Result]) -> tuple[pa.Table, pa.Table]:
        """Points and path of some drives, each made at once."""
        parts = [r.answered for r in results if r.answered is not None]
        if not parts:
            return POINTS.empty_table(), PATH.empty_table()
        epochs = Epochs._make(map(np.concatenate, zip(*(a.epochs for a in parts), strict=True)))
        output = Output._make(map(np.concatenate, zip(*(a.output for a in parts), strict=True)))
        first = np.cumsum([0, *(len(a.epochs.time) for a in parts)])[:-1].tolist()
        points = points_table(
            names, epochs, output, self.roads, attributes=self.attributes, first=first
        )
        return points, path_table(names, [a.way() for a in parts], self.roads)

    def _answer(self, name: str, rows: pa.Table) -> Result | str:
        """The answer to one trip, or why there is none."""
        if not name:
            return f"{rows.num_rows:,} rows name no trip; a drive_id in each was expected"
        try:
            drives = drive_from_table(rows, vehicle=self.vehicle, settings=self.settings)
            return self._matched(drives[0])
        except WhichroadError as error:
            return str(error)
        except Exception as error:  # one trip's trouble is not the others'
            return f"this should not happen ({type(error).__name__}: {error}); please report it"

    def _matched(self, drive: Drive) -> Result:
        return match(
            drive, self.roads, vehicle=self.vehicle, settings=self.settings, lag=self.lag,
            attributes=self.attributes,
        )  # fmt: skip


def _failed(name: str, reason: str) -> dict[str, Any]:
    return {"drive_id": name, "answered": False, "reason": reason, "epochs": 0, "fixes": 0,
            "epochs_without_answer": 0}  # fmt: skip


def _row(name: str, result: Result) -> dict[str, Any]:
    """A trip's summary as a row of `tables.DRIVES`."""
    told = result.summary
    answered = told["epochs_without_answer"] < told["epochs"]
    row = {field: told.get(field) for field in DRIVES.names}
    row |= {
        "drive_id": name,
        "answered": answered,
        "reason": None if answered else "no epoch could be answered",
        "skipped": list(told["skipped"].items()),
        "notes": list(told["notes"]),
    }
    return row
