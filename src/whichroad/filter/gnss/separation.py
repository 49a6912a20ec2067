"""Solutions beside each other: with fixes and map, and by odometry alone.

A receiver that is pulled away slowly never gives a fix that does not fit.  Its error and the
position share the pull.  So the belief is copied every some seconds, and the copy is moved by
the odometry alone.  Without a fault the place by odometry differs from the belief as the
difference of their covariances says.  Where they differ by more, odometry or receiver are wrong,
and not both solutions can be right.  Until roads decide, the level covers both (as the
solution separation of ARAIM, Blanch et al. 2015, does), and hypotheses live at both.
"""

import math

from ..._compile import Record, kernel
from ..creeping import crept
from ..hypotheses.births import Start, cold_start
from ..motion import GYRO_PACE, Increment, predict_plane, wheel_noise
from ..records import COPIES
from ..state import (
    GX,
    GY,
    MOTION,
    NOTHING,
    RECEIVER,
    WHEELS,
    B,
    Belief,
    Context,
    H,
    K,
    N,
    Path,
    X,
    Y,
    heaviest,
    normalise,
)
from ..vetting.motion_sources import ARC, is_possible
from ..vetting.windows import ANCHORS, BY_GYRO
from .bias import is_fine
from .gross_error import error_of, is_gross

_EVERY = 15.0  # s between two copies
_LONGEST = 120.0  # s for which one is kept
_LEARNT = 30.0  # s of fixes before the first one
_TURNED = 0.1  # rad, sigma of the heading of what is copied, at most
_HOLDS = 0.05  # P(a fault) from which on no other copy is made
_SPLITS = 0.5  # and from which on hypotheses are added at the copy
_SHARE = 0.5  # P(the odometry is right) then
_LEAST = 0.25  # m², variance of the difference on any axis, at least
_SOFT = 1.5  # times: squared differences of sound drives over their variances
_PRIOR = 10.0  # nats against a fault where the two differ as expected
_OF_SIDE = 0.01  # weight from which on a side lives
_CALM = 90.0  # s in which a larger error of the receiver becomes usual
_LEAST_CALM = 0.9  # scale of its sigmas


@kernel(inline=True)
def _is_due(state: Record) -> bool:
    """Whether the windows have kept an anchor with this epoch."""
    windows = state.vetting.windows
    return bool(
        windows.count > 0 and windows.anchors[(windows.count - 1) % ANCHORS].time == state.time
    )


@kernel
def _reckon(state: Record, par: Record, gyro: int) -> None:
    """Move the copies by the odometry since the last anchor, or drop them without it.

    Odometry that is believed anew was wrong before, or else the fixes were that it differed from.
    """
    separation = state.separation
    windows = state.vetting.windows
    anchor = windows.anchors[(windows.count - 1) % ANCHORS]
    sums = separation.sums
    c = math.cos(sums[2])
    s = math.sin(sums[2])
    dx = anchor.ox - sums[0]
    dy = anchor.oy - sums[1]
    arc = anchor.arc - sums[3]
    clock = arc
    if gyro == BY_GYRO:
        clock = GYRO_PACE if abs(arc) > 0.0 else 0.0
    move = Increment(arc, anchor.turn - sums[2], c * dx + s * dy, c * dy - s * dx, clock)
    noise = crept(state.vetting.slow, wheel_noise(par, abs(arc), move.turn))
    sums[0], sums[1] = anchor.ox, anchor.oy
    sums[2], sums[3] = anchor.turn, anchor.arc
    outvoted = state.vetting.refused[ARC] == 1 and anchor.speeds == 1
    sound = anchor.odometry == 1 and not outvoted and is_possible(state.vetting)
    anew = state.vetting.returned_at  # what copies before have been moved by may be wrong
    for k in range(COPIES):
        copy = separation.reckoned[k]
        if copy.live == 0:
            continue
        holds = copy.begun >= anew or copy.p > _SPLITS
        if sound and holds and state.time - copy.begun <= _LONGEST:
            predict_plane(copy.mu, copy.cov, move, state.scale, noise)
        else:
            copy.live = 0
            copy.p = 0.0


