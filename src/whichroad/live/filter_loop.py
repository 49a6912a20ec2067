"""Filter loop of the live service: observations in, messages out, in one thread.

Inputs call `take` and a timer calls `tick`.  Each message is passed to all outputs when it
is made.  Nothing here blocks.

The time of what is published is that of the sensors.  It never goes back, and never beyond
the newest observation by more than the inputs' usual intervals explain.  A late observation
is taken at its own time, and the estimate is predicted to the time that was published already.
"""

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from ..diagnosis.sensor_states import SensorState
from ..errors import WhichroadError
from ..observations import GeoFix, Observation, SensorReading
from ..online import Estimate, Localizer
from ..readers.reckoned_places import HEARD
from .dead_reckoning import DeadReckoning
from .health import Health, Latency
from .heard_sensors import HeardSensors
from .message_types import LIVE, UNKNOWN, EstimateMessage, PlayMessage
from .messages import Around, Messages
from .outside_map import OutsideMap
from .recording import Recorder
from .reorder_buffer import ReorderBuffer
from .troubles import Troubles

Sink = Callable[[bytes, EstimateMessage], None]

_SILENCE = 0.3  # s without an observation after which messages are predicted
_LATE_BY = 2.5  # usual intervals without an observation after which this is dead reckoning
_INTERVALS = 5.0  # usual intervals beyond the newest observation that are predicted, at most
_LEAST_HORIZON, _HORIZON = 1.0, 60.0  # s, bounds of that prediction
_STALE = 1.0  # s after the end of a prediction, from which on it is stale
_ASSUMED = 1.0  # s, usual interval of the observations before two have come
_LOST = 1.0  # s of messages, at most, between the last checkpoint and a crash
_LEAST = 0.02  # s, shortest time between messages triggered by fixes
_AHEAD = 5.0  # s, largest difference of clocks beyond the window
_LEADS = 1.0  # s by which readings of further sensors may be ahead of fixes and odometry
_OTHERS_SILENT = 3.0  # s of silence of the other inputs after which a differing clock is accepted
_RECENT = 0.25  # s after a fix during which the next fix is expected
_BETWEEN = 1.5  # factor on the message interval for odometry while a fix is expected
_STATES = 0.2  # s between two looks at the sensors' states
_RECORDED = 0.09  # s of event time between recorded estimates


