"""Which point objects are near the vehicle in a straight line, and how probably."""

import math

from ..._compile import Record, entry, kernel
from ...graph.index import cell_key, find
from ...graph.network import Roads, plane_scale
from ..gaussian import normal_cdf
from .point_objects import CELL, LEAST, REACH, Findings, Places, add, finish

_STEPS = 32  # of an integral over a circle


@kernel
def within_circle(dx: float, dy: float, xx: float, xy: float, yy: float, radius: float) -> float:
    """P(a Gaussian vector is shorter than a radius).

    Args:
        dx: Its mean.
        dy: As above.
        xx: Its covariance.
        xy: As above.
        yy: As above.
        radius: In the same unit.
    """
    middle = 0.5 * (xx + yy)
    half_width = math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    major = math.sqrt(max(middle + half_width, 1e-12))
    minor = math.sqrt(max(middle - half_width, 1e-12))
    away = math.sqrt(dx * dx + dy * dy)
    if away + REACH * major < radius:
        return 1.0
    if away - REACH * major > radius:
        return 0.0
    axis = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c = math.cos(axis)
    s = math.sin(axis)
    u = c * dx + s * dy
    v = c * dy - s * dx
    low = max(-radius, u - REACH * major)
    high = min(radius, u + REACH * major)
    step = (high - low) / _STEPS
    total = 0.0
    for k in range(_STEPS):
        t = low + (k + 0.5) * step
        half = math.sqrt(max(radius * radius - t * t, 0.0))
        z = (t - u) / major
        across = normal_cdf((half - v) / minor) - normal_cdf((-half - v) / minor)
        total += math.exp(-0.5 * z * z) * across
    return min(max(total * step * 0.3989422804014327 / major, 0.0), 1.0)


@kernel
def _near(stance: Record, place: Record, scale: float, radius: float) -> tuple[float, float, float]:
    """P that a place is within a radius, and mean and variance of its distance (m, m²)."""
    extra = place.sigma * place.sigma
    if place.on_map == 1:
        dx, dy = (place.x - stance.map_x) / scale, (place.y - stance.map_y) / scale
        xx, xy, yy = stance.map_xx + extra, stance.map_xy, stance.map_yy + extra
    else:
        dx, dy = (place.x - stance.x) / scale, (place.y - stance.y) / scale
        xx, xy, yy = stance.xx + extra, stance.xy, stance.yy + extra
    p = within_circle(dx, dy, xx, xy, yy, radius)
    square = dx * dx + dy * dy
    away = math.sqrt(square)
    if square < xx + yy:  # about here: no direction
        return p, math.sqrt(square + 0.5 * (xx + yy)), 0.5 * (xx + yy)
    radial = (dx * dx * xx + 2.0 * dx * dy * xy + dy * dy * yy) / square
    return p, away + 0.5 * (xx + yy - radial) / away, radial


@entry
def find_nearby(
    count: int, radius: float, known: float, farthest: float, roads: Roads, places: Places,
    work: Findings,
) -> int:  # fmt: skip
    """Find the places within a radius of the vehicle.

    Args:
        count: Stances in the buffer.
        radius: m.
        known: P(one of these is right).
        farthest: Largest sigma of a place, m.
        roads: The network, for the plane's scale.
        places: The places.
        work: `found` is filled: distance is that in a straight line.

    Returns:
        How many were found, the nearest first.
    """
    found = 0
    for i in range(count):
        stance = work.stance[i]
        if stance.p < LEAST:
            continue
        scale = plane_scale(roads, stance.x, stance.y)
        variance = max(stance.xx + stance.yy, stance.map_xx + stance.map_yy)
        reach = radius + REACH * math.sqrt(variance + farthest * farthest)
        reach = scale * reach + abs(stance.map_x - stance.x) + abs(stance.map_y - stance.y)
        low = math.floor((stance.y - reach) / CELL)
        high = math.floor((stance.y + reach) / CELL)
        column = math.floor((stance.x - reach) / CELL)
        while column <= math.floor((stance.x + reach) / CELL):
            at = find(places.key, cell_key(column, low))
            last = cell_key(column, high)
            while at < len(places.key) and places.key[at] <= last:
                place = int(places.in_cell[at])
                p, mean, variance = _near(stance, places.place[place], scale, radius)
                if p > 0.0:
                    found = add(work, found, place, p * stance.p, mean, variance)
                at += 1
            column += 1
    return finish(work, found, known)
