"""What could be known of drives that turn round, by who knows how they were made.

The oracle knows `turning`'s own model: which edges are driven, the priors of turns, speeds,
braking and accelerating, how often one turns round and how long one stands there, and the noise
of the fixes.  It finds the most probable sequence of states, one a fix: a place on a directed
edge, 5 m apart, driving or standing before turning round.  Between two fixes it enumerates all
routes that take the right time.  A route is pruned where what is left of it would take too long
at free speed, so that none is missed.

What it takes more simply than `turning` draws it: a way round a block, and into a dead end, has
the priors of turns; standing ends at a rate; and braking does not reach beyond the next node.
"""

import heapq
import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import shapely

from whichroad.evaluate import route_mismatch
from whichroad.simulate.route_choice import drivable

from .. import Figure, Options, interval, share
from ..sparse import harness
from . import matched, turning

GRID = 5.0  # m, between two places of an edge
RATES = (10, 30, 60)  # s
REACH = 22.0  # m, from a fix, of the places that count
WAIT = 15.0  # s, mean time of standing
LEAST_WAIT = 3.0  # s
RATE = 0.5 / turning.EVERY_M  # 1/m, of turning round within an edge: half of the kinds do so
TURN_GRID, STAND_GRID = 25.0, 8.0  # m, between places at which one turns round, and stands
TIMING = (1.0, 0.02)  # s, and share of the time: error of the travel times
ASIDE = (0.0, 8.0, 13.0)  # m, at which one stands
SHARE = 0.81  # of the noise's variance that is slow
WORTH = 15.0  # nats below the best, from which on a state is left
MOST_ROUTES = 4000  # from one edge to one fix


class State(NamedTuple):
    """A place of the vehicle."""

    edge: int
    s: float  # m
    aside: float  # m to the right, where it stands before turning round; -1: it drives


class Leg(NamedTuple):
    """A way from the end of one edge (or its start, where it turned there) to another edge."""

    edges: tuple[int, ...]  # entered one after the other; none: on along the same edge
    time: float  # s, from the end of the first edge to the start of the last one
    cap: float  # m/s, speed at the start of the last one
    log_p: float
    turned: int  # which of the edges it turned into; -1: none
    begin: float  # m, where on it, and on the edge before, it did so


