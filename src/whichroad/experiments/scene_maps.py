"""The experiments' maps, drawn here: streets as lines in metres, and the compiled map."""

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..geodesy.angles import radians
from ..geodesy.plane import Plane

if TYPE_CHECKING:
    from ..roadmap import RoadMap

Streets = Mapping[str, list[tuple[float, float]]]
"""Name of each street to its line, m east and north of `ORIGIN`; ends that meet are joined."""

ORIGIN = Plane(49.40, 2.80)
"""Beside Compiègne, where the paper drove."""


def draw_map(streets: Streets) -> "RoadMap":
    """Compile streets, open in both directions."""
    import pyarrow as pa
    import shapely

    from ..roadmap import RoadMap

    geometry = []
    for line in streets.values():
        lat, lon = ORIGIN.to_geodetic(*np.array(line, float).T)
        geometry.append(shapely.to_wkb(shapely.linestrings(np.column_stack([lon, lat]))))
    table = pa.table({"geometry": geometry, "name": list(streets)})
    return RoadMap.from_edges(table, crs="EPSG:4326", directed=False)


def street_of(roads: "RoadMap", edge: int) -> str:
    """Name of the street that an edge is of."""
    return str(roads.attributes(edge)["name"])


def along(roads: "RoadMap", streets: list[str]) -> list[int]:
    """The directed edges that lead along these streets, one after the other.

    The first is driven towards the second, every other one away from the one before.
    """
    edges = roads.arrays.edges
    of: dict[str, list[int]] = {}
    for edge in range(len(edges)):
        of.setdefault(street_of(roads, edge), []).append(edge)
    second = {int(edges.from_node[e]) for e in of[streets[1]]}
    route = [next(e for e in of[streets[0]] if int(edges.to_node[e]) in second)]
    for name in streets[1:]:
        here = int(edges.to_node[route[-1]])
        route.append(next(e for e in of[name] if int(edges.from_node[e]) == here))
    return route


def _ray(start: tuple[float, float], degrees: float, length: float) -> tuple[float, float]:
    """The point at a distance in a direction, counter-clockwise from east."""
    angle = radians(degrees)
    x, y = start[0] + length * np.cos(angle), start[1] + length * np.sin(angle)
    return float(x), float(y)


def fork() -> Streets:
    """A road, another one leaving it to the right, and 15 m later one to the left."""
    a, b = (600.0, 0.0), (615.0, 0.0)
    return {
        "1": [(0.0, 0.0), a],
        "2a": [a, b],
        "2": [b, (1240.0, 0.0)],
        "3": [a, _ray(a, -9.0, 640.0)],
        "4": [b, _ray(b, 9.0, 600.0)],
    }


def junction() -> Streets:
    """A road that goes on straight, and one that leaves it at 10 degrees to the right."""
    a = (600.0, 0.0)
    return {"1": [(0.0, 0.0), a], "2": [a, (1200.0, 0.0)], "3": [a, _ray(a, -10.0, 600.0)]}


GAP = 12.0
"""Between the parallel roads, m."""


def parallel() -> Streets:
    """One road becomes two that run side by side."""
    a = (500.0, 0.0)
    return {
        "approach": [(0.0, 0.0), a],
        "left road": [a, (700.0, 0.0), (2200.0, 0.0)],
        "right road": [a, (700.0, -GAP), (2200.0, -GAP)],
    }


_TOWN = {
    "a": (-400, 0), "b": (0, 0), "c": (0, 260), "d": (300, 300), "e": (620, 330),
    "f": (900, 470), "g": (1010, 760), "h": (1330, 800), "i": (1400, 520), "j": (1380, 200),
    "k": (1820, 150),
}  # fmt: skip
_BENDS = {
    "de": [(400, 345), (520, 350)],
    "ef": [(720, 330), (830, 385)],
    "fg": [(915, 560), (985, 660)],
    "hi": [(1390, 740), (1420, 630)],
    "jk": [(1500, 215), (1640, 170)],
}
_SIDE = {
    "b west": ("b", [(-20, -240)]), "b east": ("b", [(330, -30)]),
    "c north": ("c", [(-30, 520)]), "c west": ("c", [(-260, 250)]),
    "d south": ("d", [(330, 60)]), "d north": ("d", [(270, 560)]),
    "e fork": ("e", [(760, 300), (1040, 280)]), "e north": ("e", [(590, 590)]),
    "f east": ("f", [(1160, 560)]), "f west": ("f", [(740, 620)]),
    "g north": ("g", [(1060, 980)]), "g west": ("g", [(760, 800)]),
    "h north": ("h", [(1350, 980)]), "h east": ("h", [(1620, 830)]),
    "i east": ("i", [(1680, 560)]), "i west": ("i", [(1150, 500)]),
    "j west": ("j", [(1130, 190)]), "j south": ("j", [(1350, -60)]),
}  # fmt: skip


def outage() -> Streets:
    """Three kilometres of bends, crossings, a fork and five turns."""
    streets = {}
    for one, other in zip("abcdefghij", "bcdefghijk", strict=True):
        name = one + other
        streets[name] = [_TOWN[one], *_BENDS.get(name, []), _TOWN[other]]
    streets |= {name: [_TOWN[start], *line] for name, (start, line) in _SIDE.items()}
    return {name: [(float(x), float(y)) for x, y in line] for name, line in streets.items()}


BLOCK = 120.0
"""Between the cross streets of `canyon`, m."""


def canyon() -> Streets:
    """A street grid that is driven east, north and east again, through its middle."""
    streets: dict[str, list[tuple[float, float]]] = {}
    for row in range(6):
        for column in range(-1, 18):
            x, y = column * BLOCK, row * BLOCK
            streets[f"east {column} {row}"] = [(x, y), (x + BLOCK, y)]
            if row < 5 and column >= 0:
                streets[f"north {column} {row}"] = [(x, y), (x, y + BLOCK)]
    return streets


CANYON_ROUTE = [
    *(f"east {column} 1" for column in range(-1, 8)),
    *(f"north 8 {row}" for row in range(1, 4)),
    *(f"east {column} 4" for column in range(8, 18)),
]


@functools.cache
def known(name: str) -> "RoadMap":
    """The compiled map of one scene, drawn once."""
    drawn = {
        "fork": fork, "outage": outage, "parallel": parallel, "junction": junction, "gst": canyon,
    }  # fmt: skip
    return draw_map(drawn[name]())
