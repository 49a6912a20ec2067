"""The answers to some trips at once: what costs a call is called once for all of them.

A trip of fixes about which there is nothing to say costs little more than its filter.
Others are read one by one, and say what they would alone.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .columns import figures_of, path_table, points_table
from .core.epoch import CLOCK, Epochs, new_epochs
from .epochs import Timeline, epochs_of_fixes
from .errors import SettingError, WhichroadError
from .fleet import Fleet, localize_fleet, one_fleet
from .localizer import localize_recorded
from .readers import drive_from_table
from .readers.many_trips import TripBatch, batched_fixes
from .records import Drive
from .roadmap import RoadMap
from .route import traversals
from .session import are_near, timeline_of, tuned_by
from .settings import Settings, Vehicle
from .smoother import Lag
from .tables import ATTRIBUTES, DRIVES, PATH, POINTS


class Tables(NamedTuple):
    """What many trips say."""

    points: pa.Table  # one row per epoch, `tables.POINTS`
    path: pa.Table  # one row per edge driven, `tables.PATH`
    drives: pa.Table  # one row per trip, `tables.DRIVES`, also where there is no answer

    def __repr__(self) -> str:
        return ", ".join(f"{name}: {len(t):,} rows" for name, t in self._asdict().items())


def joined(parts: Sequence[Tables]) -> Tables:
    """Tables one behind the other."""
    if not parts:
        return Tables(POINTS.empty_table(), PATH.empty_table(), DRIVES.empty_table())
    return Tables(*(pa.concat_tables(column) for column in zip(*parts, strict=True)))


class _Answer(NamedTuple):
    """Trips, localized."""

    names: list[str]
    fleet: Fleet
    drive: Drive | None  # of one trip; None: there is nothing to say of their reading

    def each(self) -> "list[_Answer]":
        """One by one."""
        fleets = self.fleet.each() if len(self.names) > 1 else [self.fleet]
        return [_Answer([n], f, self.drive) for n, f in zip(self.names, fleets, strict=True)]


class _Failure(NamedTuple):
    """A trip without an answer."""

    name: str
    reason: str

    def each(self) -> "list[_Failure]":
        """Itself."""
        return [self]


class _Plain(NamedTuple):
    """Those trips of a parcel about whose reading there is nothing to say."""

    epochs: Epochs  # of all, one behind the other
    first: NDArray[np.int64]  # (trips + 1,) where those of each trip of the parcel begin
    usable: NDArray[np.bool_]  # (trips,) whether they are its epochs


class Job(NamedTuple):
    """What all trips share."""

    roads: RoadMap
    vehicle: Vehicle | None
    settings: Settings | None
    lag: Lag | None
    attributes: bool
    crs: Any = None

    def tables(self, parcel: TripBatch) -> Tables:
        """The answers to the trips of a parcel."""
        vehicle = self.vehicle or Vehicle()
        settings = tuned_by(self.settings, vehicle)
        answers = list(self._answers(parcel, vehicle, settings))
        try:
            return self._together(answers)
        except Exception:  # find out which trip's tables cannot be made
            return joined([self._alone(one) for answer in answers for one in answer.each()])

    def _answers(
        self, parcel: TripBatch, vehicle: Vehicle, settings: Settings
    ) -> Iterator[_Answer | _Failure]:
        """The answers to all trips, in order; as many at once as may be."""
        plain, trip = self._plain(parcel), 0
        odd = np.flatnonzero(~plain.usable if self.lag is None else np.ones(len(parcel.names)))
        while trip < len(parcel.names):
            end = int(next(iter(odd[odd >= trip]), len(parcel.names)))
            found = self._fleet(parcel.names, plain, trip, end, vehicle, settings)
            if found is not None:
                yield found
                trip += len(found.names)
            if trip < len(parcel.names) and (found is None or trip < end):
                yield self._answer(parcel, plain, trip, vehicle, settings)
                trip += 1

    def _plain(self, parcel: TripBatch) -> _Plain:
        """The epochs of the trips that need not be read alone."""
        first, usable = np.array(parcel.first), np.zeros(len(parcel.names), np.bool_)
        read = batched_fixes(parcel.table, first[:-1], self.settings or Settings())
        if read is None or not len(read[0]):
            return _Plain(new_epochs(0), np.zeros(len(first), np.int64), usable)
        fixes, plain = read
        begin = np.cumsum([0, *np.where(plain, np.diff(first), 0)])
        own = begin[:-1][plain]
        epochs, apart = epochs_of_fixes(fixes, own.tolist(), self.roads.plane)
        near = are_near(fixes.lat_deg[own], fixes.lon_deg[own], self.roads)
        if not near.all():  # one fix of each is enough
            near = np.logical_or.reduceat(are_near(fixes.lat_deg, fixes.lon_deg, self.roads), own)
        usable[plain] = apart & near
        return _Plain(epochs, begin, usable & [name != "" for name in parcel.names])

    def _fleet(
        self, names: list[str], plain: _Plain, trip: int, end: int, vehicle: Vehicle,
        settings: Settings,
    ) -> _Answer | None:  # fmt: skip
        """The answers to some usable trips from one on, or None where it has to be alone."""
        if trip == end:
            return None
        bounds = plain.first[trip : end + 1]
        epochs = Epochs._make(column[bounds[0] : bounds[-1]] for column in plain.epochs)
        try:
            fleet = localize_fleet(
                self.roads, epochs, (bounds - bounds[0]).tolist(), vehicle, settings
            )
        except Exception:  # find out whose trouble it is
            return None
        return fleet and _Answer(names[trip : trip + len(fleet.first) - 1], fleet, None)

    def _answer(
        self, parcel: TripBatch, plain: _Plain, trip: int, vehicle: Vehicle, settings: Settings
    ) -> _Answer | _Failure:
        """The answer to one trip, or why there is none."""
        name, (low, high) = parcel.names[trip], parcel.first[trip : trip + 2]
        if not name:
            rows = f"{high - low:,} rows name no trip"
            return _Failure(name, f"{rows}; a drive_id in each was expected")
        try:
            drive = None
            if plain.usable[trip]:
                begin, end = plain.first[trip : trip + 2]
                epochs = Epochs._make(column[begin:end] for column in plain.epochs)
                timeline = Timeline(epochs, CLOCK, 0)
            else:
                rows_ = parcel.table.slice(low, high - low)
                drive = drive_from_table(
                    rows_, vehicle=self.vehicle, settings=self.settings, crs=self.crs
                )[0]
                timeline = timeline_of(drive, self.roads, vehicle)
            recorded = localize_recorded(
                self.roads, timeline, vehicle=vehicle, settings=settings, lag=self.lag
            )
            way = traversals(timeline.epochs, recorded, self.roads.arrays)
            bounds = [0, len(timeline.epochs.time)], [0, len(way.edge)]
            fleet = Fleet(timeline.epochs, recorded.output, bounds[0], way, bounds[1])
            return _Answer([name], fleet, drive)
        except SettingError:
            raise  # it is the caller's, not the trip's
        except WhichroadError as error:
            return _Failure(name, str(error))
        except Exception as error:  # one trip's trouble is not the others'
            return _Failure(name, _unexpected(error))

    def _alone(self, answer: _Answer | _Failure) -> Tables:
        try:
            return self._together([answer])
        except Exception as error:
            name = answer.name if isinstance(answer, _Failure) else answer.names[0]
            return self._together([_Failure(name, _unexpected(error))])

    def _together(self, answers: Sequence[_Answer | _Failure]) -> Tables:
        """The tables of some trips, each made at once."""
        drives = pa.concat_tables(
            [_failed(a) if isinstance(a, _Failure) else _told(a) for a in answers]
        )
        found = [a for a in answers if isinstance(a, _Answer)]
        if not found:
            columns = pa.schema([*POINTS, *ATTRIBUTES]) if self.attributes else POINTS
            return Tables(columns.empty_table(), PATH.empty_table(), drives)
        names = [name for a in found for name in a.names]
        fleet = one_fleet([a.fleet for a in found])
        points = points_table(
            names, fleet.epochs, fleet.output, self.roads, attributes=self.attributes,
            first=fleet.first[:-1],
        )  # fmt: skip
        return Tables(points, path_table(names, fleet.way, self.roads, fleet.first_edge), drives)


def _unexpected(error: Exception) -> str:
    return f"this should not happen ({type(error).__name__}: {error}); please report it"


def _failed(failure: _Failure) -> pa.Table:
    """A trip without an answer as a row of `tables.DRIVES`."""
    row = {"drive_id": failure.name, "answered": False, "reason": failure.reason, "epochs": 0,
           "fixes": 0, "epochs_without_answer": 0, "skipped": [], "notes": []}  # fmt: skip
    return pa.Table.from_pylist([row], DRIVES)


def _told(answer: _Answer) -> pa.Table:
    """Trips as rows of `tables.DRIVES`."""
    fleet, drive, d = answer.fleet, answer.drive, len(answer.names)
    columns: dict[str, Any] = dict(
        figures_of(fleet.epochs, fleet.output, fleet.first, fleet.way, fleet.first_edge)
    )
    answered = columns["epochs_without_answer"] < columns["epochs"]
    columns |= {
        "drive_id": answer.names,
        "answered": answered,
        "reason": pa.array(["no epoch could be answered"] * d, mask=answered),
        "skipped": [list(drive.skipped.items()) if drive else []] * d,
        "notes": [list(drive.notes) if drive else []] * d,
    }
    return pa.Table.from_arrays(
        [pa.array(columns[field.name], field.type) for field in DRIVES], schema=DRIVES
    )
