"""Nothing was heard for a while: the vehicle may have been driven or carried elsewhere.

A log that pauses says nothing of what happened meanwhile.  Until the next fix the probability of
having been moved stands beside the hypotheses, as what none of them knows.  The fix decides: the
density of where vehicles come to be meanwhile falls with the square of the distance.
"""

import math

from ..._compile import Record, kernel
from ..hypotheses.births import cold_start
from ..state import START, Belief, Context, K, Path, X, Y, most_probable, normalise, redraw
from ..vetting.motion_sources import SPEED
from .noise import update_root
from .position import NU0, NU1, V00, V01, V11, Axes, innovations
from .standstill import is_still
from .start import start_at_fix, start_of
from .update import LATEST, observe_fix

SPARSE = 2.5  # s; fixes farther apart are joined by routes
_NO_SPEED = 20.0  # m/s, sigma of a speed that says nothing
_STANDING = 0.5  # m/s; a receiver that reports less stands,
_CREEPS, _SIGMAS = 0.1, 3.0  # m/s, sigmas: unless it measures speeds better than that
_LEFT = 0.3  # m/s, of the speed of a vehicle that has come to rest
_STANDS, _CREPT = 0.25, 0.3  # m/s that any standing receiver reports; m and four sigmas
_STOOD = 5.0  # m and four sigmas, beyond which it has moved between fixes that are far apart
_SILENT = 60.0  # s without any reading, from which on the vehicle may be elsewhere,
_GAP, _GAP_OF_RATES = 15.0, 4.0  # or on another road nearby; rates say less of a gap than counts
_UNUSUAL = 4.0  # and times the usual interval of readings
_CARRIED = 0.3  # P(it is), where it stood before and after by its odometry,
_DRIVEN = 0.9  # and where it did not
_ROLLED = 1.0  # m
FASTEST = 30.0  # m/s, at which it may have been moved,
_FARTHEST = 2e4  # and m, how far
_NEAREST = 10.0  # m, about which all places are alike
_LONGEST = 3600.0  # s; the receiver's errors have become others by then
_STAYED, _MOVED = 1e-3, 0.99  # shares below which, and beyond which, nothing is added


@kernel
def is_pause(quiet: float, usual: float) -> bool:
    """Whether so long without a reading (s) is a pause, and not how often there usually is one."""
    return bool(usual > 0.0 and quiet > _SILENT and quiet > _UNUSUAL * usual)


@kernel
def is_gap(quiet: float, usual: float, rates: bool) -> bool:
    """Whether so long without a reading (s) the way through the roads is not known."""
    least = _GAP_OF_RATES if rates else _GAP
    return bool(usual > 0.0 and quiet > least and quiet > _UNUSUAL * usual)


@kernel
def hear(state: Record, time: float) -> None:
    """Note a fix or a measured odometry, and how long after the last one it came."""
    if state.heard[0] != 0.0:
        state.heard[1] += LATEST * (time - state.heard[0] - state.heard[1])
    state.heard[0] = time


@kernel
def may_have_moved(state: Record, arc: float, quiet: float) -> None:
    """Note that the vehicle may be elsewhere.

    Args:
        state: In place.
        arc: What odometry says of the pause, m: counters go on.
        quiet: Its duration, s.
    """
    may_be_lost(state, _DRIVEN if abs(arc) > _ROLLED else _CARRIED, FASTEST * quiet)
    state.moving = min(max(state.moving, quiet), _LONGEST)


@kernel
def may_be_lost(state: Record, p: float, metres: float) -> None:
    """Note that the vehicle is with probability p anywhere within so many metres more."""
    state.elsewhere[0] = max(state.elsewhere[0], p)
    state.elsewhere[1] = min(state.elsewhere[1] + metres, _FARTHEST)


