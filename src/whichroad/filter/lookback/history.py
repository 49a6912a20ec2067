"""The history of the filter: a graph of merged hypotheses, for smoothing.

A *step* is an epoch at which something was observed or hypotheses branched.  Its nodes are the
hypotheses of that epoch.  A link from a node to one of the step before holds the share of its
weight that came from there.  The smoother (`filter.lookback.smoother`) and the best path
(`filter.lookback.best_path`) read this graph.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from ..._compile import Array, Matrix, Record, Records, Vector, kernel
from ...graph.network import records
from .._simd import N, copy_record
from ..motion import Increment, Noise, drift_clock, predict_plane
from ..records import DEPARTURE, DROPPED, GROSS, UNMAPPED
from ..sparse.driver import pace_of
from ..state import CLOCK, KEPT, NO_EDGE, OFF_ROAD, WHEELS, B, Belief, K
from .packed_noise import pack_noise

PACKED = N * (N + 1) // 2

_LEAST_SHARE = 1e-7  # share of a hypothesis' weight below which it gets no link
_LONGEST_STEP = 1.0  # s between two steps, at most

MOTION = np.dtype(
    [
        ("arc", "f8"),  # Σ δs, odometer metres; without odometry the time, s
        ("metres", "f8"),  # distance driven, m
        ("clock", "f8"),  # Σ δc of the heading drift, m
        ("turn", "f8"),  # Σ δθ, rad
        ("forward", "f8"),  # displacement in the frame of the step before, odometer metres
        ("left", "f8"),
        ("lever_forward", "f8"),  # its derivative by the heading drift
        ("lever_left", "f8"),
        ("map_aged", "f8"),  # distance by which lane and map error have decayed, m
        ("gnss_aged", "f8"),  # time by which the GNSS bias has decayed, s
        ("plane_noise", "f8", (15,)),  # Q of X, Y, H, K, B in the frame of the step before
        ("road_noise", "f8", (3,)),  # Q along a road: of the abscissa, with κ, of κ
        ("driven", "f8", (2,)),  # by an odometer, in a sparse transition: m; m², 0: none tells it
        ("drawn", "u1"),  # 1: the heading varied about the road's; 2: and moved the vehicle
        ("mode", "u1"),  # what moved the vehicle: WHEELS, DISTANCE or CLOCK
        ("switched", "u1"),  # 1: something else did before
        ("jumped", "u1"),  # 1: by a sparse transition, whose route gives a new position
    ],
    align=True,
)

STEP = np.dtype(
    [
        ("epoch", "i8"),  # number of the epoch
        ("time", "f8"),  # s
        ("first_node", "i8"),  # nodes: first_node ... end_node - 1
        ("end_node", "i8"),
        ("motion", MOTION),  # since the step before, the same for all hypotheses
        # state of the filter at the step
        ("speed", "f8"),  # m/s
        ("last_fix", "f8"),  # time of the last fix, s
        ("misfits", "f8"),  # fixes in a row that fit no hypothesis,
        ("misfit", "f8"),  # and how far the last of them is at most, m
        ("elsewhere", "f8", (2,)),  # P(moved while nothing was heard), and how far, m
        ("standing", "f8"),  # s of standing until then
        ("gnss_factor", "f8"),  # on reported variances
        ("departure", DEPARTURE),  # of a fix that has left a vehicle whose odometer stands
        ("unmapped", UNMAPPED),  # of fixes that lie beside the road
        ("gross", GROSS),  # of a receiver that may be right where it is thought to be far off
        ("about_road", "f8"),  # variance of headings about roads on the way to it, rad²
        ("level_tail", "f8"),  # sigmas of levels over those of Gaussians; 1 beside wheels
        ("dropped", DROPPED),  # ways between sparse fixes that nobody follows
        ("speed_sigma", "f8"),  # of the vehicle between sparse fixes (filter.sparse.driver)
        ("map_factor", "f8"),  # on map_sigma²,
        ("map_rate", "f8"),  # of it, what is drawn anew over map_length,
        ("map_mean", "f8", (2,)),  # and how far the map is off as a whole, m
    ],
    align=True,
)

NODE = np.dtype(
    [
        ("p", "f8"),  # filtered probability
        ("smoothed", "f8"),  # smoothed probability
        ("first_link", "i8"),  # links: first_link ... end_link - 1
        ("end_link", "i8"),
        ("path_entry", "i8"),  # newest entry of the path tree
        ("freed", "f8"),  # variance that the GNSS bias was given since the step before
        ("pace", "f8"),  # of the vehicle between sparse fixes (filter.sparse.driver)
        ("edge", "i4"),
        ("before", "i4"),  # see HYPOTHESIS
        ("segment", "i4"),
        ("backs", "u1"),
    ],
    align=True,
)

GAUSSIAN = np.dtype(
    [
        ("mu", "f8", (N,)),
        ("cov", "f8", (PACKED,)),  # lower triangle, row by row
    ],
    align=True,
)

LINK = np.dtype(
    [
        ("origin", "i4"),  # number of the node within the step before
        ("share", "f4"),  # of the node's weight that came from there
    ],
    align=True,
)

COUNT = np.dtype([("steps", "i8"), ("nodes", "i8"), ("links", "i8")], align=True)

REFERENCE = np.dtype([("mu", "f8", (N,)), ("cov", "f8", (N, N))], align=True)


class History(NamedTuple):
    """Steps, their nodes, and the nodes' links; rows from `count` on are free.

    Nothing is stored in a history of no length.  The Gaussians are nine tenths of it:
    they are a table of their own, so that they can be dropped once the drive is smoothed.
    """

    steps: Annotated[Records, Array(STEP, 1)]  # (T,)
    nodes: Annotated[Records, Array(NODE, 1)]  # (M,)
    states: Annotated[Records, Array(GAUSSIAN, 1)]  # (M,), filtered state of each node
    links: Annotated[Records, Array(LINK, 1)]  # (L,)
    since: Annotated[Records, Array(MOTION, 1)]  # (1,) since the last step
    reference: Annotated[Records, Array(REFERENCE, 1)]  # (1,) its cov is Q since
    count: Annotated[Records, Array(COUNT, 1)]  # (1,)


def new_history(steps: int) -> History:
    """An empty history for so many steps, or none."""
    nodes = 4 * steps + 2 * KEPT if steps else 0
    links = 3 * nodes + 2 * KEPT * KEPT if steps else 0
    table = records(nodes, NODE)
    table.edge = NO_EDGE
    return History(
        records(steps, STEP), table, records(nodes, GAUSSIAN), records(links, LINK),
        records(1, MOTION), records(1, REFERENCE), records(1, COUNT),
    )  # fmt: skip


def enlarged(history: History, drop: int = 0, *, grow: bool = True) -> History:
    """A larger copy, without the first `drop` steps.

    Args:
        history: At least `drop` + 1 steps long where `drop` is not 0.
        drop: Steps to leave out.
        grow: Whether it holds twice as many steps.
    """
    steps, nodes, links = history.count[0].tolist()
    node = int(history.steps[drop].first_node) if steps else 0
    link = int(history.nodes[node].first_link) if nodes else 0
    copy = new_history((2 if grow else 1) * len(history.steps))
    copy.steps[: steps - drop] = history.steps[drop:steps]
    copy.nodes[: nodes - node] = history.nodes[node:nodes]
    copy.states[: nodes - node] = history.states[node:nodes]
    copy.links[: links - link] = history.links[link:links]
    for name in ("first_node", "end_node"):
        copy.steps[name][: steps - drop] -= node
    for name in ("first_link", "end_link"):
        copy.nodes[name][: nodes - node] -= link
    copy.since[:] = history.since
    copy.reference[:] = history.reference
    copy.count[0] = steps - drop, nodes - node, links - link
    return copy


@kernel
def is_full(history: History) -> bool:
    """Whether another step may not fit."""
    count = history.count[0]
    return bool(
        count.steps >= len(history.steps)
        or count.nodes + 2 * KEPT > len(history.nodes)
        or count.links + 2 * KEPT * KEPT > len(history.links)
    )


@kernel(inline=True)
def accumulate_motion(
    history: History, epoch: Record, moving: float, speed: float, mode: int
) -> None:
    """Add an epoch's motion to the motion since the last step, composed in the frame of that step.

    Its derivative by the heading drift b is Σ R(T) J u (C + ½ δc), with the turn T and the
    drift's clock C before.

    Args:
        history: Its `since` is added to.
        epoch: What the sensors measured.
        moving: The epoch's duration, s; 0 where the vehicle stands.
        speed: m/s.
        mode: WHEELS, DISTANCE or CLOCK.
    """
    since = history.since[0]
    arc = moving if mode == CLOCK else epoch.arc
    c, s = math.cos(since.turn), math.sin(since.turn)
    forward = c * epoch.forward - s * epoch.left
    left = s * epoch.forward + c * epoch.left
    clock = drift_clock(epoch, moving)
    lever = since.clock + 0.5 * clock
    since.forward += forward
    since.left += left
    since.lever_forward -= lever * left
    since.lever_left += lever * forward
    since.arc += arc
    since.clock += clock
    since.metres += abs(speed) * moving if mode == CLOCK else abs(arc)
    since.turn += epoch.turn
    since.mode = mode


@kernel
def _link_off_road(belief: Belief, rate: float, metres: float) -> None:
    """Link off-road hypotheses to what would have left the roads since the last step.

    The filter spawns off-road hypotheses every so many metres only, which is soon enough for
    filtering.  Smoothed, a vehicle would have left the roads long before anything shows it.

    Args:
        belief: Its lineage is changed.
        rate: Rate of leaving the roads, 1/m.
        metres: Distance driven since the last step, m.
    """
    state = belief.state[0]
    on, off = 0.0, 0.0
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            off += hyp.weight
        else:
            on += hyp.weight
    left = min(rate * metres, 0.5) * on
    if off <= 0.0 or left <= 0.0:
        return
    kept = off / (off + left)
    for a in range(state.parents):
        total = 0.0
        for i in range(state.count):
            if belief.hyp[i].edge != OFF_ROAD:
                total += belief.hyp[i].weight * belief.lineage[i, a]
        for i in range(state.count):
            if belief.hyp[i].edge == OFF_ROAD:
                belief.lineage[i, a] = kept * belief.lineage[i, a] + (1.0 - kept) * total / on


@kernel(inline=True)
def store(belief: Belief, history: History, k: int, changed: bool, leave: float) -> None:
    """Add the belief after epoch k as a step, if anything was changed or it is time.

    Args:
        belief: The filter's; its lineage counts from this step on.
        history: One step longer afterwards.
        k: Number of the epoch.
        changed: Whether anything was observed in it, or hypotheses branched.
        leave: Rate of leaving the roads, 1/m.
    """
    state = belief.state[0]
    count = history.count[0]
    due = count.steps == 0 or state.time - history.steps[count.steps - 1].time >= _LONGEST_STEP
    if not changed and not due:
        return
    _link_off_road(belief, leave, history.since[0].metres)
    step = history.steps[count.steps]
    step.epoch = k
    step.time = state.time
    step.first_node = count.nodes
    step.speed = state.speed
    step.last_fix = state.last_fix
    step.misfits, step.misfit = state.misfits, state.vetting.misfit
    step.elsewhere[0], step.elsewhere[1] = state.elsewhere[0], state.elsewhere[1]
    step.standing = state.standing
    step.gnss_factor = state.gnss_factor
    copy_record(step.departure, state.separation.departure)
    copy_record(step.unmapped, state.separation.unmapped)
    copy_record(step.dropped, state.separation.dropped)
    copy_record(step.gross, state.separation.gross)
    step.level_tail = state.level_tail if state.mode != WHEELS else 1.0
    step.speed_sigma, step.about_road = state.driver.speed_sigma, state.about_road[2]
    step.map_factor = state.map.factor
    step.map_rate = state.map.rate
    for a in range(2):
        step.map_mean[a] = state.map.whole[a]
    pack_noise(history.reference[0].cov, history.since[0].plane_noise)
    copy_record(step.motion, history.since[0])
    _clear_motion(history.since[0])
    _clear_reference(history.reference[0], belief)
    for i in range(state.count):
        _store_node(belief, history, i)
    step.end_node = count.nodes
    count.steps += 1
    state.parents = state.count


@kernel(inline=True)
def accumulate_noise(history: History, move: Increment, noise: Noise) -> None:
    """Propagate the process noise since the last step by the filter's own motion.

    A reference vehicle, known exactly at that step, is moved as every hypothesis is.  In the
    frame of the step its covariance is Q, for all of them.  Along a road, with δ the odometer,

        Q_ss⁺ = Q_ss + 2 δ Q_sκ + δ² Q_κκ + q,   Q_sκ⁺ = Q_sκ + δ Q_κκ + q_sκ

    Args:
        history: Its reference and motion are changed.
        move: The increment.
        noise: Its process noise.
    """
    reference = history.reference[0]
    predict_plane(reference.mu, reference.cov, move, 1.0, noise)
    road = history.since[0].road_noise
    road[0] += move.arc * (2.0 * road[1] + move.arc * road[2]) + noise.along
    road[1] += move.arc * road[2] + noise.cross
    road[2] += noise.rate


@kernel
def _clear_reference(reference: Record, belief: Belief) -> None:
    """A vehicle at the origin, known exactly, with the mixture's κ and heading drift."""
    for a in range(N):
        reference.mu[a] = 0.0
        for b in range(N):
            reference.cov[a, b] = 0.0
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        reference.mu[K] += hyp.weight * hyp.mu[K]
        reference.mu[B] += hyp.weight * hyp.mu[B]


