"""How the places of a drive lie to the roads, and by which shift of all of them they fit."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..graph.network import Roads
from ..observations import Array

_APART = 100.0  # m between the places that are looked at
_FEWEST, _MOST = 15, 60  # of these
_CELLS, _SPREAD = 50.0, 0.4  # m, of cells, and of places: who works a field meets fewer of these
_BOX = 2500.0  # m from the middle of these, within which roads are drawn
_FARTHEST = 700.0  # m, the largest shift
_CELL = 10.0  # m, of the drawing
CAP = 50.0  # m, beyond which a place is far from every road
_FITS = 10.0  # m from the roads on average, that moved places are at most,
_BETTER, _UNIQUE = 2.5, 1.4  # and how much farther without a shift, and by one elsewhere
_ELSEWHERE = 60.0  # m from the best shift


class Fit(NamedTuple):
    """How the places of a drive lie to the roads, m."""

    away: float  # from these on average, at most 50 each
    shift: tuple[float, float] | None  # the only one to the east and north by which they fit


def fit_to_roads(x: Array, y: Array, roads: Roads) -> Fit | None:
    """How far the places of a drive are from roads, and by which shift they lie on them.

    Args:
        x: (n,) m, plane: places in the order of the drive.
        y: (n,) m.
        roads: The map.

    Returns:
        None: there are too few, 100 m apart.
    """
    way = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    at = np.unique(np.searchsorted(way, np.arange(0.0, way[-1], _APART)))
    x, y = x[at], y[at]
    middle = np.median(x), np.median(y)
    near = (np.abs(x - middle[0]) < _BOX) & (np.abs(y - middle[1]) < _BOX)
    x, y = x[near][:_MOST], y[near][:_MOST]
    if len(x) < _FEWEST:
        return None
    half = int((_BOX + _FARTHEST) // _CELL) + 1
    away = _away(_drawn(roads, middle, half))
    column = np.floor((x - middle[0]) / _CELL).astype(np.int64) + half
    row = np.floor((y - middle[1]) / _CELL).astype(np.int64) + half
    steps = np.arange(-int(_FARTHEST // _CELL), int(_FARTHEST // _CELL) + 1)
    off = np.zeros((len(steps), len(steps)))
    low, high = steps[0], steps[-1] + 1
    for c, r in zip(column.tolist(), row.tolist(), strict=True):
        off += away[r + low : r + high, c + low : c + high]
    off /= len(x)
    i, j = np.unravel_index(np.argmin(off), off.shape)
    far = np.hypot(steps[:, None] - steps[i], steps - steps[j]) * _CELL > _ELSEWHERE
    none = len(steps) // 2
    best, now = float(off[i, j]), float(off[none, none])
    met = len(np.unique(np.column_stack([x // _CELLS, y // _CELLS]), axis=0))
    fits = (
        met >= max(_FEWEST, _SPREAD * len(x))
        and best < _FITS
        and now > _BETTER * best
        and off[far].min() > _UNIQUE * best
    )
    shift = _CELL * float(steps[j]), _CELL * float(steps[i])
    return Fit(now, shift if fits else None)


def _away(drawn: NDArray[np.bool_]) -> Array:
    """How far each cell is from those that are drawn, m, at most 50."""
    most = round(CAP / _CELL)
    square = np.where(drawn, 0.0, most**2)
    for table in (square, square.T):  # along rows, then along columns
        before = table.copy()
        for k in range(1, most):
            np.minimum(table[:, k:], before[:, :-k] + k * k, out=table[:, k:])
            np.minimum(table[:, :-k], before[:, k:] + k * k, out=table[:, :-k])
    return _CELL * np.sqrt(square)


def _drawn(roads: Roads, middle: tuple[float, float], half: int) -> NDArray[np.bool_]:
    """Cells about a place that roads pass through."""
    vertices, edges = roads.vertices.view(np.ndarray), roads.edges.view(np.ndarray)
    reach = _CELL * half
    x, y = vertices["x"] - middle[0], vertices["y"] - middle[1]
    inner = (np.abs(x) < reach) & (np.abs(y) < reach)
    last = np.zeros(len(x), np.bool_)
    last[edges["last_vertex"]] = True
    a = np.flatnonzero((inner[:-1] | inner[1:]) & ~last[:-1])
    cells = np.ceil(np.hypot(x[a + 1] - x[a], y[a + 1] - y[a]) / _CELL).astype(np.int64) + 1
    line = np.repeat(np.arange(len(a)), cells)
    share = (np.arange(len(line)) - np.repeat(np.cumsum(cells) - cells, cells)) / cells[line]
    px = x[a][line] + share * (x[a + 1] - x[a])[line]
    py = y[a][line] + share * (y[a + 1] - y[a])[line]
    drawn = np.zeros((2 * half, 2 * half), np.bool_)
    column, row = np.floor(px / _CELL).astype(int) + half, np.floor(py / _CELL).astype(int) + half
    held = (column >= 0) & (row >= 0) & (column < 2 * half) & (row < 2 * half)
    drawn[row[held], column[held]] = True
    return drawn
