"""The answers to some trips at once: what costs a call is called once for all of them.

A trip of fixes about which there is nothing to say costs little more than its filter.
Others are read one by one, and say what they would alone.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from .columns import figures_of, path_table, points_table
from .core.epoch import Epochs
from .core.output import Output
from .epochs import Timeline, timelines_of
from .errors import SettingError, WhichroadError
from .localizer import Recorded, localize_recorded
from .readers import drive_from_table
from .readers.together import fixes_together
from .readers.trips import Parcel
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


def joined(parts: Sequence[Tables]) -> Tables:
    """Tables one behind the other."""
    if not parts:
        return Tables(POINTS.empty_table(), PATH.empty_table(), DRIVES.empty_table())
    return Tables(*(pa.concat_tables(column) for column in zip(*parts, strict=True)))


class _Answer(NamedTuple):
    """A trip, localized."""

    epochs: Epochs
    recorded: Recorded
    drive: Drive | None  # None: there is nothing to say of its reading


class Job(NamedTuple):
    """What all trips share."""

    roads: RoadMap
    vehicle: Vehicle | None
    settings: Settings | None
    lag: Lag | None
    attributes: bool

    def tables(self, parcel: Parcel) -> Tables:
        """The answers to the trips of a parcel."""
        vehicle = self.vehicle or Vehicle()
        settings = tuned_by(self.settings, vehicle)
        answers: list[tuple[str, _Answer | str]] = []
        bounds = pairwise(parcel.first)
        for name, (low, high), timeline in zip(
            parcel.names, bounds, self._timelines(parcel), strict=True
        ):
            what = timeline or parcel.table.slice(low, high - low)
            answers.append((name, self._answer(name, what, vehicle, settings)))
        try:
            return self._together(answers)
        except Exception:  # find out which trip's tables cannot be made
            return joined([self._alone(name, answer) for name, answer in answers])

    def _timelines(self, parcel: Parcel) -> list[Timeline | None]:
        """The epochs of each trip; None where it must be read alone."""
        first = np.array(parcel.first)
        read = fixes_together(parcel.table, first[:-1], self.settings or Settings())
        if read is None:
            return [None] * len(parcel.names)
        fixes, plain = read
        count = np.diff(first)[plain]
        begin = np.cumsum(count) - count
        own = timelines_of(fixes, begin.tolist(), self.roads.plane)
        near = np.repeat(True, 0)
        if len(begin):
            near = np.logical_or.reduceat(are_near(fixes, self.roads), begin)
        timelines: list[Timeline | None] = [None] * len(parcel.names)
        for trip, timeline, usable in zip(np.flatnonzero(plain), own, near, strict=True):
            timelines[trip] = timeline if usable else None
        return timelines

    def _answer(
        self, name: str, what: Timeline | pa.Table, vehicle: Vehicle, settings: Settings
    ) -> _Answer | str:
        """The answer to one trip, or why there is none."""
        if not name:
            rows = len(what.epochs.time) if isinstance(what, Timeline) else what.num_rows
            return f"{rows:,} rows name no trip; a drive_id in each was expected"
        try:
            drive = None
            if not isinstance(what, Timeline):
                drive = drive_from_table(what, vehicle=self.vehicle, settings=self.settings)[0]
                what = timeline_of(drive, self.roads, vehicle)
            recorded = localize_recorded(
                self.roads, what, vehicle=vehicle, settings=settings, lag=self.lag
            )
            return _Answer(what.epochs, recorded, drive)
        except SettingError:
            raise  # it is the caller's, not the trip's
        except WhichroadError as error:
            return str(error)
        except Exception as error:  # one trip's trouble is not the others'
            return _unexpected(error)

    def _alone(self, name: str, answer: _Answer | str) -> Tables:
        try:
            return self._together([(name, answer)])
        except Exception as error:
            return self._together([(name, _unexpected(error))])

    def _together(self, answers: Sequence[tuple[str, _Answer | str]]) -> Tables:
        """The tables of some trips, each made at once."""
        found = [(name, a) for name, a in answers if isinstance(a, _Answer)]
        epochs, outputs = [a.epochs for _, a in found], [a.recorded.output for _, a in found]
        ways = [traversals(a.epochs, a.recorded, self.roads.arrays) for _, a in found]
        told = map(figures_of, epochs, outputs, ways)
        rows = [_failed(n, a) if isinstance(a, str) else _row(n, a, next(told)) for n, a in answers]
        drives = pa.Table.from_pylist(rows, DRIVES)
        if not found:
            columns = pa.schema([*POINTS, *ATTRIBUTES]) if self.attributes else POINTS
            return Tables(columns.empty_table(), PATH.empty_table(), drives)
        names = [name for name, _ in found]
        first = np.cumsum([0, *(len(e.time) for e in epochs)])[:-1].tolist()
        points = points_table(
            names,
            Epochs._make(map(np.concatenate, zip(*epochs, strict=True))),
            Output._make(map(np.concatenate, zip(*outputs, strict=True))),
            self.roads,
            attributes=self.attributes,
            first=first,
        )
        return Tables(points, path_table(names, ways, self.roads), drives)


def _unexpected(error: Exception) -> str:
    return f"this should not happen ({type(error).__name__}: {error}); please report it"


def _failed(name: str, reason: str) -> dict[str, Any]:
    return {"drive_id": name, "answered": False, "reason": reason, "epochs": 0, "fixes": 0,
            "epochs_without_answer": 0}  # fmt: skip


def _row(name: str, answer: _Answer, figures: dict[str, Any]) -> dict[str, Any]:
    """A trip as a row of `tables.DRIVES`."""
    answered = figures["epochs_without_answer"] < figures["epochs"]
    drive = answer.drive
    return figures | {
        "drive_id": name,
        "answered": answered,
        "reason": None if answered else "no epoch could be answered",
        "skipped": list(drive.skipped.items()) if drive else [],
        "notes": list(drive.notes) if drive else [],
    }
