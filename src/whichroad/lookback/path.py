"""Paths out of the graph of merged hypotheses: the best one, and those that compete."""

import heapq
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..filter.lookback.best_path import best_path, edge_probability
from ..filter.lookback.history import History
from ..filter.state import OFF_ROAD, Belief, Path, new_path
from ..graph.network import Roads
from ..observations import Array
from .rivals import follow, rivals
from .rivals import shortest as shortest

_OFF_ROAD_WEIGHT = 0.5  # weight of an off-road step in the best path, which is to be of roads
_CLOSE = 2.0  # s between two steps, up to which an edge is entered at the second
_ENTRIES = 256  # edges between two steps, at most, read from the path tree
_SURE = 0.999  # P(edge) from which on every route passes an edge
_BEAM = 200  # routes that are extended at once between two such edges
_LEAST = 1e-4  # P of a route up to which it is left out


class Chain(NamedTuple):
    """Edges in driving order, OFF_ROAD between, and when and where each was entered."""

    edge: NDArray[np.int32]
    time: Array  # s
    along: Array  # m
    share: Array | None = None  # of the likely routes that pass it; None: all pass all
    route: Array | None = None  # of these that is the one driven; None: there is one


def tidied(path: Path, *users: NDArray[np.int64]) -> Path:
    """The path tree with spare capacity, and only the entries that its users descend from.

    Args:
        path: The tree.
        users: Numbers of entries, renumbered in place; negative: none.

    Returns:
        The tree to go on with.
    """
    used = int(path.size[0])
    parent = path.entry.parent
    keep = np.zeros(used, bool)
    for entries in users:
        for entry in np.unique(entries).tolist():
            while entry >= 0 and not keep[entry]:
                keep[entry] = True
                entry = int(parent[entry])
    kept = np.flatnonzero(keep)
    number = np.full(used + 1, -1, np.int64)
    number[kept] = np.arange(len(kept))
    larger = new_path(max(len(path.entry), 4 * len(kept) + (1 << 14)))
    larger.entry[: len(kept)] = path.entry[kept]
    larger.entry.parent[: len(kept)] = number[parent[kept]]
    larger.size[0] = len(kept)
    for entries in users:
        entries[:] = number[entries]
    return larger


def heaviest_chain(path: Path, belief: Belief) -> Chain:
    """The edges of the most probable hypothesis.

    Args:
        path: The tree of edges entered.
        belief: The filter's.

    Returns:
        The edges.
    """
    hyp, entries = belief.hyp.view(np.ndarray), path.entry.view(np.ndarray)
    n = int(belief.state["count"][0])
    if n == 0:
        return Chain(np.zeros(0, np.int32), np.zeros(0), np.zeros(0))
    entry = int(hyp["path_entry"][int(np.argmax(hyp["log_weight"][:n]))])
    found, parent = [], entries["parent"]
    while entry >= 0:
        found.append(entry)
        entry = int(parent[entry])
    rows = np.array(found[::-1], int)
    edge, time, along, share, route = (
        entries[name][rows] for name in ("edge", "time", "along", "share", "route")
    )
    return Chain(edge, time, along, share.astype(float), route.astype(float))


@dataclass(frozen=True, slots=True)
class Route:
    """One of several routes."""

    p: float
    edges: tuple[int, ...]  # in driving order; those off the roads are left out


@dataclass(frozen=True, slots=True)
class Alternative:
    """A part of the drive where the route is not sure, between two edges that are."""

    start: float  # s, when the last sure edge before was still driven
    end: float  # s, when the first sure edge after it was
    routes: tuple[Route, ...]  # the most probable first; from the one edge to the other

    @property
    def ways(self) -> tuple[Route, ...]:
        """`routes` by its name of version 0.1."""
        return self.routes


