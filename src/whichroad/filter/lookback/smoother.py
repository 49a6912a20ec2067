"""Smoothing: what is known now of where the vehicle was then.

Kim's smoother over the graph of merged hypotheses (`history`), γ for P(edge), and the
equations of Rauch, Tung and Striebel (RTS) for the pose.  From the last step backwards, with f
the stored share of node j's weight that came from node i:

    γᵢ   = Σⱼ γⱼ f(j ← i)
    G    = Pᵢ Fᵀ (P⁻)⁻¹
    xᵢⱼ  = xᵢ + G (xⱼ − x⁻),   Pᵢⱼ = Pᵢ + G (Pⱼ − P⁻) Gᵀ

Node i becomes the mixture of the (xᵢⱼ, Pᵢⱼ), moment-matched.  What no link accounts for (the
filter started anew) leaves the step before as filtered.

x⁻, P⁻ and F are those of the process model of a link (`filter.lookback.link_motion`).
"""

import math
from typing import Annotated, NamedTuple

from ..._compile import Array, Record, Records, entry, kernel
from ...graph.geometry import wrap
from ...graph.network import plane_scale, records
from .._simd import N, add_times, copy_record, new_row, scale_by, set_times, set_to
from ..sparse.dropped import drop_before
from ..state import CLOCK, KEPT, NO_EDGE, Belief, Context, Epochs, H, K, Path, X, Y, new_belief
from ..summary.estimate import Output, summarise
from ..summary.node_shares import AFTER
from ..summary.waiting import summarise_waiting
from ..unmapped import carry_back
from .history import History, load
from .link_motion import LINK_MODEL, inflate_strange, predict_link
from .link_road import Link
from .smoothed_weights import SMOOTHED, smooth_weights

_NO_POSE = 1e-6  # weight of a link up to which it does not move the pose
_LEAST = 1e-12  # probability up to which a node is left out of the estimate
_UNSEEN = 0.5 * _LEAST  # the same before probabilities are made to sum to one
_STANDS = 0.05  # m/s
_WIDER = 9.0  # variance over the filtered one, from which on a smoothed pose is not believed


class SmootherBuffers(NamedTuple):
    """Buffers of a backward pass, allocated once per thread."""

    nodes: Annotated[Records, Array(SMOOTHED, 2)]  # (2, KEPT), of a step and of the one before
    model: Annotated[Records, Array(LINK_MODEL, 1)]  # (1,)
    belief: Belief  # a smoothed step as a mixture, of which an estimate is made


class Span(NamedTuple):
    """One backward pass: steps first ... last - 1 are estimated by what was known at another."""

    known: int
    first: int
    last: int


def new_buffers() -> SmootherBuffers:
    """Buffers for one thread."""
    nodes = records(2 * KEPT, SMOOTHED).reshape(2, KEPT)
    return SmootherBuffers(nodes, records(1, LINK_MODEL), new_belief())


@kernel
def begin(buffers: SmootherBuffers, history: History, step: int, slot: int) -> None:
    """Fill a slot with a step as filtered, the last one that is known."""
    separation = buffers.belief.state[0].separation
    separation.unmapped.p = separation.unmapped.hasty = separation.dropped.p = 0.0
    first = history.steps[step].first_node
    for i in range(history.steps[step].end_node - first):
        node = buffers.nodes[slot, i]
        node.p = history.nodes[first + i].p
        node.after = NO_EDGE
        load(history, first + i, node.mu, node.cov)


@kernel
def step_back(
    buffers: SmootherBuffers, history: History, path: Path, ctx: Context, step: int, slot: int,
    poses: bool,
) -> None:  # fmt: skip
    """Backward step: from a step in one slot of the buffers to the one before it in the other.

    Args:
        buffers: Its slot holds the step, smoothed; the other one is filled.
        history: The graph.
        path: The tree of edges entered.
        ctx: The drive's constants.
        step: Number of the step.
        slot: 0 or 1.
        poses: Whether poses are smoothed too.
    """
    then = history.steps[step - 1].first_node
    n = history.steps[step - 1].end_node - then
    other = 1 - slot
    rest = smooth_weights(buffers.nodes, history, step, slot)
    where = history.states[then].mu
    buffers.model[0].scale = plane_scale(ctx.roads, where[X], where[Y])
    sum_p = 0.0
    for i in range(n):
        p = buffers.nodes[other, i].p
        sum_p += p
        if poses and p >= _UNSEEN:  # else its pose is not output
            _smooth_pose(buffers, history, path, ctx, step, i, slot, rest)
    for i in range(n):
        buffers.nodes[other, i].p /= sum_p


