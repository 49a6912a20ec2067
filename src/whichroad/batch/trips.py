"""The trips of a chunk as tables.

Trips are filtered in chunks of some thousand rows, and only a few chunks are held at a time.
The fixed cost of a call is paid once for all trips of a chunk that are fixes alone, without
anything to report of their reading.  Others are read one by one, with the same result as alone.
A trip that cannot be matched gets a row that says why, and the others go on.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .._compile import Records
from ..epochs import Timeline, epochs_of_fixes
from ..errors import SettingError, WhichroadError
from ..evidence.sensed import Sensed, checked, columns_of
from ..filter.state import CLOCK, new_epochs
from ..lookback.smoothing import Lag
from ..lookback.traversals import traversals
from ..matching import are_near, skipped_of, timeline_of
from ..places import AHEAD_M, NEARBY_M, Places, places_on
from ..readers import drive_from_table
from ..readers.dates import Writing
from ..readers.many_trips import APART, TripBatch
from ..readers.reading import Reading
from ..readers.regular_trips import batched_fixes
from ..readers.splitting import STANDING, with_pauses
from ..recorded import localize_recorded
from ..roadmap import RoadMap
from ..sensors import Sensor
from ..settings import Settings, Vehicle, tuned_by
from ..tables.export import figures_of, path_table, points_table
from ..tables.provenance import with_map
from ..tables.relative_places import Surroundings, relative_schema
from ..tables.schema import ATTRIBUTES, DRIVES, PATH, POINTS
from ..wording import counted
from .filtering import Batch, filter_batch, one_batch

ALL = frozenset(("points", "path", "drives", "ahead", "nearby"))
_AGAIN = (
    f"a trip before has the same name: {APART:,} rows of others or more lie between them; all rows "
    "of a trip were expected together; sort the rows by trip and time"
)


@lru_cache(maxsize=1)
def _no_places() -> pa.Table:
    """A table of places without rows."""
    return relative_schema(None).empty_table()


class _Tables(NamedTuple):
    points: pa.Table
    path: pa.Table
    drives: pa.Table


class Tables(_Tables):
    """Estimates of many trips.

    Attributes:
        points: One row per epoch, `tables.schema.POINTS`.
        path: One row per edge driven, `tables.schema.PATH`.
        drives: One row per trip, `tables.schema.DRIVES`, also where there is no answer.
        ahead: Of `places=`: one row per epoch and place that lies ahead.
        nearby: Likewise of those within a circle.
    """

    ahead: pa.Table
    nearby: pa.Table

    def __new__(
        cls, points: pa.Table, path: pa.Table, drives: pa.Table,
        ahead: pa.Table | None = None, nearby: pa.Table | None = None,
    ) -> "Tables":  # fmt: skip
        """Three tables, and two that stand beside them."""
        self = super().__new__(cls, points, path, drives)
        self.ahead = _no_places() if ahead is None else ahead
        self.nearby = _no_places() if nearby is None else nearby
        return self

    def every(self) -> tuple[pa.Table, ...]:
        """All five, in the order of the arguments."""
        return (*self, self.ahead, self.nearby)

    def __repr__(self) -> str:
        names = (*self._fields, "ahead", "nearby")
        tables = zip(names, self.every(), strict=True)
        shown = [(n, t) for n, t in tables if n in self._fields or len(t)]
        return ", ".join(f"{name}: {counted(len(t), 'row')}" for name, t in shown)


def joined(parts: Sequence[Tables]) -> Tables:
    """Tables one after the other."""
    if not parts:
        return Tables(POINTS.empty_table(), PATH.empty_table(), DRIVES.empty_table())
    columns = zip(*(part.every() for part in parts), strict=True)
    return Tables(*(pa.concat_tables(column) for column in columns))


class _Answer(NamedTuple):
    """Trips with estimates."""

    names: list[str]
    batch: Batch
    skipped: list[dict[str, int]]  # of each, rows by reason
    notes: list[tuple[str, ...]]  # of each
    outside: list[int]  # of each, how many fixes are off the map

    def each(self) -> "list[_Answer]":
        """One by one."""
        batches = self.batch.each() if len(self.names) > 1 else [self.batch]
        parts = zip(self.names, batches, self.skipped, self.notes, self.outside, strict=True)
        return [_Answer([n], b, [s], [t], [o]) for n, b, s, t, o in parts]


class _Failure(NamedTuple):
    """A trip without an answer."""

    name: str
    reason: str
    skipped: Mapping[str, int] = {}  # rows by reason, where its table could be read

    def each(self) -> "list[_Failure]":
        """Itself."""
        return [self]


class _Regular(NamedTuple):
    """The regular trips of a chunk: those of which nothing was skipped."""

    epochs: Records  # (n,) EPOCH of all, one after the other
    first: NDArray[np.int64]  # (trips + 1,) where those of each trip of the chunk begin
    usable: NDArray[np.bool_]  # (trips,) whether they are its epochs
    outside: NDArray[np.int64]  # (trips,) how many of them are off the map
    notes: dict[int, tuple[str, ...]]  # by trip, of the usable ones


class Job(NamedTuple):
    """What all trips share."""

    roads: RoadMap
    vehicle: Vehicle | None
    settings: Settings | None
    lag: Lag | None
    attributes: bool
    crs: Any = None
    give: frozenset[str] = ALL  # tables that are made; the others come out empty
    sensors: tuple[Sensor, ...] = ()
    columns: Mapping[str, str | int] = {}  # own names, as `names.find` takes them
    tz: str | None = None  # of times that name no zone
    dates: str | None = None  # mdy, dmy or ymd, of dates such as 06/01/2026
    places: Places | None = None

    @property
    def identity(self) -> dict[str, Any]:
        """What results name as their map."""
        return self.roads.identity

    @property
    def written(self) -> Writing:
        """How times are written, where they do not show it."""
        return Writing.of(self.tz, self.dates)

    def with_more(self, sensors: Sequence[Sensor], places: Any) -> "Job":
        """The job with further sensors and with places, as `match` takes them.

        Raises:
            ReadError: It is no table of places.
            SettingError: A sensor is none, or there is no place.
        """
        return self._replace(sensors=checked(sensors), places=places_on(places, self.roads))

    @property
    def reading(self) -> Reading:
        """How tables of its trips are to be read."""
        return Reading.of(
            self.vehicle, self.settings, crs=self.crs, columns=self.own_columns(), tz=self.tz,
            dates=self.dates,
        )  # fmt: skip

    def own_columns(self) -> dict[str, str | int]:
        """Own names of columns, and the columns that the sensors read by the alias they need."""
        return {**self.columns, **columns_of(self.sensors)}

    def tables(self, chunk: TripBatch) -> Tables:
        """The tables of the trips of a chunk."""
        points, path, drives, *about = self._tables(chunk).every()
        if chunk.again or chunk.standing:
            drives = _remarked(drives, chunk)
        made = (points, path, drives, *about)
        return Tables(*(with_map(table, self.roads.identity) for table in made))

    def _tables(self, chunk: TripBatch) -> Tables:
        vehicle = self.vehicle or Vehicle()
        settings = tuned_by(self.settings, vehicle)
        answers = list(self._answers(chunk, vehicle, settings))
        try:
            return self._combined(answers)
        except Exception:  # find out which trip's tables cannot be made
            return joined([self._alone(one) for answer in answers for one in answer.each()])

    def _answers(
        self, chunk: TripBatch, vehicle: Vehicle, settings: Settings
    ) -> Iterator[_Answer | _Failure]:
        """The answers to all trips, in order; as many at once as possible."""
        regular, trip, trips = self._regular(chunk), 0, len(chunk.names)
        batched = not self.sensors and self.places is None
        single = np.flatnonzero(~regular.usable if batched else np.ones(trips))
        while trip < trips:
            end = int(next(iter(single[single >= trip]), trips))
            found = self._batch(chunk.names, regular, trip, end, vehicle, settings)
            if found is not None:
                yield found
                trip += len(found.names)
            if trip < trips and (found is None or trip < end):
                yield self._answer(chunk, regular, trip, vehicle, settings)
                trip += 1

    def _regular(self, chunk: TripBatch) -> _Regular:
        """The epochs of the trips that need not be read alone."""
        first, usable = np.array(chunk.first), np.zeros(len(chunk.names), np.bool_)
        outside = np.zeros(len(chunk.names), np.int64)
        read = batched_fixes(
            chunk.table, first[:-1], self.settings or Settings(), self.columns, self.written.zone,
            chunk.units,
        )  # fmt: skip
        if read is None or not len(read.fixes):
            return _Regular(new_epochs(0), np.zeros(len(first), np.int64), usable, outside, {})
        fixes, regular, notes = read
        begin = np.cumsum([0, *np.where(regular, np.diff(first), 0)])
        own = begin[:-1][regular]
        epochs, apart = epochs_of_fixes(fixes, own.tolist(), self.roads.plane)
        near = are_near(fixes.lat_deg, fixes.lon_deg, self.roads, epochs.fix[:, :2])
        outside[regular] = np.add.reduceat(~near, own, dtype=np.int64)
        usable[regular] = apart & np.logical_or.reduceat(near, own)
        usable &= [name != "" for name in chunk.names]
        return _Regular(epochs, begin, usable, outside, notes)

    def _batch(
        self, names: list[str], regular: _Regular, trip: int, end: int, vehicle: Vehicle,
        settings: Settings,
    ) -> _Answer | None:  # fmt: skip
        """The answers to usable trips from one on; None where that one has to be alone."""
        if trip == end:
            return None
        bounds = regular.first[trip : end + 1]
        epochs = regular.epochs[bounds[0] : bounds[-1]]
        first = (bounds - bounds[0]).tolist()
        try:
            found = filter_batch(self.roads, epochs, first, vehicle, settings, self.lag)
        except Exception:  # find out which trip is the cause
            return None
        if found is None:
            return None
        batch, more = found
        end = trip + len(batch.first) - 1
        notes = [(*regular.notes.get(trip + k, ()), *wrong) for k, wrong in enumerate(more)]
        outside = regular.outside[trip:end].tolist()
        return _Answer(names[trip:end], batch, [{}] * (end - trip), notes, outside)

    def _answer(
        self, chunk: TripBatch, regular: _Regular, trip: int, vehicle: Vehicle, settings: Settings
    ) -> _Answer | _Failure:
        """The answer to one trip, or why there is none."""
        name, (low, high) = chunk.names[trip], chunk.first[trip : trip + 2]
        if not name:
            rows = f"{high - low:,} rows name no trip"
            return _Failure(name, f"{rows}; a drive_id in every row was expected")
        skipped: dict[str, int] = {}
        try:
            notes, outside = regular.notes.get(trip, ()), int(regular.outside[trip])
            sensed = Sensed(self.sensors, self.roads) if self.sensors else None
            if regular.usable[trip] and sensed is None:
                begin, end = regular.first[trip : trip + 2]
                timeline = Timeline(regular.epochs[begin:end], CLOCK, 0)
            else:
                rows_ = chunk.table.slice(low, high - low)
                drive = drive_from_table(
                    rows_, vehicle=self.vehicle, settings=self.settings, crs=self.crs,
                    columns={**self.columns, **(sensed.columns if sensed else {})}, tz=self.tz,
                    dates=self.dates, units=chunk.units,
                )[0]  # fmt: skip
                skipped = skipped_of(drive, high - low)
                timeline, outside = timeline_of(drive, self.roads, vehicle, sensed=sensed)
                if sensed is not None:
                    drive = sensed.reported(drive)
                skipped, notes = skipped_of(drive, high - low, timeline), drive.notes
            recorded = localize_recorded(
                self.roads, timeline, vehicle=vehicle, settings=settings, lag=self.lag,
                poses=self.places is not None,
            )  # fmt: skip
            wrong = (finding.note for finding in (*recorded.withheld, *recorded.off_roads))
            further = (finding.note for finding in recorded.further)
            notes = (*notes, *further, *wrong)
            epochs, output = timeline.epochs, recorded.output
            driven = traversals(epochs, output, recorded.chain, self.roads.arrays)
            batch = Batch(epochs, output, [0, len(epochs)], driven, [0, len(driven)])
            return _Answer([name], batch, [skipped], [notes], [outside])
        except SettingError:
            raise  # it is the caller's, not the trip's
        except WhichroadError as error:
            return _Failure(name, str(error), skipped)
        except Exception as error:  # one trip's trouble is not the others'
            return _Failure(name, _unexpected(error))

    def _alone(self, answer: _Answer | _Failure) -> Tables:
        try:
            return self._combined([answer])
        except Exception as error:
            name = answer.name if isinstance(answer, _Failure) else answer.names[0]
            return self._combined([_Failure(name, _unexpected(error))])

    def _combined(self, answers: Sequence[_Answer | _Failure]) -> Tables:
        """The tables of some trips, each made at once."""
        drives = pa.concat_tables(
            [_failed_row(a) if isinstance(a, _Failure) else _drive_rows(a) for a in answers]
        )
        found = [a for a in answers if isinstance(a, _Answer)]
        columns = pa.schema([*POINTS, *ATTRIBUTES]) if self.attributes else POINTS
        about = self._about(found)
        points, path = columns.empty_table(), PATH.empty_table()
        if not found or self.give == {"drives"}:
            return Tables(points, path, drives, *about)
        names = [name for a in found for name in a.names]
        batch = one_batch([a.batch for a in found])
        if "points" in self.give:
            points = points_table(
                names, batch.epochs, batch.output, self.roads, attributes=self.attributes,
                first=batch.first[:-1],
            )  # fmt: skip
        if "path" in self.give:
            path = path_table(names, batch.driven, self.roads, batch.first_edge)
        return Tables(points, path, drives, *about)

    def _about(self, found: Sequence[_Answer]) -> tuple[pa.Table, pa.Table]:
        """The places ahead of and near to each epoch, where they are asked for."""
        empty = relative_schema(self.places).empty_table()
        if self.places is None or not found:
            return empty, empty
        about = [
            Surroundings(a.names[0], a.batch.epochs, a.batch.output, self.places) for a in found
        ]
        ahead = [one.ahead(AHEAD_M) for one in about if "ahead" in self.give]
        nearby = [one.nearby(NEARBY_M) for one in about if "nearby" in self.give]
        return pa.concat_tables([empty, *ahead]), pa.concat_tables([empty, *nearby])


def _unexpected(error: Exception) -> str:
    return f"a bug in whichroad ({type(error).__name__}: {error}); please report it"


def _remarked(drives: pa.Table, chunk: TripBatch) -> pa.Table:
    """The rows of a chunk's trips, with what its reading has to say of some."""
    rows = noted(drives, {k: [_AGAIN] for k in chunk.again}).to_pylist()
    for k, standing in chunk.standing.items():
        rows[k]["skipped"] = [*rows[k]["skipped"], (STANDING, standing)]
    return pa.Table.from_pylist(rows, DRIVES)


