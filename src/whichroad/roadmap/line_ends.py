"""Where lines of a table end, in the plane: places in which ends lie together."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..observations import Array
from .lines import Lines
from .streets import Ints

EXACT = 0.05  # m within which an end was drawn at another one, or on a line

Mask = NDArray[np.bool_]


@dataclass(slots=True)
class Drawing:
    """Lines in the plane, and the places where they end.  n lines, V vertices, G places."""

    first: Ints  # (n+1,) first vertex of each line
    x: Array  # (V,) m
    y: Array
    level: Ints  # (n,) only a road that goes on passes from one to another
    place: Ints  # (2n,) place of each end: of each line's beginning and end
    some: Ints  # (G,) one of the ends there
    end_level: Ints  # (G,) ends of different ones do not meet
    road: Ints  # (n,) the same number for rows that draw the same road
    length: Array  # (n,) m

    def lone(self) -> Mask:
        """(G,) whether one road ends there, and no other."""
        low, high = np.full(len(self.some), len(self.road)), np.full(len(self.some), -1)
        road = np.repeat(self.road, 2)
        np.minimum.at(low, self.place, road)
        np.maximum.at(high, self.place, road)
        lone: Mask = low == high
        begin, end = self.place[0::2], self.place[1::2]
        lone[begin[begin == end]] = False  # a ring
        return lone

    def vertex(self, end: Ints, inwards: int = 0) -> Ints:
        """The vertices of ends, or those so many further in."""
        last = end % 2
        return np.asarray(self.first[end // 2 + last] - last + (1 - 2 * last) * inwards)

    def xy(self) -> Array:
        """(G, 2) the places, m."""
        v = self.vertex(self.some)
        return np.column_stack([self.x[v], self.y[v]])

    def outwards(self, end: Ints) -> Array:
        """(k, 2) unit vectors in which lines end."""
        v, w = self.vertex(end), self.vertex(end, 1)
        d = np.column_stack([self.x[v] - self.x[w], self.y[v] - self.y[w]])
        return np.asarray(d / np.maximum(np.hypot(*d.T), 1e-9)[:, None])

    def shapes(self) -> NDArray[Any]:
        """(n,) the lines."""
        import shapely

        line = np.repeat(np.arange(len(self.road)), np.diff(self.first))
        return np.asarray(shapely.linestrings(self.x, self.y, indices=line))

    def move(self, to: dict[int, tuple[float, float]]) -> None:
        """Put some places elsewhere, with all lines that end there."""
        target = np.full((len(self.some), 2), np.nan)
        if to:
            target[list(to)] = list(to.values())
        end = np.flatnonzero(np.isfinite(target[self.place, 0]))
        v = self.vertex(end)
        self.x[v], self.y[v] = target[self.place[end]].T


def drawing(lines: Lines, x: Array, y: Array, level: Ints, label: Ints, end_level: Ints) -> Drawing:
    """The places where lines end.

    Args:
        lines: n lines.
        x: (V,) their vertices, m.
        y: (V,) m.
        level: (n,) their levels.
        label: (2n,) for each end the first of those in the same place.
        end_level: (2n,) levels of ends.
    """
    some, place = np.unique(label, return_inverse=True)
    total = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    length = total[lines.first[1:] - 1] - total[lines.first[:-1]]
    pair = np.sort(place.reshape(-1, 2), axis=1)
    alike = np.column_stack([pair, np.diff(lines.first), np.round(length / EXACT)])
    road = np.unique(alike, axis=0, return_inverse=True)[1].ravel()
    return Drawing(
        lines.first, x.copy(), y.copy(), level, place, some, end_level[some], road, length
    )