@kernel(inline=True)
def _smooth_pose(
    buffers: SmootherBuffers, history: History, path: Path, ctx: Context, step: int, origin: int,
    slot: int, rest: float,
) -> None:  # fmt: skip
    """The pose of a node of the step before: moments over its links to the step in a slot."""
    here = history.steps[step].first_node
    i = history.steps[step - 1].first_node + origin
    model = buffers.model[0]
    node = buffers.nodes[1 - slot, origin]
    load(history, i, model.then_mean, model.then_cov)
    for a in range(N):
        node.mu[a] = 0.0
        set_to(node.cov[a], model.then_cov[a])
    so_far = used = rest * history.nodes[i].p
    for j in range(here, history.steps[step].end_node):
        for at in range(history.nodes[j].first_link, history.nodes[j].end_link):
            if history.links[at].origin != origin:
                continue
            weight = buffers.nodes[slot, j - here].p * history.links[at].share
            so_far += weight
            if weight < 1e-3 * so_far or weight < _NO_POSE:
                continue
            later = buffers.nodes[slot, j - here]
            predict_link(model, history, path, ctx, Link(step, i, j))
            inflate_strange(model, later.mu)
            used += weight
            _add_link(model, later, node, weight / used)
    _restore_state(node, model)


@kernel(inline=True)
def _restore_state(node: Record, model: Record) -> None:
    """From deviations to a state; one whose covariance is none stays as filtered.

    What is known later makes a place surer.  One far less sure has a motion not modelled here.
    """
    mean = node.mu
    cov = node.cov
    sound = True
    for a in range(N):
        sound = sound and cov[a, a] >= 0.0
        sound = sound and (a > H or cov[a, a] <= _WIDER * model.then_cov[a, a])
    sound = sound and cov[X, X] * cov[Y, Y] > cov[Y, X] ** 2
    if sound:
        mean[X] *= model.scale
        mean[Y] *= model.scale
        add_times(mean, 1.0, model.then_mean)
        for a in range(N):
            for b in range(a):
                cov[b, a] = cov[a, b]
    else:
        set_to(mean, model.then_mean)
        for a in range(N):
            set_to(cov[a], model.then_cov[a])
    mean[H] = wrap(mean[H])


@kernel(inline=True)
def solve_gain(model: Record) -> None:
    """Gᵀ = (P⁻)⁻¹ F Pᵢ, by a Cholesky factor that leaves out states without variance."""
    root = model.root
    gain = model.gain
    unit, left, right = new_row(), new_row(), new_row()
    for a in range(N):
        variance = model.cov[a, a]
        unit[a] = 1.0 / math.sqrt(variance) if variance > 1e-18 else 0.0
    for a in range(N):
        set_times(left, unit[a], model.cov[a])
        scale_by(left, 1.0, unit)
        set_times(right, unit[a], model.cross[a])
        for b in range(a):
            factor = -root[b, a]
            add_times(left, factor, root[b])
            add_times(right, factor, gain[b])
        pivot = left[a]
        pivot = 1.0 / math.sqrt(pivot) if pivot > 1e-9 else 0.0
        set_times(root[a], pivot, left)
        set_times(gain[a], pivot, right)
        root[a, a] = pivot
    for a in range(N - 1, -1, -1):
        set_to(right, gain[a])
        for b in range(N - 1, a, -1):
            add_times(right, -root[a, b], gain[b])
        set_times(gain[a], root[a, a], right)
    for a in range(N):
        set_times(gain[a], unit[a], gain[a])


