"""Filter loop of the live service: observations in, messages out, in one thread.

Inputs call `take` and a timer calls `tick`.  Each message is passed to all outputs when it
is made.  Nothing here blocks.
"""

import json
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from ..observations import GeoFix, Observation
from ..online import Estimate, Localizer
from ..roadmap import RoadMap
from .dead_reckoning import DeadReckoning
from .health import Health, Latency
from .messages import Around, EstimateMessage, Messages, PlayMessage
from .recording import Recorder
from .reorder_buffer import ReorderBuffer

Sink = Callable[[bytes, EstimateMessage], None]

LIVE = PlayMessage(mode="live", paused=False, speed=1.0, position_s=None, length_s=None)
_SILENCE = 0.3  # s without an observation after which dead reckoning starts
_HORIZON = 60.0  # s, longest dead reckoning without an observation
_LEAST = 0.02  # s, shortest time between messages triggered by fixes
_AHEAD = 5.0  # s, largest difference of clocks beyond the window
_OTHERS_SILENT = 3.0  # s of silence of the other inputs after which a differing clock is accepted
_RECENT = 0.25  # s after a fix during which the next fix is expected
_BETWEEN = 1.5  # factor on the message interval for odometry while a fix is expected
_RECORDED = 0.09  # s of event time between recorded estimates


