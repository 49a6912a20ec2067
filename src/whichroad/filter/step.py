"""One epoch of the filter: Figure 7 of Smaili et al. 2007.

Kernels take the belief (what is estimated), the path tree and the history (what is kept of the
past), the epoch (what was measured) and the context (what is constant).
"""

from .._compile import Record, entry, kernel
from ..graph.network import plane_scale
from . import paper
from .along import advance_along, forward_only
from .creeping import count_motion, unsure_of
from .evidence.observe import observe_evidence
from .gnss.carried import may_be_carried
from .gnss.inflation import bias_time
from .gnss.noise import observe_across
from .gnss.separation import watch
from .gnss.silence import SPARSE, observe_after_silence, stands
from .gnss.standstill import driven_off
from .gnss.start import is_anywhere, is_far_finer, start_at_fix
from .gnss.update import observe_fix, observe_standing
from .gyro import rest
from .hypotheses.births import exchange_off_road, turn_round, turn_with_heading
from .hypotheses.branching import BRANCH_THRESHOLD, branch
from .hypotheses.no_sign import consider_backing, mirrored
from .hypotheses.reduction import reduce
from .lookback.history import History, accumulate_motion, accumulate_noise, is_full, store
from .map_error import learn_map
from .modes import believed, follow_odometer
from .motion import (
    Increment,
    Noise,
    blind_noise,
    driven_unseen,
    extrapolated,
    increment_of,
    pieces_of,
    predict_plane,
    wheel_noise,
)
from .road import map_is_due, observe_roads
from .roads_left import watch_roads
from .silent_wheels import roam
from .sparse.candidates import learn_driver
from .sparse.routing import transit, truncate_to_edges
from .state import (
    CLOCK,
    OFF_ROAD,
    PLANE,
    ROAD,
    ROUTES,
    STAND,
    START,
    WAIT,
    WHEELS,
    Belief,
    Context,
    Epochs,
    K,
    Path,
    X,
    Y,
    heaviest,
    normalise,
)
from .summary.estimate import Output, describe
from .summary.waiting import wait
from .vetting.motion_sources import AHEAD
from .vetting.windows import BY_GYRO, HEARD_AGAIN, is_alone
from .weaving import note_motion_along

_EXCHANGE, _TURN_TIME = 25.0, 0.25  # m between exchanges with off the roads; s, of the turn rate
_STILL = 0.3  # m by the odometer since the last fix, up to which the vehicle stands
_SPEED_KEPT, _COURSE_KEPT = 1.5, 3.0  # s, for which reports tell acceleration, and heading
_LONGEST, _FARTHEST = 1800.0, 5e4  # s without odometry, m in one epoch: beyond it starts anew
_NEW_ENTRIES = 2048  # of the path tree, for an epoch


@kernel(inline=True)
def step(
    belief: Belief, path: Path, history: History, epoch: Record, output: Output, ctx: Context,
    k: int,
) -> None:  # fmt: skip
    """One epoch: predict, observe, branch, observe the map, weigh, merge and prune, summarise."""
    state = belief.state[0]
    dt = _begin_epoch(belief, ctx, epoch)
    chi2 = 0.0
    if state.motion == START:
        _start(belief, path, ctx, epoch)  # candidates about the fix, and none of them
    if state.motion == WAIT:
        return
    if state.motion != START:
        _predict(belief, path, history, ctx, epoch, dt)  # eq. (1); along the road; by routes
        if epoch.has_fix:
            chi2 = _observe_gnss(belief, path, history, ctx, epoch)  # Y_1, Q^gps
    if epoch.evidence > 0 and not ctx.par[0].paper:
        observe_evidence(belief, ctx, epoch.first_evidence, epoch.evidence)  # further sensors
    _branch(belief, path, ctx, epoch)  # S_k, B(i, j)
    if map_is_due(state, ctx):
        _observe_map(belief, history, ctx)  # Y_carto, Q^carto
    watch(belief, path, ctx, epoch.gyro)  # beside odometry alone
    _reduce(belief, path, ctx, epoch)  # P(S_k | Y); merge within an edge, prune
    watch_roads(belief, ctx)
    _estimate_speed(belief, ctx, epoch, dt)
    state.driver.odometer = epoch.odometer[0]
    if len(history.steps) > 0:
        store(belief, history, k, state.changed == 1, ctx.par[0].off_road_leave)
    _summarise(belief, ctx, output, k, chi2)


