"""A road that the map lacks, beside one that it has: is the vehicle said to be off the roads?

A common road splits in two, whose centre lines run parallel, and the map holds one of them.  Path,
wheels and the receiver's errors are made here, with no code of the simulator.  Beside the filter
stands the exact test, which knows where the roads may part and all variances.
"""

from collections.abc import Iterator
from functools import partial
from itertools import product

import numpy as np

from whichroad.epochs import build_timeline
from whichroad.observations import Drive
from whichroad.recorded import localize_recorded
from whichroad.roadmap import RoadMap
from whichroad.settings import Settings
from whichroad.simulate import MapBuilder

from .. import Figure, Options
from .beside_exact import p_unmapped
from .drives import Row, Table, each, world
from .plain import CAR, STEP, Array, along, markov, sense

SEEDS = range(10_000, 10_200)
GAPS = (8, 10, 15, 20)  # m, between the centre lines
RECEIVERS = ("wheels", "GNSS only")
_APPROACH, _STRETCH = 500.0, 1500.0  # m, before the split and behind it
_WITHIN = 300.0  # m behind the place where the roads are parallel
_SPEED = 15.0  # m/s


def draw(gap: float) -> tuple[RoadMap, dict[str, Array]]:
    """The map, and the lines that are driven: (k, 2) m, plane."""
    builder, reach = MapBuilder(), 5.0 * gap
    end = reach + _STRETCH
    for name, x in (("begin", -_APPROACH), ("node", 0.0), ("end", end)):
        builder.node(name, x, 0.0)
    builder.way(("begin", "node"), "primary", name="Common", oneway="yes", lanes="1")
    builder.way(("node", "end"), "primary", name="Main", oneway="yes", lanes="1")
    return builder.compiled(), {
        "mapped": np.array([(-_APPROACH, 0.0), (end, 0.0)]),
        "unmapped": np.array([(-_APPROACH, 0.0), (0.0, 0.0), (reach, -gap), (end, -gap)]),
    }


def prepare() -> None:
    """The maps of this process."""
    world["unmapped"] = {gap: draw(gap) for gap in GAPS}


def one(seed: int, *, settings: Settings) -> Row:
    """All gaps, on either road, with wheels and without."""
    row: Row = {}
    for gap in GAPS:
        roads, lines = world["unmapped"][gap]
        for road, line in lines.items():
            rng = np.random.default_rng([seed, gap, len(road)])
            s, x, y, heading = along(line, _SPEED)
            right = markov(len(s), 0.3, np.exp(-(s[1] - s[0]) / 60.0), rng)
            drive = sense(x + np.sin(heading) * right, y - np.cos(heading) * right, rng)
            for receiver in RECEIVERS:
                seen = drive if receiver == "wheels" else Drive(drive.drive_id, drive.fixes)
                for key, value in _score(roads, seen, s, gap, settings):
                    row[f"{gap} {road} {receiver} {key}"] = value
            exact, gone = p_unmapped(drive, _APPROACH, _SPEED), s - _APPROACH - 5.0 * gap
            soon = (gone > 0.0) & (gone < _WITHIN)
            row[f"{gap} {road} exact found"] = float((exact[soon] >= 0.5).any())
            row[f"{gap} {road} exact off"] = float(exact[gone > 0.0].mean())
    return row


def _score(
    roads: RoadMap, drive: Drive, s: Array, gap: float, settings: Settings
) -> Iterator[tuple[str, float]]:
    """P(off the roads) from where the roads are parallel, and whether it is found soon."""
    timeline = build_timeline(drive, roads.plane, CAR)
    rows = localize_recorded(
        roads, timeline, vehicle=CAR, settings=settings, start=None
    ).output.rows
    gone = np.interp(timeline.epochs.time, 1.6e9 + STEP * np.arange(len(s)), s)
    gone -= _APPROACH + 5.0 * gap
    beside = gone > 0.0
    off = rows.p_off_road
    yield "off", float(off[beside].mean())
    yield "found", float((off[beside & (gone < _WITHIN)] >= 0.5).any())
    yield "sure", float((rows.p_edge[beside] >= 0.999).mean())
    yield "end", float(off[-1])


def run(options: Options) -> list[Figure]:
    """All seeds."""
    seeds = options.seeds or SEEDS
    table = Table(each(partial(one, settings=options.settings()), seeds, options, prepare), seeds)
    figures = []
    for receiver, gap in product(RECEIVERS, GAPS):
        name, there = f"{receiver}, {gap} m: ", f"{gap} unmapped {receiver} "
        found = ">= 90" if gap == 15 and receiver == "wheels" else ""
        figures += [
            table.share(name + "P(off) >= 0.5 within 300 m", there + "found", None, found),
            table.share(name + "P(off) on the unmapped road", there + "off", None, "", "", 1.0),
            table.share(name + "epochs with P(road) >= 0.999 there", there + "sure"),
            table.share(
                name + "P(off) on the mapped road", f"{gap} mapped {receiver} off", None,
                "<= 0.005", "", 1.0,
            ),
        ]  # fmt: skip
    for gap in GAPS:
        figures += [
            table.share(
                f"exact test, {gap} m: P(off) >= 0.5 within 300 m", f"{gap} unmapped exact found"
            ),
            table.share(
                f"exact test, {gap} m: P(off) there", f"{gap} unmapped exact off", None, "", "", 1.0
            ),
        ]
    return figures
