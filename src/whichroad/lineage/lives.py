"""Lives of hypotheses: when each was born, from which one, its weight, its end and the reason.

A hypothesis is an entry of the path tree: the vehicle entered this edge at this time, from
that edge.  It may consist of several Gaussians.  A hypothesis of the paper's method is a
candidate while it remains one.

Nothing here is guessed from positions.  The parent is that of the path tree.  What merged
into what is read from the shares of weight that the filter's kernels keep.
"""

from array import array
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..epochs import Timeline
from ..filter.state import CLOCK, OFF_ROAD
from ..observations import Array, StartPose
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle
from .epoch_by_epoch import Gaussians, run_again

OFF = "off the roads"

COUNTS = 0.01
"""Probability from which on a hypothesis counts."""

START, NODE, ON, LEFT, BACK, TURN, REVERSE, RESTART, CANDIDATE = (
    "start",
    "branch at a node",
    "the road runs on",
    "off the roads",
    "back to a road",
    "U-turn",
    "in reverse over a node",
    "restart",
    "candidate",
)

_OVER_NODES = (NODE, ON, REVERSE)

WHY = {
    "alive": "alive at the drive's end",
    "merged": "merged into another one on the same edge",
    "outweighed": "had counted, and fell below the pruning limit",
    "pruned": "fell below the pruning limit without ever having counted",
    "left behind": "handed on to what follows: the vehicle had passed its end",
    "restarted": "given up at a new start from a fix",
    "out of reach": "no longer within 30 m of the most probable estimate",
}


@dataclass(slots=True)
class Hypothesis:
    """The life of a hypothesis."""

    number: int
    edge: int  # negative: off the roads
    street: str  # its name, the source's id where it has none
    source: str | None
    parent: int  # number, -1: none
    birth: str  # START ... CANDIDATE
    created: int  # epoch
    last: int = -1  # epoch in which it was seen last
    why: str = "alive"
    into: int = -1  # the number it was merged into, or that goes on for it
    p: "array[float]" = field(default_factory=lambda: array("d"))  # from `created` to `last`
    components: "array[int]" = field(default_factory=lambda: array("i"))  # its Gaussians, likewise
    past_end: bool = False  # of its edge, when seen last


class Lives(NamedTuple):
    """All hypotheses of one drive of n epochs."""

    hypotheses: list[Hypothesis]
    time: Array  # (n,) s
    driven: Array  # (n,) m, by the estimated speed


class _Seen(NamedTuple):
    """One hypothesis in one epoch."""

    edge: int
    p: float
    components: int
    past_end: float  # the part of p beyond its edge's end
    along: float  # m


def lives_of(
    roads: RoadMap, timeline: Timeline, *, vehicle: Vehicle, settings: Settings,
    start: StartPose | str | None = None, model: str = "default",
) -> Lives:  # fmt: skip
    """Run a drive through the filter again and log every hypothesis.

    Args:
        roads: The map.
        timeline: The drive in epochs.
        vehicle: The car.
        settings: The model's numbers.
        start: As `matching.match` takes it.
        model: "default" or "paper".

    Returns:
        The hypotheses in the order of their births, and the epochs.

    Raises:
        DriveError: Nothing can start the filter.
    """
    rerun = run_again(
        roads, timeline, vehicle=vehicle, settings=settings, start=start, model=model
    )  # fmt: skip
    log = (_PaperLog if model == "paper" else _Log)(roads)
    for now in rerun.epochs:
        log.take(now)
    time = np.array(timeline.epochs.time)
    speed, dt = np.abs(rerun.estimates.speed), np.diff(time)
    if timeline.mode == CLOCK:  # the speed is a state; else that of the way since the epoch before
        speed[1:] = 0.5 * (speed[1:] + speed[:-1])
    return Lives(log.all, time, np.concatenate([[0.0], np.cumsum(speed[1:] * dt)]))


