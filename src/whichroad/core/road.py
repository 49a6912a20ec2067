"""What the road map says to every hypothesis: the paper's multi-Gaussian observation.

All hypotheses, off-road included, see the same rows with the same noise, so that
their likelihoods are densities of the same quantity and may be compared.
"""

import math

from ._jit import Vector, entry, kernel, part
from .angles import angle_of, wrap
from .belief import (
    MX,
    MY,
    OFF_ROAD,
    TRAVELLED,
    Belief,
    D,
    H,
    N,
    X,
    Y,
)
from .gaussian import LOG_2PI, update, update_across
from .motion import age_map
from .network import Roads, lane_sigma_of
from .segment import chord, chord_heading, locate, project

_MIDDLE, _NEAR, _FAR = 0.402, 0.244, 0.055  # normal weights at 0, ±σ, ±2σ, summing to one
_SPAN = 2.0 * (_NEAR + 4.0 * _FAR)  # Σ w x² / σ²
_LOOK = 5.0  # m travelled between two looks at the road whose errors are those of one
_LIGHT = 1e-3  # probability of who hardly tells what the rows of all are worth
_HALF_CHORD = 6.0  # m either side; shorter sees the digitisation, longer cuts bends


@kernel
def track(belief: Belief, roads: Roads, i: int, scale: float) -> tuple[float, float, float]:
    """Project hypothesis i, shifted into the map's frame, on its edge.

    Sets its segment, abscissa and spread.

    Returns:
        Lateral offset (m, right positive) and the unit tangent.
    """
    mean = belief.mean[i]
    cov = belief.cov[i]
    qx = mean[X] + scale * mean[MX]
    qy = mean[Y] + scale * mean[MY]
    segment, s, across, tx, ty = project(roads, belief.edge[i], belief.segment[i], qx, qy)
    belief.segment[i] = segment
    belief.abscissa[i] = s
    vxx = cov[X, X] + 2.0 * cov[X, MX] + cov[MX, MX]
    vyy = cov[Y, Y] + 2.0 * cov[Y, MY] + cov[MY, MY]
    vxy = cov[X, Y] + cov[X, MY] + cov[Y, MX] + cov[MX, MY]
    belief.spread[i] = math.sqrt(max(tx * tx * vxx + 2.0 * tx * ty * vxy + ty * ty * vyy, 1e-4))
    return across / scale, tx, ty


@entry
def observe_roads(
    belief: Belief,
    roads: Roads,
    scale: float,
    side: float,
    with_heading: bool,
    relative_sigma: float,
    heading_sigma: float,
    node_radius: float,
    node_sigma: float,
    node_heading_sigma: float,
    lane_sigma: float,
    lane_length: float,
    map_sigma: float,
    map_length: float,
    off_road_cost: float,
    row: Vector,
) -> None:
    """Condition every hypothesis on its road (the paper's Y_carto), without an along row.

        n·(p + m − c(s)) − d = e,      e ~ relative map error
        θ − chord heading    = e_θ

    The paper's row along the road is left out: its innovation is zero by construction
    and would only make the filter falsely sure.  Near junctions, where the centre line
    is not what is driven, both errors are relaxed for all hypotheses alike, by the
    weighted share that is near one.  An off-road vehicle sees the rows through its own
    free offset, which fits as a road does on average, and pays for fitting by distance.
    """
    n = belief.size[0]
    travelled = belief.clock[TRAVELLED]
    lateral = belief.scratch[0]
    tangent_x = belief.scratch[1]
    tangent_y = belief.scratch[2]
    heading = belief.scratch[3]
    slope = belief.scratch[4]
    lane_keep = math.exp(-travelled / lane_length)
    map_keep = math.exp(-travelled / map_length)
    on = 0.0
    more_lateral = 0.0
    more_heading = 0.0
    for i in range(n):
        edge = belief.edge[i]
        lane = 0.0
        sigma = lane_sigma
        if edge != OFF_ROAD:
            lane = side * roads.lane[edge]
            sigma = lane_sigma_of(roads, edge, lane_sigma)
        age_map(belief.mean[i], belief.cov[i], lane, lane_keep, sigma, map_keep, map_sigma)
        if edge == OFF_ROAD:
            continue
        lateral[i], tangent_x[i], tangent_y[i] = track(belief, roads, i, scale)
        s = belief.abscissa[i]
        p = belief.probability[i]
        on += p
        bow = 0.0
        slope[i] = 0.0
        if with_heading:
            heading[i], slope[i], bow = bend(roads, edge, belief.segment[i], s, belief.spread[i])
        elif p > _LIGHT:
            slope[i] = slope_at(roads, edge, belief.segment[i], s, belief.spread[i])
        spread2 = belief.spread[i] ** 2
        cutting = min(abs(slope[i]) * _HALF_CHORD, 1.0) * node_sigma
        sagitta = min(0.5 * abs(slope[i]) * spread2, 4.0)
        more_lateral += p * (cutting * cutting + sagitta * sagitta)
        more_heading += p * (bow * bow + 0.1 * slope[i] ** 2 * (spread2 + 9.0))
        if min(s, roads.length[edge] - s) < node_radius:
            more_lateral += p * node_sigma**2
            more_heading += p * node_heading_sigma**2
    if on > 0.0:
        more_lateral /= on
        more_heading /= on
    thin = min(max(_LOOK / travelled, 0.5), 4.0) if travelled > 0.0 else 1.0
    r_lateral = thin * (relative_sigma**2 + more_lateral)
    r_heading = thin * (heading_sigma**2 + more_heading)
    rows = 2.0 if with_heading else 1.0
    log_s = 0.0
    for i in range(n):
        if belief.edge[i] == OFF_ROAD:
            continue
        p = belief.probability[i]
        mean = belief.mean[i]
        nu = mean[D] - lateral[i]
        s = update_across(
            mean, belief.cov[i], tangent_y[i], -tangent_x[i], nu, r_lateral, scale
        )  # fmt: skip
        misfit = nu * nu / s
        if with_heading:
            for j in range(N):
                row[j] = 0.0
            row[H] = 1.0
            row[X] = -slope[i] * tangent_x[i]
            row[Y] = -slope[i] * tangent_y[i]
            row[MX] = row[X]
            row[MY] = row[Y]
            nu = wrap(heading[i] - mean[H])
            s_heading = update(mean, belief.cov[i], row, nu, r_heading, scale)
            misfit += nu * nu / s_heading
            s *= s_heading
        log_variance = math.log(s)
        log_s += p * log_variance
        belief.log_weight[i] -= 0.5 * (misfit + log_variance + rows * LOG_2PI)
    if on > 0.0:
        fit = -0.5 * (rows * (1.0 + LOG_2PI) + log_s / on)
        for i in range(n):
            if belief.edge[i] == OFF_ROAD:
                belief.log_weight[i] += fit - off_road_cost * travelled