@kernel
def _compare(state: Record, copy: Record, top: Record) -> None:
    """P(the copy and a hypothesis differ by a fault), and how far it is away.

        W = P_copy − P,    chi² = sᵀ W⁻¹ s,    P(fault) = 1 / (1 + exp(10 − chi² / 3))

    with s the difference of the places.
    """
    dx = (copy.mu[X] - top.mu[X]) / state.scale
    dy = (copy.mu[Y] - top.mu[Y]) / state.scale
    copy.away[0], copy.away[1] = dx, dy
    xx = copy.cov[X, X] - top.cov[X, X]
    xy = copy.cov[X, Y] - top.cov[X, Y]
    yy = copy.cov[Y, Y] - top.cov[Y, Y]
    middle = 0.5 * (xx + yy)
    apart = math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c, s = math.cos(angle), math.sin(angle)
    chi2 = (c * dx + s * dy) ** 2 / max(middle + apart, _LEAST)
    chi2 += (c * dy - s * dx) ** 2 / max(middle - apart, _LEAST)
    copy.p = 1.0 / (1.0 + math.exp(max(_PRIOR - 0.5 * chi2 / _SOFT, -50.0)))


@kernel
def _begin(state: Record, top: Record) -> None:
    """Copy the heaviest hypothesis, over the older copy."""
    separation = state.separation
    older = 0 if separation.reckoned[0].begun <= separation.reckoned[1].begun else 1
    copy = separation.reckoned[older]
    for i in range(N):
        copy.mu[i] = top.mu[i]
        for j in range(N):
            copy.cov[i, j] = top.cov[i, j]
    copy.begun = state.time
    copy.live = 1
    copy.p = 0.0
    copy.away[0] = copy.away[1] = 0.0
    separation.begun = state.time


@kernel
def _share(hyp: Record, ixx: float, ixy: float, iyy: float) -> None:
    """Let the receiver's error be what a fix differs from the place by.

    With V the covariance of the place and I the inverse of S that of γ is 1 + I V I.
    """
    cov = hyp.cov
    for i in (X, Y):
        vx = cov[i, X]
        vy = cov[i, Y]
        cov[i, GX] = cov[GX, i] = -(ixx * vx + ixy * vy)
        cov[i, GY] = cov[GY, i] = -(ixy * vx + iyy * vy)
    cov[GX, GX] = 1.0 - ixx * cov[X, GX] - ixy * cov[Y, GX]
    cov[GX, GY] = cov[GY, GX] = -ixx * cov[X, GY] - ixy * cov[Y, GY]
    cov[GY, GY] = 1.0 - ixy * cov[X, GY] - iyy * cov[Y, GY]


@kernel
def _split(belief: Belief, path: Path, ctx: Context, copy: Record) -> None:
    """Let hypotheses live at the copy, too: there the receiver is wrong."""
    state = belief.state[0]
    normalise(belief)
    for i in range(state.count):
        belief.hyp[i].blames = MOTION
    top = belief.hyp[heaviest(belief)]
    bx = top.mu[GX]
    by = top.mu[GY]
    cov = copy.cov
    middle = 0.5 * (cov[X, X] + cov[Y, Y])
    apart = math.sqrt(0.25 * (cov[X, X] - cov[Y, Y]) ** 2 + cov[X, Y] ** 2)
    place = ctx.work.row
    place[0], place[1] = copy.mu[X], copy.mu[Y]
    place[2] = math.sqrt(middle + apart)
    place[3] = math.sqrt(max(middle - apart, _LEAST))
    place[4] = 0.5 * math.atan2(2.0 * cov[X, Y], cov[X, X] - cov[Y, Y])
    start = Start(
        1.0, 0.0, copy.mu[H], math.sqrt(cov[H, H]), copy.mu[K], math.sqrt(cov[K, K]), copy.mu[B],
        math.sqrt(cov[B, B]), False,
    )  # fmt: skip
    cold_start(belief, path, ctx, place, start, _SHARE)
    root = state.bias_root
    det = root[0] * root[2] - root[1] * root[1]
    dx, dy = copy.away[0], copy.away[1]
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.blames != NOTHING:
            continue
        hyp.blames = RECEIVER
        hyp.mu[GX] = bx - (root[2] * dx - root[1] * dy) / det
        hyp.mu[GY] = by - (root[0] * dy - root[1] * dx) / det
        _share(hyp, root[2] / det, -root[1] / det, root[0] / det)
    state.changed = 1
    state.vetting.forked_at = state.time
    state.vetting.undecided_at = state.time
    for k in range(COPIES):
        state.separation.reckoned[k].live = 0
        state.separation.reckoned[k].p = 0.0


