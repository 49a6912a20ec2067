"""The weights of a step's nodes given what came later, and which edge follows each (Kim 1994)."""

import numpy as np

from ..._compile import Record, Records, kernel
from .._simd import N
from ..state import NO_EDGE
from .history import History

SMOOTHED = np.dtype(
    [
        ("mu", "f8", (N,)),
        ("cov", "f8", (N, N)),
        ("p", "f8"),  # smoothed probability
        ("flow", "f8"),  # the largest part of it that came back over one link
        ("after", "i4"),  # edge that follows on that way, or NO_EDGE
    ],
    align=True,
)


@kernel(inline=True)
def smooth_weights(nodes: Records, history: History, step: int, slot: int) -> float:
    """The weights of the step before, not normalised, and the edges that follow.

        γᵢ = Σⱼ γⱼ f(j ← i)

    Args:
        nodes: (2, K) SMOOTHED; the slot holds the step, the other one is filled.
        history: The graph.
        step: Number of the step.
        slot: 0 or 1.

    Returns:
        The weight that no link accounts for.
    """
    here = history.steps[step].first_node
    after = history.steps[step].end_node
    then = history.steps[step - 1].first_node
    other = 1 - slot
    known = 0.0
    for j in range(here, after):
        for at in range(history.nodes[j].first_link, history.nodes[j].end_link):
            known += nodes[slot, j - here].p * history.links[at].share
    rest = max(1.0 - known, 0.0)
    if rest < 1e-6:
        rest = 0.0
    for i in range(here - then):
        node = nodes[other, i]
        node.p = rest * history.nodes[then + i].p
        node.flow = 0.0
        node.after = NO_EDGE
    for j in range(here, after):
        later = nodes[slot, j - here]
        for at in range(history.nodes[j].first_link, history.nodes[j].end_link):
            link = history.links[at]
            node = nodes[other, link.origin]
            flow = later.p * link.share
            node.p += flow
            if flow > node.flow:
                node.flow = flow
                node.after = _follows(history.nodes[then + link.origin], history.nodes[j], later)
    return rest


@kernel(inline=True)
def _follows(here: Record, later: Record, smoothed: Record) -> int:
    """The edge that follows a node's edge, by a later node that came from it; or NO_EDGE."""
    if later.edge == here.edge:
        return int(smoothed.after)
    return int(later.edge) if later.before == here.edge else NO_EDGE