@part
def bend(
    roads: Roads, edge: int, segment: int, s: float, sigma: float
) -> tuple[float, float, float]:
    """The road's heading about an abscissa that is only known to sigma.

    Statistical linear regression of the chord's heading χ on the abscissa, at
    x = 0, ±σ, ±2σ (σ at least 2 m) with normal weights w:

        mean  = Σ w χ
        slope = Σ w χ x / Σ w x²
        bow²  = Σ w (χ − mean − slope x)²

    so that in a bend the heading tells the abscissa, as far as it is in doubt, and a
    bend that lies within the doubt is expected.

    Args:
        roads: The network.
        edge: Directed edge.
        segment: Vertex index near the abscissa.
        s: Abscissa, m.
        sigma: Its standard deviation, m.

    Returns:
        Mean heading (rad), slope (rad/m), bow (rad).
    """
    length = roads.length[edge]
    inside = min(max(s, 0.0), length)
    if roads.first[edge + 1] - roads.first[edge] == 2:
        _, _, _, tx, ty = locate(roads, edge, segment, inside)
        return math.atan2(ty, tx), 0.0, 0.0
    step = min(max(sigma, 2.0), 15.0)
    low = max(inside - 2.0 * step - _HALF_CHORD, 0.0)
    low_segment, _, _, tx, ty = locate(roads, edge, segment, low)
    high = min(inside + 2.0 * step + _HALF_CHORD, length)
    high_segment, _, _, _, _ = locate(roads, edge, low_segment, high)
    if low_segment == high_segment:  # straight, as far as it is looked at
        return math.atan2(ty, tx), 0.0, 0.0
    middle = chord_heading(roads, edge, segment, inside, _HALF_CHORD)
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
    return wrap(middle + mean), slope, math.sqrt(rest)


@kernel
def _turn_to(roads: Roads, edge: int, segment: int, s: float, heading: float) -> float:
    """The chord's heading at s less another one."""
    return float(wrap(chord_heading(roads, edge, segment, s, _HALF_CHORD) - heading))


@part
def slope_at(roads: Roads, edge: int, segment: int, s: float, sigma: float) -> float:
    """The slope of `bend` alone, rad/m."""
    length = roads.length[edge]
    if roads.first[edge + 1] - roads.first[edge] == 2:
        return 0.0
    inside = min(max(s, 0.0), length)
    step = min(max(sigma, 2.0), 15.0)
    reach = 2.0 * step + _HALF_CHORD
    if max(inside - reach, 0.0) >= roads.s[segment] and (
        min(inside + reach, length) <= roads.s[segment + 1]
    ):  # straight, as far as it is looked at
        return 0.0
    total = 0.0
    for k in range(1, 3):
        weight = _NEAR if k == 1 else 2.0 * _FAR
        total += weight * _turn_about(roads, edge, segment, inside, k * step)
    return total / (_SPAN * step)


@part
def _turn_about(roads: Roads, edge: int, segment: int, s: float, step: float) -> float:
    """By how much the chord turns from a step before an abscissa to a step after it, rad."""
    length = roads.length[edge]
    ax, ay = chord(roads, edge, segment, max(s - step, 0.0), _HALF_CHORD)
    bx, by = chord(roads, edge, segment, min(s + step, length), _HALF_CHORD)
    across = ax * by - ay * bx
    onwards = ax * bx + ay * by
    if abs(across) < 1e-12 * onwards:
        return 0.0
    return angle_of(onwards, across)
