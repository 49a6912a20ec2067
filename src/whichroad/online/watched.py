"""What an on-line filter says of its sensors, and what it was made with."""

from ..diagnosis.findings import Finding, findings
from ..diagnosis.further_sensors import further_findings
from ..diagnosis.sensor_states import SensorState, states_of
from ..diagnosis.statistics import ConsistencyStatistics
from ..places import Places
from ..sensors import Sensor
from .answering import Answering
from .epoch_filter import EpochFilter
from .sensing import Sensing


class Watched:
    """The part of a `Localizer` that tells of sensors and places."""

    _filter: EpochFilter
    _sensing: Sensing
    _statistics: ConsistencyStatistics
    _answers: Answering

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
    def sensor_states(self) -> tuple[SensorState, ...]:
        """Each sensor as the filter holds it: what is doubted, and what was learnt."""
        now = self._filter
        return states_of(now.belief, self._sensing.sensed.names, now.turns_by)

    @property
    def diagnosis(self) -> tuple[Finding, ...]:
        """Sensors that were withheld, else settings that do not fit the data so far."""
        state, names = self._filter.belief.state[0], self._sensing.sensed.names
        further = further_findings(names, state.sensors)
        return (*further, *findings(self._statistics, state.vetting))
