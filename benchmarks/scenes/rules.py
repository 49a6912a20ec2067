"""Drivers who break a rule: against a one-way, through a banned turn, into a closed street.

Each case is driven on a map with the rule, so that what the map forbids is what happens.  Other
drivers keep the rules on the same maps.
"""

from collections.abc import Iterator
from functools import partial
from itertools import product

import numpy as np

from whichroad import match
from whichroad.observations import Drive
from whichroad.roadmap import RoadMap
from whichroad.settings import Settings
from whichroad.simulate import MapBuilder

from .. import Figure, Options
from .drives import Row, Table, each, named, world
from .plain import CAR, along, sense

SEEDS = range(10_000, 10_200)
RULES = {  # name in the path table
    "one-way": "against_one_way",
    "turn": "turn_banned",
    "access": "no_access",
}
RECEIVERS = ("wheels", "GNSS only")
_BLOCK = 180.0  # m
_PLACES = {
    f"{a}{b}": (_BLOCK * a, _BLOCK * b) for a, b in product(range(-2, 3), range(-2, 3))
} | {"west": (-720.0, 0.0)}  # fmt: skip
_BROKEN = ("west", "00", "02"), "Broken"  # left at the middle
_KEPT = (
    (("west", "20"), "Row 0"), (("west", "00", "0-2"), "Column 0"),
    (("west", "-10", "-12"), "Column -1"), (("west", "10", "12"), "Column 1"),
)  # fmt: skip
_LAST = 300.0  # m of the last leg that are scored
_SPEED = 10.0  # m/s


def draw(rule: str) -> RoadMap:
    """A grid of streets; going left at its middle breaks the rule."""
    builder = MapBuilder()
    for name, (x, y) in _PLACES.items():
        builder.node(name, x, y)
    for k in range(-2, 3):
        row = [f"{a}{k}" for a in range(-2, 3)]
        if k != 0:
            builder.way(row, "residential", name=f"Row {k}")
            builder.way([f"{k}{b}" for b in range(-2, 3)], "residential", name=f"Column {k}")
    begin = builder.way(["west", "-20", "-10", "00"], "residential", name="Row 0")
    builder.way(["00", "10", "20"], "residential", name="Row 0")
    builder.way(["0-2", "0-1", "00"], "residential", name="Column 0")
    tags = {"one-way": {"oneway": "yes"}, "access": {"access": "no"}}.get(rule, {})
    north = builder.way(["02", "01", "00"], "residential", name="Broken", **tags)
    if rule == "turn":
        builder.restrict("no_left_turn", begin, "00", north)
    return builder.compiled()


def prepare() -> None:
    """The maps of this process."""
    world["rules"] = {rule: draw(rule) for rule in RULES}


def one(seed: int, *, settings: Settings) -> Row:
    """Each rule broken, and kept, with wheels and without."""
    row: Row = {}
    for rule in RULES:
        roads = world["rules"][rule]
        rng = np.random.default_rng([seed, list(RULES).index(rule)])
        for name, (way, street) in (("broken", _BROKEN), ("kept", _KEPT[rng.integers(4)])):
            _, x, y, heading = along(np.array([_PLACES[p] for p in way]), _SPEED)
            drive = sense(x + 1.75 * np.sin(heading), y - 1.75 * np.cos(heading), rng)
            for receiver in RECEIVERS:
                seen = drive if receiver == "wheels" else Drive(drive.drive_id, drive.fixes)
                for key, value in _score(roads, seen, street, float(heading[-1]), rule, settings):
                    row[f"{rule} {name} {receiver} {key}"] = value
    return row


def _score(
    roads: RoadMap, drive: Drive, street: str, heading: float, rule: str, settings: Settings
) -> Iterator[tuple[str, float]]:
    """Epochs of the last leg on the right directed edge, and the rules told."""
    result = match(drive, roads, vehicle=CAR, settings=settings)
    points = result.to_arrow()
    edge = np.array([-1 if e is None else e for e in points["edge_id"].to_pylist()])
    last = np.arange(len(edge)) >= len(edge) - _LAST / _SPEED * len(edge) / _duration(drive)
    along = np.array([roads.at(e, 0.0)[2] for e in range(len(roads))])
    right = (edge >= 0) & (named(roads, street) & (np.cos(along - heading) > 0.7))[edge]
    told = [text for text in result.path["broken_rule"] if isinstance(text, str) and text]
    yield "epochs", float(last.sum())
    yield "right", float((right & last).sum())
    yield "told", float(any(RULES[rule] in text for text in told))
    yield "any", float(bool(told))


def _duration(drive: Drive) -> float:
    """S from the first fix to the last."""
    assert drive.fixes is not None
    return float(drive.fixes.time[-1] - drive.fixes.time[0])


def run(options: Options) -> list[Figure]:
    """All seeds: right edges, rules told and rules told without cause."""
    seeds = options.seeds or SEEDS
    table = Table(each(partial(one, settings=options.settings()), seeds, options, prepare), seeds)
    figures = []
    for receiver, rule in product(RECEIVERS, RULES):
        name, broken, kept = f"{receiver}, {rule}", f"{rule} broken ", f"{rule} kept "
        broken, kept = broken + receiver + " ", kept + receiver + " "
        figures += [
            table.share(
                f"{name} broken: right epochs", broken + "right", broken + "epochs", ">= 95"
            ),
            table.share(f"{name} broken: told", broken + "told", None, ">= 95"),
            table.share(f"{name} kept: right epochs", kept + "right", kept + "epochs"),
            table.share(f"{name} kept: told without cause", kept + "any"),
        ]
    return figures