@kernel
def _clear_motion(since: Record) -> None:
    """Let the motion start anew."""
    since.arc = 0.0
    since.clock = 0.0
    since.metres = 0.0
    since.turn = since.forward = since.left = 0.0
    since.lever_forward = since.lever_left = 0.0
    since.map_aged = since.gnss_aged = 0.0
    since.driven[0] = since.driven[1] = 0.0
    since.drawn = since.jumped = since.switched = 0
    for a in range(3):
        since.road_noise[a] = 0.0


@kernel(inline=True)
def pack_state(packed: Record, hyp: Record) -> None:
    """Store the Gaussian of a hypothesis."""
    at = 0
    for a in range(N):
        packed.mu[a] = hyp.mu[a]
        for b in range(a + 1):
            packed.cov[at] = hyp.cov[a, b]
            at += 1


@kernel(inline=True)
def _store_node(belief: Belief, history: History, i: int) -> None:
    """Append hypothesis i as a node with its links, and begin its lineage anew."""
    state = belief.state[0]
    count = history.count[0]
    hyp = belief.hyp[i]
    node = history.nodes[count.nodes]
    node.edge = hyp.edge
    node.before = hyp.before
    node.segment, node.backs = hyp.segment, hyp.backs
    node.p = hyp.weight
    node.smoothed = hyp.weight
    node.path_entry = hyp.path_entry
    node.freed = hyp.freed
    hyp.freed = 0.0
    node.pace = pace_of(hyp.leg, state.driver.pace)
    node.first_link = count.links
    pack_state(history.states[count.nodes], hyp)
    for a in range(state.parents):
        if belief.lineage[i, a] > _LEAST_SHARE:
            link = history.links[count.links]
            link.origin = a
            link.share = belief.lineage[i, a]
            count.links += 1
    for a in range(state.count):
        belief.lineage[i, a] = 1.0 if a == i else 0.0
    node.end_link = count.links
    count.nodes += 1


@kernel
def load(history: History, node: int, mean: Vector, cov: Matrix) -> None:
    """The filtered state of a node: mean (N,) and covariance (N, N) are written."""
    packed = history.states[node]
    at = 0
    for a in range(N):
        mean[a] = packed.mu[a]
        for b in range(a + 1):
            cov[a, b] = packed.cov[at]
            cov[b, a] = packed.cov[at]
            at += 1
