"""Lateral profile: the path of the car from lanes, rounded corners and map error, without time."""

from typing import NamedTuple

import numpy as np

from ..graph.network import Roads
from ..observations import Array
from .map_error_field import MapErrorField
from .route_choice import Edges
from .simulation_settings import SimulationSettings

_STEP = 1.0  # m, between points of the path
_LANE_BLEND = 12.0  # m, sigma of the Gaussian that smooths a change of lane
_FAST = 12.0  # m/s, limit above which a road has a second lane
_INSIDE = 0.3  # of a bend's radius: how far inside the centre line a car can follow
_TIGHTEST = 0.25  # 1/m, the tightest bend of the rear axle's middle
_WIDTHS = (3.0,) * 8 + (6.0,) * 4  # m, rounds of relaxing what is tighter
_VISIT_BEND = 0.01  # 1/m, largest curvature at which a lane is changed


class VehiclePath(NamedTuple):
    """The path of M on an even grid along the route's centre line, shape (n,) each.

    World and map frames are both in the map's plane; the world is the map's path
    moved by the map error.  M has no sideslip, so its heading is the direction of the path.
    """

    along: Array  # true m along the route's centre lines
    travelled: Array  # true m along the path itself
    x: Array  # m, plane, world frame
    y: Array
    heading: Array  # rad, continuous (not wrapped)
    map_x: Array  # m, plane, map frame
    map_y: Array
    edges: Edges  # (r,) the route
    entry: Array  # (r + 1,) true m along the route where each edge begins; the last is its end


def gauss_markov(times: Array, sigma: float, scale: float, random: np.random.Generator) -> Array:
    """First-order Gauss-Markov process at `times` (n,), two independent columns (n, 2)."""
    keep = np.exp(-np.diff(times, prepend=times[:1]) / scale)
    draws = random.normal(0.0, sigma, (len(times), 2))
    draws[1:] *= np.sqrt(1.0 - keep[1:, None] ** 2)
    value, out = 0.0j, []
    for k, e in zip(keep.tolist(), (draws @ [1, 1j]).tolist(), strict=True):
        value = k * value + e
        out.append(value)
    complex_out = np.array(out, dtype=complex)
    return np.column_stack([complex_out.real, complex_out.imag])


def smooth(values: Array, sigma: float) -> Array:
    """Gaussian average over `sigma` metres of grid values (n,); ends continue straight."""
    reach = int(np.ceil(3.0 * sigma / _STEP))
    if reach == 0 or len(values) < 2:
        return values
    k = np.arange(-reach, reach + 1)
    weight = np.exp(-0.5 * (k * _STEP / sigma) ** 2)
    run = np.arange(1, reach + 1)
    before = values[0] - (values[1] - values[0]) * run[::-1]
    after = values[-1] + (values[-1] - values[-2]) * run
    padded = np.concatenate([before, values, after])
    return np.convolve(padded, weight / weight.sum(), mode="valid")


def _centre_line(roads: Roads, edges: Edges) -> tuple[Array, Array, Array, Array]:
    """Grid of positions along, x, y of the route's centre lines, and where each edge begins."""
    entry = np.concatenate([[0.0], np.cumsum(roads.edges.length[edges])])
    rows = roads.edges[edges]
    ranges = zip(rows.first_vertex.tolist(), rows.last_vertex.tolist(), strict=True)
    part = [roads.vertices[first : last + 1] for first, last in ranges]
    s = np.concatenate([p.s + begin for p, begin in zip(part, entry, strict=False)])
    along = np.linspace(0.0, entry[-1], max(2, int(np.ceil(entry[-1] / _STEP)) + 1))
    x = np.interp(along, s, np.concatenate([p.x for p in part]))
    y = np.interp(along, s, np.concatenate([p.y for p in part]))
    return along, x, y, entry


def _bend(x: Array, y: Array) -> Array:
    """Curvature of a grid line, 1/m, left positive, (n,)."""
    dx, dy = np.gradient(x), np.gradient(y)
    step = np.maximum(np.hypot(dx, dy), 1e-3 * _STEP)
    bend: Array = np.gradient(np.unwrap(np.arctan2(dy, dx))) / step
    return bend


