"""How an on-line filter goes on where time has not gone on as usual: pauses, clocks set back."""

from collections.abc import Callable
from threading import RLock

from ..diagnosis.finding import Finding
from ..diagnosis.sensors import late_finding, refused_finding
from ..observations import GeoFix, Observation, SensorReading, StartPose
from ..sensors.validation import check_time
from .epoch_filter import EpochFilter
from .localizer_state import State
from .set_back import Clocks

_FEWEST, _FOR = 3, 2.0  # readings in a row, and s of theirs, that are refused as late
_OF_SPEED, _LEAST_SPEED = 0.3, 0.5  # share of the way that is unsure, and m/s taken up unseen
_TURNING = 1.0  # s that a turn goes on while nothing is heard of it
_FIX_LATE = 1.0  # s; a fix later than this is refused, and odometry that is late at all
_MOST, _TAKEN = 20, 4  # refused readings that are remembered; what one taken makes up for
_BLIND = 30.0  # s in which all fixes were refused, to begin anew at their time
_NAMED = 5.0  # s in which most of a kind were refused, to be named
_LATELY = 1.0 / 300.0  # weight of one reading in the share that is late
_MUCH = 0.1  # share of late readings, to be noted
APART = 60.0  # s between readings that no latency explains: of another clock, or a pause
_STEADY = 5.0  # s by which it may change meanwhile
SET_BACK = "clock set back: started anew"
AT_FIXES = "clock ahead of the fixes: started anew at their time"
AHEAD = "clock ahead of the fixes"
LEADS = "reading of a sensor ahead of fixes and odometry"
_LED = 3  # fixes or odometry in order that a reading of a sensor made late, to doubt its clock
_FAR_AHEAD = 2.0  # s, from which on the filter begins anew at the time of fixes and odometry


class Stream:
    """How far readings of one kind are behind the others, or ahead, while most are refused.

    Attributes:
        ahead: Whether readings far ahead of the fixes are refused.
        behind: By so much, s; less than 0: ahead.
        late: The share that was refused as late, of some hundred readings before.
    """

    __slots__ = ("_alone", "_begin", "_score", "_until", "ahead", "behind", "late")

    def __init__(self) -> None:
        self._score, self.ahead = 0, False
        self._begin = self._until = self.behind = self.late = 0.0
        self._alone: tuple[float, float] | None = None  # time, behind at the first since one taken

    @property
    def refused(self) -> float:
        """For how long at least four of five have been refused, s."""
        return self._until - self._begin if self._score >= _FEWEST else 0.0

    def took(self) -> None:
        """A reading was taken."""
        self._score, self._alone, self.ahead = max(self._score - _TAKEN, 0), None, False
        self.late -= _LATELY * self.late

    def refuse(self, now: float, behind: float) -> None:
        """A reading was refused.

        Args:
            now: Time of the newest of all readings, s.
            behind: By so much the reading was behind it, s.
        """
        self.late += _LATELY * ((behind > 0.0) - self.late)
        if not self._score:
            self._begin = now
        if not self._score or now != self._until:  # later ones of an interval are less behind
            self.behind = behind
        self._score, self._until = min(self._score + 1, _MOST), now
        if self._alone is None or abs(behind - self._alone[1]) > _STEADY:
            self._alone = (now, behind)

    @property
    def is_of_another_clock(self) -> bool:
        """Whether none has been taken for long, at a difference that is no latency."""
        if self._alone is None or self._alone[1] < APART:
            return False
        return self._until - self._alone[0] >= _BLIND


class Lead:
    """Whether readings of further sensors run ahead of fixes and odometry, which these make late.

    A further sensor moves nothing and starts nothing, so it does not decide which time it is.

    Args:
        time: Of the last fix or odometry before the first of its readings, s.
    """

    __slots__ = ("_led", "_newest", "_taken", "_usual")

    def __init__(self, time: float) -> None:
        self._led, self._usual = 0, 1.0
        self._newest = self._taken = time  # of fixes and odometry: heard; used

    def heard(self, time: float) -> None:
        """A fix or odometry came."""
        if 0.0 < time - self._newest < 10.0:
            self._usual = min(time - self._newest, 1.0)
        self._newest = time

    def is_led(self, time: float, now: float) -> bool:
        """Whether a fix or odometry is late only by a further sensor, three in a row."""
        if time <= self._taken or now <= self._taken:
            self._led = 0
            return False
        self._led += 1
        return self._led >= _LED

    def took(self, time: float) -> None:
        """A fix or odometry was used."""
        self._taken = time
        if self._led < _LED:
            self._led = 0

    def is_ahead(self, time: float) -> bool:
        """Whether a further reading is of a clock that was found to run ahead."""
        return self._led >= _LED and time > self._newest + 1.5 * self._usual