class _Log:
    """Births and deaths of the default model."""

    def __init__(self, roads: RoadMap) -> None:
        self.roads = roads
        self.all: list[Hypothesis] = []
        self.alive: dict[int, Hypothesis] = {}  # by the entry of the path tree

    def take(self, now: Gaussians) -> None:
        """Add an epoch."""
        seen = self.seen(now)
        born = seen.keys() - self.alive.keys()
        dead = self.alive.keys() - seen.keys()
        before, first = self.alive, not self.all
        self.alive = {key: before[key] for key in seen if key in before}
        for key in sorted(born):
            origin = (-1, START) if first else self.origin(key, seen[key].edge, now, before)
            self.alive[key] = self.new(seen[key], *origin, now.epoch)
        for key, s in seen.items():
            h = self.alive[key]
            h.p.append(s.p)
            h.components.append(s.components)
            h.last, h.past_end = now.epoch, s.past_end > 0.5 * s.p
        for key in sorted(dead):
            self.end(key, before[key], now)

    def seen(self, now: Gaussians) -> dict[int, _Seen]:
        """The hypotheses of an epoch: several Gaussians of one entry are one."""
        found: dict[int, _Seen] = {}
        length = self.roads.arrays.edges.length
        for entry, edge, p, along in zip(now.entry, now.edge, now.p.tolist(), now.along,
                                         strict=True):  # fmt: skip
            past = p if edge >= 0 and along > length[edge] else 0.0
            old = found.get(entry)
            if old is None:
                found[entry] = _Seen(edge, p, 1, past, along)
            else:
                found[entry] = _Seen(
                    edge, old.p + p, old.components + 1, old.past_end + past, old.along
                )
        return found

    def new(self, s: _Seen, parent: int, birth: str, epoch: int) -> Hypothesis:
        """Add a hypothesis."""
        street, source = OFF, None
        if s.edge >= 0:
            source = str(self.roads.source(s.edge, max(s.along, 0.0))[0])
            street = self.roads.name(s.edge) or source
        h = Hypothesis(len(self.all), s.edge, street, source, parent, birth, epoch)
        self.all.append(h)
        return h

    def origin(
        self, key: int, edge: int, now: Gaussians, before: dict[int, Hypothesis]
    ) -> tuple[int, str]:
        """The parent's number, and how a hypothesis was born."""
        rows = [i for i, entry in enumerate(now.entry) if entry == key]
        if now.started or now.flow[rows].sum() < 0.5 * now.p[rows].sum():
            return -1, RESTART
        tree = now.path.entry
        up = nearest = int(tree.parent[key])
        while up >= 0 and up not in before:  # edges that it crossed within the epoch
            up = int(tree.parent[up])
        if up < 0:
            return -1, RESTART
        return before[up].number, self.kind(int(tree.edge[nearest]), edge)

    def kind(self, origin: int, edge: int) -> str:
        """How a vehicle comes from one edge to another."""
        if edge == OFF_ROAD:
            return LEFT
        if origin < 0:
            return BACK
        edges, turns = self.roads.arrays.edges, self.roads.arrays.turns
        opposite = edges.opposite[origin]
        if opposite == edge:
            return TURN
        ahead = edges.to_node[origin] == edges.from_node[edge]
        if not ahead and edges.to_node[edge] == edges.from_node[origin]:
            return REVERSE
        follow = turns.edge[edges.first_turn[origin] : edges.end_turn[origin]]
        return ON if follow[follow != opposite].tolist() == [edge] else NODE

    def end(self, key: int, dead: Hypothesis, now: Gaussians) -> None:
        """Set why a hypothesis has ended."""
        columns = [a for a, entry in enumerate(now.before) if entry == key]
        flow = now.flow[:, columns].sum(axis=1)
        same = [
            (float(flow[i]), self.alive[entry])
            for i, entry in enumerate(now.entry)
            if now.edge[i] == dead.edge and self.alive[entry].parent != dead.number
        ]
        taken, by = max(same, key=lambda pair: pair[0], default=(0.0, None))
        heir = self.heir(dead)
        if now.started:
            dead.why = "restarted"
        elif by is not None and taken > 0.0:
            dead.why, dead.into = "merged", by.number
        elif dead.edge >= 0 and (dead.past_end or heir >= 0):
            dead.why, dead.into = "left behind", heir
        else:
            dead.why = _fallen(dead)

    def heir(self, dead: Hypothesis) -> int:
        """The child over a node from which the most probable living descendant comes; -1: none."""
        for h in sorted(self.alive.values(), key=lambda h: -h.p[-1]):
            while h.birth in _OVER_NODES and h.parent > dead.number:
                h = self.all[h.parent]
            if h.birth in _OVER_NODES and h.parent == dead.number:
                return h.number
        return -1


class _PaperLog(_Log):
    """The paper's candidates: an edge is a hypothesis for as long as it is near enough."""

    top = -1  # the most probable one, about which candidates are drawn

    def take(self, now: Gaussians) -> None:
        """Add an epoch."""
        super().take(now)
        self.top = max(self.alive.values(), key=lambda h: h.p[-1]).number

    def seen(self, now: Gaussians) -> dict[int, _Seen]:
        """One hypothesis an edge."""
        found: dict[int, _Seen] = {}
        for edge, p, along in zip(now.edge, now.p.tolist(), now.along, strict=True):
            old = found.get(edge, _Seen(edge, 0.0, 0, 0.0, along))
            found[edge] = old._replace(p=old.p + p, components=old.components + 1)
        return found

    def origin(
        self, key: int, edge: int, now: Gaussians, before: dict[int, Hypothesis]
    ) -> tuple[int, str]:
        """What is drawn comes from the most probable one of the epoch before."""
        return self.top, CANDIDATE

    def end(self, key: int, dead: Hypothesis, now: Gaussians) -> None:
        """Nothing else ends a candidate."""
        dead.why = "out of reach"


def _fallen(dead: Hypothesis) -> str:
    return "outweighed" if max(dead.p) >= COUNTS else "pruned"
