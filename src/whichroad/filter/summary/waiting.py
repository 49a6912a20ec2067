"""Epochs of a recorded drive whose fix only fills a gap: the belief waits for the one that ends it.

The vehicle drives on meanwhile.  Where it was is told by the path, once that is known
(`lookback.gaps`).
"""

from ..._compile import kernel
from ..state import NO_EDGE, Belief, Context
from .estimate import LOST_UNKNOWN, OUTAGE, Output, describe

_PACE = 12.0  # m/s, sigma of what a vehicle drives then


@kernel
def wait(belief: Belief, ctx: Context, output: Output, k: int, time: float) -> None:
    """Leave the belief as it is at an epoch whose fix only repeats a place.

    Args:
        belief: As of the fix before the gap.
        ctx: The drive's constants.
        output: Row k is written.
        k: The epoch.
        time: Its time, s.
    """
    state = belief.state[0]
    repeats = state.vetting.repeats
    repeats.seconds += max(time - repeats.last, 0.0)
    repeats.last = time
    before = state.time
    state.time = time
    summarise_waiting(belief, ctx, output, k, time - before)
    state.time = before


@kernel
def summarise_waiting(belief: Belief, ctx: Context, output: Output, k: int, since: float) -> None:
    """`summarise` such an epoch, so many seconds after the fix before the gap."""
    state = belief.state[0]
    share, sigma = state.elsewhere[0], state.elsewhere[1]
    state.elsewhere[0] = max(share, LOST_UNKNOWN)
    state.elsewhere[1] = max(sigma, _PACE * since)
    describe(belief, ctx, output, k, 0.0, True)
    state.elsewhere[0], state.elsewhere[1] = share, sigma
    state.ranking.known = 0
    output.rows[k].edge = NO_EDGE
    output.rows[k].status = OUTAGE
