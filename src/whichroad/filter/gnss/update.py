"""An epoch's fix: update the belief, add re-initialisation hypotheses."""

import math

from ..._compile import Record, Vector, kernel
from ..hypotheses.births import Start, cold_start
from ..state import (
    CLOCK,
    DISTANCE,
    NOTHING,
    ROUTES,
    WHEELS,
    Belief,
    Context,
    H,
    K,
    Path,
    X,
    Y,
    heaviest,
    most_probable,
    normalise,
)
from .bias import age_receiver, is_fine
from .departure import drives, is_followed_blindly, note_departure, p_strayed
from .diverging_track import follow_track, has_diverged, may_have_turned
from .dragged import add_dragged, count_dragged, note_places
from .frequent_fixes import second_misfits
from .gross_error import comes_back, fork_solution, heed_gross_error, takes_back
from .inflation import (
    bias_time,
    is_alone,
    is_unlikely,
    is_vouched,
    may_reflect,
    was_silent,
)
from .jumps import jump_or_stray
from .noise import learn_factor, observe_white, update_root
from .position import (
    Axes,
    innovations,
    observe_given,
)
from .reported_motion import observe_motion
from .sides import (
    MOST_ODDS,
    blame_receiver,
    both_live,
    even_out,
    fork_biased,
    loosen,
    misfit,
    odds_of_sides,
    take_sides,
    weight_off_roads,
)
from .start import forget_factor

_RESTARTED = 0.1  # P(the belief was wrong) where a receiver alone errs more than is likely
_RECENT = 10.0  # s; wheels confirm the motion since a fix this long ago
_YOUNG = 30.0  # s of fixes, before which the belief may be as wrong as the receiver
_REFUTED = 0.3  # of the pruning floor: hypotheses below it are dropped before their update
_FAR = 20.0  # m, from a misfitting fix to the estimate, that adds re-initialisation hypotheses
_REACH, _FASTEST = 1000.0, 100.0  # m, m/s: farther from the estimate no fix can be right at once
_JUMPED = 60.0  # s after a jump of the receiver, for which it is what is wrong
_FORGOTTEN = 30.0  # s without a misfit, after which the next one is a new event
_SIDES = 1.6  # times the gate: one sound fix in a thousand
_FREQUENT = 4.0  # s between fixes, up to which a vehicle is followed along its road
_ROLLS, _ROLLED = 3.0, 6.0  # s for which who stops may roll on; chi-square that shows it
_BEGAN_SHARE = 0.5  # P(the belief was wrong) soon after the start
_MOVED_SHARE = 0.1  # P(the motion was wrong) where the receiver has not visibly jumped
_BACK_SHARE = 0.9  # and where it takes back a jump that was believed
_DOUBTED = 10.0  # s after odometry that may be wrong, for which a misfit is the odometry's
_BENT = 0.12  # rad by which odometry that was never seen to turn may have turned the wrong way
_DOPPLER = 1.0  # m/s, sigma of a speed that was measured
_TRIED = 0.9  # s between two times that the vehicle is looked for at the fix then
_UNTRIED_SHARE = 0.2  # P(its turns were wrong) each time
_STRAYED, _MOST_STRAYED = 0.05, 0.1  # P(it is at the fix), where no turns are measured
_SEARCHED = 20.0  # s for which it is
_TURNS_SHARE = 0.5  # P(the vehicle is at the fix) where turns are refused that had agreed before
LATEST = 0.5  # share of the last interval of fixes in the usual one
_FINER = 18.0  # times a fix's variance, sum over both axes, of a place that it tells far better
_LOST_TIME = 5.0  # s off the roads, from which on a far fix is doubted less than the belief


@kernel(inline=True)
def _axes(fix: Vector, white: float, thin: float) -> Axes:
    """The axes of a fix; white noise of so many reported sigmas, `thin` times its variance."""
    return Axes(
        math.cos(fix[4]), math.sin(fix[4]), (white * fix[2]) ** 2 * thin,
        (white * fix[3]) ** 2 * thin,
    )  # fmt: skip


@kernel
def _count_misfit(belief: Belief, fix: Vector, count: float) -> None:
    """Count fixes in a row that fit no hypothesis (0: it fits), and how far the last of them is."""
    state = belief.state[0]
    if count <= 0.0:
        state.misfits = 0.0
        return
    mean = belief.hyp[heaviest(belief)].mu
    away = math.hypot(fix[0] - mean[X], fix[1] - mean[Y]) / state.scale
    state.misfits += count
    state.vetting.misfit = away + 3.0 * fix[2]