@kernel(inline=True)
def _add_link(model: Record, later: Record, node: Record, share: float) -> None:
    """Add what node j knows of node i to what other nodes know of it.

    Args:
        model: i as predicted for j; its gain is solved for.
        later: j, smoothed.
        node: Deviation of i from its filtered state, and its covariance, so far; below the
            diagonal it is added to, above it means nothing.
        share: Of this link in all so far.
    """
    solve_gain(model)
    gain = model.gain
    change = model.root  # Pⱼ − P⁻; the factor is no longer needed
    off, shift, row, product = new_row(), new_row(), new_row(), new_row()
    set_to(off, later.mu)
    add_times(off, -1.0, model.mu)
    off[X] /= model.scale
    off[Y] /= model.scale
    off[H] = wrap(off[H])
    set_times(shift, off[0], gain[0])
    for c in range(1, N):
        add_times(shift, off[c], gain[c])
    for c in range(N):
        set_to(row, later.cov[c])
        add_times(row, -1.0, model.cov[c])
        set_to(change[c], row)
    set_to(off, shift)
    add_times(off, -1.0, node.mu)
    cov = node.cov
    for a in range(N):
        set_times(product, gain[0, a], change[0])
        for c in range(1, N):
            add_times(product, gain[c, a], change[c])
        set_to(row, model.then_cov[a])
        for c in range(N):
            add_times(row, product[c], gain[c])
        add_times(row, -1.0, cov[a])
        add_times(cov[a], share, row)
        add_times(cov[a], share * (1.0 - share) * off[a], off)
    add_times(node.mu, share, off)


@kernel
def as_belief(buffers: SmootherBuffers, history: History, step: int, slot: int) -> None:
    """Make the belief of the buffers the mixture of a smoothed step."""
    belief = buffers.belief
    state = belief.state[0]
    then = history.steps[step]
    state.count = 0
    speed = 0.0
    for i in range(then.end_node - then.first_node):
        node = buffers.nodes[slot, i]
        if node.p < _LEAST:
            continue
        hyp = belief.hyp[state.count]
        filtered = history.nodes[then.first_node + i]
        hyp.weight = node.p
        hyp.log_weight = math.log(node.p)
        hyp.edge, hyp.before = filtered.edge, filtered.before
        hyp.scratch[AFTER] = node.after
        hyp.segment, hyp.backs = filtered.segment, filtered.backs
        hyp.path_entry = filtered.path_entry
        set_to(hyp.mu, node.mu)
        for a in range(N):
            set_to(hyp.cov[a], node.cov[a])
        speed += node.p * node.mu[K]
        state.count += 1
    state.time = then.time
    state.mode = then.motion.mode
    state.hindsight = 1
    state.speed = max(speed, 0.0) if state.mode == CLOCK else then.speed
    state.last_fix = then.last_fix
    state.standing = then.standing
    state.gnss_factor = then.gnss_factor
    _restore_faults(state, then)
    state.map.factor, state.map.rate = then.map_factor, then.map_rate
    state.map.whole[0] = then.map_mean[0]
    state.map.whole[1] = then.map_mean[1]


@kernel(inline=True)
def _restore_faults(state: Record, then: Record) -> None:
    """What fixes said of the belief at a step; what was found out later holds before, too."""
    state.misfits, state.vetting.misfit = then.misfits, then.misfit
    state.elsewhere[0] = then.elsewhere[0]
    state.elsewhere[1] = then.elsewhere[1]
    copy_record(state.separation.departure, then.departure)
    copy_record(state.separation.gross, then.gross)
    state.level_tail = then.level_tail
    later = state.separation.unmapped.p
    copy_record(state.separation.unmapped, then.unmapped)
    carry_back(state.separation.unmapped, later)
    later = state.separation.dropped.p
    copy_record(state.separation.dropped, then.dropped)
    drop_before(state.separation.dropped, later)


