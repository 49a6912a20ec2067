"""Rows of numbers with their 95 % intervals; what is resampled are whole drives."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..observations import Array

Interval = tuple[float, float]
_DRAWS = 1000


@dataclass(frozen=True, slots=True)
class Row:
    """One number of one model in one scene."""

    scene: str
    model: str  # as `matching.match` calls it; of `gst` with the noise behind it
    figure: str
    value: float | None  # None: there was nothing to measure
    unit: str
    n: int  # drives, or hypotheses where the figure is theirs
    ci95: Interval | None = None  # of the value
    spread95: Interval | None = None  # between which 95 % of the n lie

    def as_json(self) -> dict[str, Any]:
        """The row as `experiments.json` holds it."""
        return asdict(self)


def binomial(hits: int, n: int) -> Interval:
    """Clopper-Pearson: the exact 95 % interval of a share."""

    def root(k: int, tail: float) -> float:
        """The p of which so much of the binomial's mass lies at k and below."""
        low, high = 0.0, 1.0
        for _ in range(50):
            p = 0.5 * (low + high)
            low, high = (p, high) if _below(k, n, p) > tail else (low, p)
        return 0.5 * (low + high)

    return (
        0.0 if hits == 0 else root(hits - 1, 0.975),
        1.0 if hits == n else root(hits, 0.025),
    )


def _below(k: int, n: int, p: float) -> float:
    """P(at most k of n)."""
    log_p, log_q = math.log(p), math.log1p(-p)
    whole = math.lgamma(n + 1)
    return sum(
        math.exp(whole - math.lgamma(i + 1) - math.lgamma(n - i + 1) + i * log_p + (n - i) * log_q)
        for i in range(k + 1)
    )


def _picks(n: int) -> Any:
    """Drives chosen anew with replacement, (draws, n)."""
    return np.random.default_rng(0).integers(0, n, (_DRAWS, n))


def _middle(values: Array) -> Interval:
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


def ratio(top: ArrayLike, below: ArrayLike, root: bool = False) -> tuple[float, Interval]:
    """Sum over sum of one number per drive (n,) each, or its root."""
    a, b = np.asarray(top, float), np.asarray(below, float)
    picks = _picks(len(a))
    drawn = a[picks].sum(axis=1) / b[picks].sum(axis=1)
    value = a.sum() / b.sum()
    return (
        (float(np.sqrt(value)), _middle(np.sqrt(drawn))) if root else (float(value), _middle(drawn))
    )


def median(groups: Sequence[Sequence[float]]) -> tuple[float, Interval, Interval]:
    """Median, its interval, and the middle 95 % of values that come in groups, one a drive."""
    size = np.array([len(g) for g in groups])
    flat = np.concatenate([np.asarray(g, float) for g in groups])
    first = np.cumsum(size) - size
    drawn = []
    for pick in _picks(len(groups))[:300]:
        rows = np.concatenate([np.arange(first[i], first[i] + size[i]) for i in pick])
        if len(rows):
            drawn.append(np.median(flat[rows]))
    return float(np.median(flat)), _middle(np.array(drawn)), _middle(flat)