class BestChains:
    """Paths on which most is right, by smoothed probabilities, of drives in the same tables.

    Args:
        history: The graph.
        path: The tree of edges entered.
        roads: The network.
    """

    def __init__(self, history: History, path: Path, roads: Roads) -> None:
        steps, nodes = len(history.steps), len(history.nodes)
        self._count, self._columns = history.count, _columns(history, path, roads)
        self._weight, (self._p, score) = np.zeros(steps), np.zeros((2, nodes))
        back, self._chain = np.zeros(nodes, np.int64), np.zeros(steps, np.int64)
        self._add_up = edge_probability.bind(history, self._p)
        self._find = best_path.bind(history, self._weight, self._p, score, back, self._chain)

    def found(self) -> Chain:
        """The edges of the drive that is in the tables, smoothed."""
        steps, nodes, _ = self._count[0].tolist()
        c = self._columns
        c = c._replace(time=c.time[:steps], first_node=c.first_node[:steps])
        self._add_up()
        self._p[:nodes][c.edge[:nodes] == OFF_ROAD] *= _OFF_ROAD_WEIGHT
        self._weight[:steps] = 0.1
        self._weight[: steps - 1] += c.time[1:] - c.time[:-1]
        self._find()
        return _edges_of(c, self._chain[:steps])


class _Columns(NamedTuple):
    """Columns of the graph and of the path tree: access to a field by its name is slow."""

    roads: Roads
    time: Array  # of steps
    first_node: NDArray[np.int64]
    end_node: NDArray[np.int64]
    edge: NDArray[np.int32]  # of nodes
    smoothed: Array
    path_entry: NDArray[np.int64]
    first_link: NDArray[np.int64]
    end_link: NDArray[np.int64]
    origin: NDArray[np.int32]  # of links
    share: NDArray[np.float32]
    parent: NDArray[np.int64]  # of entries
    entry_edge: NDArray[np.int32]
    entry_time: Array
    along: Array
    entry_share: Array
    entry_route: Array


class _Entered(NamedTuple):
    """An edge between two fixes."""

    edge: int
    time: float  # s
    share: float  # of the likely routes that pass it
    route: float  # of these that is the one driven


def _columns(history: History, path: Path, roads: Roads) -> _Columns:
    """Of the whole tables, free rows too."""
    step, node, link, entry = history.steps, history.nodes, history.links, path.entry
    return _Columns(
        roads, step.time, step.first_node, step.end_node, node.edge, node.smoothed,
        node.path_entry, node.first_link, node.end_link, link.origin, link.share, entry.parent,
        entry.edge, entry.time, entry.along, entry.share, entry.route,
    )  # fmt: skip


def _edges_of(c: _Columns, nodes: NDArray[np.int64]) -> Chain:
    """The edges that a chain of nodes, one a step, has driven."""
    every = c.edge[nodes]
    changes = np.append(0, np.flatnonzero(every[1:] != every[:-1]) + 1)
    edge, entry, now = every[changes], c.path_entry[nodes[changes]], c.time[changes]
    before = np.where(changes > 0, c.time[changes - 1], now)
    told = (entry >= 0) & (c.entry_edge[entry] == edge)
    when = np.where(told & (now - before > _CLOSE), c.entry_time[entry], now)
    when = np.minimum(np.maximum(when, before), now)
    columns = (
        edge, when, np.where(told, c.along[entry], 0.0), np.where(told, c.entry_share[entry], 1.0),
        np.where(told, c.entry_route[entry], 1.0),
    )  # fmt: skip
    rows = list(zip(*(column.tolist() for column in columns), strict=True))
    for n in np.flatnonzero(~follow(c.roads, edge[:-1], edge[1:]))[::-1].tolist():
        k = int(changes[n + 1])
        first, last = float(before[n + 1]), float(now[n + 1])
        rows[n + 1 : n + 1] = [
            (b.edge, min(max(b.time, first), last), 0.0, b.share, b.route)
            for b in _between(c, int(nodes[k - 1]), int(nodes[k]))
        ]
    edges, *others = zip(*rows, strict=True)
    return Chain(np.array(edges, np.int32), *(np.array(column) for column in others))