class FilterLoop:
    """The filter, its inputs' health and its outputs.

    Args:
        localizer: The on-line filter.
        window: Largest delay of an observation, s.
        rate: Messages per second while no fix triggers one.
        recorder: Records observations and estimates.

    Attributes:
        seq: Number of the last message.
        gnss_masked: Whether fixes are withheld from the filter.
        published: The last message, as JSON.
    """

    def __init__(
        self,
        localizer: Localizer,
        *,
        window: float = 1.0,
        rate: float = 10.0,
        recorder: Recorder | None = None,
    ) -> None:
        self.localizer, self.recorder = localizer, recorder
        self.buffer = ReorderBuffer(localizer, window)
        self.messages = Messages(localizer.roads)
        self.reckoning = DeadReckoning(localizer.roads.plane, localizer.vehicle)
        self.latency = Latency()
        self.sensors: dict[str, Health] = {}
        self.sinks: list[Sink] = []
        self.seq, self.gnss_masked = 0, False
        self.published: bytes = b""
        self.message: EstimateMessage | None = None
        self.play: Callable[[], PlayMessage] = lambda: LIVE
        self.least = _LEAST  # s, shortest time between messages triggered by fixes
        self._every = 1.0 / rate
        self._blank = localizer.state()
        self._fix: GeoFix | None = None
        self._fix_masked = False
        self._last_message = self._last_arrival = -1e9  # clock at the last message and observation
        self._last_fix_message = -1e9  # clock at the last message triggered by a fix
        self._recorded = -1e18

    @property
    def roads(self) -> RoadMap:
        """The map."""
        return self.localizer.roads

    def sensor(self, name: str, kind: str) -> Health:
        """The health of an input, created at the first call."""
        return self.sensors.setdefault(name, Health(name, kind))

    def take(
        self,
        health: Health,
        observations: Sequence[Observation],
        arrival: float,
        *,
        recorded: bool = False,
    ) -> None:
        """Process observations of an input, and publish a message if one is due.

        Args:
            health: Health of the input.
            observations: At least one, in the order of arrival.
            arrival: Time of arrival on the clock of `time.perf_counter`, s.
            recorded: Whether their times come from a recording.
        """
        now = time.perf_counter()
        if not recorded and not self._in_time(observations, now):
            health.skipped += len(observations)
            return
        has_fix = self.observe(observations)
        health.heard(
            len(observations), now, None if recorded else time.time() - observations[-1].time
        )
        self._last_arrival = now
        if has_fix and now - self._last_fix_message >= self.least:
            self._last_fix_message = now
            self.publish(arrival=arrival)
        elif (
            now - self._last_message
            >= (_BETWEEN if now - self._last_fix_message < _RECENT else 1.0) * self._every
        ):
            self.publish(arrival=arrival)

    def _in_time(self, observations: Sequence[Observation], now: float) -> bool:
        """Whether an input's clock agrees with the others; a lone input is accepted."""
        buffer, silent = self.buffer, now - self._last_arrival
        if buffer.now < 0.0:
            return True
        ahead = observations[0].time - buffer.now
        if ahead > silent + _AHEAD:
            why = "clock ahead of the others"
        elif ahead < -buffer.window - _AHEAD:
            why = "clock behind the others"
        else:
            return True
        if silent > _OTHERS_SILENT:
            self.localizer.restore(self._blank)
            buffer.begin(-math.inf)
            self.reckoning.stop()
            buffer.skipped["clock jumped: started anew"] += 1
            return True
        buffer.skipped[why] += len(observations)
        return False

    def observe(self, observations: Sequence[Observation]) -> bool:
        """Process observations without publishing; returns whether one was a fix."""
        has_fix = False
        recorder, buffer, reckoning = self.recorder, self.buffer, self.reckoning
        for one in observations:
            if recorder is not None:
                recorder.observe(one)
            if isinstance(one, GeoFix):
                has_fix = True
                self._fix, self._fix_masked = one, self.gnss_masked
                if self.gnss_masked:
                    continue
            else:
                reckoning.take(one)
            buffer.take(one)
            if recorder is not None and buffer.now - self._recorded >= _RECORDED:
                self._recorded = buffer.now
                recorder.record_estimate(self.localizer)
        return has_fix

    def tick(self) -> None:
        """Publish by dead reckoning while no observation arrives; called regularly."""
        now = time.perf_counter()
        silent = now - self._last_arrival
        if silent >= _SILENCE and now - self._last_message >= self._every and self.buffer.now > 0.0:
            self.publish(ahead=min(silent, _HORIZON))

    def estimate(self, ahead: float = 0.0) -> Estimate:
        """The estimate at the last observation, or `ahead` seconds after it."""
        if ahead and self.buffer.now > 0.0:
            return self.localizer.predict(self.buffer.now + ahead)
        return self.localizer.estimate()

    def publish(self, *, arrival: float | None = None, ahead: float = 0.0) -> None:
        """Make a message and pass it to all outputs.

        Args:
            arrival: Arrival time of the newest observation, for the latency.
            ahead: Dead reckoning since the last observation, s.
        """
        now = self._last_message = time.perf_counter()
        estimate = self.estimate(ahead)
        if not self.reckoning.begun and estimate.status not in ("lost",) and self.answered:
            self.reckoning.reset(estimate)
        self.seq += 1
        self.message = self.messages.estimate(estimate, self._around(now, ahead))
        self.published = json.dumps(self.message, allow_nan=False, separators=(",", ":")).encode()
        for sink in self.sinks:
            sink(self.published, self.message)
        if arrival is not None:
            self.latency.add(time.perf_counter() - arrival)

    @property
    def answered(self) -> bool:
        """Whether the filter has started."""
        return self.localizer.answered

    def mask(self, masked: bool) -> None:
        """Withhold fixes from the filter, or stop doing so."""
        if masked and not self.gnss_masked and self.answered:
            self.reckoning.reset(self.localizer.estimate())
        self.gnss_masked = masked
        self.publish()

    def reset_reckoning(self) -> None:
        """Restart dead reckoning at the present pose."""
        if self.answered:
            self.reckoning.reset(self.localizer.estimate())

    def _around(self, now: float, ahead: float) -> Around:
        localizer, back = self.localizer, self.localizer.lag is not None
        return Around(
            seq=self.seq,
            fix=self._fix,
            fix_masked=self._fix_masked,
            dead_reckoning=ahead > 0.0,
            lagged=localizer.lagged() if back else None,
            decided_until=localizer.decided_until if back else None,
            reckoning=self.reckoning.message(),
            sensors=[sensor.message(now) for sensor in self.sensors.values()],
            gnss_masked=self.gnss_masked,
            play=self.play(),
            latency_ms=self.latency.message(now),
            protection_risk=localizer.settings.protection_risk,
        )

    def health(self) -> dict[str, Any]:
        """The content of `/health`."""
        now = time.perf_counter()
        sensors = [sensor.message(now) for sensor in self.sensors.values()]
        good = bool(sensors) and all(s["ok"] or s["state"] == "ended" for s in sensors)
        return {
            "status": "ok" if good and self.answered else "degraded",
            "answered": self.answered,
            "seq": self.seq,
            "sensors": sensors,
            "gnss_masked": self.gnss_masked,
            "play": self.play(),
            "latency_ms": self.latency.message(now),
            "skipped": {**self.localizer.skipped, **self.buffer.skipped},
            "rewinds": self.buffer.rewinds,
        }