@entry
def run(
    belief: Belief, path: Path, history: History, epochs: Epochs, output: Output, ctx: Context,
    first: int, last: int,
) -> int:  # fmt: skip
    """Filter the epochs first … last − 1 of a drive; on line it is called for one at a time.

    Args:
        belief: In place; empty before the first fix.
        path: Tree of edges entered.
        history: What is stored for smoothing; of no length where nothing is.
        epochs: What the sensors measured, (n,) EPOCH.
        output: Filled for the same rows.
        ctx: The drive's constants.
        first: First epoch.
        last: One past the last.

    Returns:
        The epoch it stopped before: `last`, or earlier when a table is full.
    """
    for k in range(first, last):
        if len(path.entry) - path.size[0] < _NEW_ENTRIES and len(path.entry) > _NEW_ENTRIES:
            return k
        if len(history.steps) > 0 and is_full(history):
            return k
        if epochs[k].filled == 1 and belief.state[0].started:
            wait(belief, ctx, output, k, epochs[k].time)
            continue
        reading = believed(belief, history, ctx, epochs[k])  # less what is withheld
        step(belief, path, history, reading, output, ctx, k)
    return last


@kernel(inline=True)
def _begin_epoch(belief: Belief, ctx: Context, epoch: Record) -> float:
    """Advance the time and decide how motion is predicted; returns the epoch's duration, s."""
    par = ctx.par[0]
    state = belief.state[0]
    dt = epoch.time - state.time
    state.time = epoch.time
    state.changed = 0
    state.observed = 0
    state.motion = WAIT
    if not state.started and not epoch.has_fix:
        return float(dt)
    x = belief.hyp[0].mu[X] if state.started else epoch.fix[0]
    y = belief.hyp[0].mu[Y] if state.started else epoch.fix[1]
    state.scale = plane_scale(ctx.roads, x, y)
    gap = dt > _LONGEST if state.mode == CLOCK else abs(epoch.arc) > _FARTHEST
    lost = gap or state.misfits >= par.lost_after or is_far_finer(state, epoch)
    lost = lost or is_anywhere(belief, epoch)
    if epoch.has_fix and (not state.started or (lost and not par.paper)):
        state.motion = START
        state.changed = 1
        return 0.0
    if state.mode == WHEELS:
        state.motion = PLANE
    elif state.mode == CLOCK and stands(belief, epoch, dt):
        state.motion = STAND
    elif state.mode == CLOCK and epoch.has_fix and dt > SPARSE:
        state.motion = ROUTES
    else:
        state.motion = ROAD
    return float(dt)


@kernel(inline=True)
def _start(belief: Belief, path: Path, ctx: Context, epoch: Record) -> None:
    """Start, or start anew, from the epoch's fix."""
    state = belief.state[0]
    if ctx.par[0].paper:
        if not paper.start(belief, ctx, epoch):
            state.motion = WAIT
        return
    state.knows_heading = start_at_fix(belief, path, ctx, epoch)
    normalise(belief)