@kernel(inline=True)
def observe_standing(belief: Belief, ctx: Context, epoch: Record) -> bool:
    """A standing vehicle's fix observes the receiver's noise, and not the position.

    Returns:
        Whether it is a fix of a vehicle that stands there, and tells nothing new of the place.
        Else nothing was observed: wheels or receiver are wrong, or it is far finer than before.
    """
    state = belief.state[0]
    fix = epoch.fix
    par = ctx.par[0]
    if state.mode == CLOCK and state.still.apart > 0.0:
        _count_misfit(belief, fix, min(epoch.time - state.last_fix, 1.0))
        state.last_fix = epoch.time
        return True
    hyp = belief.hyp[heaviest(belief)]
    if hyp.cov[X, X] + hyp.cov[Y, Y] > _FINER * state.gnss_factor * fix[2] * fix[3]:
        return False
    white = math.sqrt(state.gnss_factor) * par.gnss_white_ratio
    axes = _axes(fix, white, 1.0)
    rolls = state.mode == CLOCK and is_fine(state) and state.standing < _ROLLS
    if rolls or (state.mode == WHEELS and (state.vetting.runs == 1 or drives(epoch))):
        innovations(belief, ctx, fix, axes)
        if misfit(belief, axes) > (_ROLLED if rolls else _SIDES * par.gnss_gate):
            return False
    update_root(belief, fix, state.gnss_factor, max(epoch.time - state.last_fix, 0.0))
    innovations(belief, ctx, fix, axes)
    if state.mode != CLOCK:
        note_departure(belief, epoch, axes)
    learn_factor(belief, ctx, epoch, white, 0.0)
    state.last_fix = epoch.time
    return True


@kernel(inline=True)
def _is_lost(belief: Belief) -> bool:
    """Whether the belief has been off the roads for a while; then it counts anew.

    A fix seldom misfits for long: the receiver's factor and bias adapt to it.  Roads do not;
    a belief that left them with a wrong position would stay wrong.
    """
    state = belief.state[0]
    off = weight_off_roads(belief)
    lost = state.time > state.on_road_at + _LOST_TIME
    if off < 0.5 or lost:
        state.on_road_at = state.time
    return bool(off >= 0.5 and lost)


@kernel(inline=True)
def _add_restarts(
    belief: Belief, path: Path, ctx: Context, epoch: Record, white: float, lost: bool, share: float
) -> None:  # fmt: skip
    """A far fix may be right, and the belief wrong.

    Re-initialisation hypotheses at the fix are added with a small weight; roads and fixes
    from here on decide between them and a receiver that has lost lock.  A lost belief does
    not know its heading either: the car may have been carried.
    """
    normalise(belief)
    top = belief.hyp[most_probable(belief)]
    mean = top.mu
    fix = epoch.fix
    away = math.hypot(fix[0] - mean[X], fix[1] - mean[Y]) / belief.state[0].scale
    if away > _FAR:
        par = ctx.par[0]
        start = Start(
            math.sqrt(belief.state[0].gnss_factor), white, mean[H],
            math.inf if lost else math.sqrt(top.cov[H, H]) + 0.03, mean[K],
            math.sqrt(top.cov[K, K]), 0.0, par.drift_sigma, True,
        )  # fmt: skip
        cold_start(belief, path, ctx, fix, start, share)


@kernel(inline=True)
def _take_sides(belief: Belief, ctx: Context, epoch: Record, axes: Axes) -> bool:
    """A misfit with sound motion and a receiver that works: either may be wrong."""
    state = belief.state[0]
    vetting = state.vetting
    odds = abs(odds_of_sides(belief))
    if epoch.time - vetting.forked_at > _FORGOTTEN and odds > MOST_ODDS:
        for i in range(state.count):
            belief.hyp[i].blames = NOTHING
    jumped = epoch.time - vetting.windows.jumped_at <= _JUMPED
    share = _MOVED_SHARE
    young = state.learnt_time < _YOUNG
    untried = vetting.turned == 0 and abs(vetting.bend) > _BENT
    returned = epoch.time - vetting.returned_at < _YOUNG
    if jumped and young:
        return False
    if young:
        share = _BEGAN_SHARE
    elif jumped:
        share = ctx.par[0].gnss_lost
    elif untried or returned:
        share = _BEGAN_SHARE
    gate = 0.0 if vetting.wavers == 1 else _SIDES * ctx.par[0].gnss_gate
    wrong_way = max(2.0 * abs(vetting.bend) if untried else 0.0, may_have_turned(belief))
    misfits = misfit(belief, axes) > gate
    if misfits and comes_back(belief, axes, ctx.par[0].gnss_gate):
        return True
    if misfits and not both_live(belief, axes) and takes_back(belief, axes, epoch.time):
        share = _BACK_SHARE
    changed, undecided = take_sides(belief, axes, gate, share, wrong_way)
    if undecided:
        if epoch.time - vetting.forked_at > _FORGOTTEN:
            vetting.undecided_at = epoch.time
            vetting.untried = untried or returned
            state.restarted_at = epoch.time
        vetting.forked_at = epoch.time
    return changed


