"""The path between points as lines, lengths, times and manoeuvres, for both services."""

import math
from typing import NamedTuple

import numpy as np

from ..geodesy.angles import bearing_of, radians, wrap_bearing, wrap_degrees
from ..observations import Array
from .matched_trace import Matched, Piece

HALF_TURN = 180.0  # degrees
_STRAIGHT, _SLIGHT, _NORMAL, _TURNED = 20.0, 60.0, 120.0, 170.0  # degrees of a turn
_JOINED = 1e-7  # degrees up to which ends of pieces are one place
_CORNER = 60.0  # degrees from which on a turn within one street is told


class Line(NamedTuple):
    """Pieces of the path drawn: piece k has the vertices first[k] up to first[k + 1]."""

    lat: Array  # degrees
    lon: Array
    first: list[int]
    begin: list[int]  # where each begins in the line that joins them

    def end(self, k: int) -> int:
        """Where piece k ends in the line that joins all."""
        return self.begin[k] + self.first[k + 1] - self.first[k] - 1

    def vertices(self, low: int, high: int) -> tuple[Array, Array]:
        """Latitudes and longitudes of pieces low to high - 1 as one line."""
        lat, lon = (v[self.first[low] : self.first[high]] for v in (self.lat, self.lon))
        keep = np.ones(len(lat), bool)
        for k in range(low + 1, high):  # the end of a piece is the start of the next, but at gaps
            keep[self.first[k] - self.first[low]] = self.begin[k] != self.end(k - 1)
        return lat[keep], lon[keep]


class Lengths(NamedTuple):
    """Of (n,) pieces."""

    metres: list[float]
    seconds: list[float]  # at the roads' usual speeds


class Step(NamedTuple):
    """A part of the way along one street."""

    low: int  # its first piece
    high: int  # after its last
    name: str
    turn: float  # degrees at its start, clockwise; 0 at the start of the way
    before: int  # bearing at its start, degrees; 0 at the start of the way
    after: int  # bearing with which it begins


def drawn(matched: Matched, pieces: list[Piece]) -> Line:
    """The pieces as lines, each of at least two vertices."""
    edge = np.array([piece.edge for piece in pieces], np.int64)
    start, end = (np.array([p[k] for p in pieces], np.float64) for k in (2, 3))
    x, y, first = matched.roads.edge_lines(edge, start, end)
    lat, lon = matched.roads.plane.to_geodetic(x, y)
    bounds, begin = first.tolist(), [0]
    for k in range(1, len(pieces)):
        at = bounds[k]
        apart = abs(lat[at] - lat[at - 1]) + abs(lon[at] - lon[at - 1]) > _JOINED
        begin.append(begin[-1] + at - bounds[k - 1] - 1 + int(apart))
    return Line(lat, lon, bounds, begin)


def lengths(matched: Matched, pieces: list[Piece]) -> Lengths:
    """Their lengths, and the times that they usually take."""
    edge = np.array([piece.edge for piece in pieces], np.int64)
    metres = [piece.end - piece.start for piece in pieces]
    speed = matched.roads.arrays.edges.speed[edge].tolist()
    return Lengths(metres, [m / max(v, 0.5) for m, v in zip(metres, speed, strict=True)])


def names_of(matched: Matched, pieces: list[Piece]) -> list[str]:
    """What the streets of pieces are called; empty: nothing."""
    edge = np.array([piece.edge for piece in pieces], np.int64)
    return [name or "" for name in matched.roads.names(edge)]


def whole(bearing_deg: float) -> int:
    """A bearing in whole degrees, 0 to 359."""
    return int(wrap_bearing(float(round(bearing_deg))))


def bearing(lat: Array, lon: Array, *, end: bool = False) -> int:
    """The bearing with which a line begins or ends, whole degrees."""
    order = range(len(lat) - 1)
    for k in reversed(order) if end else order:
        north = float(lat[k + 1] - lat[k])
        east = float(lon[k + 1] - lon[k]) * math.cos(radians(float(lat[k])))
        if abs(north) + abs(east) > 1e-9:
            return whole(bearing_of(math.atan2(north, east), 0.0))
    return 0


def bearings(line: Line) -> tuple[list[int], list[int]]:
    """Bearings with which each piece begins and ends, whole degrees."""
    spans = [(line.first[k], line.first[k + 1]) for k in range(len(line.first) - 1)]
    lines = [(line.lat[a:b], line.lon[a:b]) for a, b in spans]
    return [bearing(*one) for one in lines], [bearing(*one, end=True) for one in lines]


def steps_of(
    names: list[str], begins: list[int], ends: list[int], low: int, high: int
) -> list[Step]:
    """Pieces low to high - 1 by streets.

    Args:
        names: Of all pieces.
        begins: Bearings with which they begin.
        ends: And end.
        low: The first piece.
        high: After the last.
    """
    found = [Step(low, high, names[low], 0.0, 0, begins[low])]
    for k in range(low + 1, high):
        turn = wrap_degrees(float(begins[k] - ends[k - 1]))
        if names[k] != names[k - 1] or abs(turn) > _CORNER:
            found[-1] = found[-1]._replace(high=k)
            found.append(Step(k, high, names[k], turn, ends[k - 1], begins[k]))
    return found


def modifier(turn: float) -> str:
    """OSRM's word for a turn in degrees, clockwise."""
    size, side = abs(turn), "right" if turn > 0 else "left"
    if size >= _TURNED:
        return "uturn"
    if size < _STRAIGHT:
        return "straight"
    if size < _SLIGHT:
        return f"slight {side}"
    return side if size < _NORMAL else f"sharp {side}"
