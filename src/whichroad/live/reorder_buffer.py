"""The order of events: observations by their own times, whenever they arrive.

An observation in order is taken at once.  One that comes late, within the window, is put
where it belongs: the localizer goes back to a state before it and takes what followed
again.  So nothing waits, and the answer is that of the sorted observations.  Of readings
with one time the first to arrive comes first.
"""

from bisect import bisect_right
from collections import Counter, deque
from dataclasses import replace

from ..localizer import Localizer
from ..records import Observation
from .state import State, restore, state_of

_EVERY = 0.05  # s between states to go back to


class ReorderBuffer:
    """Feeds a localizer in the order of event times.

    Args:
        localizer: Takes the observations.
        window: s by which an observation may be late; 0: none may.

    Attributes:
        skipped: Observations that were not taken, by reason.
        rewinds: How often the localizer went back.
    """

    def __init__(self, localizer: Localizer, window: float = 1.0) -> None:
        self.localizer, self.window = localizer, window
        self.skipped: Counter[str] = Counter()
        self.rewinds = 0
        self.now = -float("inf")  # time of the newest observation
        self._floor = -float("inf")  # no observation may be older: there is no state before it
        self._taken: deque[Observation] = deque()
        self._states: deque[State] = deque()

    def take(self, observation: Observation) -> bool:
        """Take an observation; False: it is too late, and counted.

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
        return self.localizer.take(observation)

    def begin(self, time: float) -> None:
        """The localizer was brought to a time from outside; what is older is too late."""
        self._taken.clear()
        self._states.clear()
        self.now = self._floor = time

    def _keep(self, time: float) -> None:
        """Remember the state before an observation, and drop what is beyond the window."""
        states, taken = self._states, self._taken
        state = state_of(self.localizer)
        when = time if states else self._floor
        states.append(replace(state, time=when))
        while len(states) > 1 and states[1].time <= time - self.window:
            states.popleft()
        while taken and taken[0].time < states[0].time:
            taken.popleft()

    def _take_late(self, observation: Observation) -> bool:
        """Go back, put it in its place, and take what followed again."""
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
        restore(self.localizer, state)
        mine = True
        for one in again:
            if one.time - states[-1].time >= _EVERY:
                kept = state_of(self.localizer)
                states.append(replace(kept, time=one.time))
            taken = self.localizer.take(one)
            mine = taken if one is observation else mine
        return mine
