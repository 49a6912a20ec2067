"""How much wheels usually turn otherwise than a gyro: by the metre, and by the second.

Tyres of two sizes turn the wheels by the metre; a bias turns the gyro by the second.  Both are
learnt at once, as a line through what the two differed while fixes came.
"""

import math

_BY_METRE, _BY_SECOND = 0.003, 0.02  # rad/m, of tyres 0.5 % apart, and rad/s: sigmas before
_NOISE = 0.02  # rad, of about a second
_FORGET = 300.0  # s
_STRANGE = 0.15  # rad/s beyond what is usual: one of the two is wrong
_MOST = 1.5  # rad that are explained at most


class UsualDifference:
    """The turn by wheels less that by a gyro, as it usually is."""

    def __init__(self) -> None:
        self._sums = [0.0] * 5  # m², m·s, s²; rad·m, rad·s

    def take(self, seconds: float, arc: float, difference: float) -> None:
        """Learn of what they differed.

        Args:
            seconds: Over which they did.
            arc: Driven meanwhile, m.
            difference: Turn by the wheels less that by the gyro, rad.
        """
        if abs(difference - self.over(seconds, arc)) > _STRANGE * seconds:
            return
        new = arc * arc, arc * seconds, seconds * seconds, difference * arc, difference * seconds
        kept = math.exp(-seconds / _FORGET)
        self._sums = [kept * a + b for a, b in zip(self._sums, new, strict=True)]

    def over(self, seconds: float, arc: float) -> float:
        """What is usual over so many seconds and metres, rad."""
        mm, ms, ss, rm, rs = self._sums
        mm, ss = mm + (_NOISE / _BY_METRE) ** 2, ss + (_NOISE / _BY_SECOND) ** 2
        both = mm * ss - ms * ms
        by_metre, by_second = (ss * rm - ms * rs) / both, (mm * rs - ms * rm) / both
        return min(max(by_metre * arc + by_second * seconds, -_MOST), _MOST)

    def kept(self) -> list[float]:
        """What it knows, as numbers."""
        return self._sums

    def restore(self, kept: list[float]) -> None:
        """Know again what `kept` gave."""
        self._sums = list(kept)
