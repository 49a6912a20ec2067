"""Fixes that are as fast as the odometer, on another track than the belief.

Turns that were measured wrong lead to other roads, which happen to fit.  The fixes then go
another way at the vehicle's speed, and further and further off.  A receiver that errs does not
keep the speed of the vehicle in another direction.
"""

import math

from ..._compile import kernel
from ...graph.geometry import wrap
from ..state import Belief, H, heaviest

_DIFFERS, _LONG = 0.5, 3.0  # rad by which tracks differ, and s for which they do then
_BY_TURNS = 0.5  # share of that, by which odometry has turned since
_ANYWHERE = 1.0  # rad, from which on nothing else is asked
_WRONG_WAY, _MORE = 0.3, 1.2  # rad from which on turns may have been as wrong, and times that


@kernel
def _difference(belief: Belief) -> float:
    """By how much the heaviest hypothesis heads elsewhere than the fixes, rad."""
    vetting = belief.state[0].vetting
    return abs(float(wrap(vetting.track - belief.hyp[heaviest(belief)].mu[H])))


@kernel
def may_have_turned(belief: Belief) -> float:
    """By how much turns may have been wrong that fixes do not show, rad; 0: nothing says so."""
    differs = _difference(belief)
    if differs <= _WRONG_WAY + belief.state[0].vetting.track_sigma:
        return 0.0
    return _MORE * differs


@kernel
def follow_track(belief: Belief, since: float) -> None:
    """Count how long the belief has headed elsewhere than the fixes.

    A receiver that is pulled away begins to while the vehicle drives straight on.  So the
    odometry must have turned since they agreed, or the directions differ by far.

    Args:
        belief: With what was vetted.
        since: Seconds since the last fix.
    """
    vetting = belief.state[0].vetting
    off = _difference(belief) - vetting.track_sigma
    turns = vetting.windows.now.turn
    if off > _ANYWHERE or (off > _DIFFERS and abs(turns - vetting.agreed_turn) > _BY_TURNS * off):
        vetting.diverged += since
    elif off <= _DIFFERS and vetting.track_sigma < math.inf:
        vetting.diverged = 0.0
        vetting.agreed_turn = turns


@kernel
def has_diverged(belief: Belief) -> bool:
    """Whether the vehicle is to be looked for at the fix; the count begins anew then."""
    vetting = belief.state[0].vetting
    if vetting.diverged < _LONG:
        return False
    vetting.diverged = 0.0
    return True
