"""Heights of a drive against the heights of its roads over the ground: what all hypotheses share.

A height is z = g + h + e + white noise.  The ground g rises and falls by a slope that lasts for
some hundred metres, e is the sensor's own slow error, and h is how high the road is over the
ground, by the levels of the map (`roadmap.levels`).  Given h all is linear and Gaussian, with a
covariance that depends on no reading: one Kalman filter of (g, slope, e) gives the gains for all
hypotheses.  Each of them keeps its own mean (`filter.evidence.elevation`).
"""

import math

import numpy as np

from ..observations import Array
from ..sensors.kinds import Elevation

SLOPE, SLOPE_M = 0.02, 300.0  # sigma of the ground's slope along roads, and m that it lasts
_FIRST = 1e4  # m², of the ground before the first reading
_SEEN = np.array([1.0, 0.0, 1.0])  # a reading sees the ground and the error


class Gains:
    """The filter that all hypotheses share, of one sensor."""

    def __init__(self) -> None:
        self._cov: Array | None = None  # (3, 3) of ground (m), slope, error (m)
        self._at = (0.0, 0.0)  # s and m driven, of the last reading

    def of(self, one: Elevation, time: float, metres: float) -> tuple[float, ...]:
        """What a reading does to the means: its row of `filter.evidence.evidence_kinds`.

        Args:
            one: The reading.
            time: s, not before the one before.
            metres: Driven since the beginning.

        Returns:
            Metres since the last reading, what slope and error keep since then, the three gains,
            and the variance of the innovation, m².
        """
        drift, slope = one.drift_m**2, SLOPE**2
        if self._cov is None:
            self._cov, self._at = np.diag([_FIRST, slope, drift]), (time, metres)
        seconds, driven = max(time - self._at[0], 0.0), max(metres - self._at[1], 0.0)
        bent, kept = math.exp(-driven / SLOPE_M), math.exp(-seconds / one.drift_s)
        step = np.array([[1.0, driven, 0.0], [0.0, bent, 0.0], [0.0, 0.0, kept]])
        cov = step @ self._cov @ step.T
        cov += np.diag([0.0, slope * (1.0 - bent * bent), drift * (1.0 - kept * kept)])
        seen = cov @ _SEEN
        variance = float(_SEEN @ seen) + one.sigma_m**2
        gain = seen / variance
        self._cov, self._at = cov - np.outer(gain, seen), (time, metres)
        return (driven, bent, kept, *gain.tolist(), variance)

    def kept(self) -> list[float]:
        """All that it remembers, as numbers."""
        return [] if self._cov is None else [*self._at, *self._cov.ravel().tolist()]

    def restore(self, kept: list[float]) -> None:
        """Remember that and nothing else."""
        self._cov = np.array(kept[2:]).reshape(3, 3) if kept else None
        self._at = (kept[0], kept[1]) if kept else (0.0, 0.0)
