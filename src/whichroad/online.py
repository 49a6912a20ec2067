"""The filter on line: one observation in, one estimate out.

It runs `filter.step.run`, which is the method in the paper's order (its Figure 7), for one
epoch at a time.  The localizer owns the belief; nothing else remembers.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from ._compile import Record, Records
from .diagnosis.findings import Finding, findings
from .diagnosis.statistics import Watch
from .errors import SettingError
from .estimate_detail import Snapshot, pose_at, row_of
from .filter.estimate import ESTIMATE, Output, new_output
from .filter.history import new_history
from .filter.motion import arc_chord
from .filter.state import (
    CLOCK,
    DISTANCE,
    EPOCH,
    FILTER,
    PARAMETERS,
    WHEELS,
    Belief,
    Context,
    H,
    new_belief,
    new_epochs,
    new_path,
    new_work,
)
from .filter.step import run
from .global_start import start_at
from .observations import (
    Distance,
    Estimate,
    GeoFix,
    Observation,
    SpeedYaw,
    StartPose,
    WheelSpeed,
    WheelTicks,
)
from .roadmap import RoadMap, open_map
from .sensors.gnss import fix_row
from .sensors.odometry import bridged_step
from .sensors.validation import validated
from .settings import Settings, Vehicle, parameters
from .smoothing import Window
from .tables.status import STATUS, far_off

_NO_HISTORY = new_history(0)
_LATE = 1.0  # s; an observation later than this is refused
_SILENT = 2.0  # s without odometry, and three usual intervals, after which motion is what the
# receiver says
_TURNING = 1.0  # s that a turn goes on while nothing is heard of it


class Localizer:
    """The on-line filter: one observation in, one estimate out.

    Example:
        >>> localizer = Localizer(roads)                                # doctest: +SKIP
        >>> estimate = localizer.update(GeoFix(time=0.0, lat_deg=49.4, lon_deg=8.7))
        >>> estimate.edge, estimate.p_road

    Args:
        roads: The map, or its path.
        vehicle: The car.
        settings: The model's numbers.
        start: A known pose, or its (lat, lon, bearing) in degrees; else the first fix starts
            the filter.
        lag: Seconds by which `lagged` looks back; None: nothing is remembered for it.

    Raises:
        SettingError: The lag is not a number of seconds.
        MapError: It is no map.
    """

    def __init__(
        self,
        roads: RoadMap | str | Path,
        *,
        vehicle: Vehicle | None = None,
        settings: Settings | None = None,
        start: StartPose | tuple[float, float, float] | None = None,
        lag: float | str | None = None,
    ) -> None:
        self.roads = open_map(roads)
        self.vehicle = vehicle or Vehicle()
        self.settings = settings or Settings()
        self.skipped: dict[str, int] = {}  # reason -> observations refused
        self._past = None if lag is None else Window(lag)
        self.lag = None if self._past is None else self._past.lag  # s; None: never looks back
        self._path = new_path(0 if lag is None else 1 << 14)
        self._epochs, self._output = new_epochs(1), new_output(1, False)
        self._belief = new_belief(lag is not None)
        par = parameters(self.settings, self.vehicle, CLOCK)
        self._ctx = Context(par, self.roads.arrays, new_work())
        self._set_records()
        self._odometer: tuple[float, float, float] | None = None  # time, distance, turn
        self._rate = (0.0, 0.0)  # m/s, rad/s
        self._interval = 0.0  # s, usually between odometry readings
        self._began: float | None = None  # when the first fix came, until the next reading
        self._reading: WheelTicks | WheelSpeed | Distance | SpeedYaw | None = None
        self._start = StartPose.of(start)
        self._far_fix = (-math.inf, 0.0)  # time of the last fix, m it is away if not believed
        self._watch = Watch(self.settings, self.vehicle)

    def _set_records(self) -> None:
        """Views of the tables' records: their fields are read ten times as fast."""
        self._epoch = _record(self._epochs, EPOCH)
        self._answer = _record(self._output.rows, ESTIMATE)
        self._par = _record(self._ctx.par, PARAMETERS)
        self._state = _record(self._belief.state, FILTER)

    def __getstate__(self) -> dict[str, Any]:
        views = ("_epoch", "_answer", "_par", "_state")
        return {name: value for name, value in self.__dict__.items() if name not in views}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._set_records()

    @property
    def _mode(self) -> int:
        """What moves the vehicle."""
        return int(self._par["mode"])

    @_mode.setter
    def _mode(self, mode: int) -> None:
        self._par["mode"] = mode

    def _set_belief(self, belief: Belief) -> None:
        self._belief, self._state = belief, _record(belief.state, FILTER)

    def update(self, observation: Observation) -> Estimate:
        """Take one observation and say where the vehicle is.

        A fix that is up to a second late is moved along with the vehicle; an older
        observation, and one that cannot be, is refused and counted in `skipped`.

        Args:
            observation: A fix or an odometry reading; times in seconds, one clock.

        Returns:
            The estimate at the observation's time.

        Raises:
            ReadError: It is no observation, or its time is not in seconds since 1970.
        """
        if not self.take(observation):
            return self.predict(float(self._state["time"]))
        return self.estimate()

    def take(self, observation: Observation) -> bool:
        """Take one observation and say nothing, for those who ask less often than they tell.

        Args:
            observation: As `update` takes it.

        Returns:
            Whether it was taken; False: it is too late or cannot be, and counted in `skipped`.
        """
        if (possible := validated(observation, self.skipped)) is None:
            return False
        observation = possible
        late = float(self._state["time"]) - observation.time
        if self._state["started"] and late > (_LATE if isinstance(observation, GeoFix) else 0.0):
            self.skipped["late"] = self.skipped.get("late", 0) + 1
            return False
        if isinstance(observation, GeoFix):
            self._take_fix(observation, max(late, 0.0))
        else:
            self._take_odometry(observation)
        if self._mode != CLOCK:
            self._watch.look(self._epoch, self._answer)
        return True

    @property
    def diagnosis(self) -> tuple[Finding, ...]:
        """Settings that do not fit the data so far; nothing without odometry."""
        return findings(self._watch)

    def predict(self, time: float) -> Estimate:
        """Dead reckoning to a later time, without changing the filter.

        Args:
            time: Not before the last observation, s.

        Returns:
            The estimate expected there.
        """
        real, past = self._belief, self._past
        ahead = max(time - float(self._state["time"]), 0.0)
        self._set_belief(Belief._make(table.copy() for table in real))
        self._past = None
        try:
            turn = self._rate[1] * min(ahead, _TURNING)
            self._fill(time, self._rate[0] * ahead, turn, False)
            self._run()
            return self.estimate()
        finally:
            self._set_belief(real)
            self._past = past

    def _take_odometry(self, reading: WheelTicks | WheelSpeed | Distance | SpeedYaw) -> None:
        arc, turn = self._increment(reading)
        self._mode = DISTANCE if isinstance(reading, Distance) else WHEELS
        self._begin_at_start(reading.time)
        self._fill(reading.time, arc, turn, True)
        self._run()

    def _increment(
        self, reading: WheelTicks | WheelSpeed | Distance | SpeedYaw
    ) -> tuple[float, float]:
        """Arc and turn since the last epoch, less what a fix in between already took."""
        before, self._reading = self._reading, reading
        if before is None or type(before) is not type(reading):
            self._odometer = (reading.time, 0.0, 0.0)
            return 0.0, 0.0
        dt = reading.time - before.time
        arc, turn = bridged_step(before, reading, self.vehicle, self._rate, self.skipped)
        taken = self._odometer or (0.0, 0.0, 0.0)
        self._interval = self._interval or dt
        if self._is_silent(dt) and taken[0] > before.time:  # fixes said since where it went
            self._odometer = (reading.time, 0.0, 0.0)
            return self._rate[0] * (reading.time - taken[0]), 0.0
        self._interval += 0.2 * (dt - self._interval)
        if dt > 0:
            self._rate = (arc / dt, turn / dt)
        if self._began is not None and dt > 0:  # what was driven before the start is no one's
            part = min(max((self._began - before.time) / dt, 0.0), 1.0)
            arc, turn = arc * (1.0 - part), turn * (1.0 - part)
        self._odometer, self._began = (reading.time, 0.0, 0.0), None
        return arc - taken[1], turn - taken[2]

    def _is_silent(self, seconds: float) -> bool:
        """Whether that is longer than odometry usually says nothing."""
        return seconds > max(_SILENT, 3.0 * self._interval)

    def _take_fix(self, fix: GeoFix, late: float) -> None:
        time = max(fix.time, float(self._state["time"])) if late else fix.time
        if not self._state["started"] and self._start is None:
            self._began = time
        self._begin_at_start(time)
        ahead = time - float(self._state["time"]) if self._state["started"] else 0.0
        silent = self._reading is not None and self._is_silent(time - self._reading.time)
        if silent:
            on = fix.speed if math.isfinite(fix.sigma_speed) else self._rate[0]
            self._rate = (on, 0.0)
        arc, turn = self._rate[0] * ahead, self._rate[1] * ahead
        if self._odometer is not None:
            _, a, t = self._odometer
            self._odometer = (time, a + arc, t + turn)
        self._fill(time, arc, turn, self._mode != CLOCK and not silent)
        fixed, course, sigma = fix_row(fix, self.roads.plane, self.settings.default_sigma_m)
        row = list(fixed)
        e = self._epoch
        e["has_fix"] = 1
        if late and self._state["count"]:
            hyp = self._belief.hyp[: int(self._state["count"])]
            heading_now = float(hyp["mu"][int(np.argmax(hyp["weight"])), H])
            speed = float(self._state["speed"])
            row[0] += speed * late * math.cos(heading_now)
            row[1] += speed * late * math.sin(heading_now)
        e["fix"] = row
        e["speed"], e["speed_sigma"] = fix.speed, fix.sigma_speed
        e["course"], e["course_sigma"] = course, sigma
        self._run()
        self._far_fix = (time, self._disbelieved(row))

    def _disbelieved(self, fix: list[float]) -> float:
        """How far away (m) the fix of this epoch lies, if it is not believed, else 0."""
        row = row_of(self._answer)
        away = math.hypot(fix[0] - row.x, fix[1] - row.y)
        variance = (fix[2] * max(row.gnss_scale, 1.0)) ** 2 + row.cov[0] + row.cov[3]
        sigma = math.sqrt(variance)
        return away if far_off(away, sigma) else 0.0

    def _begin_at_start(self, time: float) -> None:
        if self._start is not None and not self._state["started"]:
            start_at(
                self._belief, self.roads, self._path, self._ctx, self._start, time, self.settings
            )  # fmt: skip

    def _fill(self, time: float, arc: float, turn: float, known: bool) -> None:
        e = self._epoch
        e["time"], e["arc"], e["turn"] = time, arc, turn
        e["forward"], e["left"] = arc_chord(arc, turn)
        e["odometry_valid"] = known
        e["has_fix"] = 0

    def _run(self) -> None:
        if self._past is not None:
            self._path = self._past.make_room(self._belief, self._path)
        history = _NO_HISTORY if self._past is None else self._past.history
        run(self._belief, self._path, history, self._epochs, self._output, self._ctx, 0, 1)

    def estimate(self) -> Estimate:
        """The estimate at the last observation that was taken."""
        return self._estimate(self._belief, self._answer)

    def lagged(self) -> Estimate | None:
        """The estimate of a moment the lag ago, by all that was observed since.

        Of the last epoch before that moment at which something was observed; None before
        there is one.

        Raises:
            SettingError: The localizer was made without a lag.
        """
        found = self._look(True)
        return None if found is None else self._estimate(found[0], _record(found[1].rows, ESTIMATE))

    @property
    def decided_until(self) -> float | None:
        """The last time at which one road has 0.999 of the probability, by all that is known.

        What was driven before it is decided as well as it ever will be; None: nothing is.

        Raises:
            SettingError: The localizer was made without a lag.
        """
        found = self._look(False)
        return None if found is None else found[2]

    def _look(self, back: bool) -> tuple[Belief, Output, float | None] | None:
        if self._past is None:
            raise SettingError(
                "lag is None; seconds were expected, to look back: Localizer(lag=10)"
            )
        return self._past.look(self._ctx, self._path, float(self._state["time"]), back)

    def _estimate(self, belief: Belief, answer: Record) -> Estimate:
        row = row_of(answer)
        answered = row.live > 0
        xx, xy, xh, yy, yh, hh = row.cov
        return Estimate(
            float(belief.state["time"][0]),
            pose_at(self.roads.plane, row.x, row.y, row.heading),
            np.array([[xx, xy, xh], [xy, yy, yh], [xh, yh, hh]]),
            row.edge if row.edge >= 0 else None, row.p_edge, row.p_off_road,
            STATUS[row.status], row.s, row.lateral,
            row.protection_level if answered else math.inf,
            row.gnss_scale if answered else 1.0,
            Snapshot(belief, row, self.roads, self._far_fix, self.settings.unknown),
        )  # fmt: skip


def _record(table: Records, dtype: np.dtype[Any]) -> Record:
    """The one record of a table, as a view that knows its fields by `record["name"]` alone."""
    return table.view(np.ndarray).view(dtype)[0]