def _between(c: _Columns, i: int, j: int) -> list[_Entered]:
    """Edges driven between those of two linked nodes that do not follow one another."""
    then, edge = int(c.edge[i]), int(c.edge[j])
    off_road = OFF_ROAD in (then, edge)  # a parked vehicle came and leaves by roads
    found: list[_Entered] = []
    entry, stop = int(c.path_entry[j]), int(c.path_entry[i])
    while (entry := int(c.parent[entry])) >= 0 and entry != stop:
        at = int(c.entry_edge[entry])
        if at in (OFF_ROAD, then) or len(found) == _ENTRIES:
            break
        shares = float(c.entry_share[entry]), float(c.entry_route[entry])
        found.append(_Entered(at, float(c.entry_time[entry]), *shares))
    if entry >= 0 and (entry == stop or c.entry_edge[entry] == then):
        return found[::-1]
    if off_road:
        return []
    step = int(np.searchsorted(c.first_node, j, side="right")) - 1
    time = float(c.time[step])
    return [_Entered(e, time, 1.0, 1.0) for e in shortest(c.roads, then, edge) or []]


def alternatives(
    history: History, path: Path, roads: Roads, *, told: bool = True
) -> list[Alternative]:
    """The drive in parts between sure edges, each with its routes and their probabilities.

    The parts follow each other, the last edge of one being the first of the next; nearly all
    have one route.  P of the routes of a part sum to 1, less what no route was found for.

    Args:
        history: The graph, smoothed.
        path: The tree of edges entered.
        roads: The network.
        told: Whether routes between the same two fixes are told that the filter only counted.

    Returns:
        The parts in driving order.
    """
    steps, nodes, links = history.count[0].tolist()
    step, node, link = history.steps[:steps], history.nodes[:nodes], history.links[:links]
    c = _columns(history._replace(steps=step, nodes=node, links=link), path, roads)
    time = c.time
    p = np.zeros(len(c.edge))
    edge_probability(history, p)
    top = np.maximum.reduceat(p, c.first_node) if steps else np.zeros(0)
    sure = np.flatnonzero(top >= _SURE).tolist()
    if not sure or sure[0] != 0:
        sure.insert(0, 0)
    if sure[-1] != steps - 1:
        sure.append(steps - 1)
    best = [_best_edge(c, p, t) for t in sure]
    parts: list[Alternative] = []
    for k in range(len(sure) - 1):
        a, b = sure[k], sure[k + 1]
        if b == a + 1 and best[k] == best[k + 1]:
            continue
        parts.append(Alternative(float(time[a]), float(time[b]), _routes(c, a, b, told)))
    if not parts and steps:
        alone = Route(1.0, (best[0],) if best[0] != OFF_ROAD else ())
        parts.append(Alternative(float(time[0]), float(time[steps - 1]), (alone,)))
    return parts


def _best_edge(c: _Columns, p: Array, step: int) -> int:
    first, last = c.first_node[step], c.end_node[step]
    return int(c.edge[first + int(np.argmax(p[first:last]))])


def _ways(c: _Columns, i: int, j: int, told: bool) -> list[tuple[float, tuple[int, ...]]]:
    """Edges between those of two linked nodes with their shares, which sum to 1 at most."""
    at_once = bool(follow(c.roads, c.edge[[i]], c.edge[[j]])[0])
    between = [] if at_once else _between(c, i, j)
    taken = tuple(b.edge for b in between)
    share = min((b.route for b in between), default=1.0)
    found = [(share, taken)]
    if told and share < 1.0 - _LEAST:
        step = int(np.searchsorted(c.first_node, j, side="right")) - 1
        way = [int(c.edge[i]), *taken, int(c.edge[j])]
        others = rivals(c.roads, way, [b.share for b in between], float(np.diff(c.time)[step - 1]))
        found += [((1.0 - share) * p, edges) for p, edges in others if edges != taken]
    return found


