"""Map observations: the paper's multi-Gaussian Y_carto.

All hypotheses, off-road included, see the same rows with the same noise, so that
their likelihoods are densities of the same quantity and may be compared.
"""

import math
from typing import NamedTuple

from .._compile import Record, entry, kernel
from ..graph.geometry import (
    HALF_CHORD,
    angle_of,
    chord,
    chord_heading,
    is_straight,
    locate,
    project,
    wrap,
)
from ..graph.network import Roads, is_at_node, parts
from .beside import gain_beside, update_beside
from .gaussian import LOG_2PI, update, update_across, update_state
from .haste import weigh_haste
from .one_course import ROWS, weigh_rows
from .slow_states import decay_map, map_decay
from .state import MX, MY, OFF_ROAD, START, Belief, Context, D, H, N, X, Y, lane_mean, lane_sigma
from .unmapped import followed

_MIDDLE, _NEAR, _FAR = 0.402, 0.244, 0.055  # normal weights at 0, ±σ, ±2σ, summing to one
_WIDEST = 15.0  # m, sigma of an abscissa up to which the road is looked at
_SPAN = 2.0 * (_NEAR + 4.0 * _FAR)  # Σ w x² / σ²
_CORRELATION = 5.0  # m driven within which the errors of map rows are one error
_LEAST_SPACING = 0.1  # m
_LIGHT = 1e-3  # weight below which a hypothesis does not decide the rows' variance
_FORKS = 0.1, 0.4  # sine of the angle at which a road forks off, and no corner is turned
_SHALLOW = 0.2  # sine below which roads of one lane are left as they are drawn
_APART = 8.0  # m, between two roads from which on they are driven as they are drawn
_FORK = 60.0  # m from a node, at most, until they are
_HEADING, _SLOPE = range(2)  # scratch of a hypothesis
INNOVATION, VARIANCE = 3, 4  # the same: of the heading of its road


class RoadNoise(NamedTuple):
    """Variances of the map's rows in one epoch, the same for all hypotheses."""

    lateral: float  # m²
    heading: float  # rad²
    on_road: float  # weight on the roads


@kernel
def track(belief: Belief, roads: Roads, i: int) -> None:
    """Project hypothesis i, shifted into the map's frame, on its edge.

    Sets its segment, abscissa and along-track sigma, its lateral offset and the unit tangent.
    """
    hyp = belief.hyp[i]
    scale = belief.state[0].scale
    mean = hyp.mu
    cov = hyp.cov
    qx = mean[X] + scale * mean[MX]
    qy = mean[Y] + scale * mean[MY]
    segment, s, across, tx, ty = project(roads, hyp.edge, hyp.segment, qx, qy)
    hyp.segment = segment
    hyp.along = s
    vxx = cov[X, X] + 2.0 * cov[X, MX] + cov[MX, MX]
    vyy = cov[Y, Y] + 2.0 * cov[Y, MY] + cov[MY, MY]
    vxy = cov[X, Y] + cov[X, MY] + cov[Y, MX] + cov[MX, MY]
    hyp.along_sigma = math.sqrt(max(tx * tx * vxx + 2.0 * tx * ty * vxy + ty * ty * vyy, 1e-4))
    hyp.lateral = across / scale
    hyp.tangent[0] = tx
    hyp.tangent[1] = ty


@kernel
def map_is_due(state: Record, ctx: Context) -> bool:
    """Whether the map is observed in this epoch: by distance, in the paper by time."""
    par = ctx.par[0]
    if state.motion == START:
        return True
    if par.paper:
        return bool(state.time - state.map_time > par.paper_step - 1e-3)
    return bool(state.since_map >= par.map_spacing)


@kernel
def observe_roads(belief: Belief, ctx: Context, with_heading: bool) -> None:
    """Observe the map, and whether its roads are driven at the vehicle's speed."""
    weigh_haste(belief, ctx, float(belief.state[0].since_map))
    observe_map(belief, ctx, with_heading)


