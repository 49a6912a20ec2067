"""What an on-line filter says of its sensors, and what it was made with."""

from threading import RLock

from ..diagnosis.findings import Finding, findings
from ..diagnosis.further_sensors import further_findings
from ..diagnosis.map_offset import map_error_of, outside_finding, outside_of
from ..diagnosis.sensor_states import SensorState, states_of
from ..diagnosis.sensors import (
    least_speed_findings,
    sensor_findings,
    takeover_findings,
    tick_findings,
)
from ..diagnosis.statistics import ConsistencyStatistics
from ..filter.vetting.windows import BY_WHEELS
from ..observations import WheelTicks
from ..places import Places
from ..roadmap import RoadMap
from ..sensors import Sensor
from ..sensors.dead_band import DeadBand
from ..sensors.gyro_turns import GyroTurns
from ..sensors.odometry import turn_of_ticks
from .answering import Answering
from .epoch_filter import EpochFilter
from .localizer_state import Reading
from .pauses import Streams
from .sensing import Sensing
from .set_back import Clocks


class Watched:
    """The part of a `Localizer` that tells of sensors and places."""

    roads: RoadMap
    _lock: RLock
    _filter: EpochFilter
    _sensing: Sensing
    _statistics: ConsistencyStatistics
    _answers: Answering
    _gyro: GyroTurns
    _band: DeadBand
    _reading: Reading | None
    _streams: Streams
    _clocks: Clocks

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """Its further sensors."""
        return self._sensing.sensed.sensors

    @property
    def sensor_columns(self) -> dict[str, str]:
        """The columns that its further sensors read, by the alias that has readers keep them."""
        return self._sensing.sensed.columns

    @property
    def places(self) -> Places | None:
        """Its point objects."""
        return self._answers.places

    @property
    def answered(self) -> bool:
        """Whether there is an answer yet: a fix came, or a pose was given."""
        return self._filter.count > 0

    def last_rows(self) -> tuple[bytes, bytes]:
        """The last epoch and its estimate as records: `filter.state.EPOCH` and `ESTIMATE`."""
        with self._lock:
            return self._filter.epoch.tobytes(), self._filter.estimate.tobytes()

    @property
    def sensor_states(self) -> tuple[SensorState, ...]:
        """Each sensor as the filter holds it: what is doubted, and what was learnt."""
        with self._lock:
            now = self._filter
            return states_of(now.belief, self._sensing.sensed.names, now.turns_by)

    @property
    def diagnosis(self) -> tuple[Finding, ...]:
        """Sensors that were withheld, else settings that do not fit the data so far.

        A vehicle that is off the map is named first; with latitude and longitude swapped
        nothing else can be judged.
        """
        with self._lock:
            belief, names = self._filter.belief, self._sensing.sensed.names
            state = belief.state[0]
            outside = outside_of(belief, self.roads)
            elsewhere = () if outside is None else (outside_finding(outside),)
            if outside is not None and outside.swapped:
                return elsewhere
            streams = (*self._clocks.findings(self._filter.time), *self._streams.findings())
            further = (*elsewhere, *streams, *further_findings(names, state.sensors))
            if isinstance(self._reading, WheelTicks) and self._gyro.by == BY_WHEELS:
                further += tick_findings(turn_of_ticks(self._statistics.vehicle))
            further += least_speed_findings(self._band.found)
            named = takeover_findings(self._gyro.takeover)
            if named:  # settings are not judged by sensors that are wrong
                return (*further, *named, *sensor_findings(state.vetting))
            off = map_error_of(belief, self._statistics.settings, self.roads.plane)
            return (*further, *findings(self._statistics, state.vetting, off))
