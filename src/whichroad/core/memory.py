"""What the filter remembers when it is asked to look back: one graph of merged hypotheses.

A *step* is an epoch at which something was observed or the roads changed.  Its nodes are the
hypotheses that lived then; a link from a node to one of the step before says which share of
its weight came from there.  Everything that looks back reads this graph (`core.lookback`).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ._jit import Floats32, Ints, Ints32, Matrix, Vector, kernel, part
from .belief import (
    GNSS_SCALE,
    KEPT,
    LAST_FIX,
    MISFITS,
    NO_EDGE,
    NOW,
    OFF_ROAD,
    ORIGINS,
    SPEED,
    STOOD,
    Belief,
    N,
)
from .epoch import CLOCK, Epochs

PACKED = N * (N + 1) // 2
_LEAST = 1e-7  # share of a hypothesis that is not worth a link
_SELDOM = 1.0  # s between two steps, at most

# since the step before, the same for all hypotheses
ARC, METRES, TURN, SWUNG = range(4)  # Σ δs, m driven, Σ δθ, Σ |δθ|; δs is time without wheels
FORWARD, LEFT = 4, 5  # displacement in the frame of then, odometer metres
LEVER_FORWARD, LEVER_LEFT = 6, 7  # and its derivative by the heading drift
MAP_AGED, GNSS_AGED = 8, 9  # m and s by which the slow errors have aged
JUMPED = 10  # 1: by routes, which tell the position anew
SINCE = 11
# and what the clock said at the step
STEP_SPEED, STEP_FIX, STEP_MISFITS, STEP_STOOD, STEP_SCALE = range(SINCE, 16)
PAST = 16


class Memory(NamedTuple):
    """Steps, their nodes, and the nodes' links; no rows where nothing is remembered.

    Shapes: T steps, M nodes, L links.
    """

    epoch: Ints  # (T,) number of the epoch
    time: Vector  # (T,) s
    first_node: Ints  # (T+1,)
    past: Matrix  # (T, PAST) what happened since the step before
    edge: Ints32  # (M,)
    segment: Ints32  # (M,)
    p: Vector  # (M,) filtered probability
    smoothed: Vector  # (M,) what looking back made of it
    tree: Ints  # (M,) node of the route tree
    mean: Matrix  # (M, N)
    cov: Matrix  # (M, PACKED) lower triangle, row by row
    first_link: Ints  # (M+1,)
    origin: Ints32  # (L,) number of the node within the step before
    share: Floats32  # (L,)
    since: Vector  # (SINCE,) what happened since the last step
    size: Ints  # (3,) steps, nodes, links


def new_memory(steps: int) -> Memory:
    """An empty memory with room for so many steps, or none."""
    nodes = 4 * steps + KEPT if steps else 0
    links = 3 * nodes + KEPT * KEPT if steps else 0
    return Memory(
        np.zeros(steps, np.int64),
        np.zeros(steps),
        np.zeros(steps + 1, np.int64),
        np.zeros((steps, PAST)),
        np.full(nodes, NO_EDGE, np.int32),
        np.zeros(nodes, np.int32),
        np.zeros(nodes),
        np.zeros(nodes),
        np.zeros(nodes, np.int64),
        np.zeros((nodes, N)),
        np.zeros((nodes, PACKED)),
        np.zeros(nodes + 1, np.int64),
        np.zeros(links, np.int32),
        np.zeros(links, np.float32),
        np.zeros(SINCE),
        np.zeros(3, np.int64),
    )


def enlarged(memory: Memory, drop: int = 0, *, grow: bool = True) -> Memory:
    """The same with room for more, without the first `drop` steps."""
    steps, nodes, links = memory.size.tolist()
    node = int(memory.first_node[drop])
    link = int(memory.first_link[node])
    room = new_memory(2 * len(memory.time) if grow else len(memory.time))
    of = {len(memory.time): (drop, steps), len(memory.edge): (node, nodes)}
    of |= {len(memory.time) + 1: (drop, steps + 1), len(memory.edge) + 1: (node, nodes + 1)}
    of |= {len(memory.origin): (link, links)}
    old: Any
    new: Any
    for name, old, new in zip(Memory._fields[:-2], memory, room, strict=False):
        low, high = of[len(old)]
        new[: high - low] = old[low:high] - {"first_node": node, "first_link": link}.get(name, 0)
    room.since[:] = memory.since
    room.size[:] = steps - drop, nodes - node, links - link
    return room


@kernel
def is_full(memory: Memory) -> bool:
    """Whether another step may not fit."""
    steps, nodes, links = memory.size
    return bool(
        steps >= len(memory.time)
        or nodes + KEPT > len(memory.edge)
        or links + KEPT * KEPT > len(memory.origin)
    )


@part
def note_motion(
    memory: Memory, epochs: Epochs, k: int, moving: float, speed: float, mode: int
) -> None:
    """Add an epoch's motion to what happened since the last step.

    Displacements are composed in the frame of that step; their derivative by the heading
    drift b is Σ R(T) J u (A + ½ δs), with the turn T and the arc A before.

    Args:
        memory: Its `since` is added to.
        epochs: What the sensors said.
        k: The epoch.
        moving: Its time, s; 0 where the vehicle stands.
        speed: m/s.
        mode: WHEELS, DISTANCE or CLOCK.
    """
    since = memory.since
    arc = moving if mode == CLOCK else epochs.arc[k]
    turn = since[TURN]
    c = math.cos(turn)
    s = math.sin(turn)
    forward = c * epochs.forward[k] - s * epochs.left[k]
    left = s * epochs.forward[k] + c * epochs.left[k]
    lever = since[ARC] + 0.5 * arc
    since[FORWARD] += forward
    since[LEFT] += left
    since[LEVER_FORWARD] -= lever * left
    since[LEVER_LEFT] += lever * forward
    since[ARC] += arc
    since[METRES] += abs(speed) * moving if mode == CLOCK else abs(arc)
    since[TURN] += epochs.turn[k]
    since[SWUNG] += abs(epochs.turn[k])


@kernel
def _born_between(belief: Belief, rate: float, metres: float) -> None:
    """Let off-road hypotheses owe to the roads what would have left them since the last step.

    The filter lets hypotheses leave the roads every so many metres, which is soon enough to
    find the way; looked back at, a vehicle would have left long before anything told so.
    """
    n = belief.size[0]
    on = 0.0
    off = 0.0
    for i in range(n):
        if belief.edge[i] == OFF_ROAD:
            off += belief.probability[i]
        else:
            on += belief.probability[i]
    born = min(rate * metres, 0.5) * on
    if off <= 0.0 or born <= 0.0:
        return
    kept = off / (off + born)
    for a in range(int(belief.clock[ORIGINS])):
        total = 0.0
        for i in range(n):
            if belief.edge[i] != OFF_ROAD:
                total += belief.probability[i] * belief.share[i, a]
        for i in range(n):
            if belief.edge[i] == OFF_ROAD:
                belief.share[i, a] = kept * belief.share[i, a] + (1.0 - kept) * total / on


@part
def remember(belief: Belief, memory: Memory, k: int, changed: bool, leave: float) -> None:
    """Add the belief after epoch k as a step, if anything was changed or it is time.

    From here on the hypotheses' shares count from this step.

    Args:
        belief: The filter's; its shares are begun anew.
        memory: One step longer afterwards.
        k: Number of the epoch.
        changed: Whether anything was observed in it, or the roads changed.
        leave: Rate of leaving the roads, 1/m.
    """
    step = memory.size[0]
    now = belief.clock[NOW]
    if not changed and step > 0 and now - memory.time[step - 1] < _SELDOM:
        return
    node = memory.size[1]
    link = memory.size[2]
    origins = int(belief.clock[ORIGINS])
    _born_between(belief, leave, memory.since[METRES])
    memory.epoch[step] = k
    memory.time[step] = now
    memory.first_node[step] = node
    for j in range(SINCE):
        memory.past[step, j] = memory.since[j]
        memory.since[j] = 0.0
    clock = belief.clock
    past = memory.past[step]
    past[STEP_SPEED] = clock[SPEED]
    past[STEP_FIX] = clock[LAST_FIX]
    past[STEP_MISFITS] = clock[MISFITS]
    past[STEP_STOOD] = clock[STOOD]
    past[STEP_SCALE] = clock[GNSS_SCALE]
    n = belief.size[0]
    for i in range(n):
        memory.edge[node] = belief.edge[i]
        memory.segment[node] = belief.segment[i]
        memory.p[node] = belief.probability[i]
        memory.smoothed[node] = belief.probability[i]
        memory.tree[node] = belief.node[i]
        memory.first_link[node] = link
        at = 0
        for a in range(N):
            memory.mean[node, a] = belief.mean[i, a]
            for b in range(a + 1):
                memory.cov[node, at] = belief.cov[i, a, b]
                at += 1
        for a in range(origins):
            if belief.share[i, a] > _LEAST:
                memory.origin[link] = a
                memory.share[link] = belief.share[i, a]
                link += 1
        for a in range(n):
            belief.share[i, a] = 1.0 if a == i else 0.0
        node += 1
    memory.first_node[step + 1] = node
    memory.first_link[node] = link
    memory.size[0] = step + 1
    memory.size[1] = node
    memory.size[2] = link
    belief.clock[ORIGINS] = n
