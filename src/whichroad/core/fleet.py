"""Many drives, one behind the other, in one compiled call: what a call costs is paid once."""

from typing import NamedTuple

from ._jit import Bytes, Ints, Vector, entry, part
from .belief import CAPACITY, CLOCKS, KEPT, NO_EDGE, OFF_ROAD, Belief, Route
from .drive import run
from .epoch import Epochs
from .memory import Memory
from .network import Roads
from .output import Output
from .parameters import Parameters
from .passage import drive_edges, turn_rules
from .switching import Work


class Chains(NamedTuple):
    """The edges that the most probable hypothesis of each of d drives has come by."""

    first: Ints  # (d + 1,) where each begins, and where there is room
    edge: Ints  # (r,)
    time: Vector  # (r,) when each was entered, s
    abscissa: Vector  # (r,) where, m


class Passages(NamedTuple):
    """When and where each edge was driven, and what it broke, (r,) each; see `drive_edges`."""

    enter_time: Vector
    exit_time: Vector
    enter_m: Vector
    exit_m: Vector
    p: Vector
    gap: Bytes
    rules: Ints


@part
def _begin(belief: Belief, fresh: Belief, route: Route, work: Work) -> None:
    """As new for the next drive; rows of mean and cov are written before they are read."""
    for i in range(CAPACITY):
        belief.log_weight[i] = fresh.log_weight[i]
        belief.probability[i] = fresh.probability[i]
        belief.edge[i] = fresh.edge[i]
        belief.segment[i] = fresh.segment[i]
        belief.abscissa[i] = fresh.abscissa[i]
        belief.spread[i] = fresh.spread[i]
        belief.stay[i] = fresh.stay[i]
        belief.drove[i] = fresh.drove[i]
        belief.node[i] = fresh.node[i]
        belief.fresh[i] = fresh.fresh[i]
        for j in range(len(belief.scratch)):
            belief.scratch[j, i] = fresh.scratch[j, i]
        for j in range(min(belief.share.shape[1], KEPT)):
            belief.share[i, j] = fresh.share[i, j]
    belief.size[0] = fresh.size[0]
    for j in range(CLOCKS):
        belief.clock[j] = fresh.clock[j]
    for j in range(len(work.row)):
        work.row[j] = 0.0
    for j in range(len(work.root)):
        work.root[j] = 0.0
    route.size[0] = 0


@part
def _tell_chain(belief: Belief, route: Route, chains: Chains, d: int) -> bool:
    """Write the heaviest hypothesis' edges, repeats joined; False: there is no room."""
    top = 0
    for i in range(belief.size[0]):
        if belief.log_weight[i] > belief.log_weight[top]:
            top = i
    newest = belief.node[top] if belief.size[0] else -1
    count = 0
    after = NO_EDGE
    node = newest
    while node >= 0:
        edge = route.edge[node]
        if edge != OFF_ROAD and edge != after:
            count += 1
            after = edge
        node = route.parent[node]
    at = chains.first[d] + count
    if at > len(chains.edge):
        return False
    chains.first[d + 1] = at
    after = NO_EDGE
    node = newest
    while node >= 0:
        edge = route.edge[node]
        if edge != OFF_ROAD:
            if edge != after:
                at -= 1
            chains.edge[at] = edge
            chains.time[at] = route.time[node]
            chains.abscissa[at] = route.abscissa[node]
            after = edge
        node = route.parent[node]
    return True


@entry
def localize_each(
    belief: Belief, fresh: Belief, roads: Roads, route: Route, work: Work, epochs: Epochs,
    output: Output, first: Ints, chains: Chains, mode: int, side: float, lever: Vector,
    par: Parameters, outage_after: float, ambiguous_below: float, memory: Memory,
) -> int:  # fmt: skip
    """Localize drives, see `drive.run`.

    Args:
        belief: Scratch.
        fresh: An empty one.
        roads: The network.
        route: Scratch.
        work: Scratch.
        epochs: (n,) of all drives.
        output: (n,) written.
        first: (d + 1,) the epoch at which each drive begins, and n.
        chains: Written.
        mode: WHEELS, DISTANCE or CLOCK.
        side: 1 where one drives on the right, −1 on the left.
        lever: Antenna ahead and left of M, m, (2,).
        par: The settings.
        outage_after: Seconds without a fix that make an outage.
        ambiguous_below: P(edge) below which the road is ambiguous.
        memory: One of no length: nobody looks back.

    Returns:
        How many drives are done; less than d where the next one needs more room.
    """
    chains.first[0] = 0
    for d in range(len(first) - 1):
        _begin(belief, fresh, route, work)
        last = first[d + 1]
        done = run(
            belief, roads, route, work, epochs, output, first[d], last, mode, side, lever, par,
            outage_after, ambiguous_below, False, memory,
        )  # fmt: skip
        if done < last or not _tell_chain(belief, route, chains, d):
            return d
    return len(first) - 1


@part
def _first_epochs(entered: Vector, time: Vector, found: Ints) -> None:
    """The first epoch not before each edge was entered, and behind them the number of epochs."""
    for i in range(len(entered)):
        low, high = 0, len(time)
        while low < high:
            middle = (low + high) // 2
            if time[middle] < entered[i]:
                low = middle + 1
            else:
                high = middle
        found[i] = low
    found[len(entered)] = len(time)


@entry
def pass_each(
    roads: Roads, epochs: Epochs, output: Output, s: Vector, first: Ints, chains: Chains,
    epoch: Ints, told: Passages,
) -> None:  # fmt: skip
    """Fill in the passages of the chains of drives.

    Args:
        roads: The network.
        epochs: (n,) of all drives.
        output: (n,) what was said of them.
        s: (n,) the abscissae of that.
        first: (d + 1,) the epoch at which each drive begins, and n.
        chains: Their edges, r in all.
        epoch: (r + 1,) scratch.
        told: Written.
    """
    for d in range(len(first) - 1):
        low, high = first[d], first[d + 1]
        a, b = chains.first[d], chains.first[d + 1]
        if a == b:
            continue
        edge = chains.edge[a:b]
        entered = chains.time[a:b]
        time = epochs.time[low:high]
        _first_epochs(entered, time, epoch[: b - a + 1])
        known = high - 1
        while known >= low and output.live[known] <= 0:
            known -= 1
        for i in range(a, b):
            told.rules[i] = roads.rule[chains.edge[i]]
        turn_rules(roads, edge, told.rules[a:b])
        drive_edges(
            roads, edge, entered, chains.abscissa[a:b], epoch[: b - a + 1], time,
            output.edge[low:high], s[low:high], output.alt_edge[low:high], output.alt_p[low:high],
            known - low if known >= low else high - low - 1,
            told.enter_time[a:b], told.exit_time[a:b], told.enter_m[a:b], told.exit_m[a:b],
            told.p[a:b], told.gap[a:b],
        )  # fmt: skip
