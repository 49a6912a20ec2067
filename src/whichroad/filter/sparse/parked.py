"""Standing beside the roads, between sparse fixes.

A vehicle that is slow may have left its road and stand in a yard or a car park, to the left or
to the right.  There it stays where it is: its fixes keep their offset from the road, which the
receiver's error does not.  On the road it may stand as well, and as long.
"""

from ..._compile import Record, kernel
from ..road import track
from ..state import CAPACITY, OFF_ROAD, Belief, Context, K, X, Y, redraw, rescale, spawn

_PARKS = 1.0 / 150.0  # 1/s, at which a slow vehicle leaves its road to stand beside it
_MOST = 0.1  # P of it between two fixes at most
_SLOW = 5.0  # m/s, mean speed between two fixes of a vehicle that may have parked
_ASIDE, _ASIDE_SIGMA = 25.0, 12.0  # m from the road's line, on either side
_ALONG_SIGMA = 10.0  # m along the road
_REST_VARIANCE = 0.02  # (m/s)², of the speed of a vehicle that stands
_STANDS = 30.0  # s; half of those that stop stand no longer


@kernel
def goes_on_standing(stood: float, dt: float) -> float:
    """P that who has stood for some time goes on to stand, P(t > τ) = 1 / (1 + τ / 30 s).

    Args:
        stood: s.
        dt: s to come.
    """
    return (_STANDS + stood) / (_STANDS + stood + dt)


@kernel(inline=True)
def is_parked(hyp: Record) -> bool:
    """Whether a hypothesis stands beside the roads."""
    return bool(hyp.edge == OFF_ROAD and hyp.stood > 0.0)


@kernel(inline=True)
def park(belief: Belief, ctx: Context, row: int, metres: float, dt: float) -> None:
    """Append children of an arriving hypothesis that stand beside its road, on either side.

    Args:
        belief: The row has arrived near a fix, and has not seen it yet.
        ctx: The drive's constants.
        row: The hypothesis.
        metres: Straight distance since the last fix.
        dt: s since then.
    """
    if metres > _SLOW * dt:
        return
    track(belief, ctx.roads, row)
    share = 0.5 * min(_PARKS * dt, _MOST)
    scale = belief.state[0].scale
    for side in range(2):
        if belief.state[0].count >= CAPACITY:
            return
        hyp = belief.hyp[spawn(belief, row, share, OFF_ROAD, belief.hyp[row].segment)]
        tx, ty = hyp.tangent[0], hyp.tangent[1]
        away = scale * (_ASIDE if side == 0 else -_ASIDE)
        hyp.mu[X] += away * ty
        hyp.mu[Y] -= away * tx
        along, across = _ALONG_SIGMA**2, _ASIDE_SIGMA**2
        hyp.cov[X, X] += along * tx * tx + across * ty * ty
        hyp.cov[Y, Y] += along * ty * ty + across * tx * tx
        hyp.cov[X, Y] += (along - across) * tx * ty
        hyp.cov[Y, X] = hyp.cov[X, Y]
        redraw(hyp, K, 0.0, _REST_VARIANCE)
        hyp.stood = dt
    rescale(belief.hyp[row], 1.0 - 2.0 * share)


@kernel(inline=True)
def stay_parked(belief: Belief, i: int, dt: float, least: float) -> int:
    """A parked hypothesis stays; a child of it drives off.

    Args:
        belief: In place.
        i: The hypothesis.
        dt: s since the last fix.
        least: Weight below which there is no child.

    Returns:
        The child's row, still where it stood; -1: none.
    """
    hyp = belief.hyp[i]
    leaves = 1.0 - goes_on_standing(hyp.stood, dt)
    hyp.stood += dt
    if hyp.weight * leaves < least or belief.state[0].count >= CAPACITY:
        return -1
    child = spawn(belief, i, leaves, OFF_ROAD, hyp.segment)
    rescale(hyp, 1.0 - leaves)
    belief.hyp[child].stood = 0.0
    return child
