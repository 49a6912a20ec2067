"""One wheel counter as it comes in, reading by reading."""

import math
from collections import Counter

from ..readers.wheel_counters import JUMP
from ..sensors.odometry import nearest_step
from ..sensors.validation import FASTEST

_JITTER = 0.02  # s, tolerance of time stamps


class CounterStream:
    """A counter that is unwrapped and signed; jumps are bridged at the speed before.

    Args:
        bits: Of the counter; 0: it does not wrap.
        metres_per_tick: Of its wheel.
    """

    def __init__(self, bits: int, metres_per_tick: float) -> None:
        self._modulus, self._scale = 2.0**bits if bits else 0.0, metres_per_tick
        self._time, self._raw = -math.inf, 0.0
        self._rate = 0.0  # counts a second, of the last readings
        self._usual = 0.0  # s between readings
        self._total = 0.0

    @property
    def begun(self) -> bool:
        """Whether there was a reading."""
        return self._time > -math.inf

    @property
    def state(self) -> list[float]:
        """Its whole state."""
        return [self._time, self._raw, self._rate, self._usual, self._total]

    @state.setter
    def state(self, values: list[float]) -> None:
        """Go on from the state of a stream that was before."""
        self._time, self._raw, self._rate, self._usual, self._total = values

    def take(self, stamp: float, raw: float, backwards: bool, skipped: Counter[str]) -> float:
        """The cumulative count at a new reading."""
        if not self.begun:
            self._time, self._raw, self._total = stamp, raw, raw
            return self._total
        if stamp <= self._time:  # taken up by another clock: as if no time had passed
            self._time, self._raw = stamp, raw
            return self._total
        since = stamp - self._time
        gap = self._usual > 0.0 and since > 3.0 * self._usual
        step = raw - self._raw
        expected = abs(self._rate) * since
        if self._modulus:
            step = nearest_step(step, self._modulus, expected if gap else 0.0)
        if abs(step) * self._scale > FASTEST * (since + _JITTER):
            skipped[JUMP] += 1
            step = expected if self._rate >= 0.0 else -expected
        elif backwards:
            step = -abs(step)
        if not gap:
            self._usual += 0.1 * (since - self._usual) if self._usual else since
            self._rate += 0.3 * (step / since - self._rate)
        self._time, self._raw = stamp, raw
        self._total += step
        return self._total
