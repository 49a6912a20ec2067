"""A link of the history along a road: F, Q and mean of position and heading.

The equations and the noise are those of `filter.motion` and `filter.along` (corners).
"""

import math
from typing import NamedTuple

from ..._compile import Record, Vector, kernel
from ...graph.geometry import locate, project, turn_within, wrap
from ...graph.network import Roads
from ..along import CORNER, CORNER_RADIUS, keep_about
from ..motion import Noise, rate_of_turn
from ..state import MX, MY, OFF_ROAD, D, H, K, Path, X, Y
from ..weaving import derivatives, weave
from .history import History

_ENTRIES = 256  # of the path tree between two steps, at most
_PACKED_HEADING = H * D - H * (H - 1) // 2  # of the heading in packed noise of X, Y, H, K, B


class Link(NamedTuple):
    """A link of the graph."""

    step: int  # of j
    i: int  # node of the step before
    j: int  # node


class Advance(NamedTuple):
    """A displacement along the path from the edge of then to the edge of now."""

    then_edge: int
    then_segment: int
    edge: int
    skipped: float  # from the start of the edge of then to the start of the edge of now, m
    distance: float  # driven, m
    odometer: float  # derivative of the distance by κ


@kernel(inline=True)
def keep_heading(model: Record, history: History, roads: Roads, link: Link) -> None:
    """The vehicle's own heading, where courses were heard, turns with the road within an edge."""
    edge = history.nodes[link.j].edge
    then = history.nodes[link.i]
    begin = 0.0
    if then.edge == edge:
        begin = _along(roads, edge, then.segment, model.then_mean, model.scale)
    segment = history.nodes[link.j].segment
    end = _along(roads, edge, segment, model.mu, model.scale)
    turn = turn_within(roads, edge, segment, begin, end)
    model.mu[H] = wrap(model.then_mean[H] + turn)
    model.f[H, H] = 1.0
    model.f[H, K] = rate_of_turn(turn, model.then_mean[K])
    model.q[H] = history.steps[link.step].motion.plane_noise[_PACKED_HEADING]


@kernel
def _along(roads: Roads, edge: int, segment: int, mean: Vector, scale: float) -> float:
    """Abscissa of a state on an edge, m."""
    x = mean[X] + scale * mean[MX]
    y = mean[Y] + scale * mean[MY]
    _, s, _, _, _ = project(roads, edge, segment, x, y)
    return s


@kernel(inline=True)
def move_on_road(model: Record, roads: Roads, advance: Advance, corners: bool) -> float:
    """Moved along the road, as `motion.predict_road` does; F and the mean are set.

    Args:
        model: In place; Q is left alone.
        roads: The network.
        advance: The displacement.
        corners: Whether corners of the map are driven as arcs.

    Returns:
        The turn between the two tangents, at most 1.6 rad.
    """
    mean = model.then_mean
    scale = model.scale
    qx = mean[X] + scale * mean[MX]
    qy = mean[Y] + scale * mean[MY]
    _, s, across, tx, ty = project(roads, advance.then_edge, advance.then_segment, qx, qy)
    s += advance.distance - advance.skipped
    edge = advance.edge
    segment, cx, cy, nx, ny = locate(roads, edge, roads.edges[edge].first_vertex, s)
    heading = math.atan2(ny, nx)
    turn = wrap(heading - math.atan2(ty, tx))
    bent = min(abs(turn), 1.6)
    if corners and bent > CORNER:
        s += CORNER_RADIUS * (2.0 * math.tan(0.5 * bent) - bent)
        segment, cx, cy, nx, ny = locate(roads, edge, segment, s)
    c = math.cos(turn)
    sine = math.sin(turn)
    f = model.f
    f[X, X] = c
    f[X, Y] = -sine
    f[Y, X] = sine
    f[Y, Y] = c
    f[X, MX] = c - 1.0
    f[X, MY] = -sine
    f[Y, MX] = sine
    f[Y, MY] = c - 1.0
    f[X, K] = nx * advance.odometer
    f[Y, K] = ny * advance.odometer
    f[K, K] = 1.0
    model.mu[X] = cx + across * ny - scale * mean[MX]
    model.mu[Y] = cy - across * nx - scale * mean[MY]
    model.mu[H] = heading
    model.mu[K] = mean[K]
    model.about = wrap(mean[H] - math.atan2(ty, tx))
    return bent


