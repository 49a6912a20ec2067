"""What the GNSS and the map say to every hypothesis.

All hypotheses, off-road included, see the same rows with the same noise, so that
their likelihoods are densities of the same quantity and may be compared.
"""

import math

from ._jit import Vector, kernel
from .angles import wrap
from .belief import (
    GNSS_XX,
    GNSS_XY,
    GNSS_YY,
    GX,
    GY,
    MX,
    MY,
    OFF_ROAD,
    TRAVELLED,
    Belief,
    D,
    H,
    K,
    N,
    X,
    Y,
)
from .gaussian import (
    condition,
    innovation_variance,
    normal_cdf,
    reshape_along,
    truncated_moments,
)
from .motion import age_gnss, age_map
from .network import Roads
from .segment import chord_heading, locate, project

_HALF_CHORD = 6.0  # m either side; shorter sees the digitisation, longer cuts bends


@kernel
def normalise(belief: Belief) -> float:
    """Make the weights sum to one; returns the log of what they summed to."""
    n = belief.size[0]
    top = -math.inf
    for i in range(n):
        top = max(top, belief.log_weight[i])
    total = 0.0
    for i in range(n):
        belief.probability[i] = math.exp(belief.log_weight[i] - top)
        total += belief.probability[i]
    log_total = top + math.log(total)
    for i in range(n):
        belief.log_weight[i] -= log_total
        belief.probability[i] /= total
    return log_total


@kernel
def _fix_row(
    mean: Vector, row: Vector, fix: Vector, root: Vector, ex: float, ey: float, scale: float,
    lever: Vector,
) -> float:  # fmt: skip
    """Fill the row of one axis (ex, ey) of the fix's ellipse; returns the innovation, m.

    z = p + R(θ) a + S γ + white, along the unit vector e of the axis; `root` is S.
    """
    ax = 0.0
    ay = 0.0
    if lever[0] != 0.0 or lever[1] != 0.0:
        c = math.cos(mean[H])
        s = math.sin(mean[H])
        ax = c * lever[0] - s * lever[1]
        ay = s * lever[0] + c * lever[1]
    row[X] = ex
    row[Y] = ey
    row[H] = -ex * ay + ey * ax
    row[GX] = ex * root[0] + ey * root[1]
    row[GY] = ex * root[1] + ey * root[2]
    dx = (fix[0] - mean[X]) / scale - ax - root[0] * mean[GX] - root[1] * mean[GY]
    dy = (fix[1] - mean[Y]) / scale - ay - root[1] * mean[GX] - root[2] * mean[GY]
    return float(ex * dx + ey * dy)


@kernel
def gnss_root(belief: Belief, fix: Vector, interval: float, smoothing: float, root: Vector) -> None:
    """Scale of the slow GNSS error: what receivers report, smoothed over time.

    Scaling it by each fix's own ellipse would let the ellipse's jitter measure the
    error: a sigma that scatters by 5 % took the filter's ANEES from 0.9 to 1.4.  Where
    the smoothed scale does change, the error is drawn anew in that proportion.

    Args:
        belief: Its clock keeps the smoothed covariance; γ is aged.
        fix: x, y, sigma_major, sigma_minor (m), heading of the major axis.
        interval: Since the last fix, s; negative: begin with this one.
        smoothing: Time constant, s.
        root: Filled with the symmetric root: xx, xy, yy, m.
    """
    c = math.cos(fix[4])
    s = math.sin(fix[4])
    a = fix[2] ** 2
    b = fix[3] ** 2
    clock = belief.clock
    xx = a * c * c + b * s * s
    xy = (a - b) * c * s
    yy = a * s * s + b * c * c
    if interval >= 0.0:
        new = 1.0 - math.exp(-interval / smoothing)
        before = clock[GNSS_XX] * clock[GNSS_YY] - clock[GNSS_XY] ** 2
        xx = clock[GNSS_XX] + new * (xx - clock[GNSS_XX])
        xy = clock[GNSS_XY] + new * (xy - clock[GNSS_XY])
        yy = clock[GNSS_YY] + new * (yy - clock[GNSS_YY])
        ratio = math.sqrt(math.sqrt((xx * yy - xy * xy) / before))
        keep = min(ratio, 1.0 / ratio)
        if keep < 0.995:
            for i in range(belief.size[0]):
                age_gnss(belief.mean[i], belief.cov[i], -math.log(keep), 1.0)
    clock[GNSS_XX] = xx
    clock[GNSS_XY] = xy
    clock[GNSS_YY] = yy
    det = math.sqrt(max(xx * yy - xy * xy, 0.0))
    trace = math.sqrt(xx + yy + 2.0 * det)
    root[0] = (xx + det) / trace
    root[1] = xy / trace
    root[2] = (yy + det) / trace


