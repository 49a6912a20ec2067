"""Angles, and positions on an edge: projection, point and heading at an abscissa.

The orthogonal projection of the paper's Figure 3, with the closest extremity where
the foot falls outside a segment; before the first and beyond the last vertex the
edge is prolonged straight, so that an abscissa may be below 0 or above the length.
"""

import math

from .._compile import kernel
from .network import Roads

HALF_CHORD = 6.0  # m either side; shorter sees the digitisation, longer cuts bends


@kernel
def wrap(angle: float) -> float:
    """Bring an angle into (-π, π]."""
    if -math.pi < angle <= math.pi:
        return angle
    wrapped = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    if wrapped <= -math.pi:  # the quotient was rounded up, or the angle is -π itself
        return min(wrapped + 2.0 * math.pi, math.pi)
    return min(wrapped, math.pi)


@kernel
def angle_of(x: float, y: float) -> float:
    """Angle of a vector, atan2(y, x); of one nearly along x without atan2, as exactly."""
    if x <= 0.0 or abs(y) > 0.1 * x:
        return math.atan2(y, x)
    t = y / x
    q = t * t
    rest = 1.0 / 7.0 - q * (1.0 / 9.0 - q * (1.0 / 11.0 - q / 13.0))
    return t * (1.0 - q * (1.0 / 3.0 - q * (0.2 - q * rest)))


@kernel
def project(
    roads: Roads, edge: int, segment: int, x: float, y: float
) -> tuple[int, float, float, float, float]:
    """Project a plane point on an edge, walking from a segment that was near before.

    Args:
        roads: The network.
        edge: Directed edge.
        segment: Vertex index at which to start looking.
        x: Point, plane.
        y: Point, plane.

    Returns:
        Segment (vertex index), abscissa (true m, may leave [0, length]), lateral offset
        (plane units, right of the driving direction positive), unit tangent (tx, ty).
    """
    first = roads.edges[edge].first_vertex
    last = roads.edges[edge].last_vertex - 1
    i = min(max(segment, first), last)
    direction = 0
    while True:
        a = roads.vertices[i]
        b = roads.vertices[i + 1]
        dx = b.x - a.x
        dy = b.y - a.y
        length2 = dx * dx + dy * dy
        t = ((x - a.x) * dx + (y - a.y) * dy) / length2
        if t > 1.0 and i < last and direction >= 0:
            direction = 1
            i += 1
            continue
        if t < 0.0 and i > first:
            if direction == 1:
                t = 0.0  # outer side of a bend: the vertex is closest
                break
            direction = -1
            i -= 1
            continue
        if t > 1.0 and i < last:
            t = 1.0
        break
    length = math.sqrt(length2)
    tx = dx / length
    ty = dy / length
    a = roads.vertices[i]
    across = (x - a.x) * ty - (y - a.y) * tx
    s = a.s + t * (roads.vertices[i + 1].s - a.s)
    return i, s, across, tx, ty


@kernel
def locate(
    roads: Roads, edge: int, segment: int, s: float
) -> tuple[int, float, float, float, float]:
    """Point and unit tangent at an abscissa (prolonged beyond the ends).

    Returns:
        Segment (vertex index), x, y (plane), tx, ty.
    """
    first = roads.edges[edge].first_vertex
    last = roads.edges[edge].last_vertex - 1
    i = min(max(segment, first), last)
    while i < last and s > roads.vertices[i + 1].s:
        i += 1
    while i > first and s < roads.vertices[i].s:
        i -= 1
    a = roads.vertices[i]
    b = roads.vertices[i + 1]
    dx = b.x - a.x
    dy = b.y - a.y
    t = (s - a.s) / (b.s - a.s)
    length = math.sqrt(dx * dx + dy * dy)
    return i, a.x + t * dx, a.y + t * dy, dx / length, dy / length


@kernel
def chord_heading(roads: Roads, edge: int, segment: int, s: float, half: float) -> float:
    """Heading of the chord from `half` metres before to `half` metres after s, rad."""
    dx, dy = chord(roads, edge, segment, s, half)
    return math.atan2(dy, dx)


@kernel
def chord(roads: Roads, edge: int, segment: int, s: float, half: float) -> tuple[float, float]:
    """The chord itself, plane units; the tangent where it has no length."""
    length = roads.edges[edge].length
    low = min(max(s - half, 0.0), max(length - half, 0.0))
    high = max(min(s + half, length), min(half, length))
    i, ax, ay, tx, ty = locate(roads, edge, segment, low)
    _, bx, by, _, _ = locate(roads, edge, i, high)
    dx = bx - ax
    dy = by - ay
    if dx * dx + dy * dy < 1e-6:
        return tx, ty
    return dx, dy


@kernel
def turn_within(roads: Roads, edge: int, segment: int, begin: float, end: float) -> float:
    """By how much the road's chord of 12 m turns between two abscissae of an edge, rad."""
    if is_straight(roads, edge):
        return 0.0
    length = roads.edges[edge].length
    ax, ay = chord(roads, edge, segment, min(max(begin, 0.0), length), HALF_CHORD)
    bx, by = chord(roads, edge, segment, min(max(end, 0.0), length), HALF_CHORD)
    return angle_of(ax * bx + ay * by, ax * by - ay * bx)


@kernel
def is_straight(roads: Roads, edge: int) -> bool:
    """Whether an edge is one segment."""
    return bool(roads.edges[edge].last_vertex - roads.edges[edge].first_vertex == 1)
