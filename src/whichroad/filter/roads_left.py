"""Roads that are left while no fix comes: the vehicle has left them, or its motion is wrong.

Counters that lose turns in a tunnel turn the belief off its road.  Both are as rare.  Until a fix
comes, or roads fit again for long enough, the vehicle may be wherever its way could have led.
"""

import math

from .._compile import Record, kernel
from .gnss.separation import cover_place
from .gnss.sides import weight_off_roads
from .haste import watch_haste
from .sparse.dropped import forget_dropped
from .state import CLOCK, ROUTES, Belief, Context, X, Y, most_probable
from .unmapped import watch_fixes

_SURE = 0.01  # P(off the roads) up to which their place is known
_LEFT = 0.5  # and from which on they are left
_FORGOTTEN = -7.0  # log-odds of wrong motion, below which it is doubted no longer
_ANY_TURN = 1.0  # rad², of a heading by turns that may have been lost


@kernel
def watch_roads(belief: Belief, ctx: Context) -> None:
    """Whether roads were left: beside fixes, while none comes, or not followed any more.

    Args:
        belief: Normalised.
        ctx: The drive's constants.
    """
    if belief.state[0].changed == 1 and not ctx.par[0].paper:
        watch_fixes(belief, ctx)
        watch_haste(belief, ctx)
    if belief.state[0].observed == 1 and belief.state[0].motion != ROUTES:
        forget_dropped(belief, ctx)
    _count_way(belief, ctx)


@kernel(inline=True)
def _count_way(belief: Belief, ctx: Context) -> None:
    """Count the way since roads were left, and what following roads again says, in an epoch.

    The log-odds that the motion was wrong begin at 0.  Who is in a wrong place follows a road by
    chance, which costs `off_road_cost` a metre.

    Args:
        belief: Normalised.
        ctx: The drive's constants.
    """
    state = belief.state[0]
    left = state.separation.roads
    moved = state.since_fix - left.seen
    left.seen = state.since_fix
    if state.mode == CLOCK or moved < 0.0:
        left.known = left.doubted = 0
    if state.mode == CLOCK or moved <= 0.0:
        return
    off = weight_off_roads(belief)
    left.metres += moved
    if left.doubted == 1:
        left.odds -= ctx.par[0].off_road_cost * moved * (1.0 - off)
        if left.odds < _FORGOTTEN:
            left.doubted = 0
    elif off < _SURE:
        top = belief.hyp[most_probable(belief)]
        left.place[0], left.place[1] = top.mu[X], top.mu[Y]
        left.metres = 0.0
        left.known = 1
    elif left.known == 1 and off > _LEFT and state.time - state.last_fix > ctx.par[0].outage_after:
        left.doubted = 1
        left.odds = 0.0


@kernel
def p_turned_wrong(state: Record) -> float:
    """P(the motion that led off the roads was wrong)."""
    left = state.separation.roads
    return 1.0 / (1.0 + math.exp(-left.odds)) if left.doubted == 1 else 0.0


@kernel
def cover_way(state: Record, out: Record, risk: float) -> None:
    """Let an estimate cover all places that the way since the roads could have led to.

    These are within the distance s driven from the place where they were left: with the variance
    ¼ s² of each axis, as all over a disc.  The heading may be off by a radian.

    Args:
        state: With the way.
        out: The estimate, in place: levels and covariance.
        risk: Of the level.
    """
    p = p_turned_wrong(state)
    if p <= risk:
        return
    left = state.separation.roads
    dx = (left.place[0] - out.x) / state.scale
    dy = (left.place[1] - out.y) / state.scale
    way = left.metres
    beyond = (way + out.protection_level, way + out.level_along, way + out.level_across)
    cover_place(out, dx, dy, p, beyond)
    out.cov[0] += 0.25 * p * way * way
    out.cov[3] += 0.25 * p * way * way
    out.cov[5] += p * _ANY_TURN