class Streams:
    """Readings by kind: fixes, odometry, and those of further sensors."""

    __slots__ = ("fixes", "further", "lead", "odometry")

    def __init__(self) -> None:
        self.fixes, self.odometry, self.further = Stream(), Stream(), Stream()
        self.lead: Lead | None = None  # of further readings, where there are any

    def of(self, observation: Observation) -> Stream:
        """The one to which an observation belongs."""
        if isinstance(observation, GeoFix):
            return self.fixes
        return self.further if isinstance(observation, SensorReading) else self.odometry

    def findings(self) -> tuple[Finding, ...]:
        """Those of which most are refused by their times, or many as late."""
        kinds = (("gnss", self.fixes), ("odometry", self.odometry), ("readings", self.further))
        return tuple(
            refused_finding(name, one.behind, one.refused) if one.refused >= _NAMED
            else late_finding(name, one.late, _MUCH)
            for name, one in kinds if one.refused >= _NAMED or one.late > _MUCH
        )  # fmt: skip


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
    _start: StartPose | None
    _before_wake: State | None
    _late: LateReadings
    _streams: Streams
    _clocks: Clocks
    _run: Callable[[], None]
    restore: Callable[[State], None]
    _blank: Callable[[], State]
    state: Callable[[], State]

    def _in_order(self, observation: Observation) -> bool:
        """Whether a reading is taken by its time; begins anew where others can be none."""
        time, now, stream = observation.time, self._filter, self._streams.of(observation)
        late = now.time - time
        lead = self._streams.lead
        if stream is self._streams.further:
            if lead is None:
                self._streams.lead = lead = Lead(now.time)
            if lead.is_ahead(time):
                return self._refuse(LEADS, stream, late)
        elif lead is not None:
            lead.heard(time)
        if stream.ahead and late < -APART:
            return self._refuse(AHEAD, stream, late)
        may = min(_FIX_LATE, self._clocks.latest) if stream is self._streams.fixes else 0.0
        if late > may and now.started:
            if self._late.are_of_another_clock(time):
                self._begin_anew(SET_BACK)
            elif stream is self._streams.fixes and stream.is_of_another_clock:
                self._begin_anew(AT_FIXES)
                self._streams.odometry.ahead = self._streams.further.ahead = True
            elif (
                lead is not None
                and stream is not self._streams.further
                and lead.is_led(time, now.time)
                and late > _FAR_AHEAD
            ):
                self._begin_anew(LEADS + ": started anew at their time")
                self._streams.lead = lead
            else:
                return self._refuse("late", stream, late)
            stream, late = self._streams.of(observation), 0.0  # new ones
        self._late.took()
        stream.took()
        if lead is not None and stream is not self._streams.further:
            lead.took(time)
        clocks = self._clocks
        if stream is self._streams.odometry:
            clocks.moved(observation, late)  # type: ignore[arg-type]
            return True
        clocks.took(observation, late)
        if clocks.unsure:
            now.widen_along(clocks.unsure)
            clocks.unsure = 0.0
        return True

    def _refuse(self, why: str, stream: Stream, late: float) -> bool:
        """Count a reading that is not taken; False."""
        stream.refuse(self._filter.time, late)
        self.skipped[why] = self.skipped.get(why, 0) + 1
        return False

    def _begin_anew(self, why: str) -> None:
        """Forget all but the settings, and count it."""
        clocks = self._clocks.kept()
        self.restore(self._blank())
        self._clocks.restore(clocks)
        self._start = None
        self.skipped[why] = self.skipped.get(why, 0) + 1

    def wake(self, time: float) -> None:
        """Say where the vehicle may be after a pause of which nothing is known.

        The vehicle goes on at the speed that was, through the roads that may follow; its place
        along the heading becomes uncertain by a share of that way.  The next observation tells
        more of the pause: it is taken as if nothing had been asked, and `state` is that before.

        Args:
            time: When it wakes up, s.

        Raises:
            ReadError: The time is not in seconds since 1970.
        """
        check_time(time, "wake")
        with self._lock:
            now, time = self._filter, time + self._clocks.behind
            before = self.state()
            if self._before_wake is not None and time > now.time:
                self.restore(before)
            age = time - now.time
            if age <= 0.0 or not now.started:
                return
            speed, turn = self._rate if self._rate[0] else (now.speed, 0.0)
            now.fill(time, speed * age, turn * min(age, _TURNING), 0)
            self._run()
            now.widen_along((_OF_SPEED * abs(speed) + _LEAST_SPEED) * age)
            now.fill(time, 0.0, 0.0, 0)
            self._run()
            self._before_wake = before
