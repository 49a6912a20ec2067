"""A small town of our own as OpenStreetMap XML, with the situations of the paper.

    old town ── roundabout ── boulevard (two carriageways, a side lane) ── fork of 10°
                    └─ a long road with bends and junctions, back to the boulevard

It is drawn in metres about one point near Compiègne; any resemblance to streets that
exist there is accidental.
"""

import math

import numpy as np

from ..geodesy.angles import radians
from .map_builder import MapBuilder, Point

_GRID = 5  # streets in each direction of the old town
_CARRIAGEWAY = 6.75  # m, from the boulevard's axis to either carriageway
_SIDE_LANE = 13.0  # m, from the eastern carriageway to the side lane
_RING = 16.0  # m, radius of the roundabout

# Places that roads pass, in m; those of the old town and the boulevard are computed.
_PLACES: dict[str, Point] = {
    # Route de Soissons, the long road: from the roundabout south, then east
    "soissons 1": (772.0, 110.0),
    "soissons 2": (838.0, -40.0),
    "vineyard": (900.0, -180.0),
    "soissons 3": (955.0, -335.0),
    "soissons 4": (1075.0, -432.0),
    "crossroads": (1200.0, -470.0),
    "soissons 5": (1360.0, -505.0),
    "soissons 6": (1620.0, -460.0),
    "soissons 7": (1830.0, -300.0),
    # Avenue du Nord, from the crossroads to the boulevard
    "avenue 1": (1214.0, -340.0),
    "avenue 2": (1262.0, -205.0),
    "avenue 3": (1335.0, -85.0),
    "quarry": (1382.0, 20.0),
    "avenue 4": (1424.0, 130.0),
    "quarry end": (1250.0, 62.0),
    # Route du Sud, from the crossroads back to the old town
    "south 1": (1190.0, -620.0),
    "south 2": (1000.0, -730.0),
    "south 3": (640.0, -600.0),
    "south 4": (330.0, -260.0),
    # behind the boulevard: one road splits into two at 10 degrees
    "lead-in": (2700.0, 236.0),
    "fork": (2900.0, 236.0),
    "left 1": (3048.5, 249.0),
    "left 2": (3200.0, 262.3),
    "left 3": (3420.0, 300.0),
    "left 4": (3640.0, 390.0),
    "right 1": (3048.5, 223.0),
    "right 2": (3200.0, 209.7),
    "right 3": (3430.0, 170.0),
    "right 4": (3660.0, 80.0),
    "end": (3830.0, 240.0),
    # Route du Nord, back
    "north 1": (3650.0, 640.0),
    "north 2": (2900.0, 790.0),
    "north 3": (1900.0, 700.0),
    "north 4": (1150.0, 620.0),
    "north 5": (800.0, 430.0),
}


def draw_town(seed: int = 1) -> str:
    """Draw the town: OSM XML text with about 2 km by 4 km of roads.

    Args:
        seed: Moves the crossings of the old town about; the rest is the same for each.

    Returns:
        The contents of an .osm file.
    """
    return _draw(seed).xml()


def places(seed: int = 1) -> dict[str, int]:
    """OSM node ids of the town's named places."""
    return _draw(seed).names


def _draw(seed: int) -> MapBuilder:
    builder = MapBuilder()
    _old_town(builder, np.random.default_rng(seed))
    for name, (x, y) in _PLACES.items():
        builder.node(name, x, y)
    _roundabout(builder, (760.0, 230.0))
    _boulevard(builder)
    _long_roads(builder)
    _fork(builder)
    return builder


def _old_town(builder: MapBuilder, random: np.random.Generator) -> None:
    """An irregular grid of narrow streets; `old c r` is column c, row r."""
    for c in range(_GRID):
        for r in range(_GRID):
            x, y = random.uniform(-12.0, 12.0, 2)
            builder.node(f"old {c} {r}", 120.0 * c + float(x), 110.0 * r + float(y))
    slow = {"maxspeed": "30"}
    rows = ("Rue Basse", "Rue du Pont", "Grande Rue", "Rue des Lices", "Rue Haute")
    columns = ("Rue du Moulin", "Rue Saint-Jean", "Rue du Change", "Rue Neuve", "Rue de l'Est")
    for r, name in enumerate(rows):
        kind = "secondary" if r == 2 else "residential"
        extra = {"maxspeed": "50"} if r == 2 else slow | ({"oneway": "yes"} if r == 3 else {})
        builder.way([f"old {c} {r}" for c in range(_GRID)], kind, name=name, **extra)
    for c, name in enumerate(columns):
        last = 3 if c == 3 else _GRID  # Rue Neuve ends early: the grid is not regular
        extra = slow | ({"oneway": "-1"} if c == 1 else {})
        builder.way([f"old {c} {r}" for r in range(last)], "residential", name=name, **extra)
    x, y = builder.places[builder.names["old 2 2"] - 1]
    builder.node("car park 1", x + 55.0, y + 30.0)
    builder.node("car park 2", x + 58.0, y + 82.0)
    builder.node("car park 3", x + 20.0, y + 84.0)
    middle = builder.bend([builder.names["old 2 2"], builder.names["car park 1"]])[1]
    builder.names["car park gate"] = middle
    builder.way(
        ["old 2 2", "car park gate", "car park 1", "car park 2"], "service", service="parking_aisle"
    )
    builder.way(
        ["car park 2", "car park 3", "car park gate"],
        "service",
        service="parking_aisle",
        oneway="yes",
    )


