"""How an on-line filter goes on where time has not gone on as usual: pauses, clocks set back."""

from collections.abc import Callable
from threading import RLock

from ..observations import StartPose
from ..sensors.validation import check_time
from .epoch_filter import EpochFilter
from .localizer_state import Reading, State

_FEWEST, _FOR = 3, 2.0  # readings in a row, and s of theirs, that are refused as late
_OF_SPEED, _LEAST_SPEED = 0.3, 0.5  # share of the way that is unsure, and m/s taken up unseen
_TURNING = 1.0  # s that a turn goes on while nothing is heard of it
SET_BACK = "clock set back: started anew"


class LateReadings:
    """Readings that were refused as late since the last one that was taken."""

    def __init__(self) -> None:
        self._count, self._first, self._last = 0, 0.0, 0.0

    def took(self) -> None:
        """A reading was taken."""
        self._count = 0

    def are_of_another_clock(self, time: float) -> bool:
        """Whether all sensors go on at an earlier time, now that one more reading is late.

        That is so after a time stamp far ahead, and where a clock was set back.
        """
        if self._count and time < self._last:  # neither goes on
            self._count = 0
        if not self._count:
            self._first = time
        self._count, self._last = self._count + 1, time
        return self._count >= _FEWEST and time - self._first >= _FOR


class Pauses:
    """The part of a `Localizer` that goes on after pauses, and at another time."""

    skipped: dict[str, int]
    _lock: RLock
    _filter: EpochFilter
    _rate: tuple[float, float]
    _reading: Reading | None
    _odometer: tuple[float, float, float] | None
    _began: float | None
    _start: StartPose | None
    _late: LateReadings
    _behind: tuple[float, float, float]
    _run: Callable[[], None]
    restore: Callable[[State], None]
    _blank: Callable[[], State]

    def _in_order(self, time: float, most: float) -> bool:
        """Whether a reading that may be so late is taken; begins anew where all are later."""
        if most == 0.0:
            now, since = self._filter.time, self._behind[0]
            self._behind = (since or now, now, now - time) if now > time else (0.0, 0.0, 0.0)
        if self._filter.time - time > most and self._filter.started:
            if not self._late.are_of_another_clock(time):
                self.skipped["late"] = self.skipped.get("late", 0) + 1
                return False
            self.restore(self._blank())
            self._start = None
            self.skipped[SET_BACK] = self.skipped.get(SET_BACK, 0) + 1
        self._late.took()
        return True

    def wake(self, time: float) -> None:
        """Go on after a pause of which nothing is known, less sure by what it may have brought.

        The vehicle goes on at the speed that was, through the roads that may follow; its place
        along the heading becomes uncertain by a share of that way.  Odometer readings before
        are forgotten: the next one is the first.

        Args:
            time: When it wakes up, s.

        Raises:
            ReadError: The time is not in seconds since 1970.
        """
        check_time(time, "wake")
        with self._lock:
            now = self._filter
            age = time - now.time
            if age <= 0.0 or not now.started:
                return
            speed, turn = self._rate if self._rate[0] else (now.speed, 0.0)
            now.fill(time, speed * age, turn * min(age, _TURNING), 0)
            self._run()
            now.widen_along((_OF_SPEED * abs(speed) + _LEAST_SPEED) * age)
            self._reading, self._odometer, self._began = None, None, None
            now.fill(time, 0.0, 0.0, 0)
            self._run()