@kernel
def observe_fix(
    belief: Belief,
    fix: Vector,
    root: Vector,
    interval: float,
    scale: float,
    lever: Vector,
    white_ratio: float,
    gate: float,
    row: Vector,
) -> float:
    """Condition every hypothesis on a GNSS fix (the paper's Y₁), its error correlated.

    The white part is scaled with the interval, so that measuring ten times as often
    teaches nearly nothing more.  A fix that no hypothesis of weight explains within
    the gate is given the variance that makes it fit the best one: it is weighed
    down, never locked out, and alike for all.

    Args:
        belief: In place.
        fix: x, y (plane), sigma_major, sigma_minor (m), heading of the major axis (rad).
        root: S, the symmetric root of the covariance that scales the slow error, xx, xy, yy (m).
        interval: Since the last fix, s.
        scale: Local scale of the plane.
        lever: Antenna ahead and left of M, m.
        white_ratio: White sigma over reported sigma for one fix a second.
        gate: Chi-square (two degrees) of a fix that is taken at its word.
        row: Scratch, (N,).

    Returns:
        The smallest chi-square before weighing down.
    """
    n = belief.size[0]
    thin = max(1.0, 1.0 / max(interval, 0.01))
    r0 = (white_ratio * fix[2]) ** 2 * thin
    r1 = (white_ratio * fix[3]) ** 2 * thin
    c = math.cos(fix[4])
    s = math.sin(fix[4])
    for j in range(N):
        row[j] = 0.0
    best = math.inf
    extra0 = 0.0
    extra1 = 0.0
    for i in range(n):
        if belief.probability[i] < 0.01:
            continue
        nu0 = _fix_row(belief.mean[i], row, fix, root, c, s, scale, lever)
        s0 = innovation_variance(belief.cov[i], row, r0)
        nu1 = _fix_row(belief.mean[i], row, fix, root, -s, c, scale, lever)
        s1 = innovation_variance(belief.cov[i], row, r1)
        chi2 = nu0 * nu0 / s0 + nu1 * nu1 / s1
        if chi2 < best:
            best = chi2
            over = max(chi2 / gate - 1.0, 0.0)
            extra0 = s0 * over
            extra1 = s1 * over
    for i in range(n):
        nu = _fix_row(belief.mean[i], row, fix, root, c, s, scale, lever)
        gain = condition(belief.mean[i], belief.cov[i], row, nu, r0 + extra0, scale)
        nu = _fix_row(belief.mean[i], row, fix, root, -s, c, scale, lever)
        gain += condition(belief.mean[i], belief.cov[i], row, nu, r1 + extra1, scale)
        belief.log_weight[i] += gain
    return best


@kernel
def observe_state(
    belief: Belief, state: int, value: float, variance: float, scale: float, row: Vector
) -> None:
    """Condition every hypothesis on one of its states: course (H) or speed (K)."""
    for j in range(N):
        row[j] = 0.0
    row[state] = 1.0
    for i in range(belief.size[0]):
        nu = value - belief.mean[i, state]
        if state == H:
            nu = wrap(nu)
        belief.log_weight[i] += condition(belief.mean[i], belief.cov[i], row, nu, variance, scale)


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


