"""The filter on line: one observation in, one estimate out.

It runs `filter.step.run`, the paper's Figure 7, for one epoch at a time, and owns the belief.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from threading import RLock
from typing import Any

from ..diagnosis.statistics import ConsistencyStatistics
from ..errors import ReadError
from ..filter.state import CLOCK, DISTANCE, WHEELS, Context, new_belief, new_path, new_work
from ..filter.vetting.motion_sources import AHEAD, BELOW
from ..filter.vetting.windows import BY_WHEELS, GYRO_ALONE, HEARD_AGAIN, UNTURNED
from ..global_start import start_at
from ..lookback.smoothing import Window
from ..observations import (
    Distance,
    GeoFix,
    Observation,
    SensorReading,
    StartPose,
    WheelSpeed,
    WheelTicks,
    YawRate,
)  # fmt: skip
from ..roadmap import RoadMap, open_map
from ..roadmap.extent import check_start
from ..sensors import Sensor
from ..sensors.beside_wheels import driven_on
from ..sensors.dead_band import DeadBand
from ..sensors.even_steps import EvenSteps
from ..sensors.glitches import Glitches
from ..sensors.gnss import fix_row
from ..sensors.gyro_turns import GyroTurns
from ..sensors.odometry import bridged_step, true_rate
from ..sensors.validation import check_time, validated
from ..settings import Settings, Vehicle, parameters, tuned_by
from .answering import Answering
from .epoch_filter import EpochFilter
from .estimates import Estimate
from .late_fixes import motion_since
from .least_speed import heed_least_speed
from .localizer_state import Reading, State
from .looks_back import LooksBack
from .one_odometry import SECOND, is_worse
from .pauses import APART, LateReadings, Pauses, Streams
from .remembers import Remembers
from .seldom import forget, seldom_by, write_reading
from .sensing import Sensing
from .set_back import Clocks
from .silence import between, is_speed, learnt, lost_after, silent_after
from .ties import Tie, Ties
from .watched import Watched

# s between epochs of a gyro while wheels are silent; that are predicted, else numbers overflow
_BESIDE, _FARTHEST = 1.0, 366 * 86400.0
_TURNING, _STEERED = 1.0, 4.0  # s that a turn goes on unheard; until the road turns a prediction


class Localizer(LooksBack, Watched, Pauses, Remembers, Ties):
    """The on-line filter: one observation in, one estimate out.

    It may be used from several threads: a call waits until that of another thread is done.
    Only `pickle` and `copy` need it to be at rest; `to_bytes` does not.

    Example:
        >>> localizer = Localizer(roads)                                # doctest: +SKIP
        >>> estimate = localizer.update(GeoFix(time=0.0, lat_deg=49.4, lon_deg=8.7))
        >>> estimate.edge, estimate.p_road

    Args:
        roads: The map, or its path.
        vehicle: The car, or the path of its vehicle.toml.
        settings: The model's numbers; the car's `[noise]` overrides them.
        start: A known pose, or its (lat, lon, bearing) in degrees; else the first fix starts
            the filter.
        lag: Seconds by which `lagged` looks back; None: nothing is remembered for it.
        places: Point objects for `Estimate.ahead`: `Places`, or a table or path as that takes it.
        sensors: Further ones (`whichroad.sensors`); each reading comes as a `SensorReading`.

    Raises:
        SettingError: The lag is not a number of seconds, the start is not on the map, or an
            argument is of another type.
        MapError: It is no map.
        ReadError: The vehicle's file could not be understood.
    """

    def __init__(
        self,
        roads: RoadMap | str | Path,
        *,
        vehicle: Vehicle | str | Path | None = None,
        settings: Settings | None = None,
        start: StartPose | tuple[float, float, float] | None = None,
        lag: float | str | None = None,
        places: Any = None,
        sensors: Sequence[Sensor] = (),
    ) -> None:
        self.roads = open_map(roads)
        if isinstance(vehicle, str | Path):
            from ..readers import read_vehicle  # which loads all readers

            vehicle = read_vehicle(vehicle)
        self.settings = tuned_by(settings, vehicle)
        self.vehicle = vehicle or Vehicle()
        self._lock = RLock()  # around each public call: kernels let other threads run
        self._answers = Answering(self.roads, places, self.settings.unknown)
        self.skipped: dict[str, int] = {}  # reason -> observations refused
        self._past = None if lag is None else Window(lag)
        self.lag = None if self._past is None else self._past.lag  # s; None: never looks back
        ctx = Context(parameters(self.settings, self.vehicle, CLOCK), self.roads.arrays, new_work())
        self._filter = EpochFilter(ctx)
        if self._past is not None:
            self._filter = EpochFilter(ctx, new_belief(True), new_path(1 << 14), self._past.history)
        self._ahead: EpochFilter | None = None  # of `predict`
        self._odometer, self._rate = None, (0.0, 0.0)  # time, distance, turn; m/s, rad/s
        self._gyro = GyroTurns(self.vehicle.track_width)
        self._creeps, self._glitches = False, Glitches()  # whether it does so now; of rates
        self._band, self._steps = DeadBand(self.vehicle.least_speed), EvenSteps()  # of slow ways
        self._filter.belief.state[0].vetting.slow.least = self._band.least
        self._sensing = Sensing(sensors, self.roads)
        self._interval = 0.0  # s, usually between odometry readings
        self._began = None  # when the first fix came, until the next reading
        self._reading: Reading | None = None
        self._start = check_start(StartPose.of(start), self.roads)
        self._far_fix = (-math.inf, 0.0)  # time of the last fix, m it is away if not believed
        self._statistics = ConsistencyStatistics(self.settings, self.vehicle)
        self._late = LateReadings()
        self._streams = Streams()  # what of each was refused
        self._clocks = Clocks()  # and which were set back
        self._before_wake: State | None = None
        self._tie: Tie | None = None  # from 30 attributes on CPython reads each of them slower

    def update(self, observation: Observation) -> Estimate:
        """Take one observation and say where the vehicle is.

        A fix that is up to a second late is moved along with the vehicle; an older
        observation, and one that cannot be, is refused and counted in `skipped`.  Where
        nothing but older ones has come for two seconds, the clock was set back, or the last
        time was wrong: it begins anew, which is counted too.  So it does at the time of the fixes
        where all of them have been minutes behind for 30 s; what is ahead of them is refused then.
        Odometry's clock that steps back by up to 10 s is found out after 0.3 s: the filter goes on
        by the clock before, estimates have the sensors' times, and `diagnosis` names it.

        Args:
            observation: A fix or an odometry reading; times in seconds, one clock.

        Returns:
            The estimate at the observation's time.

        Raises:
            ReadError: It is no observation, or its time is not in seconds since 1970.
        """
        self._lock.acquire()  # `with` takes 0.2 µs longer, a hundredth of a call
        try:
            if not self._take(observation):
                return self.predict(self._filter.time - self._clocks.behind)
            return self._answers.of(self._filter, self._far_fix, self._clocks.behind)
        finally:
            self._lock.release()

    def take(self, observation: Observation) -> bool:
        """Take one observation without an estimate, for callers who read fewer than they send.

        Args:
            observation: As `update` takes it.

        Returns:
            Whether it was taken; False: it is too late or cannot be, and counted in `skipped`.
        """
        with self._lock:
            return self._take(observation)

    def _take(self, observation: Observation) -> bool:
        if (possible := validated(observation, self.skipped)) is None:
            return False
        if self._before_wake is not None:
            self.restore(self._before_wake)
        last = self._reading
        if self._clocks.stirred or (last is not None and possible.time < last.time):
            possible = self._clocks.at_filter_time(possible, self._filter.time)
        if isinstance(possible, YawRate):
            rate = true_rate(possible.yaw_rate, self.vehicle)
            return self._take_yaw_rate(replace(possible, yaw_rate=rate))
        if self._tie is not None and (taken := self._heed_tie(possible)) is not None:
            return taken
        if not self._in_order(possible):
            return False
        if isinstance(possible, GeoFix):
            return self._observe(possible)
        if isinstance(possible, SensorReading):
            return self._observe(possible)
        if not self._take_odometry(possible):
            return False
        if self._filter.mode != CLOCK:
            self._statistics.accumulate(*self._filter.numbers())
        return True

    def predict(self, time: float) -> Estimate:
        """Dead reckoning to a later time, in the end along the roads, without changing the filter.

        Args:
            time: At most a year after the last observation, s.

        Returns:
            The estimate expected there; of a time before the last observation, the one at it.

        Raises:
            ReadError: The time is not in seconds since 1970, or more than a year ahead.
        """
        check_time(time, "predict")
        with self._lock:
            now = self._filter
            if self._ahead is None:
                self._ahead = EpochFilter(now.ctx)
            double, time = self._ahead, max(time + self._clocks.behind, now.time)
            ahead = time - now.time
            if now.started and ahead > _FARTHEST:
                raise ReadError(
                    f"predict: time is {time:g}, {ahead / 86400.0:,.0f} days after the last "
                    "observation; at most a year was expected; are both of one clock?"
                )
            double.copy_from(now)
            valid = BELOW if self._creeps else AHEAD
            speed, turn, by = self._rate[0], self._rate[1] * min(ahead, _TURNING), BY_WHEELS
            if ahead > _STEERED and now.mode == WHEELS and not self._creeps:
                double.fill(now.time + _STEERED, speed * _STEERED, turn, valid)
                double.run()
                ahead, turn, by = ahead - _STEERED, 0.0, UNTURNED
            double.fill(time, speed * ahead, turn, valid, by)
            double.run()
            return self._answers.of(double, self._far_fix, self._clocks.behind)

    def _take_yaw_rate(self, reading: YawRate) -> bool:
        """Keep it until the odometry is read; in a silence of wheels move by it."""
        now, wheels = self._filter, self._reading
        taken = self._gyro.take(reading, wheels, self.skipped)
        if (
            taken and now.started and isinstance(wheels, WheelTicks | WheelSpeed)
            and self._is_lost(reading.time - wheels.time)
            and _BESIDE <= reading.time - now.time <= APART
        ):  # fmt: skip
            self._close_tie()
            self._gyro.takeover.mute(ahead := reading.time - now.time)
            metres, speed = driven_on(self._rate[0], ahead)
            self._move_to(reading.time, metres / ahead)
            self._rate = (float(speed), 0.0)
            self._run()
        return taken

    def _take_odometry(self, reading: Reading) -> bool:
        now = self._reading
        if now and is_worse(reading, now) and not self._is_lost(reading.time - now.time):
            self.skipped[SECOND] = self.skipped.get(SECOND, 0) + 1
            return False
        if seldom := seldom_by(now, reading, self._interval, self._far_fix[0], self._filter):
            self._steps.even(reading)
            self._reading, self._odometer = reading, (reading.time, 0.0, 0.0)
            self._interval = seldom
            self._filter.set_mode(CLOCK, reading.geared)
            return True
        reading = self._steps.even(self._glitches.without(now, reading, self.skipped))
        arc, turn, valid, by = self._increment(reading)
        steered = self._gyro.alone or not isinstance(reading, Distance)
        self._filter.set_mode(WHEELS if steered else DISTANCE, reading.geared)
        self._begin_at_start(reading.time)
        self._filter.fill(reading.time, arc, turn, valid, by, self._steps.unsure)
        self._run()
        return True

    def _increment(self, reading: Reading) -> tuple[float, float, int, int]:
        """What was driven since the last epoch, less what fixes in between took, as filled."""
        before, self._reading = self._reading, reading
        if before is None or type(before) is not type(reading):
            self._clocks.tied = self._clocks.tied or self._far_fix[0] == reading.time
            self._odometer, self._interval, self._creeps = (reading.time, 0.0, 0.0), 0.0, False
            return 0.0, 0.0, 1, self._gyro.by
        taken, gap = self._odometer or (0.0, 0.0, 0.0), reading.time - before.time
        lost = self._is_lost(gap)
        if taken[0] >= reading.time > before.time:
            self._clocks.tied = True  # from the next time on
        unheard = self._is_silent(gap) and taken[0] > before.time  # fixes since then have moved it
        if unheard and is_speed(reading):  # it tells the way since the last of them
            before, taken = between(before, reading, taken[0]), (0.0, 0.0, 0.0)
        dt = reading.time - before.time
        silent = self._is_silent(dt)
        self._interval = learnt(self._interval, gap)
        arc, turn, valid = bridged_step(
            before, reading, self.vehicle, self._rate, self.skipped, silent
        )
        least = self._band.least
        self._creeps = not self._steps.step and self._band.take(before, reading, arc)
        if self._band.least != least:
            heed_least_speed(self._filter, self._band.least, least)
        arc, turn = self._gyro.steered(before, reading, arc, turn)
        if unheard and not is_speed(reading):
            return self._counted_on(reading, arc, turn, dt)
        if (silent and is_speed(reading)) or (lost and isinstance(reading, WheelTicks)):
            valid = 0  # the way was longer than the turn tells
        elif self._creeps and valid:
            valid = BELOW
        if dt > 0:
            self._rate = (arc / dt, turn / dt)
        if self._began is not None and dt > 0:  # what was driven before the start is no one's
            part = min(max((self._began - before.time) / dt, 0.0), 1.0)
            arc, turn = arc * (1.0 - part), turn * (1.0 - part)
        self._odometer, self._began = (reading.time, 0.0, 0.0), None
        return arc - taken[1], turn - taken[2], valid, self._gyro.by

    def _counted_on(
        self, reading: Reading, arc: float, turn: float, dt: float
    ) -> tuple[float, float, int, int]:
        """What was driven since the last fix, of what was counted in a silence of dt s."""
        taken, now = self._odometer or (0.0, 0.0, 0.0), self._filter
        self._odometer = (reading.time, 0.0, 0.0)
        by_gyro = self._gyro.in_silence(now.time, reading.time)
        if by_gyro is not None and now.mode == WHEELS and isinstance(reading, WheelTicks):
            return arc - taken[1], by_gyro, 0, HEARD_AGAIN
        part = (reading.time - taken[0]) / dt
        return arc * part, turn * part, 0, self._gyro.by

    def _is_silent(self, seconds: float) -> bool:
        """Whether that is longer than odometry usually says nothing."""
        return seconds > silent_after(self._interval)

    def _is_lost(self, seconds: float) -> bool:
        """Whether it is so long that others take its place."""
        return seconds > lost_after(self._interval)

    def _take_fix(self, fix: GeoFix, late: float) -> None:
        now = self._filter
        time = max(fix.time, now.time) if late else fix.time
        if not now.started and self._start is None:
            self._began = time
        self._move_to(time, fix.speed if math.isfinite(fix.sigma_speed) else self._rate[0])
        (x, y, major, minor, axis), course, sigma = fix_row(
            fix, self.roads.plane, self.settings.default_sigma_m
        )
        sigma_speed = fix.sigma_speed
        if late and now.count:
            since = motion_since(now, fix.time, (course, sigma))
            x, y, course = x + since.x, y + since.y, course + since.turn
            major, minor = math.hypot(major, since.sigma), math.hypot(minor, since.sigma)
            sigma = math.hypot(sigma, since.turn_sigma)
            sigma_speed = math.hypot(sigma_speed, since.speed_sigma)
        now.add_fix((x, y, major, minor, axis, fix.speed, sigma_speed, course, sigma))
        self._gyro.takeover.fixed(fix.lat_deg, fix.lon_deg, math.sqrt(major * minor))
        write_reading(now, self._reading, time, self.vehicle, self._steps)
        self._run()
        forget(now)
        self._far_fix = (time, self._filter.disbelieved(x, y, major))

    def _take_sensed(self, reading: SensorReading) -> bool:
        now = self._filter
        rows = self._sensing.rows(reading, now, self.skipped)
        if rows and (now.started or self._start is not None):
            self._move_to(reading.time, self._rate[0])
            self._sensing.add(rows, now)
            self._run()
        return bool(rows)

    def _move_to(self, time: float, speed: float) -> None:
        """Begin an epoch between readings of odometry; in its silence that speed holds, m/s."""
        now = self._filter
        self._begin_at_start(time)
        ahead = time - now.time if now.started else 0.0
        silent = self._reading is not None and self._is_silent(time - self._reading.time)
        if silent:
            self._rate, self._creeps = (speed, 0.0), False
        arc, turn, by = self._rate[0] * ahead, self._rate[1] * ahead, self._gyro.by
        if silent and now.mode == WHEELS and now.started:
            measured = self._gyro.in_silence(now.time, time)
            turn, by = (turn, by) if measured is None else (measured, GYRO_ALONE)
        if self._odometer is not None:
            _, a, t = self._odometer
            self._odometer = (time, a + arc, t + turn)
        known = now.mode != CLOCK and not silent and (now.started or time <= now.time)
        valid = BELOW if self._creeps else 2
        now.fill(time, arc, turn, known * (valid if ahead > 0.0 else 1), by)

    def _begin_at_start(self, time: float) -> None:
        if self._start is not None and not self._filter.started:
            belief, path, ctx = self._filter.belief, self._filter.path, self._filter.ctx
            start_at(belief, self.roads, path, ctx, self._start, time, self.settings)

    def _run(self) -> None:
        now = self._filter
        if not now.run() and self._past is not None:
            path = self._past.ensure_capacity(now.belief, now.path)
            now.keep(path, self._past.history)
            now.run()

    def estimate(self) -> Estimate:
        """The estimate at the last observation that was taken."""
        with self._lock:
            return self._answers.of(self._filter, self._far_fix, self._clocks.behind)
