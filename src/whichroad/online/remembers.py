"""What an on-line filter remembers, as a value to go back to, and as bytes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from threading import RLock
from typing import Any, Self

from ..diagnosis.statistics import ConsistencyStatistics
from ..lookback.smoothing import Window
from ..observations import StartPose
from ..roadmap import RoadMap
from ..sensors import Sensor
from ..sensors.dead_band import DeadBand
from ..sensors.even_steps import EvenSteps
from ..sensors.glitches import Glitches
from ..sensors.gyro_turns import GyroTurns
from ..settings import Settings, Vehicle
from .epoch_filter import EpochFilter
from .localizer_state import Made, Odometry, Reading, State, fingerprint
from .pauses import LateReadings, Streams
from .sensing import Sensing
from .set_back import Clocks
from .ties import Observed, Tie


class Remembers:
    """The part of a `Localizer` that gives and takes its state."""

    roads: RoadMap
    vehicle: Vehicle
    settings: Settings
    skipped: dict[str, int]
    lag: float | None
    _lock: RLock
    _filter: EpochFilter
    _past: Window | None
    _odometer: tuple[float, float, float] | None
    _rate: tuple[float, float]
    _interval: float
    _began: float | None
    _reading: Reading | None
    _far_fix: tuple[float, float]
    _gyro: GyroTurns
    _band: DeadBand
    _creeps: bool
    _glitches: Glitches
    _steps: EvenSteps
    _sensing: Sensing
    _start: StartPose | None
    _statistics: ConsistencyStatistics
    _late: LateReadings
    _streams: Streams
    _clocks: Clocks
    _before_wake: State | None
    _tie: Tie | None
    _go_back: Callable[[], list[Observed]]
    _observe_again: Callable[[Sequence[Observed]], None]
    _map: str = ""  # its fingerprint, once it was asked for

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_ahead": None, "_lock": None}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        self.__dict__.update(kept)
        self._lock = RLock()

    def to_bytes(self) -> bytes:
        """All that this localizer remembers but its map, for `from_bytes`.

        Not among it are the sums behind `diagnosis`, and the past that `lagged` looks back at:
        these begin anew.
        """
        return self.state().to_bytes()

    @classmethod
    def from_bytes(
        cls, data: bytes, roads: RoadMap | str | Path, *,
        vehicle: Vehicle | str | Path | None = None, settings: Settings | None = None,
        places: Any = None, sensors: Sequence[Sensor] = (),
    ) -> Self:  # fmt: skip
        """A localizer that goes on where another one was, to the bit.

        The readings by which a clock's step is found are not kept: a state of the first three
        after a step loses it.

        Args:
            data: What `to_bytes` gave.
            roads: The same map, or its path.
            vehicle: None: the car that it had; else what holds from now on.
            settings: None: those that it had.
            places: As the constructor takes them.
            sensors: Those that it had, in their order.

        Raises:
            ReadError: The bytes are damaged, of another version, or no bytes.
            MapError: They are of another map.
            SettingError: The sensors are others than it had.
        """
        state = State.from_bytes(data)
        made = state.made
        localizer = cls(  # type: ignore[call-arg]
            roads, vehicle=vehicle or made.vehicle, settings=settings or made.settings,
            start=made.start, lag=made.lag, places=places, sensors=sensors,
        )  # fmt: skip
        known = replace(state, made=made._replace(vehicle=localizer.vehicle))
        localizer.restore(known)
        localizer.skipped = dict(state.skipped)
        return localizer

    def state(self) -> State:
        """A copy of all that this localizer remembers, to go back to by `restore`."""
        with self._lock:
            if self._before_wake is not None:
                return self._before_wake
            now = self._filter
            time, count, observed = now.time, now.count, self._go_back()
            odometry = Odometry(
                self._odometer, self._rate, self._interval, self._began, self._reading,
                self._far_fix, now.mode, self._gyro.kept(), self._sensing.kept(),
                self._clocks.kept(), [self._creeps, *self._band.kept()],
                self._glitches.kept(), self._steps.kept(),
            )  # fmt: skip
            state = State(
                time, count, now.tables(), odometry, self._made(), dict(self.skipped),
                tuple(observed), self._statistics.waiting, now.path,
            )  # fmt: skip
            self._observe_again(observed)
            return state

    def restore(self, state: State) -> None:
        """Remember what a state says, and nothing else.

        Settings, vehicle, map and counts of what was skipped stay.  What was watched after that
        moment for the diagnosis is forgotten as far as it was not summed up.

        Args:
            state: Of this localizer, or of one with the same map, lag, vehicle and sensors.

        Raises:
            MapError: It is of another map.
            SettingError: It was kept with another lag or vehicle, or with other sensors.
        """
        with self._lock:
            state.made.check(self._made())
            now, known, self._before_wake = self._filter, state.odometry, None
            now.set_tables(state.tables)
            now.set_mode(known.mode, getattr(known.reading, "geared", False))
            self._gyro.restore(known.gyro)
            self._sensing.restore(known.sensed)
            self._clocks.restore(known.clocks)
            self._creeps = known.band[0]
            self._band.restore(known.band[1:])
            self._glitches.restore(known.glitches)
            self._steps.restore(known.steps)
            now.belief.state[0].vetting.slow.least = self._band.least  # as this vehicle says
            self._odometer, self._rate = known.odometer, known.rate
            self._interval, self._began = known.interval, known.began
            self._reading, self._far_fix = known.reading, known.far_fix
            if self._past is not None:
                if now.path is not state.path:  # tidied since, or of another process: begun anew
                    now.belief.hyp["path_entry"][: now.count] = -1
                self._past.forget_after(now.time, now.belief)
            self._statistics.forget_after(state.watched)
            self._late.took()
            self._streams = Streams()
            self._tie = None
            self._observe_again(state.observed)

    def _blank(self) -> State:
        """The state before anything was observed."""
        from .localizer import Localizer  # whose base class this is

        begun = Localizer(
            self.roads, vehicle=self.vehicle, settings=self.settings, lag=self.lag,
            sensors=self._sensing.sensed.sensors,
        )  # fmt: skip
        begun._map = self._fingerprint()
        return begun.state()

    def _made(self) -> Made:
        return Made(
            self._fingerprint(), self.lag, self.vehicle, self.settings, self._start,
            self._sensing.sensed.names,
        )  # fmt: skip

    def _fingerprint(self) -> str:
        self._map = self._map or fingerprint(self.roads)
        return self._map
