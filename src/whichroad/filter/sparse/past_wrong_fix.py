"""Past a fix that was wrong: with the next fix a hypothesis begins anew where it was before.

At the wrong fix it was somewhere, and nobody knows where (`wrong_fix`).  The routes to the
next fix begin where it was at the fix before, and have the time of both.  Each of them says where
it was in between: that becomes a node of the history, for the path and for smoothing.
"""

import math

from ..._compile import Record, kernel
from ...graph.geometry import locate
from ...graph.index import vertex_at
from ..gaussian import reshape_on_map
from ..lookback.history import History, pack_state
from ..road import track
from ..speed_process import SpeedProcess, speed_process
from ..state import CAPACITY, KEPT, NO_EDGE, Belief, Context, K, Path, enter, move_row
from .arrival import Foot, Transition, place_on_road, predict_transition
from .candidates import SparseFix
from .driven import conditioned, driven_by
from .driver import SPEED_SIGMA, likely_excess, pace_of
from .origin import is_waiting
from .wrong_fix import carry

_ALONE = 0.99  # share of a hypothesis that came from one node of the last step


@kernel
def begin_anew(belief: Belief, path: Path, ctx: Context, dt: float) -> None:
    """Take the hypotheses that took the last fix to be wrong to where they were before it.

    Args:
        belief: Its waiting hypotheses are changed.
        path: The tree of edges entered.
        ctx: The drive's constants.
        dt: Since the last epoch, s.
    """
    state = belief.state[0]
    for i in range(state.count):
        hyp = belief.hyp[i]
        waits = is_waiting(hyp, state.time - dt)
        hyp.origin.waits = 2 if waits else 0
        if not waits:
            continue
        for _ in range(hyp.origin.entries):
            if hyp.path_entry >= 0:
                hyp.path_entry = path.entry[hyp.path_entry].parent
        track(belief, ctx.roads, i)
        _put_back(hyp, state, ctx)
        track(belief, ctx.roads, i)
        tx, ty = hyp.tangent[0], hyp.tangent[1]
        shrink = hyp.origin.variance / hyp.along_sigma**2
        reshape_on_map(hyp.mu, hyp.cov, tx, ty, hyp.origin.along - hyp.along, shrink, state.scale)
        for a in range(2):
            hyp.cov[a, K] = hyp.cov[K, a] = hyp.origin.cross * hyp.tangent[a]
        track(belief, ctx.roads, i)


@kernel
def _put_back(hyp: Record, state: Record, ctx: Context) -> None:
    """Place, heading and speed of a hypothesis as they were; slow states stay as they are."""
    origin = hyp.origin
    edge = int(origin.edge)
    s = float(origin.along)
    segment, x, y, tx, ty = locate(ctx.roads, edge, vertex_at(ctx.roads, edge, s), s)
    inflation = origin.rate_variance / (SPEED_SIGMA * SPEED_SIGMA)
    taken = Transition(-s, 0.0, origin.rate, origin.rate, s, 0.0, 0.0, 0.0, inflation)
    foot = Foot(s, x, y, tx, ty)
    before = math.atan2(hyp.tangent[1], hyp.tangent[0])
    hyp.segment = segment
    predict_transition(hyp, ctx, taken, foot, before, SpeedProcess(0.0, 0.0, 0.0, 0.0, SPEED_SIGMA))
    place_on_road(hyp, state, ctx, taken, foot, edge)
    hyp.edge = edge
    hyp.before = NO_EDGE


@kernel
def _node_of(belief: Belief, history: History, row: int, dt: float) -> int:
    """The node of the last step that a hypothesis is, if a node can be added beside it; else -1."""
    state = belief.state[0]
    parents = int(state.parents)
    if len(history.steps) == 0 or parents == 0 or parents >= KEPT or state.count >= CAPACITY:
        return -1
    last = history.steps[history.count[0].steps - 1]
    if last.end_node - last.first_node != parents or last.time < state.time - dt - 1e-3:
        return -1
    top = 0
    for a in range(parents):
        if belief.lineage[row, a] > belief.lineage[row, top]:
            top = a
    return int(last.first_node) + top if belief.lineage[row, top] > _ALONE else -1