@kernel(inline=True)
def _predict(
    belief: Belief, path: Path, history: History, ctx: Context, epoch: Record, dt: float
) -> None:
    """The process model, for the epoch's kind of motion."""
    state = belief.state[0]
    mode = state.mode
    heard = state.motion != ROUTES and epoch.time - state.course_time < _COURSE_KEPT
    state.knows_heading, state.weaves = mode == WHEELS or heard, 0
    if ctx.par[0].paper:
        paper.predict(belief, ctx, epoch, dt)
        return
    if epoch.gyro == BY_GYRO and state.motion == PLANE:
        rest(belief, history, ctx.par[0], epoch, dt)
    consider_backing(belief, ctx, epoch, dt)
    if len(history.steps) > 0:
        moving = 0.0 if state.motion == STAND else dt
        accumulate_motion(history, epoch, moving, state.speed, mode)
    if state.motion == PLANE:
        _predict_wheels(belief, path, history, ctx, epoch, dt)
    elif state.motion == STAND:
        count_motion(state, 0.0, dt)
    elif state.motion == ROUTES:
        learn_driver(belief, ctx, dt)
        metres = transit(belief, path, history, ctx, epoch, dt)
        history.since[0].jumped = 1
        history.since[0].map_aged += metres
        count_motion(state, metres, dt)
        state.standing = max(state.standing, belief.hyp[heaviest(belief)].stood)
    else:
        metres = abs(state.speed) * dt if mode == CLOCK else abs(epoch.arc)
        odometer = dt if mode == CLOCK else epoch.arc
        unseen = epoch.time - state.reports.speed[1] > _SPEED_KEPT
        q = blind_noise(ctx.par[0], odometer, metres, mode, unseen, heard)
        q = driven_off(state.still, history.since[0], _noise(state, epoch, q, metres, 0.0, dt))
        note_motion_along(history, state, odometer, q, metres)
        turned = epoch.odometry_valid != AHEAD and turn_round(belief, ctx, dt)  # none predicted
        changed = advance_along(belief, path, ctx, odometer, q) or turned
        if (mode == CLOCK and forward_only(belief, ctx)) or changed:
            state.changed = 1
        count_motion(state, metres, dt)
    if mode != CLOCK and dt > 1e-6 and epoch.gyro != HEARD_AGAIN:
        follow_odometer(state, epoch.arc, dt)


@kernel(inline=True)
def _predict_wheels(
    belief: Belief, path: Path, history: History, ctx: Context, epoch: Record, dt: float
) -> None:
    """Equation (1) in equal pieces of the arc, branching between them."""
    state = belief.state[0]
    heard_again = epoch.gyro == HEARD_AGAIN
    pieces = 1 if heard_again else pieces_of(epoch.arc)
    move = increment_of(epoch, pieces, dt)
    if heard_again:  # its arc is the rest of a distance
        move = Increment(0.0, move.turn, 0.0, 0.0, move.clock)
    metres = abs(move.arc)
    for piece in range(pieces):
        if piece > 0:
            if state.changed:
                normalise(belief)
            if branch(belief, path, ctx, epoch.arc / pieces, 0.0):
                state.changed = 1
            if state.changed:
                reduce(belief, path, ctx)
        q = wheel_noise(ctx.par[0], metres, move.turn)
        q = _noise(state, epoch, q, metres, dt - (piece + 1) * dt / pieces, dt / pieces)
        if len(history.steps) > 0:
            accumulate_noise(history, move, q)
        if metres > 0.0 or move.turn != 0.0 or q.along > 0.0:  # else nothing moves
            back = mirrored(move, epoch)
            for i in range(state.count):
                own = back if belief.hyp[i].backs == 1 else move
                predict_plane(belief.hyp[i].mu, belief.hyp[i].cov, own, state.scale, q)
        count_motion(state, abs(epoch.arc) if heard_again else metres, dt / pieces)
    if is_alone(epoch):
        roam(belief, history, epoch, dt)
    if dt > 1e-6:
        state.turn_rate[0] = epoch.turn / dt
        state.turn_rate[1] += (state.turn_rate[0] - state.turn_rate[1]) * dt / (dt + _TURN_TIME)


@kernel(inline=True)
def _noise(
    state: Record, epoch: Record, noise: Noise, metres: float, left: float, dt: float
) -> Noise:  # fmt: skip
    """Process noise of an increment, more where the odometer did not measure it.

    The increment takes dt seconds, and `left` seconds of the epoch are left after it.
    """
    measured = epoch.odometry_valid != 0 and epoch.odometry_valid != AHEAD
    if state.mode == CLOCK or measured or is_alone(epoch):
        state.unmeasured = 0.0
        return unsure_of(state, noise, metres, epoch.arc)
    before = state.unmeasured
    state.unmeasured += metres
    noise = extrapolated(unsure_of(state, noise, metres, epoch.arc), before, metres)
    if epoch.odometry_valid == AHEAD:
        return driven_unseen(noise, state.vetting.silent - left, dt)
    return noise