@entry
def observe_map(belief: Belief, ctx: Context, with_heading: bool) -> None:
    """Condition every hypothesis on its road (the paper's Y_carto), without an along row.

        n·(p + m − c(s)) − d = e,      e ~ relative map error
        θ − chord heading    = e_θ

    The paper's row along the road is left out: its innovation is zero by construction
    and would only make the filter falsely sure.  An off-road vehicle sees the rows through
    its own free offset, which fits as a road does on average, and pays for fitting by
    distance.  Where speeds are too high for the roads (`haste`) it follows another one beside
    them, which fits as well and pays nothing.

    Args:
        belief: In place; weights are to be normalised afterwards.
        ctx: The drive's constants.
        with_heading: Whether headings are the vehicle's own, and not the roads'.
    """
    metres = belief.state[0].since_map
    noise = _road_noise(belief, ctx, metres, with_heading)
    rows = 2.0 if with_heading else 1.0
    log_s = across = better = 0.0
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            continue
        misfit, s, fit = _observe_road(hyp, ctx, noise, with_heading, belief.state[0].scale)
        log_variance = math.log(s)
        log_s += hyp.weight * log_variance
        across += hyp.weight * fit
        better += hyp.weight * (rows - misfit)
        hyp.scratch[ROWS] = -0.5 * (misfit + log_variance + rows * LOG_2PI)
    weigh_rows(belief, ctx)
    cost = ctx.par[0].off_road_cost * metres * followed(belief.state[0])
    variances = noise.lateral, noise.heading
    if noise.on_road > 0.0:
        usual = -0.5 * (rows * (1.0 + LOG_2PI) + log_s / noise.on_road)
        haste = belief.state[0].separation.unmapped.haste
        usual += 0.5 * haste[0] * max(better / noise.on_road, 0.0)
        for i in range(belief.state[0].count):
            hyp = belief.hyp[i]
            if hyp.edge == OFF_ROAD:
                hyp.log_weight += usual - cost
                if with_heading:
                    fit = across / noise.on_road
                    hyp.log_weight += gain_beside(belief, ctx, i, fit, variances, usual, cost)
    elif with_heading:
        update_beside(belief, ctx, variances, cost)


@kernel(inline=True)
def _road_noise(belief: Belief, ctx: Context, metres: float, with_heading: bool) -> RoadNoise:
    """Age the slow states, track each hypothesis on its road, and find the rows' variances.

    Near junctions, where the centre line is not what is driven, both errors are relaxed for
    all hypotheses alike, by the weighted share that is near one.
    """
    par = ctx.par[0]
    usual = belief.state[0].map
    kept = map_decay(par, usual.rate, metres)
    on = 0.0
    more_lateral = 0.0
    more_heading = 0.0
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        edge = hyp.edge
        hyp.grace -= metres
        lane, width = lane_mean(ctx, edge), lane_sigma(ctx, edge)
        decay_map(hyp.mu, hyp.cov, par, usual, kept, lane, width)
        if edge == OFF_ROAD:
            continue
        track(belief, ctx.roads, i)
        s = hyp.along
        p = hyp.weight
        on += p
        bow = 0.0
        slope = 0.0
        if with_heading:
            hyp.scratch[_HEADING], slope, bow = heading_regression(
                ctx.roads, edge, hyp.segment, s, hyp.along_sigma
            )
            if s < _FORK and hyp.before >= 0:
                late, heading = leaves_late(ctx.roads, hyp, hyp.scratch[_HEADING])
                if late:
                    hyp.scratch[_HEADING], slope = heading, 0.0
        elif p > _LIGHT:
            slope = heading_slope(ctx.roads, edge, hyp.segment, s, hyp.along_sigma)
        hyp.scratch[_SLOPE] = slope
        variance = hyp.along_sigma**2
        cutting = min(abs(slope) * HALF_CHORD, 1.0) * par.node_sigma
        sagitta = min(0.5 * abs(slope) * variance, 4.0)
        more_lateral += p * (cutting * cutting + sagitta * sagitta)
        more_heading += p * (bow * bow + 0.1 * slope**2 * (variance + 9.0))
        if is_at_node(ctx.roads, edge, s, par.node_radius):
            more_lateral += p * par.node_sigma**2
            more_heading += p * par.node_heading_sigma**2
    if on > 0.0:
        more_lateral /= on
        more_heading /= on
    thin = _CORRELATION / max(metres, _LEAST_SPACING) if metres > 0.0 else 1.0
    return RoadNoise(
        thin * (par.relative_sigma**2 + more_lateral),
        thin * (par.edge_heading_sigma**2 * usual.heading_factor + more_heading),
        on,
    )


