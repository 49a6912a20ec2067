"""How much of a route was missed, and how much of an answer was never driven."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geodesy.angles import radians
from ..observations import Array
from ..ragged import row_and_place

_NEAR = 3.0  # m, largest distance between geometries of one road
_TURN = radians(60.0)  # largest angle between directions that match
_STEP = 1.0  # m, between the samples compared
_REACH = _NEAR * np.sqrt(2.0)  # m, search radius in position and direction
_TURN_RADIUS = _NEAR / (2.0 * np.sin(0.5 * _TURN))  # m per unit vector, so that 60° count as 3 m


class Mismatch(NamedTuple):
    """Lengths after Newson and Krumm (2009), m."""

    missed: float  # d-: true route that the answer does not cover
    extra: float  # d+: answer that the true route does not cover
    driven: float  # d0: length of the true route

    @property
    def fraction(self) -> float:
        """(d- + d+) / d0."""
        return (self.missed + self.extra) / self.driven


def route_mismatch(
    true: Sequence[ArrayLike], extended: Sequence[ArrayLike], found: Sequence[ArrayLike]
) -> Mismatch:
    """Compare routes by their geometry alone, however a program cuts and names its roads.

    Both are sampled every metre.  A sample is covered if one of the other route lies near
    it and points in the same direction: distance² + (turn as metres)² <= 2 (3 m)², where a turn of
    60° is 3 m.

    Args:
        true: Lines (k, 2) of the true route, plane m.
        extended: The same to the ends of its first and last edge, so that an answer of
            whole edges is not charged for them.
        found: Lines of the answer.

    Returns:
        Missed, extra and driven length.
    """
    truth, roomy, answer = _sample(true), _sample(extended), _sample(found)
    return Mismatch(_uncovered(truth, answer), _uncovered(answer, roomy), float(truth[:, 4].sum()))


def _sample(lines: Sequence[ArrayLike]) -> Array:
    """Samples (n, 5) of lines: x, y, direction as two lengths, length each stands for."""
    rows = [np.zeros((0, 5))]
    for line in lines:
        p = np.asarray(line, dtype=float)
        step = np.diff(p, axis=0)
        size = np.hypot(step[:, 0], step[:, 1]) if len(p) > 1 else np.zeros(0)
        k = np.flatnonzero(size > 1e-6)
        count = np.ceil(size[k] / _STEP).astype(np.int64)
        row, part = row_and_place(count)
        of, many = k[row], count[row]
        share = (part + 0.5) / many
        direction = step[of] / size[of, None]
        place = p[of] + share[:, None] * step[of]
        rows.append(np.column_stack([place, _TURN_RADIUS * direction, size[of] / many]))
    return np.concatenate(rows)


def _uncovered(a: Array, b: Array) -> float:
    """Length of samples `a` that have no near neighbour among samples `b`."""
    if not len(a) or not len(b):
        return float(a[:, 4].sum())
    low = np.minimum(a[:, :2].min(axis=0), b[:, :2].min(axis=0)) - _REACH
    columns = int((max(a[:, 0].max(), b[:, 0].max()) - low[0]) / _REACH) + 3
    b = b[np.argsort(_cell(b, low, columns), kind="stable")]
    keys = _cell(b, low, columns)
    home = _cell(a, low, columns)
    covered = np.zeros(len(a), dtype=bool)
    for row in (-1, 0, 1):  # three cells side by side are one run of keys
        first = np.searchsorted(keys, home + row * columns - 1)
        last = np.searchsorted(keys, home + row * columns + 1, side="right")
        open_ = np.flatnonzero((first < last) & ~covered)
        k = first[open_]
        while len(open_):
            gap = ((a[open_, :4] - b[k, :4]) ** 2).sum(axis=1)
            hit = gap <= _REACH**2
            covered[open_[hit]] = True
            k = k + 1
            go_on = ~hit & (k < last[open_])
            open_, k = open_[go_on], k[go_on]
    return float(a[~covered, 4].sum())


def _cell(samples: Array, low: Array, columns: int) -> NDArray[np.int64]:
    """Number of the square cell, one reach wide, that each sample lies in."""
    at = ((samples[:, :2] - low) / _REACH).astype(np.int64)
    cell: NDArray[np.int64] = at[:, 1] * columns + at[:, 0]
    return cell