@kernel(inline=True)
def _observe_gnss(
    belief: Belief, path: Path, history: History, ctx: Context, epoch: Record
) -> float:
    """The epoch's fix, unless the vehicle stands; returns its chi-square."""
    state = belief.state[0]
    if ctx.par[0].paper:
        return paper.observe_gnss(belief, ctx, epoch)
    if state.elsewhere[0] > 0.0:
        state.changed = 1
        state.observed = 1
        return observe_after_silence(belief, path, ctx, epoch)
    carried = may_be_carried(belief, ctx.par[0], epoch)
    still = state.motion == STAND or (state.mode != CLOCK and state.since_fix <= _STILL)
    if carried or (still and observe_standing(belief, ctx, epoch)):
        return 0.0
    if state.motion == ROUTES or state.changed:
        normalise(belief)
    par = ctx.par[0]
    history.since[0].gnss_aged += state.moving * par.gnss_time / bias_time(state, par, epoch)
    state.changed = 1
    state.observed = 1
    chi2 = observe_fix(belief, path, ctx, epoch)
    if state.vetting.moved == 1:
        history.since[0].switched = 1
    return chi2


@kernel(inline=True)
def _branch(belief: Belief, path: Path, ctx: Context, epoch: Record) -> None:
    """Weigh by what was observed, and pass on what has left its edge."""
    state = belief.state[0]
    if ctx.par[0].paper or state.motion == START:  # candidates are drawn anew
        return
    if state.motion == ROUTES:
        truncate_to_edges(belief, ctx)
        forward_only(belief, ctx)
        state.since_map = 0.0
    if state.changed:
        normalise(belief)
    if state.motion == ROUTES:
        observe_across(belief, ctx, epoch)
        state.since_exit = 0.0
        return
    wheels = state.motion == PLANE
    arc = epoch.arc / pieces_of(epoch.arc) if wheels else 0.0
    threshold = 0.0 if wheels else BRANCH_THRESHOLD
    if (arc != 0.0 or state.observed) and branch(belief, path, ctx, arc, threshold):
        state.changed = 1


@kernel(inline=True)
def _observe_map(belief: Belief, history: History, ctx: Context) -> None:
    """Y_carto, after hypotheses have left the roads, come back and turned round."""
    state = belief.state[0]
    if ctx.par[0].paper:
        paper.switch(belief, ctx)
        return
    if state.motion != START:
        _exchange(belief, ctx)
    history.since[0].map_aged += state.since_map
    observe_roads(belief, ctx, state.knows_heading == 1)
    learn_map(belief, ctx)
    state.since_map = state.dragged[0] = state.dragged[1] = 0.0
    state.changed = 1


@kernel(inline=True)
def _reduce(belief: Belief, path: Path, ctx: Context, epoch: Record) -> None:
    """Merge and prune where anything changed; the paper starts anew when it is lost."""
    if ctx.par[0].paper:
        paper.restart_if_lost(belief, ctx, epoch)
    elif belief.state[0].changed:
        reduce(belief, path, ctx)


@kernel(inline=True)
def _exchange(belief: Belief, ctx: Context) -> None:
    """The off-road mode, seldom where it does not matter, and U-turns by heading."""
    state = belief.state[0]
    matters = False
    for i in range(state.count):
        matters = matters or (belief.hyp[i].edge == OFF_ROAD and belief.hyp[i].weight > 1e-3)
    if state.since_exit >= _EXCHANGE or matters:
        exchange_off_road(belief, ctx)
    if state.mode == WHEELS:
        turn_with_heading(belief, ctx)


@kernel(inline=True)
def _estimate_speed(belief: Belief, ctx: Context, epoch: Record, dt: float) -> None:
    """Speed of M over ground, m/s, by the weighted κ."""
    state = belief.state[0]
    if ctx.par[0].paper:
        paper.estimate_speed(belief, ctx, epoch, dt)
        return
    rate = 0.0
    for i in range(state.count):
        rate += belief.hyp[i].weight * belief.hyp[i].mu[K]
    if state.mode == CLOCK:
        state.speed = max(rate, 0.0)
    elif dt > 1e-6 and epoch.gyro != HEARD_AGAIN:
        state.speed = rate * epoch.arc / dt


@kernel(inline=True)
def _summarise(belief: Belief, ctx: Context, output: Output, k: int, chi2: float) -> None:
    """The estimate of epoch k; in the paper the pose of the most probable hypothesis."""
    describe(belief, ctx, output, k, chi2, belief.state[0].changed == 1)
    if ctx.par[0].paper:
        paper.keep_most_probable(belief, ctx, output, k)