@kernel
def move_with_lane(model: Record, kept: float, lanes: tuple[float, float, float]) -> None:
    """Moved across the road with its lane offset, as `hypotheses.lane_offset.change_lane` does.

    Args:
        model: F, Q and the mean are those along the road; in place.
        kept: What is kept of the lane offset at the node.
        lanes: Usual lane offset before and after, m, and its sigma after.
    """
    old, new, sigma = lanes
    nx, ny = math.sin(model.mu[H]), -math.cos(model.mu[H])  # to the right
    share = kept - 1.0
    shift = new - old + share * (model.then_mean[D] - old)
    model.mu[X] += model.scale * nx * shift
    model.mu[Y] += model.scale * ny * shift
    model.f[X, D] += share * nx
    model.f[Y, D] += share * ny
    moves = (new - old) ** 2
    variance = (1.0 - kept * kept) * sigma * sigma + moves
    model.q[D] += moves
    model.q[X] += variance * nx * nx
    model.q[Y] += variance * ny * ny
    model.cov[X, Y] += variance * nx * ny
    model.cov[X, D] += variance * nx
    model.cov[Y, D] += variance * ny


@kernel(inline=True)
def weave_on_road(model: Record, roads: Roads, advance: Advance) -> None:
    """Moved by the heading, as `along.advance_along` does where fixes are fine and frequent.

    Args:
        model: F and the mean are set; Q is left alone.
        roads: The network.
        advance: The displacement.
    """
    mean, scale, f = model.then_mean, model.scale, model.f
    qx, qy = mean[X] + scale * mean[MX], mean[Y] + scale * mean[MY]
    _, _, _, tx, ty = project(roads, advance.then_edge, advance.then_segment, qx, qy)
    way = weave(mean, (tx, ty), advance.odometer)
    x, y, u, v = derivatives(way, (tx, ty), advance.odometer)
    ahead = Advance(
        advance.then_edge, advance.then_segment, advance.edge, advance.skipped, way.ahead,
        advance.odometer,
    )  # fmt: skip
    bent = move_on_road(model, roads, ahead, False)
    if bent > CORNER:  # straight on, whichever edge it comes to be on
        model.mu[X] = mean[X] + scale * (way.ahead * tx - way.aside * ty)
        model.mu[Y] = mean[Y] + scale * (way.ahead * ty + way.aside * tx)
        model.mu[H] = math.atan2(ty, tx)
        f[X, X] = f[Y, Y] = 1.0
        f[X, Y] = f[Y, X] = f[X, MX] = f[X, MY] = f[Y, MX] = f[Y, MY] = 0.0
        f[X, K], f[Y, K] = tx * advance.odometer, ty * advance.odometer
    c, s = f[X, X], f[Y, X]
    nx, ny = math.cos(model.mu[H]), math.sin(model.mu[H])
    if bent <= CORNER:
        model.mu[X] -= scale * way.aside * ny
        model.mu[Y] += scale * way.aside * nx
    f[X, H], f[Y, H] = c * x - s * y, s * x + c * y
    f[X, K] += c * u - s * v
    f[Y, K] += s * u + c * v


@kernel
def wobble(model: Record, advance: Advance, bent: float, variance: float) -> None:
    """The heading about the road's, of which a share is kept, as `along.advance_along` does.

    Args:
        model: Its heading is the road's; in place.
        advance: The displacement.
        bent: Turn of the road, rad.
        variance: Of headings about roads, rad².
    """
    keep, rate = keep_about(model.about, advance.distance, bent)
    model.mu[H] = wrap(model.mu[H] + keep * model.about)
    model.f[H, H] = keep
    model.f[H, K] = rate * advance.odometer
    model.q[H] = (1.0 - keep * keep) * variance


@kernel
def add_road_noise(model: Record, noise: Noise) -> None:
    """Q of a motion along a road with the heading predicted."""
    nx = math.cos(model.mu[H])
    ny = math.sin(model.mu[H])
    cov = model.cov
    cov[X, Y] = (noise.along - noise.across) * nx * ny
    cov[X, K] = noise.cross * nx
    cov[Y, K] = noise.cross * ny
    q = model.q
    q[X] = noise.along * nx * nx + noise.across * ny * ny
    q[Y] = noise.along * ny * ny + noise.across * nx * nx
    q[H] = noise.heading
    q[K] = noise.rate


@kernel
def skipped_along(roads: Roads, path: Path, history: History, link: Link) -> tuple[float, float]:
    """Metres and seconds from the start of the edge of i to the start of the edge of j.

    By the path tree; metres are negative where it does not connect them.
    """
    then = history.nodes[link.i]
    edge = history.nodes[link.j].edge
    if edge == then.edge:
        return 0.0, 0.0
    total = 0.0
    time = 0.0
    entry = history.nodes[link.j].path_entry
    for _ in range(_ENTRIES):
        entry = path.entry[entry].parent if entry >= 0 else -1
        if entry < 0:
            break
        before = path.entry[entry].edge
        if before == OFF_ROAD or roads.edges[edge].opposite == before:
            break
        length = roads.edges[before].length
        total += length
        time += length / max(roads.edges[before].speed, 1.0)
        if entry == then.path_entry or before == then.edge:
            return total, time
        edge = before
    return -1.0, 0.0
