"""What further sensors say: scalar rows on the state, and log-likelihoods by attribute of the road.

All hypotheses of an epoch, off-road included, see the same rows with the same noise.  No row
here moves the vehicle: the process model is not concerned.  How much of a reading is new, where
errors last, is counted before it comes here (`sensors.lasting`).
"""

import math

from ..._compile import Record, Vector, entry, kernel
from ...graph.geometry import wrap
from ..gaussian import LOG_2PI, condition, innovation_variance, normal_cdf
from ..gnss.position import lever_arm
from ..gnss.silence import hear
from ..road import track
from ..state import CLOCK, MX, MY, OFF_ROAD, Belief, Context, D, H, K, N, V, X, Y, most_probable
from .elevation import weigh_elevation
from .evidence_kinds import (
    ATTRIBUTE,
    BEARING,
    CLASSES,
    ELEVATION,
    HEADING,
    LATERAL,
    POSITION,
    RANGE,
    SPEED,
)

_SLOW = 2.0  # m/s, below which speeds do not observe the odometer's scale
_NEAREST = 0.5  # m, to a place
_DOUBTFUL = 0.45  # of the gate: beyond it a reading is doubted, though it is no misfit yet
_JUDGES = 0.01  # weight from which on a hypothesis judges a reading
_MISTAKEN = 0.02  # P(headings are not the vehicle's), once for as long as
_MISTAKEN_S = 300.0  # s
_WRONG = 2.0  # score of a misfit; a reading that fits takes one off
_REFUSED, _MOST = 8.0, 16.0  # score from which on a sensor is not believed; the largest
_S = 0  # scratch: innovation variance


@entry
def observe_evidence(belief: Belief, ctx: Context, first: int, count: int) -> None:
    """Condition every hypothesis on rows of `Work.evidence`.

    Args:
        belief: In place; weights are to be normalised afterwards.
        ctx: The drive's constants.
        first: First row.
        count: How many.
    """
    state = belief.state[0]
    last = min(first + count, len(ctx.work.evidence.rows))
    for k in range(first, last):
        reading = ctx.work.evidence.rows[k]
        if reading.kind == ATTRIBUTE or reading.kind == ELEVATION:
            state.sensors[reading.sensor].heard += 1.0
            if reading.kind == ATTRIBUTE:
                _weigh_attribute(belief, ctx, reading)
            else:
                weigh_elevation(belief, ctx, reading)
            continue
        if reading.kind == SPEED and state.mode != CLOCK and abs(state.odometer_speed) < _SLOW:
            continue
        if reading.bias > 0.0:
            _begin_bias(belief, reading)
        if reading.kind == HEADING:
            _observe_heading(belief, ctx, reading)
            state.course_time = state.heading_time = state.time
        else:
            _observe_axis(belief, ctx, reading, 0)
        if reading.kind == POSITION:
            _observe_axis(belief, ctx, reading, 1)
            hear(state, state.time)
        if reading.bias > 0.0:
            top = belief.hyp[most_probable(belief)]
            sensor = state.sensors[reading.sensor]
            sensor.bias[0], sensor.bias[1] = top.mu[V], top.cov[V, V]
    state.changed = 1
    state.observed = 1


@kernel
def _begin_bias(belief: Belief, reading: Record) -> None:
    """The error that stays, where a hypothesis knows nothing of it: as last known, or its prior."""
    sensor = belief.state[0].sensors[reading.sensor]
    if sensor.bias[2] == 0.0:
        sensor.bias[1] = sensor.bias[2] = reading.bias
        sensor.by_angle = 1 if reading.kind == HEADING or reading.kind == BEARING else 0
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.cov[V, V] <= 0.0:
            hyp.mu[V], hyp.cov[V, V] = sensor.bias[0], sensor.bias[1]


@kernel
def _observe_axis(belief: Belief, ctx: Context, reading: Record, axis: int) -> None:
    """Condition every hypothesis on one scalar row.

    What a reading may err by decides whether it fits: its own variance r.  What it is worth is
    the share ρ of it that is new, by the variance r/ρ.  A row that no hypothesis of weight explains
    within two sigmas, o times beyond that, is given o (o − 1) times its innovation variance more,
    alike for all: the farther it is off, the less it moves anything.  A sensor that lately gave
    rows beyond the gate is doubted: its variance is multiplied by one and its score.
    """
    state = belief.state[0]
    variance = _worth(belief, ctx, reading, axis)
    if variance == math.inf:
        return
    row = ctx.work.row
    bound = 0.0
    fit = 0.0
    for i in range(state.count):
        hyp = belief.hyp[i]
        if reading.kind == LATERAL and hyp.edge == OFF_ROAD:
            continue
        nu, curved = _fill_row(hyp, row, state, reading, axis)
        ell = condition(hyp.mu, hyp.cov, row, nu, variance + curved, state.scale)
        hyp.log_weight += ell
        s = hyp.scratch[_S] - reading.variance[axis] + variance
        bound += hyp.weight
        fit -= 0.5 * hyp.weight * (1.0 + LOG_2PI + math.log(s))
    if reading.kind == LATERAL and bound > 0.0:
        for i in range(state.count):
            if belief.hyp[i].edge == OFF_ROAD:  # it fits as a road does on average
                belief.hyp[i].log_weight += fit / bound