class Network:
    """The roads as `turning` drives them."""

    def __init__(self, roads: Any, allowed: np.ndarray, ends: np.ndarray) -> None:
        self.roads, self.allowed, self.ends = roads, allowed | ends, ends
        self.allowed[roads.arrays.edges.opposite[ends]] = True
        self.length = np.asarray(roads.arrays.edges.length, float)
        self.limit = 0.85 * np.asarray(roads.arrays.edges.speed, float)
        self.opposite = np.asarray(roads.arrays.edges.opposite)
        self.rule = np.asarray(roads.arrays.edges.rule)
        self.onwards = lru_cache(None)(self._onwards)
        self.clock = lru_cache(None)(self._clock)
        self.at = lru_cache(None)(roads.at)
        self.before: dict[int, list[int]] = {}
        for edge in np.flatnonzero(self.allowed).tolist():
            for to, _, _ in self.onwards(edge):
                self.before.setdefault(to, []).append(edge)

    def _onwards(self, edge: int) -> list[tuple[int, float, float]]:
        """Ways on: edge, log prior, and the cap of the speed at the node, m/s."""
        to, p = turning.successors(self.roads.arrays, edge, self.allowed)
        turns = self.roads.arrays.turns[
            self.roads.arrays.edges.first_turn[edge] : self.roads.arrays.edges.end_turn[edge]
        ]
        total = float(p.sum())
        if total <= 0.0:
            return []
        found = []
        for e, q, angle in zip(to.tolist(), p.tolist(), turns.angle.tolist(), strict=True):
            if q > 0.0:
                cap = min(self.limit[edge], self.limit[e], _cap(abs(angle)))
                found.append((int(e), math.log(q / total), float(cap)))
        return found

    def _clock(self, edge: int, first: float, last: float) -> tuple[np.ndarray, np.ndarray]:
        """Abscissas of an edge, and the times at which a car is there, from and to some speeds."""
        n = max(2, int(self.length[edge] / turning.STEP) + 1)
        s = np.linspace(0.0, self.length[edge], n)
        pose = np.array([self.roads.at(edge, float(a)) for a in s])
        bend = np.abs((np.diff(pose[:, 2]) + np.pi) % (2.0 * np.pi) - np.pi)
        v = np.full(n, self.limit[edge])
        v[1:] = np.minimum(v[1:], [_cap(b) for b in bend])
        v[0], v[-1] = min(v[0], first), min(v[-1], last)
        ds = s[1] - s[0]
        for i in range(1, n):
            v[i] = min(v[i], math.sqrt(v[i - 1] ** 2 + 2.0 * turning.ACCELERATION * ds))
        for i in range(n - 2, -1, -1):
            v[i] = min(v[i], math.sqrt(v[i + 1] ** 2 + 2.0 * turning.BRAKING * ds))
        return s, np.concatenate([[0.0], np.cumsum(2.0 * ds / (v[1:] + v[:-1]))])

    def time(self, edge: int, first: float, last: float) -> float:
        """Seconds on a whole edge."""
        return float(self.clock(edge, round(first, 1), round(last, 1))[1][-1])

    def place(self, edge: int, s: float, aside: float = -1.0) -> tuple[float, float]:
        """A place in the plane, m."""
        x, y, heading = self.at(edge, round(s, 1))
        aside = max(aside, 0.0)
        return x + aside * math.sin(heading), y - aside * math.cos(heading)

    def slow(self, edge: int) -> float:
        """Seconds that braking to turn round, and getting away again, take longer."""
        rates = 1.0 / turning.BRAKING + 1.0 / turning.ACCELERATION
        return float(0.5 * self.limit[edge] * rates)

    def part(self, edge: int, first: float, last: float, s: Any) -> Any:
        """Seconds from the start of an edge to some abscissas."""
        return np.interp(s, *self.clock(edge, round(first, 1), round(last, 1)))


def _cap(bend: float) -> float:
    """Highest speed at a bend, m/s."""
    if bend > 1.5:
        return turning.MANOEUVRE
    return 4.5 if bend > 0.8 else 8.0 if bend > 0.3 else 99.0


def bounds(net: Network, goals: set[int], most: float, turns: bool) -> dict[int, float]:
    """Least seconds from the start of edges to the start of one of the goals."""
    found: dict[int, float] = {}
    queue = [(0.0, edge) for edge in goals]
    heapq.heapify(queue)
    while queue:
        time, edge = heapq.heappop(queue)
        if edge in found or time > most:
            continue
        found[edge] = time
        before = net.before.get(edge, [])
        for one in before:
            if one not in found:
                heapq.heappush(queue, (time + net.length[one] / net.limit[one], one))
        other = int(net.opposite[edge])
        if turns and other >= 0 and other not in found:
            heapq.heappush(queue, (time + LEAST_WAIT, other))
    return found


def legs(
    net: Network, first: int, goals: set[int], most: float, least: tuple[dict[int, float], ...]
) -> Iterator[Leg]:
    """All ways from the end of an edge to the goals that take no longer than some seconds.

    `least` is what `bounds` says of who has turned round, and of who has not.
    """
    stack = [Leg((to,), 0.0, cap, log_p, -1, 0.0) for to, log_p, cap in net.onwards(first)]
    stack += list(_turns(net, Leg((first,), -net.time(first, 99.0, 99.0), 99.0, 0.0, -1, 0.0)))
    count = 0
    while stack and count < MOST_ROUTES:
        leg = stack.pop()
        edge = leg.edges[-1]
        if leg.time + least[leg.turned < 0].get(edge, math.inf) > most:
            continue
        count += 1
        if edge in goals:
            yield leg
        for to, log_p, cap in net.onwards(edge):
            time = leg.time + net.time(edge, leg.cap, cap)
            stack.append(Leg((*leg.edges, to), time, cap, leg.log_p + log_p, leg.turned, leg.begin))
        if leg.turned < 0:
            stack += list(_turns(net, leg))