@kernel
def note_between(
    belief: Belief, path: Path, history: History, ctx: Context, source: int, label: int,
    fix: SparseFix,
) -> None:  # fmt: skip
    """Add where the newest hypothesis was at the wrong fix to the last step of the history.

    Args:
        belief: The newest hypothesis has arrived at the fix.
        path: The tree of edges entered.
        history: One node longer afterwards, unless there is none.
        ctx: The drive's constants.
        source: The hypothesis that began anew.
        label: The end of the route that was taken; -1: it stayed on its edge.
        fix: The fix, and the time since the origin.
    """
    state = belief.state[0]
    origin = belief.hyp[source].origin
    waited = origin.ignored - origin.since
    like = _node_of(belief, history, source, fix.dt - waited)
    if like < 0:
        return
    child = belief.hyp[state.count - 1]
    route = ctx.work.search.label
    length = route[label].length if label >= 0 else -belief.hyp[source].along
    part = waited / fix.dt
    if fix.driven.metres > 0.0 and origin.driven[1] > 0.0:
        part = min(max(origin.driven[0] / fix.driven.metres, 0.0), 1.0)
    metres = max(length + child.along, 0.0) * part
    process = speed_process(waited, fix.process.sigma)
    driven = driven_by(process, waited, origin.driven[0], origin.driven[1], 0.0)
    at = label
    while at >= 0 and route[at].length > metres:
        at = int(route[at].parent)
    row = int(state.count)
    move_row(belief, source, row)
    carry(
        belief, ctx, row, at, metres,
        SparseFix(
            fix.x, fix.y, fix.map_x, fix.map_y, fix.sigma, fix.radius, fix.jitter, fix.bias_keep,
            waited, conditioned(driven), fix.found, fix.beyond, fix.pace,
            1.0 / likely_excess(waited), fix.coarse, driven,
        ),
    )  # fmt: skip
    entry = int(child.path_entry)
    if at >= 0 and at == label:
        entry = enter(path, int(route[at].edge), entry, state.time - fix.dt + waited, 0.0)
    elif at >= 0:
        while entry >= 0 and path.entry[entry].edge != route[at].edge:
            entry = int(path.entry[entry].parent)
    else:
        entry = int(belief.hyp[source].path_entry)
    belief.hyp[row].path_entry = entry
    _add_node(belief, history, row, like)


@kernel
def _add_node(belief: Belief, history: History, row: int, like: int) -> None:
    """Add a row to the last step, with the links of another node of it; the newest comes from it.

    Its filtered probability is 0: before the next fix nobody knew of it.
    """
    state = belief.state[0]
    count = history.count[0]
    node = history.nodes[count.nodes]
    hyp = belief.hyp[row]
    node.edge = hyp.edge
    node.before, node.backs = hyp.before, hyp.backs
    node.segment = hyp.segment
    node.p = node.smoothed = 0.0
    node.freed = history.nodes[like].freed
    node.pace = pace_of(hyp.leg, state.driver.pace)
    node.path_entry = hyp.path_entry
    node.first_link = count.links
    pack_state(history.states[count.nodes], hyp)
    for at in range(history.nodes[like].first_link, history.nodes[like].end_link):
        link = history.links[count.links]
        link.origin = history.links[at].origin
        link.share = history.links[at].share
        count.links += 1
    node.end_link = count.links
    count.nodes += 1
    history.steps[count.steps - 1].end_node = count.nodes
    new = int(state.parents)
    for i in range(len(belief.hyp)):
        belief.lineage[i, new] = 0.0
    for a in range(new):
        belief.lineage[state.count - 1, a] = 0.0
    belief.lineage[state.count - 1, new] = 1.0
    state.parents = new + 1
