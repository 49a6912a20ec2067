"""Errors that last: how much a reading says that the one before has not said.

The error of a sensor is a Gauss-Markov process of sigma σ.  From reading to reading it keeps
φ = exp(−Δt/τ − Δs/λ), where it lasts for τ s and λ m.  Of a constant quantity n such readings know
as much as

    1/σ² (1 + (n − 1) share),    share = (1 − φ) / (1 + φ)

so that each reading after the first is worth a share of one.  Its variance is σ²/share, and a
log-likelihood is multiplied by the share.  The error itself is no state: the filter does not learn
it.

A heading is no constant: the filter remembers it for some seconds of driving, and an error that
lasts about as long would be averaged away too soon.  It is taken to last half as long again.
"""

import math

_LONGER = {"Heading": 1.5}  # times the time and way that an error of a kind is said to last
_LEAST = 1e-6  # share, below which a reading says nothing
Key = tuple[int, str, float, float]  # sensor, kind, place (0, 0: none)


class Lasting:
    """When and where each error was last drawn."""

    def __init__(self) -> None:
        self._last: dict[Key, tuple[float, float]] = {}

    def share(self, key: Key, time: float, metres: float, lasts: tuple[float, float]) -> float:
        """The share of a reading that is new, 0 to 1; the reading is remembered.

        Args:
            key: Whose error it is.
            time: s.
            metres: Driven since the beginning.
            lasts: s and m over which the error lasts; 0: it does not.
        """
        before = self._last.get(key)
        self._last[key] = (time, metres)
        if before is None or not any(lasts):
            return 1.0
        age = (time - before[0]) / lasts[0] if lasts[0] > 0.0 else 0.0
        age += (metres - before[1]) / lasts[1] if lasts[1] > 0.0 else 0.0
        share = math.tanh(
            0.5 * max(age, 0.0) / _LONGER.get(key[1], 1.0)
        )  # (1 - exp(-age)) / (1 + exp(-age))
        return share if share > _LEAST else 0.0

    def kept(self) -> list[list[float | str]]:
        """All that it remembers, as numbers and text."""
        return [[*key, *last] for key, last in self._last.items()]

    def restore(self, kept: list[list[float | str]]) -> None:
        """Remember that and nothing else."""
        self._last = {
            (int(i), str(kind), float(a), float(b)): (float(time), float(metres))
            for i, kind, a, b, time, metres in kept
        }
