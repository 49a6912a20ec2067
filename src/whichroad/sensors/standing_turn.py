"""A vehicle that is turned as a whole while its wheels stand, as on a turntable, by its gyro.

The turn counts once the gyro reads again what it read before: one that has broken meanwhile does
not.  Nor does what is sooner over or faster than a turntable, as a burst of the gyro.  Then it is
given in steps that a vehicle can make.
"""

import math

_RATE, _FASTEST = 0.05, 0.9  # rad/s, from what the gyro reads at rest, that is a turn; at most
_SHORTEST = 3.0  # s of a turn: what is sooner over is a burst of the gyro
_CALM = 0.5  # s at rest, before and after
_LEARNS = 10.0  # s over which the rate at rest is averaged
_LEAST, _MOST = 0.2, 2.0 * math.pi + 0.5  # rad, of a turn that counts
_GIVEN = 1.0  # rad/s


class StandingTurn:
    """The turn that a gyro measures while wheels stand."""

    def __init__(self) -> None:
        self._rest, self._rested = 0.0, 0.0  # rad/s, of the gyro, and s over which it is known
        self._calm = 0.0  # s for which it has been that,
        self._turned = math.nan  # and rad turned since it was not; NaN: it is at rest, or unknown
        self._lasted = 0.0  # s of that turn
        self._owed = 0.0  # rad that count and are not given yet

    def take(self, dt: float, stands: bool, gyro: float) -> bool:
        """Take a reading.

        Args:
            dt: Since the one before, s.
            stands: Whether both wheels read 0.
            gyro: Turn by the gyro, rad.

        Returns:
            Whether a turn that counts has ended.
        """
        off = gyro - self._rest * dt
        if not stands:
            self._calm, self._turned = 0.0, math.nan
            return False
        if abs(off) >= _RATE * dt:
            if self._calm >= _CALM and math.isnan(self._turned):
                self._turned = self._lasted = 0.0
            self._calm = 0.0
            self._lasted += dt
            self._turned += off if abs(off) <= _FASTEST * dt else math.nan
            return False
        self._calm += dt
        self._rested = min(self._rested + dt, _LEARNS)
        self._rest += off / max(self._rested, dt)
        if math.isnan(self._turned) or self._calm < _CALM:
            return False
        counts = _LEAST < abs(self._turned) < _MOST and self._lasted >= _SHORTEST
        self._owed += self._turned if counts else 0.0
        self._turned = math.nan
        return counts

    def given(self, dt: float) -> float:
        """What of it is turned in so many seconds, rad."""
        most = _GIVEN * dt
        step = min(max(self._owed, -most), most)
        self._owed -= step
        return step

    def kept(self) -> list[float | None]:
        """What it knows, as numbers."""
        turned = None if math.isnan(self._turned) else self._turned
        return [self._rest, self._rested, self._calm, self._owed, self._lasted, turned]

    def restore(self, kept: list[float | None]) -> None:
        """Know again what `kept` gave."""
        *known, turned = kept
        self._rest, self._rested, self._calm, self._owed, self._lasted = (
            one or 0.0 for one in known
        )
        self._turned = math.nan if turned is None else turned
