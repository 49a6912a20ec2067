"""From a chain of edges to traversals: edges with times of entry and exit."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..filter.lookback.gaps import place_in_gaps
from ..filter.lookback.passage import TRAVERSAL, broken_rules, first_epochs, time_edges
from ..filter.state import OFF_ROAD
from ..filter.summary.estimate import Output
from ..graph.network import Roads, records
from .path import Chain
from .rivals import follow, rules_of_turns

_SHORT = 30.0  # m
_GLANCE = 5.0  # s, on an edge that leads nowhere
_TOUCHED = 0.5  # m of an edge, within which a vehicle that turns round on it was in the junction
_SURE = 0.9  # P of an edge, from which on the points say that it was driven

Traversals = Records  # (r,) TRAVERSAL, the edges of a path in driving order


def _improbable(driven: Traversals) -> NDArray[np.bool_]:
    """Edges that no path begins with: less likely than not, and driven for some metres only.

    Where a drive begins beside a junction, the heaviest chain may have begun on any of its roads.
    """
    rows = driven.view(np.ndarray)  # of which a field is had at once
    return np.asarray((rows["p"] < 0.5) & (rows["exit_m"] - rows["enter_m"] < _SHORT))


def _begin(driven: Traversals) -> int:
    """The first edge of a path that it may begin with; it gets the time of those before it."""
    begins = np.flatnonzero(~_improbable(driven))
    begin = int(begins[0]) if len(begins) else 0
    if begin and not driven.gap[1 : begin + 1].any():
        driven.enter_time[begin] = driven.enter_time[0]
    return begin


def trimmed(driven: Traversals, first: NDArray[np.int64]) -> tuple[Traversals, NDArray[np.int64]]:
    """Several paths, one behind the other, each from the edge it may begin with to its end.

    Args:
        driven: Their rows.
        first: (d + 1,) where each begins, and the number of rows.

    Returns:
        The rows that are left, and where each path begins in them.
    """
    ends = np.asarray(driven.p >= 0.0)
    if not ends.all():
        driven, first = driven[ends], np.append(0, np.cumsum(ends))[first]
    left = np.ones(len(driven), bool)
    starts = first[:-1][np.diff(first) > 0]
    for a in starts[_improbable(driven[starts])].tolist():
        end = int(first[np.searchsorted(first, a, side="right")])
        left[a : a + _begin(driven[a:end])] = False
    if left.all():
        return driven, first
    return driven[left], np.append(0, np.cumsum(left))[first]


def without_glances(
    driven: Traversals, first: NDArray[np.int64], roads: Roads
) -> tuple[Traversals, NDArray[np.int64]]:
    """Several paths, not yet timed, without edges that lead nowhere where those around join.

    At a sharp junction another road is the likeliest one for some seconds, and is left again by
    no turn.  Its whole length would count as driven.

    Args:
        driven: Their rows.
        first: (d + 1,) where each begins, and the number of rows.
        roads: The network.

    Returns:
        The rows that are left, and where each path begins in them.
    """
    if len(driven) < 3:
        return driven, first
    rows = driven.view(np.ndarray)
    edge, entered = rows["edge"].astype(np.int32), rows["entered"]
    lost = np.zeros(len(edge), bool)
    lost[1:-1] = entered[2:] - entered[1:-1] <= _GLANCE
    lost[1:-1] &= rows["left"][1:-1] <= 0.0
    lost[first[:-1][np.diff(first) > 0]] = lost[first[1:] - 1] = False
    at = np.flatnonzero(lost)
    if not len(at):
        return driven, first
    at = at[~follow(roads, edge[at], edge[at + 1])]
    at = at[follow(roads, edge[at - 1], edge[at + 1])]
    if not len(at):
        return driven, first
    left = np.ones(len(edge), bool)
    left[at] = False
    return driven[left], np.append(0, np.cumsum(left))[first]


def without_touches(
    driven: Traversals, first: NDArray[np.int64], roads: Roads
) -> tuple[Traversals, NDArray[np.int64]]:
    """Several paths, timed, without edges that are left by a turn round before they are driven.

    In a junction, an edge that leads out of it may be the likeliest one for a while.  The chain
    leaves it by its opposite, neither being driven, and that would count as a U-turn.  Where
    the edges around join, their turn is the one that was driven, also where it is banned.  The
    edge before has the time.  Points that are sure of an edge keep it.

    Args:
        driven: Their rows.  Times and rules of those beside what is left out are changed.
        first: (d + 1,) where each begins, and the number of rows.
        roads: The network.

    Returns:
        The rows that are left, and where each path begins in them.
    """
    if len(driven) < 4:
        return driven, first
    rows, edges = driven.view(np.ndarray), roads.edges.view(np.ndarray)
    touched = rows["exit_m"] - rows["enter_m"] < _TOUCHED
    touched &= ((rows["last_seen"] < 0) | (rows["p"] < _SURE)) & ~rows["gap"]
    at = np.flatnonzero(touched[1:-2] & touched[2:-1] & ~rows["gap"][3:]) + 1
    at = at[edges["opposite"][rows["edge"][at]] == rows["edge"][at + 1]]
    at = at[np.diff(at, prepend=-4) > 3]  # of several on end the first
    at = at[np.searchsorted(first, at - 1, "right") == np.searchsorted(first, at + 2, "right")]
    rules = rules_of_turns(roads, rows["edge"][at - 1], rows["edge"][at + 2])
    at, rules = at[rules >= 0], rules[rules >= 0]
    if not len(at):
        return driven, first
    rows["exit_time"][at - 1] = rows["enter_time"][at + 2]
    rows["rules"][at + 2] = edges["rule"][rows["edge"][at + 2]] | rules
    left = np.ones(len(driven), bool)
    left[at] = left[at + 1] = False
    return driven[left], np.append(0, np.cumsum(left))[first]


def untimed(chains: Sequence[Chain]) -> tuple[Traversals, NDArray[np.int64]]:
    """The edges of paths, repeats joined; when and where they were driven is not filled in.

    An edge left for off-road and entered again further on is one edge.

    Args:
        chains: (d,) their edges.

    Returns:
        Their rows, one path behind the other, and (d + 1,) where each begins.
    """
    if not chains:
        return records(0, TRAVERSAL), np.zeros(1, np.int64)
    bounds = np.cumsum([0, *(len(chain.edge) for chain in chains)])
    edge, entered, along = (np.concatenate([c[k] for c in chains]) for k in range(3))
    share, route = (
        np.concatenate([np.ones(len(c.edge)) if c[k] is None else c[k] for c in chains])
        for k in (3, 4)
    )
    on = np.flatnonzero(edge != OFF_ROAD)
    road, whose = edge[on], np.searchsorted(bounds, on, side="right")
    new = np.ones(len(on), bool)
    new[1:] = (road[1:] != road[:-1]) | (whose[1:] != whose[:-1])
    at = on[new]
    driven = records(len(at), TRAVERSAL)
    rows = driven.view(np.ndarray)
    rows["edge"], rows["entered"], rows["along"] = road[new], entered[at], along[at]
    before = np.minimum(np.append(at[1:], len(edge)), bounds[whose[new]]) - 1
    rows["left"] = np.where(edge[before] == OFF_ROAD, along[before], 0.0)
    rows["share"], rows["route"] = share[at], route[at]
    return driven, np.searchsorted(at, bounds)


def traversals(epochs: Records, output: Output, chain: Chain, roads: Roads) -> Traversals:
    """The edges of a path, timed by the positions on them.

    Epochs whose fix only fills a gap get their places by it.

    Args:
        epochs: (n,) EPOCH of the drive.
        output: (n,) the estimates, in place.
        chain: The edges.
        roads: The network.

    Returns:
        One row per edge, in driving order.
    """
    driven, _ = without_glances(*untimed([chain]), roads)
    if not len(driven):
        return driven
    first = np.zeros(len(driven) + 1, np.int64)
    first_epochs(driven, epochs, first)
    broken_rules(roads, driven)
    estimates = output.rows
    known = np.flatnonzero(estimates["live"] > 0)
    last = int(known[-1]) if len(known) else len(epochs) - 1
    time_edges(roads, driven, first, epochs, estimates, last)
    timed = driven["p"] >= 0.0
    driven = driven if timed.all() else driven[timed]
    if epochs["filled"].any():
        place_in_gaps(roads, driven, epochs, estimates)
    begin = _begin(driven)
    driven = driven[begin:] if begin else driven
    return without_touches(driven, np.array([0, len(driven)]), roads)[0]
