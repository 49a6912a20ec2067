"""Two roads side by side with different numbers of lanes: does a lane count decide the road?

A common road splits in two, whose centre lines run parallel.  The vehicle keeps its lane, or
changes lanes at random.  Its path, its wheels and the receiver's errors are made here, with no
code of the simulator: a car wanders in its lane as on any road, and a change is an event.
"""

from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from whichroad.epochs import build_timeline
from whichroad.observations import Drive
from whichroad.recorded import localize_recorded
from whichroad.roadmap import RoadMap
from whichroad.settings import Settings
from whichroad.simulate import MapBuilder

from .. import Figure, Options
from .drives import Row, Table, each, named, world
from .plain import CAR, STEP, Array, along, markov, sense

SEEDS = range(10_000, 10_200)
GAPS = (8, 10, 14, 18, 25)  # m, between the centre lines
LANES = {  # name: tags, and lanes that there are, of the main road and the side road
    "3 and 1": ((3, 1), (3, 1)),
    "2 and 1": ((2, 1), (2, 1)),
    "1 and 1": ((1, 1), (1, 1)),
    "1 and 3": ((1, 3), (1, 3)),
    "3 and 1, no tags": (None, (3, 1)),
    "3 and 1, tagged 1 and 3": ((1, 3), (3, 1)),
}
RECEIVERS = ("wheels", "GNSS only")
SURE = 0.999
LANE = 3.3  # m
_APPROACH, _STRETCH = 500.0, 1500.0  # m, before the split and behind it
_SPEED = 20.0  # m/s


class Pair(NamedTuple):
    """A map of two parallel one-way roads, and the centre lines."""

    roads: RoadMap
    lines: dict[str, Array]  # name: (k, 2) vertices from the begin of the common road, m, plane
    lanes: dict[str, int]  # driven on


def draw(gap: float, tags: tuple[int, int] | None, lanes: tuple[int, int]) -> Pair:
    """The map; the side road lies right of the main one."""
    builder, reach = MapBuilder(), 5.0 * gap
    end = reach + _STRETCH
    places = {
        "begin": (-_APPROACH, 0.0), "node": (0.0, 0.0), "main end": (end, 0.0),
        "merge": (reach, -gap), "side end": (end, -gap),
    }  # fmt: skip
    for name, (x, y) in places.items():
        builder.node(name, x, y)
    tagged = None if tags is None else {"Common": max(tags), "Main": tags[0], "Side": tags[1]}
    for name, nodes in (
        ("Common", ("begin", "node")),
        ("Main", ("node", "main end")),
        ("Side", ("node", "merge", "side end")),
    ):
        count = {} if tagged is None else {"lanes": str(tagged[name])}
        builder.way(nodes, "primary", name=name, oneway="yes", maxspeed="80", **count)
    lines = {
        "Main": [places["begin"], places["main end"]],
        "Side": [places[n] for n in ("begin", "node", "merge", "side end")],
    }
    return Pair(
        builder.compiled(),
        {k: np.array(v) for k, v in lines.items()},
        dict(zip(("Main", "Side"), lanes, strict=True)),
    )


def prepare() -> None:
    """The maps of this process."""
    world["lanes"] = {(g, n): draw(g, *LANES[n]) for g, n in product(GAPS, LANES)}


def _right_of_line(s: Array, lanes: int, common: int, rng: np.random.Generator) -> Array:
    """Offset right of the centre line at distances s: lanes kept or changed, and wandering."""
    changes = bool(rng.random() < 0.5)
    lane = int(rng.integers(common))
    middle = np.empty(len(s))
    until = 0.0
    for k, at in enumerate(s):
        count = common if at < _APPROACH else lanes
        if lane >= count:  # the road has fewer
            lane = count - 1
        if changes and at > until:
            if until > 0.0 and count > 1:
                lane = int(np.clip(lane + rng.choice([-1, 1]), 0, count - 1))
            until = at + rng.exponential(400.0)
        middle[k] = (lane - 0.5 * (count - 1)) * LANE
    reach = max(int(80.0 / (s[1] - s[0])), 1)  # m that a change of lane takes
    padded = np.pad(middle, (reach, reach), mode="edge")
    smooth = np.convolve(padded, np.full(reach, 1.0 / reach), mode="same")[reach:-reach]
    return smooth + markov(len(s), 0.25, np.exp(-(s[1] - s[0]) / 60.0), rng)


def _drive(pair: Pair, road: str, rng: np.random.Generator) -> tuple[Drive, Array]:
    """A drive along a road, and the distance that it has gone every 0.1 s."""
    s, x, y, heading = along(pair.lines[road], _SPEED)
    right = _right_of_line(s, pair.lanes[road], max(pair.lanes.values()), rng)
    return sense(x + np.sin(heading) * right, y - np.cos(heading) * right, rng), s


def one(seed: int, *, settings: Settings) -> Row:
    """All gaps and lane counts, on either road, with wheels and without."""
    row: Row = {}
    for gap, lanes in product(GAPS, LANES):
        pair: Pair = world["lanes"][gap, lanes]
        rng = np.random.default_rng([seed, gap, list(LANES).index(lanes)])
        road, other = rng.permutation(["Main", "Side"]).tolist()
        drive, s = _drive(pair, road, rng)
        for receiver in RECEIVERS:
            seen = drive if receiver == "wheels" else Drive(drive.drive_id, drive.fixes)
            for key, value in _score(pair, seen, s, (road, other), settings):
                row[f"{gap} {lanes} {receiver} {key}"] = value
    return row


def _score(
    pair: Pair, drive: Drive, s: Array, names: tuple[str, str], settings: Settings
) -> Iterator[tuple[str, float]]:
    """Whether the wrong road was ever sure, and the right one the most probable at the end."""
    timeline = build_timeline(drive, pair.roads.plane, CAR)
    rows = localize_recorded(
        pair.roads, timeline, vehicle=CAR, settings=settings, start=None
    ).output.rows
    gone = np.interp(timeline.epochs.time, 1.6e9 + STEP * np.arange(len(s)), s) - _APPROACH
    behind = (gone > 10.0) & (rows.live > 0)
    p = []
    for name in names:
        on = (rows.alt_edge >= 0) & named(pair.roads, name)[np.maximum(rows.alt_edge, 0)]
        p.append(np.where(on, rows.alt_p, 0.0).sum(axis=1, dtype=float))
    yield "wrong", float((p[1][behind] >= SURE).any())
    yield "end", float(p[0][-1] > max(p[1][-1], rows.p_off_road[-1]))
    yield "sure", float(p[0][-1] >= SURE)
    yield "right", float((p[0] > p[1])[behind].mean())


def run(options: Options) -> list[Figure]:
    """All seeds; wrong certainty by drives, and the right road at the end."""
    seeds = options.seeds or SEEDS
    table = Table(each(partial(one, settings=options.settings()), seeds, options, prepare), seeds)
    figures = []
    for receiver, gap, lanes in product(RECEIVERS, GAPS, LANES):
        key = f"{gap} {lanes} {receiver} "
        name = f"{receiver}, {gap} m, lanes {lanes}: "
        goal = ">= 99" if gap >= 14 and receiver == "wheels" else ""
        figures += [
            table.share(name + "wrong at P >= 0.999", key + "wrong", None, "<= 0.2"),
            table.share(name + "right at the end", key + "end", None, goal),
            table.share(name + "right epochs", key + "right"),
            table.share(name + "sure at the end", key + "sure"),
        ]
    return figures
