"""Playback of recorded drives: at any speed, with pause, step and seek."""

import asyncio
import math
import time
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from ..errors import DriveError
from ..observations import (
    Distance,
    Drive,
    GeoFix,
    Observation,
    Odometer,
    SensorReading,
    SpeedYaw,
    SpeedYawRate,
    WheelCounts,
    WheelSpeed,
    WheelSpeeds,
    WheelTicks,
    WithGyro,
    YawRate,
)
from ..online import State
from .filter_loop import FilterLoop
from .message_types import PlayMessage

_KINDS: dict[type, Callable[..., Observation]] = {
    WheelCounts: WheelTicks, WheelSpeeds: WheelSpeed, Odometer: Distance, SpeedYawRate: SpeedYaw,
}  # fmt: skip
_OF_READING = ("values", "sensor")  # of a `SensorReading`, after its time
_BLOCK = 4096  # observations created at once
_SLICE = 0.004  # s of work before other tasks run
_STEP = 0.1  # s of the recording in one step
_NAP = 0.02  # s, the longest sleep while playing
_KEPT_EVERY = 2.0  # s of the recording between stored states
_MOST_KEPT = 400


class RecordedObservations:
    """The observations of a recorded drive, in the order of their times.

    Args:
        drive: The recording; of equal times the odometry comes first.
        laps: Number of repetitions.

    Raises:
        DriveError: The drive has neither a fix nor odometry.
    """

    def __init__(self, drive: Drive, laps: int = 1) -> None:
        self._columns: list[tuple[Callable[..., Observation], list[Any]]] = []
        times, kinds, rows = [], [], []
        log, fixes = drive.odometry, drive.fixes
        if isinstance(log, WithGyro):
            self._columns.append((YawRate, [log.gyro.time, log.gyro.rate]))
            log = log.distance
        if log is not None and len(log.time):
            columns = [getattr(log, field.name) for field in fields(log)]
            if drive.geared:
                columns.append(np.ones(len(log.time), bool))
            self._columns.append((_KINDS[type(log)], columns))
        if fixes is not None and len(fixes):
            columns = [getattr(fixes, field.name) for field in fields(GeoFix)]
            self._columns.append((GeoFix, columns))
        if drive.sensed:
            columns = [np.array([one.time for one in drive.sensed])]
            columns += [_objects([getattr(one, n) for one in drive.sensed]) for n in _OF_READING]
            self._columns.append((SensorReading, columns))
        for kind, (_, columns) in enumerate(self._columns):
            times.append(columns[0])
            kinds.append(np.full(len(columns[0]), kind, np.int8))
            rows.append(np.arange(len(columns[0])))
        if not times:
            raise DriveError(f"{drive.drive_id}: neither a fix nor odometry; nothing to play")
        time_ = np.concatenate(times)
        order = np.argsort(time_, kind="stable")
        self.time = time_[order]
        self._kind, self._row = np.concatenate(kinds)[order], np.concatenate(rows)[order]
        self._laps = laps
        self._lap = float(self.time[-1] - self.time[0]) + 1.0
        self._block: list[Observation] = []
        self._first = -1

    def __len__(self) -> int:
        return len(self.time) * self._laps

    @property
    def length(self) -> float:
        """From the first to the last observation, s."""
        return self.when(len(self) - 1) - float(self.time[0])

    def when(self, index: int) -> float:
        """Time of an observation, s."""
        lap, row = divmod(index, len(self.time))
        return float(self.time[row]) + lap * self._lap

    def index(self, when: float) -> int:
        """The first observation at or after a time."""
        lap = int(max(when - float(self.time[0]), 0.0) // self._lap)
        if lap >= self._laps:
            return len(self)
        row = int(np.searchsorted(self.time, when - lap * self._lap))
        return lap * len(self.time) + row

    def __getitem__(self, index: int) -> Observation:
        at = index - self._first
        if not 0 <= at < len(self._block) or self._first < 0:
            self._make(index)
            at = 0
        return self._block[at]

    def _make(self, index: int) -> None:
        """Create the block of observations that begins at an index."""
        lap, row = divmod(index, len(self.time))
        end = min(row + _BLOCK, len(self.time))
        block: list[Any] = [None] * (end - row)
        for kind, (make, columns) in enumerate(self._columns):
            places = np.flatnonzero(self._kind[row:end] == kind)
            rows = self._row[row:end][places]
            taken = [column[rows] for column in columns]
            taken[0] = taken[0] + lap * self._lap
            values = zip(*(column.tolist() for column in taken), strict=True)
            for place, cells in zip(places.tolist(), values, strict=True):
                block[place] = make(*cells)
        self._block, self._first = block, index


def _objects(values: list[Any]) -> Any:
    """An array of any objects, (n,)."""
    found = np.empty(len(values), object)
    found[:] = values
    return found


class Player:
    """Plays a recording into a filter loop.

    Args:
        filter_loop: Processes the observations.
        recording: The observations.
        speed: Multiple of real time; None: as fast as possible.
        paused: Whether to wait for `resume` or `step`.

    Attributes:
        ended: Set when everything was played.
    """

    def __init__(
        self,
        filter_loop: FilterLoop,
        recording: RecordedObservations,
        *,
        speed: float | None = 1.0,
        paused: bool = False,
    ) -> None:
        self.filter_loop, self.recording = filter_loop, recording
        self.speed, self.paused = speed, paused
        self.ended = asyncio.Event()
        self._health = filter_loop.sensor("recording", "file")
        self._health.link = "open"
        self._at = 0
        self._kept: list[tuple[int, State]] = []
        self._every = _KEPT_EVERY
        self._anchor = (0.0, 0.0)  # clock and time of the recording that correspond
        self._target: int | None = None  # index to which a seek goes
        self._wake = asyncio.Event()
        filter_loop.play, filter_loop.present = self.message, self._present

    @property
    def position(self) -> float:
        """Seconds from the recording's beginning."""
        return self.recording.when(max(self._at - 1, 0)) - float(self.recording.time[0])

    def message(self) -> PlayMessage:
        """The state of play."""
        return PlayMessage(
            mode="replay",
            paused=self.paused,
            speed=self.speed,
            position_s=round(self.position, 3),
            length_s=round(self.recording.length, 3),
        )

    def start_at(self, when: float) -> None:
        """Begin at a time that the filter has reached already."""
        self._at = self.recording.index(when)

    async def run(self) -> None:
        """Play until cancelled; waits while paused and at the end."""
        self._set_anchor()
        while True:
            if self._target is not None:
                self._run_on(self._target)
                await asyncio.sleep(0)
            elif self.paused or self._at >= len(self.recording):
                if self._at >= len(self.recording) and not self.ended.is_set():
                    self._health.link = "ended"
                    self.filter_loop.publish()
                    self.ended.set()
                self._wake.clear()
                await self._wake.wait()
                self._set_anchor()
            elif self.speed is None:
                self._play_slice(len(self.recording))
                await asyncio.sleep(0)
            else:
                await self._play_at(self.speed)

    async def _play_at(self, speed: float) -> None:
        clock, recorded = self._anchor
        due = recorded + speed * (time.perf_counter() - clock)
        when = self.recording.when(self._at)
        if when <= due:
            end = self.recording.index(due + 1e-9)
            reached = self._play_slice(max(end, self._at + 1))
            await asyncio.sleep(0.001 if reached else 0)
        else:
            await asyncio.sleep(min((when - due) / speed, _NAP))

    def _play_slice(self, end: int) -> bool:
        """Play up to an index for a limited time; returns whether it was reached."""
        began = arrival = time.perf_counter()
        recording, filter_loop, health = self.recording, self.filter_loop, self._health
        end = min(end, len(recording))
        while self._at < end:
            chunk = [recording[i] for i in range(self._at, min(self._at + 32, end))]
            self._keep()
            self._at += len(chunk)
            filter_loop.take(health, chunk, arrival, recorded=True)
            arrival = time.perf_counter()
            if arrival - began > _SLICE:
                break
        return self._at >= end

    def _keep(self) -> None:
        """Store the state for seeking; the longer the drive, the fewer states."""
        when = self.recording.when(self._at)
        if self._kept and when - self.recording.when(self._kept[-1][0]) < self._every:
            return
        self._kept.append((self._at, self.filter_loop.localizer.state()))
        if len(self._kept) > _MOST_KEPT:
            self._kept = self._kept[::2]
            self._every *= 2.0

    def _present(self, clock: float) -> float:
        """Time of the recording at a clock's time, not beyond the next observation."""
        if self.speed is None or self.paused or self._at >= len(self.recording):
            return -math.inf
        anchor, recorded = self._anchor
        due = recorded + self.speed * (clock - anchor)
        return min(due, self.recording.when(self._at))

    def _set_anchor(self) -> None:
        self._anchor = (
            time.perf_counter(),
            self.recording.when(min(self._at, len(self.recording) - 1)),
        )

    # Controls

    def pause(self) -> None:
        """Pause."""
        self.paused = True
        self.filter_loop.publish()

    def resume(self) -> None:
        """Resume; at the end, start from the beginning."""
        if self._at >= len(self.recording):
            self.seek(0.0)
        self.paused = False
        self._wake.set()

    def step(self, seconds: float = _STEP) -> None:
        """Play some seconds, then pause."""
        self.paused = True
        target = self.recording.when(min(self._at, len(self.recording) - 1)) + seconds
        self._target = self.recording.index(target)
        self._wake.set()

    def set_speed(self, speed: float | None) -> None:
        """Set the speed as a multiple of real time; None: as fast as possible."""
        self.speed = speed
        self._set_anchor()
        self._wake.set()

    def seek(self, position: float) -> None:
        """Go to a time, s from the beginning, processing all observations before it."""
        target = self.recording.index(float(self.recording.time[0]) + max(position, 0.0))
        self.ended.clear()
        self._health.link = "open"
        if target < self._at:
            while len(self._kept) > 1 and self._kept[-1][0] > target:
                self._kept.pop()
            at, state = self._kept[-1] if self._kept else (0, self.filter_loop.localizer.state())
            self.filter_loop.localizer.restore(state)
            self._at = at
            self.filter_loop.begin(self.recording.when(at))
        self._target = target
        self._wake.set()

    def _run_on(self, target: int) -> None:
        """Process observations without publishing, for a limited time."""
        began, target = time.perf_counter(), min(target, len(self.recording))
        while self._at < target and time.perf_counter() - began < _SLICE:
            self._keep()
            end = min(self._at + 32, target)
            chunk = [self.recording[i] for i in range(self._at, end)]
            self._at = end
            self.filter_loop.observe(chunk)
        if self._at >= target:
            self._target = None
            self._set_anchor()
            self.filter_loop.publish()
