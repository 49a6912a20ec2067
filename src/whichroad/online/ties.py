"""Odometry that is given after a fix of its own time: it goes in before that.

Rows of a table, and synchronised messages, have one time for a fix and for odometry, and either
may come first.  A fix is answered at once, by motion that goes on as it was.  Odometry of its time
then finds the vehicle moved already, and says nothing that could be held against the fixes.  So
what was known before the fix is kept, and odometry of its time goes in from there.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

from ..diagnosis.statistics import ConsistencyStatistics
from ..filter.state import CLOCK, Path
from ..lookback.smoothing import Window
from ..observations import GeoFix, Observation, SensorReading
from ..sensors.gyro_turns import GyroTurns
from .epoch_filter import EpochFilter
from .localizer_state import Reading
from .one_odometry import is_worse
from .sensing import Sensing
from .set_back import Clocks

Observed = GeoFix | SensorReading


class Tie(NamedTuple):
    """What was known before the first fix or further reading of a moment, and what came since."""

    time: float  # s, by the filter's clock
    tables: dict[str, bytes]
    path: Path
    entries: int  # of the path's tree
    fields: tuple[Any, ...]  # of the localizer, which fixes and further readings change
    sensed: list[Any]
    observed: list[Observed]  # that was taken since
    numbers: list[tuple[Sequence[float], Sequence[float]]]  # not yet summed up for the diagnosis


class Ties:
    """The part of a `Localizer` that puts odometry before what was observed of its time."""

    skipped: dict[str, int]
    _filter: EpochFilter
    _past: Window | None
    _odometer: tuple[float, float, float] | None
    _rate: tuple[float, float]
    _began: float | None
    _reading: Reading | None
    _far_fix: tuple[float, float]
    _creeps: bool
    _gyro: GyroTurns
    _sensing: Sensing
    _statistics: ConsistencyStatistics
    _tie: Tie | None
    _clocks: Clocks
    _in_order: Callable[[Observation], bool]
    _is_lost: Callable[[float], bool]
    _take_odometry: Callable[[Reading], bool]
    _take_fix: Callable[[GeoFix, float], None]
    _take_sensed: Callable[[SensorReading], bool]

    def _observe(self, observed: Observed) -> bool:
        """Take a fix or a further reading, before which odometry of its time may go in later."""
        now = self._filter
        if self._clocks.tied is not False and self._tie is None:
            self._open_tie(observed.time)
        if isinstance(observed, SensorReading):
            taken = self._take_sensed(observed)
        else:
            self._take_fix(observed, max(now.time - observed.time, 0.0))
            taken = True
        tie = self._tie
        if tie is not None:
            tie.observed.append(observed)
        if now.mode != CLOCK and isinstance(observed, GeoFix):
            if tie is not None:
                tie.numbers.append(now.numbers())
            else:
                self._statistics.accumulate(*now.numbers())
        return taken

    def _open_tie(self, time: float) -> None:
        """Keep what is known before the first thing that is observed of a moment, s."""
        now, last = self._filter, self._reading
        if (now.started and time <= now.time) or (last is not None and time <= last.time):
            return
        if self._past is not None:  # a tree that is tidied cannot be taken back
            now.keep(self._past.ensure_capacity(now.belief, now.path), self._past.history)
        fields = (self._odometer, self._rate, self._creeps, self._began, self._far_fix)
        sensed = self._sensing.kept() if self._sensing.sensed.sensors else []
        self._tie = Tie(
            time, now.tables(), now.path, int(now.path.size[0]),
            (*fields, self._gyro.takeover.fix), sensed, [], [],
        )  # fmt: skip

    def _close_tie(self) -> None:
        """Nothing goes in before what was observed of the last moment any more."""
        tie, self._tie = self._tie, None
        if tie is None:
            return
        self._clocks.tied = self._clocks.tied or False
        for numbers in tie.numbers:
            self._statistics.accumulate(*numbers)

    def _heed_tie(self, observation: Observation) -> bool | None:
        """Close a tie that is over, and take odometry before what was observed of its time.

        Returns:
            Whether it was taken there; None: it does not go in there.
        """
        assert self._tie is not None
        if observation.time > self._tie.time:
            self._close_tie()
        if isinstance(observation, Observed) or self._tie is None:
            return None
        reading, last = cast(Reading, observation), self._reading
        if reading.time < self._tie.time:
            return None
        second = last and is_worse(reading, last) and not self._is_lost(reading.time - last.time)
        if second or not (observed := self._go_back()):
            return None
        self._clocks.tied = True
        taken = self._in_order(reading) and self._take_odometry(reading)
        if taken and self._filter.mode != CLOCK:
            self._statistics.accumulate(*self._filter.numbers())
        self._observe_again(observed)
        return taken

    def _go_back(self) -> list[Observed]:
        """Know what was known before the tie, if there is one; what is to be observed again."""
        tie, now = self._tie, self._filter
        if tie is None or tie.path is not now.path:  # tidied in between
            self._close_tie()
            return []
        self._tie = None
        now.set_tables(tie.tables)
        *fields, self._gyro.takeover.fix = tie.fields
        self._odometer, self._rate, self._creeps, self._began, self._far_fix = fields
        if tie.sensed:
            self._sensing.restore(tie.sensed)
        if self._past is not None:
            now.path.size[0] = tie.entries
            self._past.forget_after(now.time, now.belief)
        return tie.observed

    def _observe_again(self, observed: Sequence[Observed]) -> None:
        """Take what was taken before, and was counted then."""
        skipped = dict(self.skipped)
        for one in observed:
            self._observe(one)
        if self.skipped != skipped:
            self.skipped.clear()
            self.skipped.update(skipped)