@kernel(inline=True)
def _observe_road(
    hyp: Record, ctx: Context, noise: RoadNoise, with_heading: bool, scale: float
) -> tuple[float, float, float]:
    """Condition one hypothesis on its road's rows.

    Returns:
        Chi-square and innovation variance; the log-likelihood of the row across, at least usual.
    """
    mean = hyp.mu
    tx = hyp.tangent[0]
    ty = hyp.tangent[1]
    nu = mean[D] - hyp.lateral
    s = update_across(mean, hyp.cov, ty, -tx, nu, noise.lateral, scale)
    misfit = nu * nu / s
    across = -0.5 * (min(misfit, 1.0) + math.log(s) + LOG_2PI)
    if with_heading:
        nu = wrap(hyp.scratch[_HEADING] - mean[H])
        slope = hyp.scratch[_SLOPE]
        if slope == 0.0:
            s_heading = update_state(mean, hyp.cov, H, nu, noise.heading, scale)
        else:
            row = ctx.work.row
            for j in range(N):
                row[j] = 0.0
            row[H] = 1.0
            row[X] = row[MX] = -slope * tx
            row[Y] = row[MY] = -slope * ty
            s_heading = update(mean, hyp.cov, row, nu, noise.heading, scale)
        hyp.scratch[INNOVATION], hyp.scratch[VARIANCE] = nu, s_heading
        misfit += nu * nu / s_heading
        s *= s_heading
    return misfit, s, across


@kernel(inline=True)
def heading_regression(
    roads: Roads, edge: int, segment: int, s: float, sigma: float
) -> tuple[float, float, float]:
    """The road's heading about an abscissa that is only known to sigma.

    Statistical linear regression of the chord's heading χ on the abscissa, at
    x = 0, ±σ, ±2σ (σ at least 2 m) with normal weights w:

        mean  = Σ w χ
        slope = Σ w χ x / Σ w x²
        bow²  = Σ w (χ − mean − slope x)²

    so that in a bend the heading observes the abscissa, as far as it is uncertain, and a
    bend within that uncertainty is expected.  Beyond σ = 15 m the road is not looked at, and what
    turns there does not go on turning: the slope is (15 m / σ)² of that, the rest is bow.

    Args:
        roads: The network.
        edge: Directed edge.
        segment: Vertex index near the abscissa.
        s: Abscissa, m.
        sigma: Its standard deviation, m.

    Returns:
        Mean heading (rad), slope (rad/m), bow (rad).
    """
    length = roads.edges[edge].length
    inside = min(max(s, 0.0), length)
    if is_straight(roads, edge):
        _, _, _, tx, ty = locate(roads, edge, segment, inside)
        return math.atan2(ty, tx), 0.0, 0.0
    step = min(max(sigma, 2.0), _WIDEST)
    low = max(inside - 2.0 * step - HALF_CHORD, 0.0)
    low_segment, _, _, tx, ty = locate(roads, edge, segment, low)
    high = min(inside + 2.0 * step + HALF_CHORD, length)
    high_segment, _, _, _, _ = locate(roads, edge, low_segment, high)
    if low_segment == high_segment:  # straight within the span
        return math.atan2(ty, tx), 0.0, 0.0
    middle = chord_heading(roads, edge, segment, inside, HALF_CHORD)
    near = _turn_to(roads, edge, segment, min(inside + step, length), middle)
    near_low = _turn_to(roads, edge, segment, max(inside - step, 0.0), middle)
    far = _turn_to(roads, edge, segment, min(inside + 2.0 * step, length), middle)
    far_low = _turn_to(roads, edge, segment, max(inside - 2.0 * step, 0.0), middle)
    mean = _NEAR * (near + near_low) + _FAR * (far + far_low)
    slope = (_NEAR * (near - near_low) + 2.0 * _FAR * (far - far_low)) / (_SPAN * step)
    rise = slope * step
    rest = (
        _MIDDLE * mean**2
        + _NEAR * ((near - mean - rise) ** 2 + (near_low - mean + rise) ** 2)
        + _FAR * ((far - mean - 2.0 * rise) ** 2 + (far_low - mean + 2.0 * rise) ** 2)
    )
    if sigma > _WIDEST:
        share = (_WIDEST / sigma) ** 2
        rest += (rise * (1.0 - share)) ** 2
        slope *= share
    return wrap(middle + mean), slope, math.sqrt(rest)