@kernel(inline=True)
def stands(belief: Belief, epoch: Record, dt: float) -> bool:
    """Whether the receiver says that the vehicle stands, and has stood since its last fix.

    Its speed says so; where it reports none, its fixes do.
    """
    state = belief.state[0]
    since = epoch.time - min(state.vetting.windows.speed_time, state.last_fix)
    if not epoch.has_fix and state.vetting.refused[SPEED] == 0 and since <= SPARSE:
        return bool(state.still.at_rest == 1)
    stood = state.still.at_rest == 1
    at_rest = _is_at_rest(belief, epoch, dt)
    state.still.at_rest = 1 if at_rest else 0
    if at_rest and not stood:
        for i in range(state.count):
            redraw(belief.hyp[i], K, 0.0, _LEFT**2)
    return at_rest


@kernel(inline=True)
def _is_at_rest(belief: Belief, epoch: Record, dt: float) -> bool:
    """The same of an epoch with a fix, or of one whose last fix reported no speed."""
    state = belief.state[0]
    if not epoch.has_fix or epoch.speed_sigma > _NO_SPEED:
        return is_still(state, epoch, dt, SPARSE)
    state.still.apart = 0.0
    least = min(max(_SIGMAS * epoch.speed_sigma, _CREEPS), _STANDING)
    if epoch.speed_sigma >= 1.0 or epoch.speed >= least or state.speed >= 3.0 * _STANDING:
        return False
    if dt <= SPARSE and epoch.speed < _STANDS:
        return True
    top = belief.hyp[most_probable(belief)].mu
    away = math.hypot(epoch.fix[0] - top[X], epoch.fix[1] - top[Y]) / state.scale
    return bool(away < (_STOOD if dt > SPARSE else _CREPT) + 4.0 * epoch.fix[2])


@kernel
def _share_elsewhere(belief: Belief, ctx: Context, epoch: Record) -> float:
    """P(the vehicle was moved), given where the first fix afterwards is."""
    state = belief.state[0]
    par = ctx.par[0]
    fix = epoch.fix
    white = state.gnss_factor * par.gnss_white_ratio**2
    axes = Axes(math.cos(fix[4]), math.sin(fix[4]), white * fix[2] ** 2, white * fix[3] ** 2)
    innovations(belief, ctx, fix, axes)
    stayed = 0.0
    away = math.inf
    for i in range(state.count):
        hyp = belief.hyp[i]
        to = hyp.scratch
        first = to[NU0] * to[NU0]
        second = to[NU1] * to[NU1]
        v0 = to[V00] + axes.r0
        v1 = to[V11] + axes.r1
        det = v0 * v1 - to[V01] ** 2
        chi2 = (first * v1 - 2.0 * to[NU0] * to[NU1] * to[V01] + second * v0) / det
        stayed += hyp.weight * math.exp(-0.5 * chi2) / math.sqrt(det)
        if hyp.weight > 0.01:
            away = min(away, first + second)
    area = max(away, _NEAREST**2) * math.log(max(state.elsewhere[1] / _NEAREST, math.e))
    moved = state.elsewhere[0] / area
    return float(moved / (moved + (1.0 - state.elsewhere[0]) * stayed))


@kernel(inline=True)
def observe_after_silence(belief: Belief, path: Path, ctx: Context, epoch: Record) -> float:
    """The first fix after a pause: the vehicle stayed, or starts anew here, or may have done both.

    Returns:
        Chi-square of the position under the hypothesis that fits it best; 0 at a new start.
    """
    state = belief.state[0]
    update_root(belief, epoch.fix, state.gnss_factor, _LONGEST)
    share = _share_elsewhere(belief, ctx, epoch)
    state.elsewhere[0] = 0.0
    state.elsewhere[1] = 0.0
    if share > _MOVED:
        start_at_fix(belief, path, ctx, epoch)
        normalise(belief)
        state.motion = START
        return 0.0
    chi2 = observe_fix(belief, path, ctx, epoch)
    if share > _STAYED:
        normalise(belief)
        cold_start(belief, path, ctx, epoch.fix, start_of(belief, ctx, epoch), share)
    return chi2