@kernel
def _observe_heading(belief: Belief, ctx: Context, reading: Record) -> None:
    """Condition every hypothesis on a heading, which may be that of another axis.

    At a start no other sensor may tell the direction, and a compass that is mounted backwards
    bears itself out with each reading.  So all of them together say no more against a hypothesis
    than that they are mistaken: with A what they have said, over the hypothesis that fits best,

        log P(A) = log((1 − P(mistaken)) exp A + P(mistaken))

    Where mistaken is likelier they tell that hypothesis nothing.  A is forgotten in time.
    """
    state = belief.state[0]
    variance = _worth(belief, ctx, reading, 0)
    if variance == math.inf:
        return
    best = _best_fit(belief, reading, variance)
    kept = math.exp(-max(state.time - state.heading_time, 0.0) / _MISTAKEN_S)
    row = ctx.work.row
    for i in range(state.count):
        hyp = belief.hyp[i]
        nu, _ = _fill_row(hyp, row, state, reading, 0)
        if best == -math.inf:
            hyp.log_weight += condition(hyp.mu, hyp.cov, row, nu, variance, state.scale)
            continue
        before = kept * hyp.amiss
        hyp.amiss = min(before + _log_likelihood(hyp, nu, reading, variance) - best, 0.0)
        hyp.log_weight += best + _with_mistakes(hyp.amiss) - _with_mistakes(before)
        if hyp.amiss > math.log(_MISTAKEN):
            condition(hyp.mu, hyp.cov, row, nu, variance, state.scale)


@kernel
def _with_mistakes(amiss: float) -> float:
    """What headings have said of a hypothesis, nats, where they may be mistaken."""
    return math.log((1.0 - _MISTAKEN) * math.exp(amiss) + _MISTAKEN)


@kernel
def _worth(belief: Belief, ctx: Context, reading: Record, axis: int) -> float:
    """The variance that a row is taken with; infinite: its sensor is not believed."""
    best, extra = _judge(belief, ctx, reading, axis)
    sensor = belief.state[0].sensors[reading.sensor]
    if best < math.inf and not _is_believed(sensor, best > ctx.par[0].gnss_gate):
        return math.inf
    return float((reading.variance[axis] + extra) * (1.0 + sensor.score) / reading.share)


@kernel
def _log_likelihood(hyp: Record, nu: float, reading: Record, variance: float) -> float:
    """Of a heading, by the innovation variance that `_judge` left in the scratch."""
    s = hyp.scratch[_S] - reading.variance[0] + variance
    return float(-0.5 * (LOG_2PI + math.log(s) + nu * nu / s))


@kernel
def _best_fit(belief: Belief, reading: Record, variance: float) -> float:
    """Log-likelihood of a heading under the hypothesis of weight that fits it best; -inf: none."""
    state = belief.state[0]
    best = -math.inf
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.weight >= _JUDGES:
            bias = hyp.mu[V] if reading.bias > 0.0 else 0.0
            nu = wrap(reading.value - hyp.mu[H] - bias)
            best = max(best, _log_likelihood(hyp, nu, reading, variance))
    return float(best)


@kernel
def _judge(belief: Belief, ctx: Context, reading: Record, axis: int) -> tuple[float, float]:
    """The smallest chi-square of a row, and the variance that it gets beyond the gate."""
    state = belief.state[0]
    row = ctx.work.row
    best = math.inf
    extra = 0.0
    for i in range(state.count):
        hyp = belief.hyp[i]
        nu, curved = _fill_row(hyp, row, state, reading, axis)
        s = innovation_variance(hyp.cov, row, reading.variance[axis] + curved)
        hyp.scratch[_S] = s
        if hyp.weight < _JUDGES or (reading.kind == LATERAL and hyp.edge == OFF_ROAD):
            continue
        chi2 = nu * nu / s
        if chi2 < best:
            best = chi2
            over = chi2 / (_DOUBTFUL * ctx.par[0].gnss_gate)
            extra = s * over * max(over - 1.0, 0.0)
    return best, extra


@kernel
def _is_believed(sensor: Record, misfits: bool) -> bool:
    """Count a row of a sensor; whether it is believed: not after misfits in a row."""
    sensor.heard += 1.0
    if misfits:
        sensor.misfits += 1.0
        sensor.score = min(sensor.score + _WRONG, _MOST)
    else:
        sensor.score = max(sensor.score - 1.0, 0.0)
    if sensor.score >= _REFUSED:
        sensor.refused = 1
    elif sensor.score <= 0.0:
        sensor.refused = 0
    if sensor.refused == 1:
        sensor.withheld += 1.0
        return False
    return True