def _widen(x: Array, y: Array) -> tuple[Array, Array]:
    """Smooth a line where its curvature exceeds what a car can steer."""
    for width in _WIDTHS:
        share = np.clip((np.abs(_bend(x, y)) - 0.7 * _TIGHTEST) / (0.3 * _TIGHTEST), 0.0, 1.0)
        if not share.any():
            break
        share = smooth(share, width + 1.0)
        x, y = x + share * (smooth(x, width) - x), y + share * (smooth(y, width) - y)
    return x, y


def _offset(
    roads: Roads,
    edges: Edges,
    entry: Array,
    along: Array,
    bend: Array,
    settings: SimulationSettings,
    random: np.random.Generator,
) -> Array:
    """Lateral offset of the car, metres right of the centre line, (n,)."""
    on = np.clip(np.searchsorted(entry, along, side="right") - 1, 0, len(edges) - 1)
    own = random.normal(0.0, settings.street_sigma, len(edges))
    offset = (roads.edges.lane[edges] + own)[on]
    can_change = (roads.edges.speed[edges][on] > _FAST) & (smooth(np.abs(bend), 20.0) < _VISIT_BEND)
    for begin in _poisson(settings.lane_change_rate, along[-1], random):
        visit = (along > begin) & (along < begin + random.uniform(100.0, 400.0))
        offset[visit & can_change] -= settings.lane_width
    offset = smooth(offset, _LANE_BLEND)
    coarse = np.linspace(0.0, along[-1], max(2, int(along[-1] / 10.0)))
    stray = gauss_markov(coarse, settings.lane_sigma, settings.lane_length, random)[:, 0]
    offset += smooth(np.interp(along, coarse, stray), 6.0)
    return offset if settings.driving_side == "right" else -offset


def _poisson(rate: float, length: float, random: np.random.Generator) -> Array:
    """Where independent events of `rate` per metre happen over `length` metres."""
    return random.uniform(0.0, length, random.poisson(rate * length))


def draw_path(
    roads: Roads,
    edges: Edges,
    error_field: MapErrorField,
    settings: SimulationSettings,
    random: np.random.Generator,
) -> VehiclePath:
    """Lay the path of M along a route.

    The centre line's corners are rounded, the lane's offset is added (less of it on the
    inside of tight bends, where no car could follow), and the map's error moves the whole.

    Args:
        roads: The network.
        edges: (r,) connected edges in driving order.
        error_field: World minus map.
        settings: Lanes and corners.
        random: Source of chance.

    Returns:
        The path from the start of the first edge to the end of the last.
    """
    along, x, y, entry = _centre_line(roads, edges)
    x, y = smooth(x, settings.corner_smoothing), smooth(y, settings.corner_smoothing)
    bend = smooth(_bend(x, y), 2.0)
    offset = _offset(roads, edges, entry, along, bend, settings, random)
    most = _INSIDE / np.maximum(-bend, 1e-3)  # right of the line, in right-hand bends
    least = -_INSIDE / np.maximum(bend, 1e-3)
    offset = smooth(np.clip(offset, least, most), 4.0)
    dx, dy = np.gradient(x), np.gradient(y)
    step = np.hypot(dx, dy)
    map_x, map_y = _widen(smooth(x + offset * dy / step, 2.0), smooth(y - offset * dx / step, 2.0))
    shift = error_field.at(map_x, map_y)
    x, y = map_x + shift[:, 0], map_y + shift[:, 1]
    scale = 1.0 + roads.plane.curvature[0] * (x**2 + y**2)
    pieces = np.hypot(np.diff(x), np.diff(y)) / (0.5 * (scale[1:] + scale[:-1]))
    heading = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
    return VehiclePath(
        along=along,
        travelled=np.concatenate([[0.0], np.cumsum(pieces)]),
        x=x,
        y=y,
        heading=heading,
        map_x=map_x,
        map_y=map_y,
        edges=edges,
        entry=entry,
    )