def turns_at(net: Network, edge: int, apart: float) -> list[float]:
    """Places of an edge at which one turns round: its end where it is a dead one."""
    length = net.length[edge]
    if net.ends[edge]:
        return [length]
    count = max(2, int(0.5 * length / apart) + 1)
    return [float(a) for a in np.linspace(0.3 * length, 0.8 * length, count)]


def _turns(net: Network, leg: Leg) -> Iterator[Leg]:
    """A leg that turns round on its last edge; its time is without the standing."""
    edge = leg.edges[-1]
    other = int(net.opposite[edge])
    if other < 0 or net.rule[other]:
        return
    length = net.length[edge]
    dead = bool(net.ends[edge])
    if not dead and length < 60.0:
        return
    slow = net.slow(edge)
    places = turns_at(net, edge, TURN_GRID)
    for at in places:
        log_p = 0.0 if dead else math.log(RATE * 0.5 * length / len(places))
        time = leg.time + float(net.part(edge, leg.cap, 99.0, at)) + slow
        time -= float(net.part(other, 99.0, 99.0, length - at))
        yield Leg((*leg.edges, other), time, 99.0, leg.log_p + log_p, len(leg.edges), at)


def states_near(net: Network, tree: Any, x: float, y: float) -> list[State]:
    """Places of edges near a fix, driving and standing."""
    found = []
    for edge in tree.query(shapely.Point(x, y), "dwithin", REACH + ASIDE[-1]).tolist():
        if not net.allowed[edge]:
            continue
        length = net.length[edge]
        grid = np.linspace(0.0, length, max(2, int(length / GRID) + 1)).tolist()
        found += [
            State(edge, s, -1.0) for s in grid if math.dist(net.place(edge, s), (x, y)) < REACH
        ]  # fmt: skip
        other = int(net.opposite[edge])
        if other < 0 or net.rule[other] or (length < 60.0 and not net.ends[edge]):
            continue
        found += [
            State(edge, s, a) for s in turns_at(net, edge, STAND_GRID) for a in ASIDE
            if math.dist(net.place(edge, s, a), (x, y)) < REACH
        ]  # fmt: skip
    return found


class Step(NamedTuple):
    """The states at a fix, and how each was come to."""

    states: list[State]
    residual: np.ndarray  # (n, 2) m, of the fix
    score: np.ndarray  # (n,) nats
    before: np.ndarray  # (n,) row of the state at the fix before
    leg: list[Leg | None]  # None: it stood


def _log_time(leg: Leg, late: np.ndarray, after: float, stood: bool) -> np.ndarray:
    """Log-density of being late by some seconds, which are a stand where there was one."""
    if leg.turned >= 0 or stood:
        return np.where(late >= 0.0, -math.log(WAIT) - late / WAIT, -math.inf)
    sigma = TIMING[0] + TIMING[1] * after
    return np.asarray(-0.5 * (late / sigma) ** 2 - math.log(sigma))


