"""The filter of the live service: observations in, messages out, everything in one thread.

Inputs call `take`, a clock calls `tick`; the outputs that were added are handed each message
as it is made.  Nothing here waits for anything.
"""

import json
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from ..localizer import Localizer
from ..records import Estimate, GeoFix, Observation
from ..roadmap import RoadMap
from .dead_reckoning import DeadReckoning
from .health import Health, Latency
from .messages import Around, EstimateMessage, Messages, PlayMessage
from .recording import Recorder
from .reorder_buffer import ReorderBuffer
from .state import restore, state_of

Sink = Callable[[bytes, EstimateMessage], None]

LIVE = PlayMessage(mode="live", paused=False, speed=1.0, position_s=None, length_s=None)
_SILENCE = 0.3  # s without an observation after which the filter goes on alone
_HORIZON = 60.0  # s that it goes on
_LEAST = 0.02  # s between messages that fixes call for
_AHEAD = 5.0  # s by which clocks may differ beyond the window before they are doubted
_DOUBT = 3.0  # s of silence of the others after which a doubted clock is believed
_RECENT = 0.25  # s after a fix in which the next one is waited for,
_BETWEEN = 1.5  # so that odometry calls for a message this many times later
_RECORDED = 0.09  # s of event time between recorded estimates


class FilterLoop:
    """The filter and what is known around it.

    Args:
        localizer: Owns the belief.
        window: s by which an observation may be late and still be put in its place.
        rate: Messages a second, where no fix calls for one.
        recorder: Is told everything.

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
        self.least = _LEAST  # s between messages that fixes call for
        self._every = 1.0 / rate
        self._blank = state_of(localizer)
        self._fix: GeoFix | None = None
        self._fix_masked = False
        self._told = self._heard = -1e9  # when the last message was made, something came,
        self._fresh = -1e9  # and the last message was made that a fix called for
        self._recorded = -1e18

    @property
    def roads(self) -> RoadMap:
        """The map."""
        return self.localizer.roads

    def sensor(self, name: str, kind: str) -> Health:
        """The health of an input, made when it is first asked for."""
        return self.sensors.setdefault(name, Health(name, kind))

    def take(
        self,
        health: Health,
        observations: Sequence[Observation],
        arrival: float,
        *,
        recorded: bool = False,
    ) -> None:
        """Take what an input said, and publish if it is time to.

        Args:
            health: Of the input.
            observations: In the order of arrival, at least one.
            arrival: When they came, on the clock of `time.perf_counter`.
            recorded: Their times are not the world's.
        """
        now = time.perf_counter()
        if not recorded and not self._in_time(observations, now):
            health.skipped += len(observations)
            return
        fresh = self.observe(observations)
        health.heard(
            len(observations), now, None if recorded else time.time() - observations[-1].time
        )
        self._heard = now
        if fresh and now - self._fresh >= self.least:
            self._fresh = now
            self.publish(arrival=arrival)
        elif now - self._told >= (_BETWEEN if now - self._fresh < _RECENT else 1.0) * self._every:
            self.publish(arrival=arrival)

    def _in_time(self, observations: Sequence[Observation], now: float) -> bool:
        """Whether a clock agrees with the others; where only this one speaks, it is believed."""
        buffer, silent = self.buffer, now - self._heard
        if buffer.now < 0.0:
            return True
        ahead = observations[0].time - buffer.now
        if ahead > silent + _AHEAD:
            why = "clock ahead of the others"
        elif ahead < -buffer.window - _AHEAD:
            why = "clock behind the others"
        else:
            return True
        if silent > _DOUBT:
            restore(self.localizer, self._blank)
            buffer.begin(-math.inf)
            self.reckoning.stop()
            buffer.skipped["clock jumped: started anew"] += 1
            return True
        buffer.skipped[why] += len(observations)
        return False

    def observe(self, observations: Sequence[Observation]) -> bool:
        """Take observations without a word; returns whether one of them was a fix."""
        fresh = False
        recorder, buffer, reckoning = self.recorder, self.buffer, self.reckoning
        for one in observations:
            if recorder is not None:
                recorder.observe(one)
            if isinstance(one, GeoFix):
                fresh = True
                self._fix, self._fix_masked = one, self.gnss_masked
                if self.gnss_masked:
                    continue
            else:
                reckoning.take(one)
            buffer.take(one)
            if recorder is not None and buffer.now - self._recorded >= _RECORDED:
                self._recorded = buffer.now
                recorder.say(self.localizer)
        return fresh

    def tick(self) -> None:
        """Called often: where nothing comes, the filter goes on by dead reckoning and says so."""
        now = time.perf_counter()
        silent = now - self._heard
        if silent >= _SILENCE and now - self._told >= self._every and self.buffer.now > 0.0:
            self.publish(ahead=min(silent, _HORIZON))

    def estimate(self, ahead: float = 0.0) -> Estimate:
        """What the filter says now, or so many seconds after the last observation."""
        if ahead and self.buffer.now > 0.0:
            return self.localizer.predict(self.buffer.now + ahead)
        return self.localizer.estimate()

    def publish(self, *, arrival: float | None = None, ahead: float = 0.0) -> None:
        """Make a message and hand it to all outputs.

        Args:
            arrival: When what it is made of came, for the latency.
            ahead: s of dead reckoning since the last observation.
        """
        now = self._told = time.perf_counter()
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
        """Whether the filter has begun."""
        return int(self.localizer._belief.size[0]) > 0

    def mask(self, masked: bool) -> None:
        """Withhold fixes from the filter, or give them to it again."""
        if masked and not self.gnss_masked and self.answered:
            self.reckoning.reset(self.localizer.estimate())
        self.gnss_masked = masked
        self.publish()

    def reset_reckoning(self) -> None:
        """Let wheels alone begin again at the pose that is."""
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
        """What `/health` says."""
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