@kernel
def _heed_receiver(state: Record, since: float) -> None:
    """By how much the position may be worse than told, where the receiver errs more of late."""
    separation = state.separation
    scale = max(math.sqrt(state.gnss_factor), _LEAST_CALM)
    if separation.calm <= 0.0 or scale < separation.calm:
        separation.calm = scale
    separation.calm += (scale - separation.calm) * (1.0 - math.exp(-since / _CALM))
    separation.restless = math.sqrt(scale / separation.calm)


@kernel
def _is_split(belief: Belief) -> bool:
    """Whether both a side that blames the receiver lives, and one that does not."""
    of_receiver = 0.0
    total = 0.0
    top = belief.hyp[heaviest(belief)].log_weight
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        weight = math.exp(hyp.log_weight - top)
        total += weight
        if hyp.blames == RECEIVER:
            of_receiver += weight
    return bool(_OF_SIDE * total < of_receiver < (1.0 - _OF_SIDE) * total)


@kernel
def watch(belief: Belief, path: Path, ctx: Context, gyro: int) -> None:
    """Hold the belief against its copies, with an epoch that has a fix.

    Args:
        belief: In place; hypotheses at a copy are added where the two differ too much.
        path: Tree of edges entered.
        ctx: The drive's constants.
        gyro: What measures the turn.
    """
    state = belief.state[0]
    if not _is_due(state):
        return
    separation = state.separation
    par = ctx.par[0]
    windows = state.vetting.windows
    since = min(state.time - windows.anchors[(windows.count - 2) % ANCHORS].time, 10.0)
    _heed_receiver(state, since if windows.count > 1 else 1.0)
    _reckon(state, par, gyro)
    top = belief.hyp[heaviest(belief)]
    held = False
    for k in range(COPIES):
        copy = separation.reckoned[k]
        if copy.live == 1:
            _compare(state, copy, top)
            held = held or copy.p > _HOLDS
    if state.mode != WHEELS or not state.started:
        return
    split = _is_split(belief)
    for k in range(COPIES):
        newer = separation.reckoned[k].begun >= separation.reckoned[COPIES - 1 - k].begun
        copy = separation.reckoned[k]
        sure = copy.live == 1 and copy.p > _SPLITS
        if sure and not split and (newer or separation.reckoned[COPIES - 1 - k].p <= _SPLITS):
            _split(belief, path, ctx, copy)
            return
    due = state.time - separation.begun >= _EVERY and state.learnt_time >= _LEARNT
    calm = not held and (not split or is_fine(state)) and state.vetting.tried == 1
    if due and calm and top.cov[H, H] < _TURNED * _TURNED:
        _begin(state, top)


@kernel
def cover_place(
    out: Record, dx: float, dy: float, p: float, beyond: tuple[float, float, float]
) -> None:
    """Let an estimate cover a place that the vehicle is at with a probability.

    Args:
        out: The estimate, in place: levels and covariance.
        dx: From the estimate to the place, m.
        dy: The same of the other axis.
        p: P(the vehicle is there).
        beyond: What the levels reach beyond it, m: in its direction, along the heading, across it.
    """
    c = math.cos(out.heading)
    s = math.sin(out.heading)
    out.protection_level = max(out.protection_level, math.sqrt(dx * dx + dy * dy) + beyond[0])
    out.level_along = max(out.level_along, abs(c * dx + s * dy) + beyond[1])
    out.level_across = max(out.level_across, abs(c * dy - s * dx) + beyond[2])
    share = 0.5 * p
    out.cov[0] += share * dx * dx
    out.cov[1] += share * dx * dy
    out.cov[3] += share * dy * dy


