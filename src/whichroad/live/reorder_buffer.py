"""Reorder buffer: observations are processed in the order of their own times.

An observation in order is processed at once.  For a late one within the window, the
localizer returns to a stored state before it and processes all later observations again.
So no observation waits, and the result is that of the sorted observations.  Observations
with equal times are processed in the order of arrival.
"""

from bisect import bisect_right
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace

from ..errors import WhichroadError
from ..observations import Observation, SensorReading
from ..online import Localizer, State

_EVERY = 0.05  # s between stored states


class ReorderBuffer:
    """Passes observations to a localizer in the order of their times.

    Args:
        localizer: Processes the observations.
        window: Largest delay of an observation, s; 0: late observations are skipped.
        failed: Takes what a sensor raises at a reading of its own, which is skipped.

    Attributes:
        skipped: Number of skipped observations, by reason.
        rewinds: How often the localizer returned to an earlier state.
    """

    def __init__(
        self, localizer: Localizer, window: float = 1.0,
        failed: Callable[[WhichroadError], None] = lambda error: None,
    ) -> None:  # fmt: skip
        self.localizer, self.window, self._failed = localizer, window, failed
        self.skipped: Counter[str] = Counter()
        self.rewinds = 0
        self.now = -float("inf")  # time of the newest observation
        self._floor = -float("inf")  # time of the oldest stored state
        self._taken: deque[Observation] = deque()
        self._states: deque[State] = deque()

    def take(self, observation: Observation) -> bool:
        """Process an observation; False: it was not used.

        Args:
            observation: With its own time, s.
        """
        time = observation.time
        if time < self.now:
            return self._take_late(observation)
        if self.window:
            states = self._states
            if not states or time - states[-1].time >= _EVERY:
                self._keep(time)
            self._taken.append(observation)
        self.now = time
        return self._pass(observation)

    def begin(self, time: float) -> None:
        """Start again at a time to which the localizer was set from outside.

        Args:
            time: s.
        """
        self._taken.clear()
        self._states.clear()
        self.now = self._floor = time

    def _pass(self, observation: Observation) -> bool:
        """Pass an observation to the localizer."""
        if not isinstance(observation, SensorReading):
            return self.localizer.take(observation)
        try:
            return self.localizer.take(observation)
        except WhichroadError as error:
            if observation in self._taken:
                self._taken.remove(observation)  # it would fail again
            self._failed(error)
            return False

    def _keep(self, time: float) -> None:
        """Store the state before an observation; drop states beyond the window."""
        states, taken = self._states, self._taken
        state = self.localizer.state()
        when = time if states else self._floor
        states.append(replace(state, time=when))
        while len(states) > 1 and states[1].time <= time - self.window:
            states.popleft()
        while taken and taken[0].time < states[0].time:
            taken.popleft()

    def _take_late(self, observation: Observation) -> bool:
        """Return to a state before the observation and process it and all later ones."""
        states = self._states
        if not states or observation.time < max(states[0].time, self.now - self.window):
            self.skipped["late"] += 1
            return False
        self.rewinds += 1
        while len(states) > 1 and states[-1].time > observation.time:
            states.pop()
        state = states[-1]
        times = [one.time for one in self._taken]
        place = bisect_right(times, observation.time)
        self._taken.insert(place, observation)
        # a state of time t is from before the observations of that time
        first = next(i for i, one in enumerate(self._taken) if one.time >= state.time)
        again = list(self._taken)[first:]
        self.localizer.restore(state)
        mine = True
        for one in again:
            if one.time - states[-1].time >= _EVERY:
                states.append(replace(self.localizer.state(), time=one.time))
            taken = self._pass(one)
            mine = taken if one is observation else mine
        return mine
