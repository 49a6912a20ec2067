"""Many drives, one after the other, in one compiled call: its fixed cost is paid once."""

from typing import Annotated, NamedTuple

from .._compile import Array, Ints, Record, Records, entry, kernel
from ..graph.network import Roads
from ._simd import copy_record
from .lookback.gaps import place_in_gaps
from .lookback.history import History
from .lookback.passage import Traversals, broken_rules, first_epochs, time_edges
from .state import NO_EDGE, OFF_ROAD, Belief, Context, Epochs, Path, most_probable
from .step import run
from .summary.estimate import Estimates, Output
from .vetting.motion_sources import SOURCES, VETTING


class Drives(NamedTuple):
    """Where each of d drives begins in tables of all, and the edges that it was driven along."""

    first_epoch: Ints  # (d + 1,) the epoch at which each begins, and the number of epochs
    first_edge: Ints  # (d + 1,) the edge at which each begins, and the number of edges
    driven: Traversals  # (r,)
    vetting: Annotated[Records, Array(VETTING, 1)]  # (m,) of drives of which a sensor was withheld
    vetted: Ints  # (d,) the row of each drive there, -1: none was


@kernel
def _list_edges(belief: Belief, path: Path, drives: Drives, d: int) -> bool:
    """List the edges of the most probable hypothesis, repeats joined; False: the table is full."""
    newest = -1
    if belief.state[0].count:
        newest = belief.hyp[most_probable(belief)].path_entry
    count = 0
    after = NO_EDGE
    at = newest
    while at >= 0:
        edge = path.entry[at].edge
        if edge != OFF_ROAD and edge != after:
            count += 1
            after = edge
        at = path.entry[at].parent
    row = drives.first_edge[d] + count
    if row > len(drives.driven):
        return False
    drives.first_edge[d + 1] = row
    after = NO_EDGE
    at = newest
    left = 0.0
    while at >= 0:
        entry = path.entry[at]
        if entry.edge == OFF_ROAD:
            left = entry.along
        else:
            if entry.edge != after:
                row -= 1
                drives.driven[row].left = left
            left = 0.0
            drives.driven[row].edge = entry.edge
            drives.driven[row].entered = entry.time
            drives.driven[row].along = entry.along
            drives.driven[row].share = entry.share
            drives.driven[row].route = entry.route
            after = entry.edge
        at = entry.parent
    return True


@kernel
def _withheld(vetting: Record) -> bool:
    """Whether anything that a receiver reported was withheld."""
    seconds = vetting.repeats.seconds
    for source in range(SOURCES):
        seconds += vetting.seconds[source]
    return bool(seconds > 0.0)


@entry
def localize_each(
    belief: Belief, empty: Belief, path: Path, history: History, epochs: Epochs, output: Output,
    ctx: Context, drives: Drives,
) -> int:  # fmt: skip
    """Localize drives, see `step.run`.

    Args:
        belief: Buffer.
        empty: A new one, whose state each drive begins with.
        path: Buffer.
        history: An empty one: nothing is stored.
        epochs: (n,) EPOCH of all drives.
        output: (n,) written.
        ctx: What all drives share.
        drives: Where each begins; the edges are written.

    Returns:
        How many drives are done; less than d where a table is too small for the next one.
    """
    drives.first_edge[0] = 0
    noted = 0
    for d in range(len(drives.first_epoch) - 1):
        copy_record(belief.state[0], empty.state[0])
        for j in range(len(ctx.work.row)):
            ctx.work.row[j] = 0.0
        path.size[0] = 0
        last = drives.first_epoch[d + 1]
        done = run(belief, path, history, epochs, output, ctx, drives.first_epoch[d], last)
        if done < last or not _list_edges(belief, path, drives, d):
            return d
        drives.vetted[d] = -1
        if _withheld(belief.state[0].vetting):
            if noted == len(drives.vetting):
                return d
            copy_record(drives.vetting[noted], belief.state[0].vetting)
            drives.vetted[d] = noted
            noted += 1
    return len(drives.first_epoch) - 1


@entry
def time_each(
    roads: Roads, epochs: Epochs, estimates: Estimates, drives: Drives, found: Ints
) -> None:
    """Fill in when and where the edges of drives were driven, see `passage.time_edges`.

    Args:
        roads: The network.
        epochs: (n,) EPOCH of all drives.
        estimates: (n,) ESTIMATE of them.
        drives: Their edges, r in all.
        found: (r + 1,) buffer.
    """
    for d in range(len(drives.first_epoch) - 1):
        low, high = drives.first_epoch[d], drives.first_epoch[d + 1]
        a, b = drives.first_edge[d], drives.first_edge[d + 1]
        if a == b:
            continue
        driven = drives.driven[a:b]
        first = found[: b - a + 1]
        first_epochs(driven, epochs[low:high], first)
        broken_rules(roads, driven)
        known = high - 1
        while known >= low and estimates[known].live <= 0:
            known -= 1
        last = known - low if known >= low else high - low - 1
        time_edges(roads, driven, first, epochs[low:high], estimates[low:high], last)
        place_in_gaps(roads, driven, epochs[low:high], estimates[low:high])
