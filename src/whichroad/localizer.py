"""The filter: one epoch at a time on line, or a whole recorded drive in one compiled call.

Both run `core.drive.run`, which tells the method in the paper's order (its Figure 7).
The localizer owns the belief; nothing else remembers.
"""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .core.belief import NOW, SPEED, STARTED, Belief, H, new_belief, new_route
from .core.drive import run
from .core.epoch import CLOCK, DISTANCE, WHEELS, new_epochs
from .core.memory import is_full, new_memory
from .core.motion import arc_chord
from .core.output import (
    V_GNSS_SCALE,
    V_H,
    V_HH,
    V_LATERAL,
    V_OFF,
    V_P,
    V_PROTECTION,
    V_S,
    V_X,
    V_XX,
    V_Y,
    V_YY,
    Output,
    new_output,
)
from .core.switching import new_work
from .diagnosis import Finding, findings, findings_of
from .epochs import Timeline
from .errors import DriveError, SettingError
from .reasons import STATUS, far_off
from .records import (
    Array,
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
from .scratch import Scratch, entered, told_of
from .search import is_vague, search, start_at
from .sensors.gnss import fix_row
from .sensors.odometry import bridged_step
from .sensors.validation import validated
from .settings import Settings, Vehicle
from .smoother import Lag, Past, Window, smooth
from .snapshot import Snapshot, pose_at
from .watch import Watch
from .ways import best_chain, heaviest_chain, tidied

_CHUNK = 20_000  # epochs between two looks at the route tree and the progress bar
NOTHING = new_memory(0)  # is remembered
_WHOLE = 15.0  # s between fixes, beyond which a route is chosen as a whole
_LATE = 1.0  # s; an observation later than this is refused
_SILENT = 2.0  # s without odometry, and three usual intervals, after which motion is what the
# receiver says
_TURNING = 1.0  # s that a turn goes on while nothing is heard of it


class Recorded(NamedTuple):
    """A recorded drive, localized."""

    output: Output
    route_edge: NDArray[np.int32]  # edges of the most probable route, OFF_ROAD between
    route_time: Array  # when each was entered, s
    route_abscissa: Array
    diagnose: Callable[[], tuple[Finding, ...]] = tuple
    past: Past | None = None  # what it can be looked back over with, where that was asked for

    @property
    def diagnosis(self) -> tuple[Finding, ...]:
        """Settings that do not fit the data; looked for when asked."""
        return self.diagnose()


def side_of(vehicle: Vehicle) -> float:
    """1 where one drives on the right, −1 on the left."""
    return 1.0 if vehicle.driving_side == "right" else -1.0


def lever_of(vehicle: Vehicle) -> Array:
    """The antenna ahead and left of M, m, (2,)."""
    return np.array([vehicle.antenna_forward, vehicle.antenna_left])


def localize_recorded(
    roads: RoadMap,
    timeline: Timeline,
    *,
    vehicle: Vehicle | None = None,
    settings: Settings | None = None,
    start: StartPose | str | None = None,
    poses: bool = False,
    progress: Callable[[int], None] | None = None,
    lag: Lag | None = None,
) -> Recorded:
    """Localize a recorded drive.

    Args:
        roads: The map.
        timeline: The drive in epochs.
        vehicle: The car.
        settings: The model's numbers.
        start: A known pose at the first epoch, or "map": anywhere on it (also a pose with
            a sigma of more than 40 m or 45 degrees is searched for by wheels and map); else
            the first fix starts the filter.
        poses: Whether the poses of the alternatives are kept too, for pictures.
        progress: Told how many epochs are done, now and then.
        lag: By how much later knowledge epochs are answered; None: by what was known then.

    Returns:
        One output row per epoch, and the most probable route.

    Raises:
        DriveError: Nothing can start the filter.
    """
    vehicle, settings = vehicle or Vehicle(), settings or Settings()
    epochs = timeline.epochs
    n = len(epochs.time)
    if start is None and not epochs.has_fix.any():
        raise DriveError(
            "the drive has no usable GNSS fix; at least one, or a start pose, was expected; "
            'give start=(lat, lon, bearing), or start="map" where both wheels were recorded'
        )
    scratch = Scratch.taken()
    belief, work, route = scratch.renewed(lag is not None)
    memory, view = (NOTHING, None) if lag is None else scratch.back()
    output = new_output(n, poses)
    done = 0
    if is_vague(start, timeline.mode):
        done, route = search(
            roads, timeline, belief, output, vehicle=vehicle, settings=settings,
            start=start if isinstance(start, StartPose) else None, progress=progress,
        )  # fmt: skip
    elif isinstance(start, StartPose):
        start_at(
            belief, roads, route, start, float(epochs.time[0]), timeline.mode, settings, vehicle
        )
    par = settings.parameters()
    while done < n:
        target = min(done + _CHUNK, n)
        done = run(
            belief, roads.arrays, route, work, epochs, output, done, target, timeline.mode,
            side_of(vehicle), lever_of(vehicle), par, settings.outage_after_s,
            settings.ambiguous_below, False, memory,
        )  # fmt: skip
        if lag is not None and is_full(memory):
            memory = scratch.enlarged(memory)
        elif done < target or len(route.edge) - route.size[0] < 4096:
            route = tidied(route, belief.node[: belief.size[0]], memory.tree[: memory.size[1]])
        if progress is not None:
            progress(done)
    told = partial(findings_of, epochs, output, timeline.mode, settings, vehicle)
    heaviest = heaviest_chain(route, belief)
    if lag is None or not memory.size[0]:
        scratch.give_back()
        return Recorded(output, *heaviest, told)
    past = Past(
        roads, memory, route, epochs, output, timeline.mode, side_of(vehicle), par,
        settings.outage_after_s, settings.ambiguous_below, lag,
    )  # fmt: skip
    whole = timeline.mode == CLOCK and timeline.interval > _WHOLE
    smoothed = smooth(past, view)  # first: the route is chosen by the smoothed probabilities
    # between fixes far apart a route is chosen as a whole, which epochs do not see
    chain = heaviest if whole else best_chain(memory, route, roads.arrays)
    past = past._replace(memory=told_of(memory), route=entered(route))
    scratch.give_back()
    return Recorded(smoothed, *chain, told, past)


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
        self._belief, self._work = new_belief(lag is not None), new_work()
        self._past = None if lag is None else Window(lag)
        self.lag = None if self._past is None else self._past.lag  # s; None: never looks back
        self._route = new_route(0 if lag is None else 1 << 14)
        self._epoch = new_epochs(1)
        self._output = new_output(1, False)
        self._par = self.settings.parameters()
        self._lever, self._side = lever_of(self.vehicle), side_of(self.vehicle)
        self._odometer: tuple[float, float, float] | None = None  # time, distance, turn
        self._rate = (0.0, 0.0)  # m/s, rad/s
        self._interval = 0.0  # s, usually between odometry readings
        self._began: float | None = None  # when the first fix came, until the next reading
        self._reading: WheelTicks | WheelSpeed | Distance | SpeedYaw | None = None
        self._mode = CLOCK
        self._start = StartPose.of(start)
        self._far_fix = (-math.inf, 0.0)  # time of the last fix, m it is away if not believed
        self._watch = Watch(self.settings, self.vehicle)

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
            return self.predict(float(self._belief.clock[NOW]))
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
        late = float(self._belief.clock[NOW]) - observation.time
        if self._belief.clock[STARTED] and late > (
            _LATE if isinstance(observation, GeoFix) else 0.0
        ):
            self.skipped["late"] = self.skipped.get("late", 0) + 1
            return False
        if isinstance(observation, GeoFix):
            self._take_fix(observation, max(late, 0.0))
        else:
            self._take_odometry(observation)
        if self._mode != CLOCK:
            self._watch.look(self._epoch, self._output)
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
        belief = Belief._make(a.copy() for a in self._belief)
        real, self._belief = self._belief, belief
        past, self._past = self._past, None
        try:
            ahead = max(time - float(real.clock[NOW]), 0.0)
            turn = self._rate[1] * min(ahead, _TURNING)
            self._fill(time, self._rate[0] * ahead, turn, False)
            self._run()
            return self.estimate()
        finally:
            self._belief, self._past = real, past

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
        time = max(fix.time, float(self._belief.clock[NOW])) if late else fix.time
        if not self._belief.clock[STARTED] and self._start is None:
            self._began = time
        self._begin_at_start(time)
        ahead = time - float(self._belief.clock[NOW]) if self._belief.clock[STARTED] else 0.0
        silent = self._reading is not None and self._is_silent(time - self._reading.time)
        if silent:
            on = fix.speed if math.isfinite(fix.sigma_speed) else self._rate[0]
            self._rate = (on, 0.0)
        arc, turn = self._rate[0] * ahead, self._rate[1] * ahead
        if self._odometer is not None:
            _, a, t = self._odometer
            self._odometer = (time, a + arc, t + turn)
        self._fill(time, arc, turn, self._mode != CLOCK and not silent)
        row, course, sigma = fix_row(fix, self.roads.plane, self.settings.default_sigma_m)
        e = self._epoch
        e.has_fix[0] = 1
        e.fix[0] = row
        if late and self._belief.size[0]:
            heading_now = float(self._belief.mean[0, H])
            speed = float(self._belief.clock[SPEED])
            e.fix[0, 0] += speed * late * math.cos(heading_now)
            e.fix[0, 1] += speed * late * math.sin(heading_now)
        e.speed[0], e.speed_sigma[0] = fix.speed, fix.sigma_speed
        e.course[0], e.course_sigma[0] = course, sigma
        self._run()
        self._far_fix = (time, self._disbelieved(e.fix[0].tolist()))

    def _disbelieved(self, fix: list[float]) -> float:
        """How far away (m) the fix of this epoch lies, if it is not believed, else 0."""
        value = self._output.value[0].tolist()
        away = math.hypot(fix[0] - value[V_X], fix[1] - value[V_Y])
        sigma = math.sqrt((fix[2] * max(value[V_GNSS_SCALE], 1.0)) ** 2 + value[V_XX] + value[V_YY])
        return away if far_off(away, sigma) else 0.0

    def _begin_at_start(self, time: float) -> None:
        if self._start is not None and not self._belief.clock[STARTED]:
            start_at(
                self._belief, self.roads, self._route, self._start, time, self._mode,
                self.settings, self.vehicle,
            )  # fmt: skip

    def _fill(self, time: float, arc: float, turn: float, known: bool) -> None:
        e = self._epoch
        e.time[0], e.arc[0], e.turn[0] = time, arc, turn
        e.forward[0], e.left[0] = arc_chord(arc, turn)
        e.moved[0] = known
        e.has_fix[0] = 0

    def _run(self) -> None:
        if self._past is not None:
            self._route = self._past.make_room(self._belief, self._route)
        run(
            self._belief, self.roads.arrays, self._route, self._work,
            self._epoch, self._output, 0, 1, self._mode, self._side, self._lever, self._par,
            self.settings.outage_after_s, self.settings.ambiguous_below, False,
            NOTHING if self._past is None else self._past.memory,
        )  # fmt: skip

    def estimate(self) -> Estimate:
        """The estimate at the last observation that was taken."""
        return self._estimate(self._belief, self._output)

    def lagged(self) -> Estimate | None:
        """The estimate of a moment the lag ago, by all that was observed since.

        Of the last epoch before that moment at which something was observed; None before
        there is one.

        Raises:
            SettingError: The localizer was made without a lag.
        """
        found = self._look(True)
        return None if found is None else self._estimate(found[0], found[1])

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
        return self._past.look(
            self.roads, self._route, float(self._belief.clock[NOW]), self._mode, self._side,
            self.settings, back,
        )  # fmt: skip

    def _estimate(self, belief: Belief, output: Output) -> Estimate:
        value = output.value[0].tolist()
        edge = int(output.edge[0])
        answered = output.live[0] > 0
        xx, xy, xh, yy, yh, hh = value[V_XX : V_HH + 1]
        return Estimate(
            float(belief.clock[NOW]),
            pose_at(self.roads.plane, value[V_X], value[V_Y], value[V_H]),
            np.array([[xx, xy, xh], [xy, yy, yh], [xh, yh, hh]]),
            edge if edge >= 0 else None, value[V_P], value[V_OFF],
            STATUS[int(output.status[0])], value[V_S], value[V_LATERAL],
            value[V_PROTECTION] if answered else math.inf,
            value[V_GNSS_SCALE] if answered else 1.0,
            Snapshot(belief, output, value, self.roads, self._far_fix, self.settings.unknown),
        )  # fmt: skip