@kernel(inline=True)
def _settle(
    belief: Belief, ctx: Context, epoch: Record, axes: Axes, doubted: bool, since: float
) -> None:
    """Where the fix fits nothing, let motion or receiver be wrong first."""
    state = belief.state[0]
    changed = doubted and loosen(belief, axes, ctx.par[0].gnss_gate)
    state.vetting.moved = changed
    if state.vetting.elsewhere == 1:
        blame_receiver(belief, axes)
        changed = True
    elif state.mode == WHEELS and since < _RECENT and not doubted:
        changed = _take_sides(belief, ctx, epoch, axes)
    elif was_silent(state, ctx.par[0], since):
        fork_biased(belief)
        changed = True
    if changed:
        innovations(belief, ctx, epoch.fix, axes)
        if epoch.time - state.vetting.windows.jumped_at <= _JUMPED:  # it is explained
            state.innovation_mean[0] = state.innovation_mean[1] = 0.0


@kernel
def _is_in_reach(belief: Belief, epoch: Record, since: float) -> bool:
    """Whether a vehicle may have come to a fix since the last one, s, if the belief is wrong."""
    mean = belief.hyp[most_probable(belief)].mu
    away = math.hypot(epoch.fix[0] - mean[X], epoch.fix[1] - mean[Y]) / belief.state[0].scale
    return bool(away < _REACH + _FASTEST * since)


@kernel(inline=True)
def _search(
    belief: Belief, path: Path, ctx: Context, epoch: Record, white: float, far: bool
) -> None:
    """Look for the vehicle at a fix that is far away, where the belief may be wrong."""
    state = belief.state[0]
    par = ctx.par[0]
    vetting = state.vetting
    lost = state.mode != CLOCK and _is_lost(belief)
    if state.mode != CLOCK and (lost or far):
        _add_restarts(belief, path, ctx, epoch, white, lost, par.gnss_lost)
    share = _TURNS_SHARE if vetting.elsewhere == 1 else 0.0
    undecided = epoch.time - vetting.undecided_at < _SEARCHED
    undecided = undecided and epoch.time > state.restarted_at + _TRIED
    if state.mode == WHEELS and vetting.untried == 1 and undecided:
        share = _UNTRIED_SHARE
    if state.mode == WHEELS and has_diverged(belief):
        share = _TURNS_SHARE
    blind = state.mode == DISTANCE and is_followed_blindly(state, epoch)
    strayed = p_strayed(state) if blind else 0.0
    if strayed > _STRAYED and epoch.time > state.restarted_at + _TRIED:
        share = max(share, min(strayed, _MOST_STRAYED))
    if is_alone(state, par, epoch) and is_unlikely(belief, epoch.time):
        share = _RESTARTED
    if share > 0.0:
        state.restarted_at = epoch.time
        _add_restarts(belief, path, ctx, epoch, white, True, share)


@kernel(inline=True)
def _learn(belief: Belief, ctx: Context, epoch: Record, white: float) -> bool:
    """Learn the receiver's factor, unless something else may be wrong; whether odometry is."""
    state = belief.state[0]
    vetting = state.vetting
    doubted = epoch.time - vetting.suspect_at < _DOUBTED
    doubted = doubted and epoch.time - vetting.windows.jumped_at > _JUMPED
    undecided = epoch.time - vetting.undecided_at < _DOUBTED
    gross = state.mode == WHEELS and is_fine(state) and state.separation.gross.p > 0.0
    if vetting.apart == 0 and not doubted and not undecided and not gross:
        learn_factor(belief, ctx, epoch, white, state.moving)
    else:
        state.factor_time = epoch.time
        state.unlearnt = 0.0
    return bool(doubted)


@kernel(inline=True)
def _count_anew(state: Record, epoch: Record) -> None:
    """What is counted from fix to fix begins at this one."""
    state.moving = 0.0
    state.since_fix = 0.0
    state.unmeasured = 0.0
    state.last_fix = epoch.time
    state.reported[0] = min(state.reported[0], epoch.fix[2])
    state.reported[1] = epoch.fix[2]