@kernel
def _estimate_until(
    buffers: SmootherBuffers, ctx: Context, epochs: Epochs, filtered: Output, output: Output,
    start: int, until: int,
) -> None:  # fmt: skip
    """Estimate the epoch of a smoothed step, and the epochs until the next step.

    Nothing was observed in these.  They differ from the step by the motion since, as filtered.
    """
    belief = buffers.belief
    state = belief.state[0]
    x = filtered.rows[start].x
    y = filtered.rows[start].y
    heading = filtered.rows[start].heading
    for k in range(start, until):
        row = filtered.rows[k]
        state.scale = plane_scale(ctx.roads, row.x, row.y)
        turned = wrap(row.heading - heading)
        for i in range(state.count):
            mean = belief.hyp[i].mu
            mean[X] += row.x - x
            mean[Y] += row.y - y
            mean[H] = wrap(mean[H] + turned)
        x = row.x
        y = row.y
        heading = row.heading
        state.standing += epochs[k].time - state.time
        if abs(row.speed) > _STANDS:
            state.standing = 0.0
        state.time = epochs[k].time
        if state.mode != CLOCK:
            state.speed = row.speed
        if epochs[k].filled == 1:
            summarise_waiting(belief, ctx, output, k, state.time - epochs[start].time)
        else:
            summarise(belief, ctx, output, k, row.chi2)


@entry
def smooth_span(
    buffers: SmootherBuffers, history: History, path: Path, ctx: Context, epochs: Epochs,
    filtered: Output, output: Output, span: Span,
) -> None:  # fmt: skip
    """Estimate steps first ... last - 1 by what was known at a later one.

    Args:
        buffers: Buffers.
        history: The graph; `smoothed` is written for these steps.
        path: The tree of edges entered.
        ctx: The drive's constants.
        epochs: (n,) EPOCH, what the sensors measured.
        filtered: (n,) the filter's estimates.
        output: (n,) written.
        span: From which step, and which steps.
    """
    slot = 0
    begin(buffers, history, span.known, slot)
    for at in range(span.known, span.first - 1, -1):
        if at < span.known:
            step_back(buffers, history, path, ctx, at + 1, slot, True)
            slot = 1 - slot
        if at < span.last:
            step = history.steps[at]
            for i in range(step.end_node - step.first_node):
                history.nodes[step.first_node + i].smoothed = buffers.nodes[slot, i].p
            until = len(epochs)
            if at + 1 < history.count[0].steps:
                until = history.steps[at + 1].epoch
            as_belief(buffers, history, at, slot)
            _estimate_until(buffers, ctx, epochs, filtered, output, step.epoch, until)


@kernel
def _surest(buffers: SmootherBuffers, history: History, at: int, slot: int) -> float:
    """P of the most probable edge of a smoothed step, components added up."""
    first = history.steps[at].first_node
    n = history.steps[at].end_node - first
    best = 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            if history.nodes[first + i].edge == history.nodes[first + j].edge:
                total += buffers.nodes[slot, j].p
        best = max(best, total)
    return best


@entry
def smooth_step(
    buffers: SmootherBuffers, history: History, path: Path, ctx: Context, output: Output, step: int,
    sure: float,
) -> int:  # fmt: skip
    """Estimate one step from the last one, and find until when the road is decided.

    Args:
        buffers: Buffers; its belief is that of the step afterwards.
        history: The graph.
        path: The tree of edges entered.
        ctx: The drive's constants.
        output: (1,) written; left alone where step < 0.
        step: The step to be estimated, or -1.
        sure: P(edge) from which on it is decided.

    Returns:
        The last step at which one edge is decided, -1 where there is none.
    """
    known = history.count[0].steps - 1
    slot = 0
    decided = -1
    begin(buffers, history, known, slot)
    for at in range(known, -1, -1):
        if at < known:
            step_back(buffers, history, path, ctx, at + 1, slot, at >= step >= 0)
            slot = 1 - slot
        if decided < 0 and _surest(buffers, history, at, slot) >= sure:
            decided = at
        if at == step:
            belief = buffers.belief
            as_belief(buffers, history, at, slot)
            mean = belief.hyp[0].mu
            belief.state[0].scale = plane_scale(ctx.roads, mean[X], mean[Y])
            summarise(belief, ctx, output, 0, 0.0)
        if decided >= 0 and (at <= step or step < 0):
            break
    return decided