class FilterLoop:
    """The filter, its inputs' health and its outputs.

    Args:
        localizer: The on-line filter.
        window: Largest delay of an observation, s.
        rate: Messages per second while no fix triggers one.
        recorder: Records observations and estimates.
        vehicle: Its name, where a service has several.
        troubles: What does not work now.
        clock: Gives the time that passes, s.

    Attributes:
        seq: Number of the last message.
        gnss_masked: Whether fixes are withheld from the filter.
        published: The last message, as JSON.
        until: Time of the newest estimate that was published, s.
        recorded: Time of the last recorded estimate, s.
        present: The event time at a time of the clock; of a recording, its player's.
    """

    def __init__(
        self,
        localizer: Localizer,
        *,
        window: float = 1.0,
        rate: float = 10.0,
        recorder: Recorder | None = None,
        vehicle: str | None = None,
        troubles: Troubles | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.localizer, self.recorder, self._clock = localizer, recorder, clock
        self.vehicle, self.troubles = vehicle, troubles or Troubles()
        self.buffer = ReorderBuffer(localizer, window, self._sensor_failed)
        self.messages = Messages(localizer.roads, localizer.places)
        self.heard = HeardSensors(localizer.sensors)
        self.reckoning = DeadReckoning(localizer.roads.plane, localizer.vehicle)
        self.latency = Latency()
        self._outside = OutsideMap(localizer.roads, self.troubles)
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
        self._receiver = UNKNOWN
        self._own = (-math.inf, -math.inf)  # time of the newest fix or odometry; its arrival
        self._last_message = self._last_arrival = -1e9  # clock at the last message and observation
        self._known: tuple[SensorState, ...] = ()
        self._asked_at = -1e9  # clock at the last look at the sensors' states
        self._last_fix_message = -1e9  # clock at the last message triggered by a fix
        self._newest = self._newest_at = -math.inf  # newest observation, clock at its arrival
        self._interval: float | None = None  # s between arrivals of the most frequent input
        self._spacing = 0.0  # s between the times of its observations
        self.until = self.recorded = -math.inf
        self.present: Callable[[float], float] = lambda now: self._newest + now - self._newest_at

    def sensor(self, name: str, kind: str) -> Health:
        """The health of an input, created at the first call."""
        return self.sensors.setdefault(name, Health(name, kind, self.troubles.report))

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
            arrival: Time of arrival on `clock`, s.
            recorded: Whether their times come from a recording.
        """
        now = self._clock()
        if not recorded and not self._in_time(observations, now):
            health.untimely += len(observations)
            return
        has_fix = self.observe(observations)
        if has_fix:
            self._receiver = health.receiver
        made = observations[-1].time
        health.heard(len(observations), now, None if recorded else time.time() - made, made)
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
        newest, first = max(buffer.now, self._newest), observations[0]
        own, own_arrival = self._own
        if isinstance(first, SensorReading):  # it does not decide which time it is
            leads = first.time - own - (now - own_arrival)  # NaN where none of these was heard yet
            if not leads <= max(buffer.window, _LEADS):
                buffer.skipped["readings ahead of fixes and odometry"] += len(observations)
                return False
        else:
            self._own = (max(own, observations[-1].time), now)
        if newest < 0.0:
            return True
        ahead = first.time - newest
        if ahead > silent + _AHEAD:
            why = "clock ahead of the others"
        elif ahead < -buffer.window - _AHEAD:
            why = "clock behind the others"
        else:
            return True
        if silent > _OTHERS_SILENT:
            self.localizer.restore(self._blank)
            self.begin(-math.inf)
            self.recorded = -math.inf
            buffer.skipped["clock jumped: started anew"] += 1
            return True
        buffer.skipped[why] += len(observations)
        return False

    def observe(self, observations: Sequence[Observation]) -> bool:
        """Process observations without publishing; returns whether one was a fix."""
        has_fix = False
        recorder, buffer, reckoning = self.recorder, self.buffer, self.reckoning
        for one in observations:
            self.heard.take(one)
            if recorder is not None:
                recorder.observe(one)
            if isinstance(one, GeoFix):
                has_fix = True
                if self._fix is None or one.time >= self._fix.time:
                    self._fix, self._fix_masked = one, self.gnss_masked
                if self.gnss_masked:
                    self._hear(one.time)
                    continue
            else:
                reckoning.take(one)
            if not buffer.take(one):
                continue
            self._hear(one.time)
            if isinstance(one, GeoFix):
                self._outside.take(one)
            if recorder is not None and buffer.now - self.recorded >= _RECORDED:
                self.recorded = buffer.now
                recorder.record_estimate(self.localizer)
        return has_fix

    def _sensor_failed(self, error: WhichroadError) -> None:
        """A further sensor raised at a reading: told once, each is counted."""
        what, _, reason = str(error).partition(": ")
        self.buffer.skipped[f"{what}: reading that it failed at"] += 1
        if not self.troubles.holds(what):
            self.troubles.begin(what, reason, f"{error}; its readings are skipped")

    def _hear(self, time_: float) -> None:
        """An observation of that time has come."""
        if time_ > self._newest:
            self._newest, self._newest_at = time_, self._clock()

    def begin(self, when: float) -> None:
        """Start again at a time to which the localizer was set from outside: earlier, maybe."""
        self.buffer.begin(when)
        self.reckoning.stop()
        self.heard.forget_after(when)
        self._fix = None
        self._newest, self._newest_at, self.until = when, self._clock(), -math.inf

    def resume(self, when: float, age: float, published: float) -> None:
        """Go on after a crash, at the first observation: until then nothing is published.

        Args:
            when: Time of the localizer's state, s.
            age: s since that state was stored.
            published: Time of the newest estimate published until then, s.
        """
        self.buffer.begin(when)
        self._last_arrival = self._clock() - age
        self.until = published + min(age, _LOST)

    def tick(self) -> None:
        """Publish a prediction while no observation arrives; called regularly."""
        now = self._clock()
        if now - self._last_arrival >= _SILENCE and now - self._last_message >= self._every:
            self.publish(when=self.present(now))

    def horizon(self, now: float) -> float:
        """Seconds that are predicted beyond the newest observation, at most.

        It is five usual intervals of the input that observes most often, of those that are not
        silent; where all are, of the last one that was not.
        """
        usual = [
            (one.interval, one.spacing or 0.0)
            for one in self.sensors.values()
            if one.interval is not None and one.state(now) == "ok"
        ]
        if usual:
            self._interval, self._spacing = min(usual)
        return min(max(_INTERVALS * self._spacing, _LEAST_HORIZON), _HORIZON)

    def estimate(self, when: float = -math.inf) -> Estimate:
        """The estimate at the last observation, or at a later time, s."""
        estimate = self.localizer.estimate()
        return self.localizer.predict(when) if estimate.time < when else estimate

    def publish(self, *, arrival: float | None = None, when: float = -math.inf) -> None:
        """Make a message and pass it to all outputs; nothing before the first observation.

        Args:
            arrival: Arrival time of the newest observation, for the latency.
            when: Time to predict to, s; it is shortened to the horizon.
        """
        now, newest = self._clock(), self._newest
        if newest == -math.inf:
            return
        if max(when, self.until) > newest:
            last = newest + self.horizon(now)
            if self.until > last + 1e-6:
                return  # an estimate that was published before a crash is newer
            when = min(when, last)
        self._last_message = now
        when = max(newest, self.until, when)
        estimate = self.estimate(when)
        self.until = max(when, estimate.time)
        if not self.reckoning.begun and estimate.status not in ("lost",) and self.answered:
            self.reckoning.reset(estimate)
        self.seq += 1
        silent = now - self._last_arrival
        usual = _ASSUMED if self._interval is None else self._interval
        dead = when > newest and silent > max(_SILENCE, _LATE_BY * usual)
        self.message = self.messages.estimate(estimate, self._around(now, dead))
        self.published = json.dumps(self.message, allow_nan=False, separators=(",", ":")).encode()
        for sink in self.sinks:
            sink(self.published, self.message)
        if arrival is not None:
            self.latency.add(self._clock() - arrival)

    @property
    def answered(self) -> bool:
        """Whether the filter has started."""
        return self.localizer.answered

    def odometry_beside(self, at: float) -> bool:
        """Whether the filter has begun, and odometry that measures turns was heard about then.

        Args:
            at: A time, s.
        """
        return self.answered and self.heard.turns(at - HEARD)

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

    def _around(self, now: float, dead_reckoning: bool) -> Around:
        localizer, back = self.localizer, self.localizer.lag is not None
        age = max(self.present(now) - self.until, 0.0)
        return Around(
            seq=self.seq,
            vehicle=self.vehicle,
            receiver=self._receiver,
            fix=self._fix,
            fix_masked=self._fix_masked,
            dead_reckoning=dead_reckoning,
            age=age,
            stale=age > _STALE,
            lagged=localizer.lagged() if back else None,
            decided_until=localizer.decided_until if back else None,
            reckoning=self.reckoning.message(),
            sensors=[sensor.message(now) for sensor in self.sensors.values()],
            heard=self.heard.messages(self.until + age, self._states(now)),
            gnss_masked=self.gnss_masked,
            play=self.play(),
            latency_ms=self.latency.message(now),
            protection_risk=localizer.settings.protection_risk,
        )

    def _states(self, now: float) -> tuple[SensorState, ...]:
        """What the filter holds of the sensors, asked for now and then: it changes slowly."""
        if now - self._asked_at >= _STATES:
            self._asked_at, self._known = now, self.localizer.sensor_states
        return self._known

    def health(self) -> dict[str, Any]:
        """The content of `/health`."""
        now = self._clock()
        sensors = [sensor.message(now) for sensor in self.sensors.values()]
        good = bool(sensors) and all(s["ok"] or s["state"] == "ended" for s in sensors)
        held = [self.troubles, *(sensor.troubles for sensor in self.sensors.values())]
        problems = [message for one in held for message in one.messages()]
        skipped = Counter(self.localizer.skipped) + self.buffer.skipped
        for one in self.sensors.values():
            skipped += one.skipped_why
        return {
            "status": "ok" if good and self.answered and not problems else "degraded",
            "problems": problems,
            "answered": self.answered,
            "seq": self.seq,
            "sensors": sensors,
            "gnss_masked": self.gnss_masked,
            "play": self.play(),
            "latency_ms": self.latency.message(now),
            "skipped": dict(skipped),
            "rewinds": self.buffer.rewinds,
        }
