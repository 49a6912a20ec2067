"""Drives that turn round every 3 km: on the spot, in a driveway, round a block, at a dead end.

Drawn on Heidelberg by our own hand: edges by the map's turn priors, speeds by its roads, fixes
with white and slow noise.  Truth is the directed edge.
"""

import heapq
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import whichroad
from whichroad.evaluate import route_mismatch
from whichroad.simulate.route_choice import drivable

from .. import Figure, Options, interval, share
from ..sparse import harness
from . import matched

KINDS = ("spot", "driveway", "block", "dead end")
RATES = (1, 10, 30, 60)  # s
EVERY_M = 3000.0  # between two turns
TURNS = 3  # a drive
SURE = 0.99
SIGMA, SLOW = 5.0, 45.0  # m; s
STEP = 2.0  # m
ACCELERATION, BRAKING = 1.6, 2.0  # m/s²
MANOEUVRE = 1.5  # m/s, at a turn
BLOCK_M = 1500.0  # longest way round a block
DEAD_END_M = 600.0  # longest way to a dead end


class Piece(NamedTuple):
    """A part of a directed edge, driven at once."""

    edge: int
    start: float  # m
    end: float
    stop: float = 0.0  # s, stood at its end
    aside: float = 0.0  # m, that the vehicle stands to the right of the road


@dataclass(frozen=True, slots=True)
class Drive:
    """Truth at 1 Hz."""

    kind: str
    pieces: list[Piece]
    time: np.ndarray
    x: np.ndarray
    y: np.ndarray
    edge: np.ndarray
    aside: np.ndarray


