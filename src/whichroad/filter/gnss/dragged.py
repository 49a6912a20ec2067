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
_WAS_X, _WAS_Y = 6, 7  # scratch, beside the innovations: its place before the fix


@kernel
def note_places(belief: Belief) -> None:
    """Note where the hypotheses are before a fix, which may drop some of them."""
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        hyp.scratch[_WAS_X] = hyp.mu[X]
        hyp.scratch[_WAS_Y] = hyp.mu[Y]


@kernel
def add_dragged(belief: Belief) -> None:
    """Add the ways by which a fix moved those on roads that it left, with the weights of before."""
    state = belief.state[0]
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            continue
        state.dragged[0] += hyp.weight * (hyp.mu[X] - hyp.scratch[_WAS_X]) / state.scale
        state.dragged[1] += hyp.weight * (hyp.mu[Y] - hyp.scratch[_WAS_Y]) / state.scale


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