def noted(drives: pa.Table, notes: Mapping[int, list[str]]) -> pa.Table:
    """The rows of trips, some of them with further notes."""
    if not notes:
        return drives
    rows = drives.to_pylist()
    for k, more in notes.items():
        rows[k]["notes"] = [*rows[k]["notes"], *more]
    return pa.Table.from_pylist(rows, DRIVES)


def _failed_row(failure: _Failure) -> pa.Table:
    """A trip without an answer as a row of `tables.schema.DRIVES`."""
    row = {"drive_id": failure.name, "answered": False, "reason": failure.reason, "epochs": 0,
           "fixes": 0, "epochs_without_answer": 0, "fixes_outside_map": 0,
           "skipped": list(failure.skipped.items()), "notes": []}  # fmt: skip
    return pa.Table.from_pylist([row], DRIVES)


def _drive_rows(answer: _Answer) -> pa.Table:
    """Trips as rows of `tables.schema.DRIVES`."""
    batch, d = answer.batch, len(answer.names)
    columns: dict[str, Any] = dict(
        figures_of(batch.epochs, batch.output, batch.first, batch.driven, batch.first_edge)
    )
    answered = columns["epochs_without_answer"] < columns["epochs"]
    columns |= {
        "drive_id": answer.names,
        "answered": answered,
        "reason": pa.array(["no epoch could be matched"] * d, mask=answered),
        "fixes_outside_map": answer.outside,
        "skipped": [list(skipped.items()) for skipped in answer.skipped],
        "notes": with_pauses(answer.notes, batch.epochs["time"], batch.first),
    }
    return pa.Table.from_arrays(
        [pa.array(columns[field.name], field.type) for field in DRIVES], schema=DRIVES
    )