def _advance(net: Network, old: Step, states: list[State], residual: Any, dt: float) -> Step:
    """The best way to each state from one fix to the next."""
    kept = math.exp(-dt / turning.SLOW) * SHARE
    variance = turning.SIGMA**2 * (1.0 - kept**2)
    off = residual[None, :, :] - kept * old.residual[:, None, :]
    noise = -0.5 * (off**2).sum(-1) / variance - math.log(variance)
    edges, s = np.array([q.edge for q in states]), np.array([q.s for q in states])
    aside = np.array([q.aside for q in states])
    new = Step(states, residual, np.full(len(states), -math.inf), np.zeros(len(states), int),
               [None] * len(states))  # fmt: skip
    goals = {int(e) for e in edges}
    most = dt + 3.0 * (TIMING[0] + TIMING[1] * dt)
    least = (bounds(net, goals, most, False), bounds(net, goals, most, True))
    live = old.score > old.score.max() - WORTH
    groups: dict[tuple[int, bool], list[int]] = {}
    for row in np.flatnonzero(live).tolist():
        q = old.states[row]
        groups.setdefault((q.edge, q.aside >= 0.0), []).append(row)
    for (edge, stood), rows in groups.items():
        at = np.array(rows)
        begin = np.array([old.states[r].s for r in rows])
        if stood:
            for r in rows:
                same = [k for k, q in enumerate(states) if q == old.states[r]]
                for k in same:
                    _offer(new, k, old.score[r] - dt / WAIT + noise[r, k], r, None)
            begin = net.length[edge] - begin
            edge = int(net.opposite[edge])
        whole = net.time(edge, 99.0, 99.0)
        gone = whole - net.part(edge, 99.0, 99.0, begin) + (net.slow(edge) if stood else 0.0)
        ways = [Leg((), -whole, 99.0, 0.0, -1, 0.0)]
        ways += list(legs(net, edge, goals, most, least))
        for leg in ways:
            last = leg.edges[-1] if leg.edges else edge
            for k in np.flatnonzero(edges == last).tolist():
                took = gone + leg.time + float(net.part(last, leg.cap, 99.0, s[k]))
                if aside[k] >= 0.0:
                    if leg.turned >= 0 or stood:
                        continue
                    late = dt - took - 0.5 * net.slow(last)
                    p = np.where(late >= 0.0, -late / WAIT, -math.inf) - math.log(len(ASIDE))
                    if not net.ends[last]:
                        places = len(turns_at(net, last, STAND_GRID))
                        p = p + math.log(RATE * 0.5 * net.length[last] / places)
                else:
                    p = _log_time(leg, dt - took, dt, stood)
                ok = np.ones(len(at), bool)
                if not leg.edges:
                    ok = s[k] >= begin
                if leg.turned == 1 and leg.edges[0] == edge and leg.turned < len(leg.edges):
                    ok = leg.begin >= begin
                if 0 <= leg.turned == len(leg.edges) - 1 and s[k] < net.length[last] - leg.begin:
                    continue
                value = np.where(ok, old.score[at] + leg.log_p + p + noise[at, k], -math.inf)
                top = int(value.argmax())
                _offer(new, k, float(value[top]), int(at[top]), leg)
    return new


def _offer(new: Step, k: int, value: float, before: int, leg: Leg | None) -> None:
    """Take a way to a state if it is better."""
    if value > new.score[k]:
        new.score[k], new.before[k], new.leg[k] = value, before, leg


def most_probable(net: Network, tree: Any, time: Any, x: Any, y: Any) -> list[turning.Piece]:
    """Parts of edges that were most probably driven, of positions at some times."""
    steps: list[Step] = []
    last = 0
    for k in range(len(time)):
        states = states_near(net, tree, float(x[k]), float(y[k]))
        if not states:
            continue
        places = np.array([net.place(*q) for q in states])
        residual = np.array([x[k], y[k]]) - places
        anew = -0.5 * (residual**2).sum(-1) / turning.SIGMA**2
        anew[[q.aside >= 0.0 for q in states]] -= 10.0
        if not steps:
            steps.append(Step(states, residual, anew, np.zeros(len(states), int), []))
            last = k
            continue
        step = _advance(net, steps[-1], states, residual, float(time[k] - time[last]))
        if not np.isfinite(step.score.max()):  # it begins anew
            worst = int(steps[-1].score.argmax())
            step = step._replace(score=anew, before=np.full(len(states), worst))
        steps.append(step)
        last = k
    return _traced(net, steps)