def _routes(c: _Columns, first: int, last: int, told: bool) -> tuple[Route, ...]:
    """Routes from one step to a later one, backwards: P(route) = Σ γ(last) Π f over its chains.

    A route is kept as its last edges, each with what follows, so that routes share their ends.
    """
    tails: list[tuple[int, int]] = []  # edge, number of the tail that follows
    number: dict[tuple[int, int], int] = {}

    def put(e: int, tail: int) -> int:
        key = (e, tail)
        if key not in number:
            number[key] = len(tails)
            tails.append(key)
        return number[key]

    edge = c.edge
    lost, here = 0.0, dict[tuple[int, int], float]()
    ways: dict[tuple[int, int], list[tuple[float, tuple[int, ...]]]] = {}
    for j in range(int(c.first_node[last]), int(c.end_node[last])):
        here[j, put(int(edge[j]), -1)] = float(c.smoothed[j])
    for step in range(last, first, -1):
        then = int(c.first_node[step - 1])
        before: dict[tuple[int, int], float] = {}
        for (j, tail), weight in here.items():
            for at in range(int(c.first_link[j]), int(c.end_link[j])):
                i, part = then + int(c.origin[at]), weight * float(c.share[at])
                if part < 0.1 * _LEAST:
                    continue
                if edge[i] == edge[j]:
                    before[i, tail] = before.get((i, tail), 0.0) + part
                    continue
                if (i, j) not in ways:
                    ways[i, j] = _ways(c, i, j, told)
                lost += part * max(1.0 - sum(share for share, _ in ways[i, j]), 0.0)
                for share, way in ways[i, j]:
                    longer = tail
                    for e in reversed(way):
                        longer = put(e, longer)
                    longer = put(int(edge[i]), longer)
                    before[i, longer] = before.get((i, longer), 0.0) + part * share
        if len(before) > _BEAM:
            before = dict(sorted(before.items(), key=lambda item: -item[1])[:_BEAM])
        if not before:  # a new beginning
            break
        here = before
    return _summed(here, tails, lost)


def _summed(
    here: dict[tuple[int, int], float], tails: list[tuple[int, int]], lost: float
) -> tuple[Route, ...]:
    """Routes of the same edges are one; `lost` is the weight of those that are not told."""
    routes: dict[tuple[int, ...], float] = {}
    for (_, tail), weight in here.items():
        edges: list[int] = []
        while tail >= 0:
            edge, tail = tails[tail]
            if edge != OFF_ROAD and (not edges or edges[-1] != edge):
                edges.append(edge)
        routes[tuple(edges)] = routes.get(tuple(edges), 0.0) + weight
    total = math.fsum(routes.values()) + lost
    kept = sorted(((w / total, e) for e, w in routes.items() if w > _LEAST * total), reverse=True)
    return tuple(Route(p, edges) for p, edges in kept)


def best_routes(parts: list[Alternative], count: int) -> list[Route]:
    """The most probable whole routes: parts are independent, given the sure edges between.

    Args:
        parts: As `alternatives` gives them.
        count: How many at most.

    Returns:
        Routes from the first edge to the last, the most probable first.
    """
    open_parts = [k for k, part in enumerate(parts) if len(part.routes) > 1]
    start = (0,) * len(open_parts)
    closed = math.fsum(math.log(part.routes[0].p) for part in parts if len(part.routes) == 1)

    def log_p(choice: tuple[int, ...]) -> float:
        return closed + math.fsum(
            math.log(parts[k].routes[c].p) for k, c in zip(open_parts, choice, strict=True)
        )

    queue, seen = [(-log_p(start), start)], {start}
    found: list[Route] = []
    while queue and len(found) < count:
        cost, choice = heapq.heappop(queue)
        found.append(
            Route(math.exp(-cost), _joined(parts, dict(zip(open_parts, choice, strict=True))))
        )
        for at, c in enumerate(choice):
            if c + 1 < len(parts[open_parts[at]].routes):
                other = (*choice[:at], c + 1, *choice[at + 1 :])
                if other not in seen:
                    seen.add(other)
                    heapq.heappush(queue, (-log_p(other), other))
    return found


def _joined(parts: list[Alternative], choice: dict[int, int]) -> tuple[int, ...]:
    edges: list[int] = []
    for k, part in enumerate(parts):
        for edge in part.routes[choice.get(k, 0)].edges:
            if not edges or edges[-1] != edge:
                edges.append(edge)
    return tuple(edges)