@kernel(inline=True)
def _weigh_fix(belief: Belief, ctx: Context, epoch: Record, axes: Axes, since: float) -> float:
    """Condition on the position; between two sides it counts little.  Returns its chi-square."""
    par = ctx.par[0]
    state = belief.state[0]
    known = state.learnt_time > _YOUNG
    if known and state.mode != WHEELS:
        reflects = may_reflect(state, par, epoch)
        if jump_or_stray(belief, axes, since, reflects, par.gnss_gate):
            innovations(belief, ctx, epoch.fix, axes)
    alone = state.mode == CLOCK and is_fine(state) and epoch.speed_sigma < _DOPPLER
    jumps = since < _RECENT and (alone or (is_vouched(state, epoch) and known))
    if jumps and second_misfits(belief, axes, par.gnss_gate, since):
        innovations(belief, ctx, epoch.fix, axes)
    tried = state.mode == WHEELS and state.vetting.tried == 1
    odds = odds_of_sides(belief) if tried else 0.0
    both = tried and abs(odds) < MOST_ODDS
    least = 0.0 if both else _REFUTED * par.prune
    chi2 = observe_given(belief, ctx, epoch.fix, axes, par.gnss_gate, jumps, least)
    if both:
        even_out(belief, odds, min(max(since, 0.0), _RECENT))
    return chi2


@kernel(inline=True)
def _follow_fix(belief: Belief, ctx: Context, epoch: Record, axes: Axes, since: float) -> float:
    """Condition on the position; where that is all that is measured, count how far it moves."""
    state = belief.state[0]
    if state.mode != CLOCK or not is_fine(state) or not is_followed_blindly(state, epoch):
        return _weigh_fix(belief, ctx, epoch, axes, since)
    note_places(belief)
    chi2 = _weigh_fix(belief, ctx, epoch, axes, since)
    add_dragged(belief)
    count_dragged(belief)
    return chi2


@kernel(inline=True)
def observe_fix(belief: Belief, path: Path, ctx: Context, epoch: Record) -> float:
    """Y₁: position, course and speed of the epoch's fix.

    The white part is scaled with the interval, so that fixes ten times as often add
    nearly no information.  Without odometry course and speed come first: nothing else knows that
    the vehicle accelerates.

    Returns:
        Chi-square of the position under the hypothesis that fits it best.
    """
    par = ctx.par[0]
    state = belief.state[0]
    fix = epoch.fix
    since = interval = epoch.time - state.last_fix
    if state.mode == CLOCK:
        interval *= min(1.0, max(state.speed, 0.25))
    measured = state.mode != CLOCK or epoch.speed_sigma < _DOPPLER
    age_receiver(belief, ctx, bias_time(state, par, epoch), measured)
    if state.vetting.elsewhere == 1:
        forget_factor(belief, par, epoch)
    factor = state.gnss_factor
    white = math.sqrt(factor) * par.gnss_white_ratio
    if state.mode == CLOCK:
        factor, white = observe_white(belief, ctx, epoch, factor, white)
    update_root(belief, fix, factor, max(interval, 0.0))
    thin = max(1.0, 1.0 / max(interval, 0.01))
    axes = _axes(fix, white, thin)
    first = state.mode == CLOCK and state.motion != ROUTES
    if first:  # what they tell of the way since the last fix is no error of the receiver
        observe_motion(belief, ctx, epoch, thin)
    innovations(belief, ctx, fix, axes)
    fork_solution(belief, ctx, epoch, axes)
    in_reach = _is_in_reach(belief, epoch, since)
    if (state.mode != CLOCK or since < _FREQUENT) and in_reach:
        note_departure(belief, epoch, axes)
    doubted = _learn(belief, ctx, epoch, white)
    _count_anew(state, epoch)
    follow_track(belief, since)
    _settle(belief, ctx, epoch, axes, doubted, since)
    state.fix_interval += LATEST * (since - state.fix_interval)
    chi2 = _follow_fix(belief, ctx, epoch, axes, since)
    far = chi2 > 4.0 * par.gnss_gate
    if par.gnss_lost > 0.0 and in_reach:
        _search(belief, path, ctx, epoch, white, far)
    if not first:
        observe_motion(belief, ctx, epoch, thin)
    heed_gross_error(belief, ctx, epoch.time)
    state.vetting.apart = far and epoch.time - state.vetting.windows.jumped_at > _JUMPED
    _count_misfit(belief, fix, 1.0 if far else 0.0)
    return chi2