def successors(roads: Any, edge: int, allowed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Legal ways on, without turning round, and their priors."""
    row = roads.edges[edge]
    turns = roads.turns[row["first_turn"] : row["end_turn"]]
    to = turns.edge
    p = turns.prior * ((turns.rule == 0) & allowed[to] & (to != row["opposite"]))
    return to, p * np.where(roads.edges.service[to] > 0, 0.05, 1.0)


def walk(roads: Any, edge: int, metres: float, allowed: np.ndarray, rng: Any) -> list[int]:
    """Edges behind an edge, about so long."""
    found: list[int] = []
    visits: dict[int, int] = {}
    while metres > 0.0:
        to, p = successors(roads, edge, allowed)
        p = p * np.array([0.25 ** visits.get(int(e), 0) for e in to])
        if not p.sum() > 0.0:
            break
        edge = int(rng.choice(to, p=p / p.sum()))
        visits[edge] = visits.get(edge, 0) + 1
        found.append(edge)
        metres -= float(roads.edges.length[edge])
    return found


def route(roads: Any, start: int, goal: Any, longest: float, allowed: np.ndarray) -> list[int]:
    """The shortest edges behind `start` up to one that is a goal; none: empty."""
    queue, came = [(0.0, start, -1)], dict[int, int]()
    while queue:
        so_far, edge, before = heapq.heappop(queue)
        if edge in came or so_far > longest:
            continue
        came[edge] = before
        if edge != start and goal(edge):
            found = []
            while edge != start:
                found.append(edge)
                edge = came[edge]
            return found[::-1]
        to, p = successors(roads, edge, allowed)
        for e in to[p > 0.0].tolist():
            heapq.heappush(queue, (so_far + float(roads.edges.length[e]), e, edge))
    return []


def dead_ends(roads: Any) -> np.ndarray:
    """Edges at whose end one can only turn round."""
    edges, turns = roads.edges, roads.turns
    origin = np.repeat(np.arange(len(edges)), edges.end_turn - edges.first_turn)
    on = turns.edge != edges.opposite[origin]
    return (np.bincount(origin, on, len(edges)) == 0) & (edges.opposite >= 0) & (edges.rule == 0)


def turned(roads: Any, kind: str, edge: int, allowed: np.ndarray, ends: np.ndarray, rng: Any) -> (
    list[Piece]
):  # fmt: skip
    """How the drive goes on from the start of an edge, up to where it has turned."""
    length, opposite = roads.edges.length, int(roads.edges.opposite[edge])
    if kind in ("spot", "driveway"):
        if opposite < 0 or length[edge] < 60.0 or roads.edges.rule[opposite]:
            return []
        s = float(rng.uniform(0.3, 0.8) * length[edge])
        stop, aside = (rng.uniform(4.0, 15.0), 0.0) if kind == "spot" else (
            rng.uniform(10.0, 60.0), rng.uniform(6.0, 15.0)
        )  # fmt: skip
        back = Piece(opposite, float(length[edge]) - s, float(length[opposite]))
        return [Piece(edge, 0.0, s, stop, aside), back]
    if kind == "block":
        if opposite < 0:
            return []
        way = route(roads, edge, lambda e: e == opposite, BLOCK_M, allowed)
        return [Piece(e, 0.0, float(length[e])) for e in [edge, *way]] if way else []
    way = route(roads, edge, lambda e: bool(ends[e]), DEAD_END_M, allowed | ends)
    if not way:
        return []
    there = [edge, *way]
    home = [int(roads.edges.opposite[e]) for e in there[::-1]]
    if min(home) < 0 or roads.edges.rule[home].any():
        return []
    out = [Piece(e, 0.0, float(length[e])) for e in there]
    out[-1] = out[-1]._replace(stop=float(rng.uniform(3.0, 15.0)))
    return out + [Piece(e, 0.0, float(length[e])) for e in home]


def pieces(roads: Any, kind: str, allowed: np.ndarray, ends: np.ndarray, rng: Any) -> list[Piece]:
    """A drive with three turns of a kind; empty where none was found."""
    length = roads.edges.length
    starts = np.flatnonzero(allowed & (roads.edges.service == 0))
    edge = int(rng.choice(starts))
    found = [Piece(edge, 0.0, float(length[edge]))]
    for _ in range(TURNS):
        turn: list[Piece] = []
        for _ in range(20):
            way = walk(roads, edge, EVERY_M * rng.uniform(0.7, 1.3), allowed, rng)
            turn = turned(roads, kind, way[-1], allowed, ends, rng) if way else []
            if turn and allowed[turn[-1].edge]:
                break
        if not turn or not allowed[turn[-1].edge]:
            return []
        found += [Piece(e, 0.0, float(length[e])) for e in way[:-1]] + turn
        edge = turn[-1].edge
    return found + [Piece(e, 0.0, float(length[e])) for e in walk(roads, edge, 1e3, allowed, rng)]


def driven(roads: Any, kind: str, parts: list[Piece]) -> Drive:
    """Positions at 1 Hz of a car that slows for bends and turns."""
    s, edge, limit, stop, aside = [], [], [], [], []
    for piece in parts:
        n = max(2, int((piece.end - piece.start) / STEP) + 1)
        s.append(np.linspace(piece.start, piece.end, n))
        edge.append(np.full(n, piece.edge))
        limit.append(np.full(n, 0.85 * float(roads.arrays.edges.speed[piece.edge])))
        stop.append(np.zeros(n))
        aside.append(np.zeros(n))
        stop[-1][-1], aside[-1][-1] = piece.stop, piece.aside
        if piece.stop > 0.0:
            limit[-1][-1] = MANOEUVRE
    of, at = np.concatenate(edge), np.concatenate(s)
    v, wait, side = np.concatenate(limit), np.concatenate(stop), np.concatenate(aside)
    pose = np.array([roads.at(int(e), float(a)) for e, a in zip(of, at, strict=True)])
    step = np.hypot(np.diff(pose[:, 0]), np.diff(pose[:, 1]))
    bend = np.abs((np.diff(pose[:, 2]) + np.pi) % (2.0 * np.pi) - np.pi)
    cap = np.where(
        bend > 1.5, MANOEUVRE, np.where(bend > 0.8, 4.5, np.where(bend > 0.3, 8.0, 99.0))
    )
    v[1:] = np.minimum(v[1:], cap)
    v[0] = 2.0
    for i in range(1, len(v)):
        v[i] = min(v[i], np.sqrt(v[i - 1] ** 2 + 2.0 * ACCELERATION * step[i - 1]))
    for i in range(len(v) - 2, -1, -1):
        v[i] = min(v[i], np.sqrt(v[i + 1] ** 2 + 2.0 * BRAKING * step[i]))
    gone = 2.0 * step / (v[1:] + v[:-1])
    clock = np.concatenate([[0.0], np.cumsum(gone + wait[:-1])])  # of leaving each place
    time = np.arange(0.0, clock[-1])
    k = np.searchsorted(clock, time, side="right") - 1
    return _at(kind, parts, pose, of, wait, side, clock, gone, time, k)


def _at(
    kind: str, parts: list[Piece], pose: np.ndarray, of: np.ndarray, wait: np.ndarray,
    side: np.ndarray, clock: np.ndarray, gone: np.ndarray, time: np.ndarray, k: np.ndarray,
) -> Drive:  # fmt: skip
    """Where the car is at each second: it stands at place k for `wait`, then drives on."""
    k = np.minimum(k, len(gone) - 1)
    since = time - clock[k]
    part = np.clip((since - wait[k]) / np.maximum(gone[k], 1e-6), 0.0, 1.0)
    stands = since < wait[k]
    x = pose[k, 0] + part * (pose[k + 1, 0] - pose[k, 0])
    y = pose[k, 1] + part * (pose[k + 1, 1] - pose[k, 1])
    off = np.where(stands, side[k], 0.0)
    x, y = x + off * np.sin(pose[k, 2]), y - off * np.cos(pose[k, 2])
    return Drive(kind, parts, time, x, y, of[k], off)


def noise(n: int, rng: Any) -> np.ndarray:
    """Slow noise of 45 s with a white part, 5 m in all, (n, 2)."""
    keep = np.exp(-1.0 / SLOW)
    slow = np.empty((n, 2))
    slow[0] = rng.normal(size=2)
    for i in range(1, n):
        slow[i] = keep * slow[i - 1] + np.sqrt(1.0 - keep**2) * rng.normal(size=2)
    return SIGMA * (0.9 * slow + np.sqrt(1.0 - 0.81) * rng.normal(size=(n, 2)))


def drives(options: Options, roads: Any) -> Iterator[tuple[Drive, np.ndarray]]:
    """Drives of all kinds with the noise of their fixes."""
    count = options.more.get("drives", matched.TRIPS)
    for seed in options.seeds or matched.SEEDS:
        rng = np.random.default_rng([21, seed])
        allowed, ends = drivable(roads.arrays, rng), dead_ends(roads.arrays)
        for number in range(count):
            kind = KINDS[number % len(KINDS)]
            found: list[Piece] = []
            while not found:
                found = pieces(roads.arrays, kind, allowed, ends, rng)
            drive = driven(roads, kind, found)
            yield drive, noise(len(drive.time), rng)


def lines(roads: Any, edges: Any, start: Any, end: Any) -> list[np.ndarray]:
    """Parts of edges as lines, plane m."""
    x, y, first = roads.edge_lines(np.asarray(edges), np.asarray(start), np.asarray(end))
    return np.split(np.column_stack([x, y]), first[1:-1])


def score(roads: Any, drive: Drive, error: np.ndarray, every: int) -> tuple[float, ...]:
    """Missed, extra and driven metres; sure epochs backwards on their edge, and sure epochs."""
    k = np.unique(np.append(np.arange(0, len(drive.time), every), len(drive.time) - 1))
    lat, lon = roads.plane.to_geodetic(drive.x[k] + error[k, 0], drive.y[k] + error[k, 1])
    fixes = {"time": drive.time[k], "lat": lat, "lon": lon, "sigma_m": np.full(len(k), SIGMA)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = whichroad.match(fixes, roads, lag="full")
    points, path = found.to_arrow(), found.path_arrow()
    edge = points["edge_id"].fill_null(-1).to_numpy(zero_copy_only=False)
    p = points["p_road"].to_numpy(zero_copy_only=False)
    true = lines(roads, *zip(*((q.edge, q.start, q.end) for q in drive.pieces), strict=True))
    answer = lines(roads, *(path[n].to_numpy() for n in ("edge_id", "enter_m", "exit_m")))
    missed, extra, length = route_mismatch(true, true, answer)
    sure = (p >= SURE) & (edge >= 0) & (drive.aside[k] == 0.0)
    back = sure & (roads.arrays.edges.opposite[drive.edge[k]] == edge)
    return missed, extra, length, float(back.sum()), float(sure.sum())


def measure(options: Options) -> list[Figure]:
    """Share of the way right and epochs backwards, of all kinds and of each."""
    pbf = options.need("maps", "heidelberg.osm.pbf")
    roads = harness.our_adapter(options, pbf).maps[0][2]
    made = list(drives(options, roads))
    figures = []
    for every in (r for r in RATES if r in matched.intervals(options)):
        rows = np.array([score(roads, drive, error, every) for drive, error in made])
        kinds = np.array([drive.kind for drive, _ in made])
        for kind in ("all", *KINDS):
            some = rows[(kinds == kind) | (kind == "all")]
            if not len(some):
                continue
            label = f"turn {kind}, {every} s"
            right = 100.0 - share(some[:, [0, 2]])
            ends = interval(lambda r: 100.0 - share(r[:, [0, 2]]), some)
            n = len(some)
            back = 10.0 * share(some[:, [3, 4]])
            figures += [
                Figure(f"{label}: way right", right, "", "%", n, ends),
                Figure(f"{label}: way extra", share(some[:, [1, 2]]), "", "%", n),
                Figure(f"{label}: backwards at P >= .99", back, "<= 1", "/1000", n),
            ]
    return figures