@kernel
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
        lane = 0.0 if edge == OFF_ROAD else side * roads.lane[edge]
        age_map(belief.mean[i], belief.cov[i], lane, lane_keep, lane_sigma, map_keep, map_sigma)
        if edge == OFF_ROAD:
            continue
        lateral[i], tangent_x[i], tangent_y[i] = track(belief, roads, i, scale)
        s = belief.abscissa[i]
        p = belief.probability[i]
        on += p
        heading[i], slope[i], bow = bend(roads, edge, belief.segment[i], s, belief.spread[i])
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
    r_lateral = relative_sigma**2 + more_lateral
    r_heading = heading_sigma**2 + more_heading
    log_s = 0.0
    for i in range(n):
        if belief.edge[i] == OFF_ROAD:
            continue
        p = belief.probability[i]
        mean = belief.mean[i]
        for j in range(N):
            row[j] = 0.0
        nx = tangent_y[i]
        ny = -tangent_x[i]
        row[X] = nx
        row[Y] = ny
        row[MX] = nx
        row[MY] = ny
        row[D] = -1.0
        nu = mean[D] - lateral[i]
        log_s += p * math.log(innovation_variance(belief.cov[i], row, r_lateral))
        gain = condition(mean, belief.cov[i], row, nu, r_lateral, scale)
        if with_heading:
            for j in range(N):
                row[j] = 0.0
            row[H] = 1.0
            row[X] = -slope[i] * tangent_x[i]
            row[Y] = -slope[i] * tangent_y[i]
            row[MX] = row[X]
            row[MY] = row[Y]
            nu = wrap(heading[i] - mean[H])
            log_s += p * math.log(innovation_variance(belief.cov[i], row, r_heading))
            gain += condition(mean, belief.cov[i], row, nu, r_heading, scale)
        belief.log_weight[i] += gain
    rows = 2.0 if with_heading else 1.0
    if on > 0.0:
        fit = -0.5 * (rows * (1.0 + math.log(2.0 * math.pi)) + log_s / on)
        for i in range(n):
            if belief.edge[i] == OFF_ROAD:
                belief.log_weight[i] += fit - off_road_cost * travelled


@kernel
def bend(
    roads: Roads, edge: int, segment: int, s: float, sigma: float
) -> tuple[float, float, float]:
    """The road's heading about an abscissa that is only known to sigma.

    The chord's heading χ is taken at s − δ, s, s + δ with δ = max(σ, 3 m):

        slope = (χ₊ − χ₋) / 2δ,     bow = (χ₊ + χ₋) / 2 − χ

    so that in a bend the heading tells the abscissa, over as much road as is in doubt.

    Args:
        roads: The network.
        edge: Directed edge.
        segment: Vertex index near the abscissa.
        s: Abscissa, m.
        sigma: Its standard deviation, m.

    Returns:
        χ (rad), slope (rad/m), bow (rad).
    """
    length = roads.length[edge]
    if roads.first[edge + 1] - roads.first[edge] == 2:
        _, _, _, tx, ty = locate(roads, edge, segment, s)
        return math.atan2(ty, tx), 0.0, 0.0
    step = min(max(sigma, 3.0), 25.0)
    low = max(s - step, 0.0)
    high = min(s + step, length)
    middle = chord_heading(roads, edge, segment, min(max(s, 0.0), length), _HALF_CHORD)
    if high - low < 1.0:
        return middle, 0.0, 0.0
    before = wrap(chord_heading(roads, edge, segment, low, _HALF_CHORD) - middle)
    after = wrap(chord_heading(roads, edge, segment, high, _HALF_CHORD) - middle)
    return middle, (after - before) / (high - low), 0.5 * (after + before)


@kernel
def forward_only(belief: Belief, row: Vector, scale: float) -> None:
    """Without odometry a vehicle drives forwards.

    On a road the speed is cut to what is above −0.5 m/s, and the hypothesis weighed
    by how much that was.  Off the roads a negative speed is the other heading.
    """
    for i in range(belief.size[0]):
        mean = belief.mean[i]
        cov = belief.cov[i]
        if belief.edge[i] == OFF_ROAD:
            if mean[K] < -0.5:
                mean[K] = -mean[K]
                mean[H] = wrap(mean[H] + math.pi)
                for j in range(N):
                    cov[K, j] = -cov[K, j]
                for j in range(N):
                    cov[j, K] = -cov[j, K]
            continue
        sigma = math.sqrt(cov[K, K])
        z = (mean[K] + 0.5) / sigma
        if z < 2.5:
            belief.log_weight[i] += math.log(max(min(2.0 * normal_cdf(z), 1.0), 1e-12))
            cut, variance = truncated_moments(mean[K], sigma, -0.5, 1e9)
            for j in range(N):
                row[j] = 0.0
            row[K] = 1.0
            reshape_along(mean, cov, row, cut - mean[K], variance / (sigma * sigma), scale)