def _roundabout(builder: MapBuilder, centre: Point) -> None:
    """Eight points, driven counter-clockwise, with arms in the four directions."""
    names = [
        "ring east",
        "ring 1",
        "ring north",
        "ring 3",
        "ring west",
        "ring 5",
        "ring south",
        "ring 7",
    ]
    for k, name in enumerate(names):
        angle = radians(45.0 * k)
        builder.node(name, centre[0] + _RING * math.cos(angle), centre[1] + _RING * math.sin(angle))
    builder.way([*names, names[0]], "secondary", junction="roundabout", maxspeed="30", lanes="1")
    builder.way(["old 4 2", "ring west"], "secondary", name="Rue de Paris", maxspeed="50")


def _axis(x: float) -> float:
    """Northing of the boulevard's axis."""
    return 236.0 + 14.0 * math.cos((x - 1100.0) / 465.0)


def _boulevard(builder: MapBuilder) -> None:
    """Two one-way carriageways from `west end` to `east end`, and a side lane of the eastern.

    Openings at 1440 (the avenue) and 2000 m (no left turn from the west); the side lane
    leaves at 1520 and returns at 2250 m.
    """
    builder.node("west end", 1100.0, _axis(1100.0))
    builder.node("east end", 2560.0, _axis(2560.0))
    stations = [*range(1140, 2530, 30), 1440, 1520, 2000, 2250]
    for x in sorted(set(stations)):
        builder.node(f"eastbound {x}", x, _axis(x) - _CARRIAGEWAY)
        builder.node(f"westbound {x}", x, _axis(x) + _CARRIAGEWAY)
        if 1570 <= x <= 2200:
            builder.node(f"side {x}", x, _axis(x) - _CARRIAGEWAY - _SIDE_LANE)

    def run(side: str, low: int, high: int) -> list[str]:
        return [f"{side} {x}" for x in sorted(set(stations)) if low <= x <= high]

    name = {"name": "Boulevard de la Marne"}
    wide = name | {"oneway": "yes", "maxspeed": "50", "lanes": "1"}
    builder.curve(["ring east", "west end"], "secondary", maxspeed="50", **name)
    builder.way(["west end", *run("eastbound", 0, 1440)], "secondary", **wide)
    onward = builder.way(run("eastbound", 1440, 2000), "secondary", **wide)
    builder.way([*run("eastbound", 2000, 9999), "east end"], "secondary", **wide)
    builder.way(["east end", *run("westbound", 2000, 9999)[::-1]], "secondary", **wide)
    builder.way([*run("westbound", 0, 2000)[::-1], "west end"], "secondary", **wide)
    builder.way(["eastbound 1440", "westbound 1440"], "secondary_link", oneway="-1")
    opening = builder.way(["eastbound 2000", "westbound 2000"], "secondary_link")
    builder.restrict("no_left_turn", onward, "eastbound 2000", opening)
    lane = ["eastbound 1520", *run("side", 1570, 2200), "eastbound 2250"]
    builder.way(lane, "tertiary", name="Contre-allée", oneway="yes", maxspeed="50", lanes="1")
    avenue = ["avenue 1", "avenue 2", "avenue 3", "quarry", "avenue 4", "eastbound 1440"]
    before = builder.curve(
        ["crossroads", *avenue], "tertiary", name="Avenue du Nord", maxspeed="50"
    )
    builder.restrict("only_right_turn", before, "eastbound 1440", onward)


def _long_roads(builder: MapBuilder) -> None:
    """Route de Soissons with its bends and junctions, and the roads that lead back."""
    south = ["ring south", "soissons 1", "soissons 2", "vineyard", "soissons 3", "soissons 4"]
    builder.curve(
        [*south, "crossroads"],
        "secondary", name="Route de Soissons", maxspeed="70",
    )  # fmt: skip
    builder.curve(
        ["crossroads", "soissons 5", "soissons 6", "soissons 7", "side 1950"],
        "secondary", name="Route de Soissons", maxspeed="70",
    )  # fmt: skip
    builder.curve(["vineyard", "avenue 2"], "unclassified", name="Chemin des Vignes")
    builder.curve(["quarry", "quarry end"], "service", name="La Carrière")
    builder.curve(
        ["crossroads", "south 1", "south 2", "south 3", "south 4", "old 2 0"],
        "tertiary", name="Route du Sud", maxspeed="70",
    )  # fmt: skip
    builder.curve(
        ["end", "north 1", "north 2", "north 3", "north 4", "north 5", "ring north"],
        "secondary", name="Route du Nord", maxspeed="80",
    )  # fmt: skip


def _fork(builder: MapBuilder) -> None:
    """One road becomes two that part at 10 degrees, and meet again at `end`."""
    builder.curve(
        ["east end", "lead-in", "fork"],
        "secondary",
        name="Route de Reims",
        maxspeed="60",
    )
    for side, name in (("left", "Route de Reims"), ("right", "Route de la Forêt")):
        run = ["fork", *(f"{side} {k}" for k in (1, 2, 3, 4)), "end"]
        builder.curve(run, "secondary", name=name, maxspeed="60")