@kernel
def leaves_late(roads: Roads, hyp: Record, heading: float) -> tuple[bool, float]:
    """Whether a vehicle whose road has just forked off still drives as the road before.

    Exits are drawn from the middle of the road, and driven from its outer lane, earlier or later
    than they are drawn.  Until the two lines are 8 m apart the vehicle's heading is that of either
    road: of the one that is nearer to it.  From a road of one lane, exits below 0.2 rad are left
    as they are drawn.

    Args:
        roads: The network.
        hyp: A hypothesis that is tracked on its edge, and came from another one.
        heading: Of its road, rad.

    Returns:
        Whether its road forks off, by 6 to 24 degrees, is near the one before, and that one's
        heading is nearer to the vehicle's; that heading, rad.
    """
    left = roads.edges[hyp.before]
    _, ex, ey, ax, ay = locate(roads, hyp.before, left.last_vertex - 1, left.length)
    _, _, _, bx, by = locate(roads, hyp.edge, roads.edges[hyp.edge].first_vertex, 0.0)
    sine = abs(ax * by - ay * bx)
    if sine < _FORKS[0] or sine > _FORKS[1] or ax * bx + ay * by < 0.0:
        return False, 0.0
    if not parts(roads, hyp.before) or (sine < _SHALLOW and left.lane_sigma == 0.0):
        return False, 0.0
    _, px, py, _, _ = locate(roads, hyp.edge, hyp.segment, hyp.along)
    if abs((px - ex) * ay - (py - ey) * ax) > _APART:
        return False, 0.0
    before = math.atan2(ay, ax)
    return abs(wrap(hyp.mu[H] - before)) < abs(wrap(hyp.mu[H] - heading)), before


@kernel
def _turn_to(roads: Roads, edge: int, segment: int, s: float, heading: float) -> float:
    """The chord's heading at s less another one."""
    return float(wrap(chord_heading(roads, edge, segment, s, HALF_CHORD) - heading))


@kernel(inline=True)
def heading_slope(roads: Roads, edge: int, segment: int, s: float, sigma: float) -> float:
    """The slope of `heading_regression` alone, rad/m."""
    length = roads.edges[edge].length
    if is_straight(roads, edge):
        return 0.0
    inside = min(max(s, 0.0), length)
    step = min(max(sigma, 2.0), _WIDEST)
    reach = 2.0 * step + HALF_CHORD
    if max(inside - reach, 0.0) >= roads.vertices[segment].s and (
        min(inside + reach, length) <= roads.vertices[segment + 1].s
    ):  # straight within the span
        return 0.0
    total = 0.0
    for k in range(1, 3):
        weight = _NEAR if k == 1 else 2.0 * _FAR
        total += weight * _turn_about(roads, edge, segment, inside, k * step)
    return total / (_SPAN * step)


@kernel(inline=True)
def _turn_about(roads: Roads, edge: int, segment: int, s: float, step: float) -> float:
    """By how much the chord turns from a step before an abscissa to a step after it, rad."""
    length = roads.edges[edge].length
    ax, ay = chord(roads, edge, segment, max(s - step, 0.0), HALF_CHORD)
    bx, by = chord(roads, edge, segment, min(s + step, length), HALF_CHORD)
    across = ax * by - ay * bx
    onwards = ax * bx + ay * by
    if abs(across) < 1e-12 * onwards:
        return 0.0
    return angle_of(onwards, across)