@kernel
def cover(state: Record, top: Record, out: Record, risk: float) -> None:
    """Let an estimate cover the places by odometry that it differs from by a fault.

    A place at a distance d with sigma a, right with the probability p, is covered by

        r = d + a √(2 log(p / risk))

    Args:
        state: With the copies.
        top: The heaviest hypothesis.
        out: The estimate, in place: levels and covariance.
        risk: Of the level.
    """
    separation = state.separation
    if state.mode == WHEELS:
        more = max(separation.restless, 1.0)
        out.protection_level *= more
        out.level_along *= more
        out.level_across *= more
    for k in range(COPIES):
        copy = separation.reckoned[k]
        if copy.live == 0 or copy.p <= risk:
            continue
        c = math.cos(out.heading)
        s = math.sin(out.heading)
        dx = copy.away[0] + (top.mu[X] - out.x) / state.scale
        dy = copy.away[1] + (top.mu[Y] - out.y) / state.scale
        away = math.sqrt(dx * dx + dy * dy)
        times = math.sqrt(2.0 * math.log(copy.p / risk))
        ex, ey = (dx / away, dy / away) if away > 0.0 else (1.0, 0.0)
        sigmas = (_sigma(copy, ex, ey), _sigma(copy, c, s), _sigma(copy, -s, c))
        beyond = (times * sigmas[0], times * sigmas[1], times * sigmas[2])
        cover_place(out, dx, dy, copy.p, beyond)


@kernel
def _sigma(copy: Record, ex: float, ey: float) -> float:
    """Of a copy's place along a direction, m."""
    cov = copy.cov
    return math.sqrt(
        max(ex * ex * cov[X, X] + 2.0 * ex * ey * cov[X, Y] + ey * ey * cov[Y, Y], 0.0)
    )


@kernel
def cover_fixes(state: Record, out: Record, risk: float) -> None:
    """Let an estimate cover both the place of fixes that lie beside the road, and that on it.

    Args:
        state: With these places.
        out: The estimate, in place: levels and covariance.
        risk: Of the level.
    """
    beside = state.separation.unmapped
    if beside.p <= risk:
        return
    _cover(state, out, (beside.at[0], beside.at[1]), beside.p, beside.sigma, risk)
    _cover(state, out, (beside.road[0], beside.road[1]), beside.p, beside.sigma, risk)


@kernel(inline=True)
def _cover(
    state: Record, out: Record, place: tuple[float, float], p: float, sigma: float, risk: float
) -> None:
    """Let an estimate cover a place (plane) of a probability, and as much about it as it errs."""
    dx = (place[0] - out.x) / state.scale
    dy = (place[1] - out.y) / state.scale
    beyond = sigma * math.sqrt(2.0 * math.log(p / risk))
    cover_place(out, dx, dy, p, (beyond, beyond, beyond))


@kernel(inline=True)
def cover_gross_error(state: Record, top: Record, out: Record, risk: float) -> None:
    """Let an estimate cover the place of a receiver that the likeliest hypothesis doubts.

    Args:
        state: With what is known of that.
        top: The heaviest hypothesis.
        out: The estimate, in place: levels and covariance.
        risk: Of the level.
    """
    p = state.separation.gross.p
    if p > risk and (state.hindsight == 0 or is_gross(top)):
        dx, dy, sigma = error_of(state, top)
        place = (top.mu[X] + state.scale * dx, top.mu[Y] + state.scale * dy)
        _cover(state, out, place, p, sigma, risk)


@kernel(inline=True)
def cover_scale(state: Record, out: Record, risk: float) -> None:
    """Let an estimate cover the last fix, where odometer or turns may have another scale, or spin.

    Args:
        state: With the fix.
        out: The estimate, in place: levels and covariance.
        risk: Of the level.
    """
    size = state.vetting.wheel_size
    p = max(size.scale.p, state.vetting.turn_size.scale.p)
    if p > risk:
        _cover(state, out, (size.at[0], size.at[1]), p, size.at[2], risk)
    spin = state.vetting.spin
    if spin.p > risk:
        now = state.vetting.windows.now
        _cover(state, out, (now.x, now.y), spin.p, spin.sigma, risk)
