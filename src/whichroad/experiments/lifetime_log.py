"""Lifetime log: every hypothesis of one drive, when it was created, its weight, its end.

The filter runs epoch by epoch and its hypotheses are read.  A hypothesis of whichroad is
an entry of the path tree: the vehicle entered this edge at this time, from that edge.  A
hypothesis of the paper's method is a candidate while it remains one.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from .._compile import Records
from ..epochs import Timeline, build_timeline
from ..filter.estimate import new_output
from ..filter.history import new_history
from ..filter.state import OFF_ROAD, Belief, Context, Path, new_belief, new_path, new_work
from ..filter.step import run
from ..observations import Array
from ..settings import Settings, parameters
from ..simulate import SimulatedDrive
from .runs import ALIVE
from .scene_maps import street_of
from .scenes import Scene

OFF = "off the roads"

WHY = {
    "alive": "alive at the drive's end",
    "merged": "merged into another one on the same edge",
    "outweighed": "had counted, and fell below the floor",
    "pruned": "fell below the floor without ever having counted",
    "left behind": "handed on to what follows: the vehicle had passed its end",
    "out of reach": "no longer within 30 m of the most probable estimate",
}


class Sighting(NamedTuple):
    """One hypothesis in one epoch."""

    key: int  # the same for the same hypothesis
    edge: int
    p: float
    parent: int  # key, -1: none
    past_end: bool  # of its edge


@dataclass(slots=True)
class Hypothesis:
    """The lifetime of a hypothesis."""

    number: int
    edge: int
    street: str
    parent: int  # number, -1: none
    created: int  # epoch
    last: int = -1  # epoch in which it was seen last
    why: str = "alive"
    into: int = -1  # the number it was merged into
    p: list[float] = field(default_factory=list)  # from `created` to `last`
    past_end: bool = False


@dataclass(frozen=True, slots=True)
class LifetimeLog:
    """All hypotheses of one drive under one model; time and distance of its n epochs."""

    since: np.ndarray
    past: np.ndarray  # m past the scene's decision
    hypotheses: list[Hypothesis]


def _beliefs(
    scene: Scene, drive: SimulatedDrive, timeline: Timeline, paper: bool
) -> Iterator[tuple[Belief, Path]]:
    """The belief and the path tree after each epoch."""
    par = parameters(Settings(), drive.vehicle, timeline.mode, paper=paper)
    ctx = Context(par, scene.roads.arrays, new_work(paper=paper))
    belief, path, history = new_belief(), new_path(0 if paper else 1 << 15), new_history(0)
    n = len(timeline.epochs)
    output = new_output(n, False)
    for k in range(n):
        run(belief, path, history, timeline.epochs, output, ctx, k, k + 1)
        yield belief, path


def _epochs_of_ours(
    scene: Scene, drive: SimulatedDrive, timeline: Timeline
) -> Iterator[list[Sighting]]:
    edges = scene.roads.arrays.edges
    for belief, path in _beliefs(scene, drive, timeline, False):
        yield _seen_of_ours(_living(belief), path, edges.length)


def _living(belief: Belief) -> Records:
    """The hypotheses, (n,)."""
    return belief.hyp[: belief.state[0].count]


def _seen_of_ours(living: Records, path: Path, length: Array) -> list[Sighting]:
    """Several Gaussians of one path entry are one hypothesis."""
    found: dict[int, Sighting] = {}
    for hyp in living:
        entry, edge = int(hyp.path_entry), int(hyp.edge)
        past = edge != OFF_ROAD and bool(hyp.along > length[edge])
        before = found.get(entry)
        p = float(hyp.weight) + (before.p if before else 0.0)
        found[entry] = Sighting(entry, edge, p, int(path.entry.parent[entry]), past)
    return list(found.values())


def _epochs_of_paper(
    scene: Scene, drive: SimulatedDrive, timeline: Timeline
) -> Iterator[list[Sighting]]:
    keys: dict[int, int] = {}
    top, count = -1, 0
    for belief, _ in _beliefs(scene, drive, timeline, True):
        living = _living(belief)
        edges, weights = living.edge.tolist(), living.weight.tolist()
        for edge in edges:
            if edge not in keys:
                keys[edge], count = count, count + 1
        keys = {edge: key for edge, key in keys.items() if edge in edges}
        yield [Sighting(keys[e], e, p, top, False) for e, p in zip(edges, weights, strict=True)]
        if edges:
            top = keys[edges[int(np.argmax(weights))]]


def log_hypotheses(scene: Scene, drive: SimulatedDrive, model: str) -> LifetimeLog:
    """Run a model over a drive and log every hypothesis."""
    timeline = build_timeline(drive.drive, scene.roads.plane, drive.vehicle)
    epochs_of = _epochs_of_paper if model == "paper" else _epochs_of_ours
    known: dict[int, Hypothesis] = {}
    alive: dict[int, Hypothesis] = {}
    for k, seen in enumerate(epochs_of(scene, drive, timeline)):
        now = {s.key: s for s in seen}
        for key, s in now.items():
            if key not in known:
                parent = known[s.parent].number if s.parent in known else -1
                street = OFF if s.edge < 0 else street_of(scene.roads, s.edge)
                known[key] = Hypothesis(len(known), s.edge, street, parent, k)
        for key in alive.keys() - now.keys():
            _close(alive[key], [known[other] for other in now], known, model)
        alive = {key: known[key] for key in now}
        for key, h in alive.items():
            h.p.append(now[key].p)
            h.last, h.past_end = k, now[key].past_end
    since = timeline.epochs.time - timeline.epochs.time[0]
    truth = drive.truth
    past = np.interp(since, truth.time - truth.time[0], truth.travelled) - scene.decision_m
    return LifetimeLog(since, past, list(known.values()))


def _ancestors(living: list[Hypothesis], known: dict[int, Hypothesis]) -> set[int]:
    """Numbers of the ancestors of the current hypotheses on roads."""
    everyone = {h.number: h for h in known.values()}
    found: set[int] = set()
    for h in living:
        up = h.parent if h.edge >= 0 else -1
        while up >= 0 and up not in found:
            found.add(up)
            up = everyone[up].parent
    return found


def _close(
    dead: Hypothesis, others: list[Hypothesis], known: dict[int, Hypothesis], model: str
) -> None:
    """Set why a hypothesis has ended."""
    same = [h for h in others if h.edge == dead.edge]
    if model == "paper":
        dead.why = "out of reach"
    elif same:
        dead.why, dead.into = "merged", same[0].number
    elif dead.past_end or dead.number in _ancestors(others, known):
        dead.why = "left behind"
    else:
        dead.why = "outweighed" if max(dead.p) >= ALIVE else "pruned"
