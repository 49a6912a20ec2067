"""A way that fixes alone tell: they drag a vehicle along whose speed says that it stands.

Where nothing measures motion, a hypothesis moves along its road by a speed that fixes have taught
it.  One on a wrong road, or in the wrong direction, has none: it stands, and its fixes drag it
away.  Roads are seen by the metre driven, so such a way has to count as well.  Coarser receivers
show no way in so few metres.
"""

import math

from ..._compile import kernel
from ..state import OFF_ROAD, Belief, X, Y, heaviest

_SIGMAS, _LEAST = 3.0, 1.0  # of the place, and m, by which fixes may move it in any case


@kernel
def add_places(belief: Belief, sign: float) -> None:
    """Add the places on roads to what fixes dragged, or take them off, with the weights of before.

    Args:
        belief: Its state in place.
        sign: 1 after a fix, -1 before it.
    """
    state = belief.state[0]
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            continue
        state.dragged[0] += sign * hyp.weight * hyp.mu[X] / state.scale
        state.dragged[1] += sign * hyp.weight * hyp.mu[Y] / state.scale


@kernel
def count_dragged(belief: Belief) -> None:
    """Count as driven what a fix dragged the vehicle beyond its sigmas."""
    state = belief.state[0]
    cov = belief.hyp[heaviest(belief)].cov
    metres = math.hypot(state.dragged[0], state.dragged[1])
    over = metres - max(_SIGMAS * math.sqrt(cov[X, X] + cov[Y, Y]), _LEAST)
    if over <= 0.0:
        return
    state.since_map += over
    state.since_exit += over
    state.dragged[0] *= 1.0 - over / metres
    state.dragged[1] *= 1.0 - over / metres