@kernel
def _fill_row(
    hyp: Record, row: Vector, state: Record, reading: Record, axis: int
) -> tuple[float, float]:
    """Fill the observation row of a hypothesis; returns innovation, and variance of curvature."""
    for j in range(N):
        row[j] = 0.0
    mean = hyp.mu
    kind = reading.kind
    if reading.bias > 0.0:
        row[V] = 1.0
    if kind == HEADING:
        row[H] = 1.0
        return wrap(reading.value - mean[H] - row[V] * mean[V]), 0.0
    if kind == LATERAL:
        row[D] = 1.0
        return float(reading.value - mean[D] - row[V] * mean[V]), 0.0
    if kind == SPEED:
        row[K] = 1.0 if state.mode == CLOCK else state.odometer_speed
        return float(reading.value - row[K] * mean[K]), 0.0
    return _fill_place_row(hyp, row, state, reading, axis)


@kernel
def _fill_place_row(
    hyp: Record, row: Vector, state: Record, reading: Record, axis: int
) -> tuple[float, float]:
    """The same of a position, or of a range or bearing to a place q.

    With the sensor at a = p + R(θ) arm (+ m where the place shares the map's error), d = q − a,
    r = |d|, u = d / r and its left normal v:

        position   e · d                 e: axis of its ellipse
        range      r        ∂/∂a = −u        second order: mean ½ P_vv / r, variance ½ (P_vv / r)²
        bearing    angle of d (− θ)   ∂/∂a = −v / r    second order: variance P_uu P_vv / r⁴
    """
    mean = hyp.mu
    constant = row[V] * mean[V]
    shift = 1.0 if reading.on_map == 1 else 0.0
    ax, ay = lever_arm(mean[H], reading.arm)
    dx = (reading.x - mean[X]) / state.scale - ax - shift * mean[MX]
    dy = (reading.y - mean[Y]) / state.scale - ay - shift * mean[MY]
    curved = 0.0
    if reading.kind == POSITION:
        ex = math.cos(reading.axis) if axis == 0 else -math.sin(reading.axis)
        ey = math.sin(reading.axis) if axis == 0 else math.cos(reading.axis)
        nu = ex * dx + ey * dy
    else:
        r = max(math.hypot(dx, dy), _NEAREST)
        ux, uy = dx / r, dy / r
        along = _variance_along(hyp, shift, ux, uy)
        across = _variance_along(hyp, shift, -uy, ux)
        if reading.kind == RANGE:
            ex, ey = -ux, -uy
            nu = reading.value - r - 0.5 * across / r - constant
            curved = 0.5 * (across / r) ** 2
        else:
            ex, ey = uy / r, -ux / r
            turn = mean[H] if reading.relative == 1 else 0.0
            nu = wrap(reading.value - math.atan2(dy, dx) + turn - constant)
            curved = along * across / (r * r * r * r)
    row[X], row[Y] = ex, ey
    row[MX], row[MY] = shift * ex, shift * ey
    row[H] = -ex * ay + ey * ax - (1.0 if reading.relative == 1 else 0.0)
    return float(nu), float(curved)


@kernel
def _variance_along(hyp: Record, shift: float, ex: float, ey: float) -> float:
    """Variance of the position along a direction, with the map's error where the place has it."""
    cov = hyp.cov
    xx = cov[X, X] + shift * (2.0 * cov[X, MX] + cov[MX, MX])
    yy = cov[Y, Y] + shift * (2.0 * cov[Y, MY] + cov[MY, MY])
    xy = cov[X, Y] + shift * (cov[X, MY] + cov[Y, MX] + cov[MX, MY])
    return float(max(ex * ex * xx + 2.0 * ex * ey * xy + ey * ey * yy, 0.0))


@kernel
def _weigh_attribute(belief: Belief, ctx: Context, reading: Record) -> None:
    """Weigh each hypothesis by the class of its road, averaged over where it is along it.

    Off the roads the last class holds: whatever is not named.
    """
    evidence = ctx.work.evidence
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge < 0:
            hyp.log_weight += reading.log_likelihood[CLASSES - 1]
            continue
        track(belief, ctx.roads, i)
        total = 0.0
        below = 0.0
        last = evidence.first[hyp.edge + 1]
        for piece in range(evidence.first[hyp.edge], last):
            upto = 1.0
            if piece + 1 < last:
                upto = normal_cdf((evidence.start[piece + 1] - hyp.along) / hyp.along_sigma)
            named = evidence.classes[reading.column, piece]
            total += (upto - below) * math.exp(reading.log_likelihood[named])
            below = upto
        hyp.log_weight += math.log(max(total, 1e-12))