def _traced(net: Network, steps: list[Step]) -> list[turning.Piece]:
    """The pieces of the best sequence of states."""
    found: list[turning.Piece] = []
    row = int(steps[-1].score.argmax())
    for k in range(len(steps) - 1, 0, -1):
        step, old = steps[k], steps[k - 1]
        leg, end, before = step.leg[row], step.states[row], int(step.before[row])
        begin = old.states[before]
        row = before
        if leg is None:
            continue
        edge, s = begin.edge, begin.s
        if begin.aside >= 0.0:
            edge, s = int(net.opposite[edge]), net.length[edge] - s
        way = [edge, *leg.edges]
        if leg.turned == 1 and leg.edges[0] == edge:
            way = list(leg.edges)  # it turned on the first edge
            turned = leg.turned
        else:
            turned = leg.turned + 1 if leg.turned >= 0 else -1
        pieces = []
        for n, one in enumerate(way):
            first = s if n == 0 else net.length[one] - leg.begin if n == turned else 0.0
            last = end.s if n == len(way) - 1 else leg.begin if n + 1 == turned else net.length[one]
            pieces.append(turning.Piece(one, float(first), float(last)))
        found = pieces + found
    return [p for p in found if p.end > p.start]


def wrong(net: Network, tree: Any, drive: turning.Drive, error: Any, every: int) -> float:
    """Metres that the oracle misses; all of them where it finds no way."""
    k = np.unique(np.append(np.arange(0, len(drive.time), every), len(drive.time) - 1))
    x, y = drive.x[k] + error[k, 0], drive.y[k] + error[k, 1]
    pieces = most_probable(net, tree, drive.time[k], x, y)
    true = turning.lines(
        net.roads, *zip(*((q.edge, q.start, q.end) for q in drive.pieces), strict=True)
    )
    if not pieces:
        return math.nan
    said = turning.lines(net.roads, *zip(*((q.edge, q.start, q.end) for q in pieces), strict=True))
    return float(route_mismatch(true, true, said)[0])


def measure(options: Options) -> list[Figure]:
    """How much less of the way is right than the oracle has, at each rate but the first."""
    roads = harness.our_adapter(options, options.need("maps", "heidelberg.osm.pbf")).maps[0][2]
    lines = [roads.arrays.vertices[e.first_vertex : e.last_vertex + 1] for e in roads.arrays.edges]
    tree = shapely.STRtree([shapely.LineString(np.column_stack([v.x, v.y])) for v in lines])
    rates = [r for r in RATES if r in matched.intervals(options)]
    rows: dict[int, list[tuple[float, ...]]] = {every: [] for every in rates}
    for seed in options.seeds or matched.SEEDS:
        rng = np.random.default_rng([21, seed])  # as `turning.drives` draws them
        net = Network(roads, drivable(roads.arrays, rng), turning.dead_ends(roads.arrays))
        one = Options(data=options.data, seeds=[seed], more=options.more)
        for drive, error in turning.drives(one, roads):
            for every in rates:
                missed, _, length, _, _ = turning.score(roads, drive, error, every)
                rows[every].append((missed, wrong(net, tree, drive, error, every), length))
                options.say(f"  seed {seed}, {drive.kind}, {every} s: {rows[every][-1]}")
    figures = []
    for every, found in rows.items():
        table = np.array(found)
        lost = int(np.isnan(table[:, 1]).sum())
        table = table[np.isfinite(table[:, 1])]
        more = np.column_stack([table[:, 0] - table[:, 1], table[:, 2]])
        label, n = f"turning, {every} s", len(table)
        goal = "<= 0.5" if every <= 10 else "<= 1"
        figures += [
            Figure(f"{label}: way right", 100.0 - share(table[:, [0, 2]]), "", "%", n),
            Figure(f"{label}: way right, oracle", 100.0 - share(table[:, [1, 2]]), "", "%", n),
            Figure(f"{label}: below the oracle", share(more), goal, "points", n,
                   interval(share, more)),
            Figure(f"{label}: no way by the oracle", float(lost), "", "", len(found)),
        ]  # fmt: skip
    return figures
