"""A vehicle whose wheels stand may be carried: by a train, below the deck of a ferry, on a truck.

While it sees no satellites nothing tells so.  Its first fixes are far from where it stands then.
They may be wrong: receivers often are when they find their satellites again.  But that does not
last.  With fixes that have stayed about the same far place for t seconds

    P(carried) = 1 / (1 + exp(4 - t / 5 s))

Until it is likely, or the vehicle drives on, they are not used, and the level covers that place.
"""

import math

from ..._compile import Record, kernel
from ..state import CLOCK, Belief, X, Y, most_probable
from .separation import cover_place

_STOOD, _SILENT = 30.0, 60.0  # s, for which it has stood at least, and saw no satellites
_FAR, _SAME = 150.0, 50.0  # m and sigmas of fixes: far away; about the same place
_SIGMAS = 5.0
_PRIOR, _LASTS = 4.0, 5.0  # nats; s
_LIKELY = 0.5


@kernel(inline=True)
def may_be_carried(belief: Belief, par: Record, epoch: Record) -> bool:
    """Whether a fix is far from a vehicle that stood while it saw no satellites: it is not used.

    Args:
        belief: Where it is likely to have been carried it starts anew at the next fix.
        par: The model's numbers.
        epoch: With a fix.
    """
    state = belief.state[0]
    carried = state.separation.carried
    fix = epoch.fix
    if carried.p > 0.0 and epoch.time - carried.time > _SILENT:
        carried.p = 0.0
    stood = state.standing > _STOOD and epoch.time - state.last_fix > _SILENT
    if state.mode == CLOCK or (carried.p == 0.0 and not stood):
        return False
    top = belief.hyp[most_probable(belief)]
    away = math.hypot(fix[0] - top.mu[X], fix[1] - top.mu[Y]) / state.scale
    sigma = math.sqrt(fix[2] * fix[2] + top.cov[X, X] + top.cov[Y, Y])
    if away < _FAR + _SIGMAS * sigma:
        carried.p = 0.0
        return False
    rests = state.standing > 0.0
    moved = math.hypot(fix[0] - carried.place[0], fix[1] - carried.place[1]) / state.scale
    if carried.p == 0.0 or (rests and moved > _SAME + _SIGMAS * fix[2]):
        carried.since = epoch.time
        carried.place[0] = fix[0]
        carried.place[1] = fix[1]
    carried.time = epoch.time
    carried.sigma = fix[2]
    carried.p = 1.0 / (1.0 + math.exp(_PRIOR - (epoch.time - carried.since) / _LASTS))
    if carried.p > _LIKELY or not rests:
        state.misfits = par.lost_after
        state.gnss_factor = 0.0
    return True


@kernel
def cover_carried(state: Record, out: Record, risk: float) -> None:
    """Let an estimate cover the place to which the vehicle may have been carried.

    Args:
        state: With that place.
        out: The estimate, in place: levels and covariance.
        risk: Of the level.
    """
    carried = state.separation.carried
    if carried.p <= risk or state.time - carried.time > _SILENT:
        return
    dx = (carried.place[0] - out.x) / state.scale
    dy = (carried.place[1] - out.y) / state.scale
    more = _SAME + _SIGMAS * carried.sigma
    cover_place(out, dx, dy, carried.p, (more, more, more))
