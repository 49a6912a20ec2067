"""Short drives on hand-made maps on which the road is in doubt, for the particle filter.

The cold start has a heading; chance is in the fixes, the road taken and where along it
the drive begins.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from scenes import drive_along, epochs_of, gnss, grid_town, living, network, steps
from whichroad._compile import Records
from whichroad.graph.network import Roads
from whichroad.settings import Settings

_DARK = 30.0  # m driven with fixes, where they end
_MARGIN = 100.0  # m of the first road that are not driven


class Scene(NamedTuple):
    """A map and a drive on it."""

    roads: Roads
    epochs: Records


def _drive(
    streets: list, corners: list, seed: int, *, dark: float, radius: float = 60.0,
    margin: float = _MARGIN,
) -> Scene:  # fmt: skip
    """Drive along corners at 10 m/s, an epoch each 2 m, a fix each second until `dark`."""
    rng = np.random.default_rng([seed, 6])
    truth = drive_along(
        corners, radius=radius, interval=0.2, margin=margin - rng.uniform(0.0, 10.0)
    )
    epoch = np.arange(len(truth.s))
    at = np.flatnonzero((truth.s < dark) & (epoch % 5 == 0))
    roads = network([np.array(line, float) for line in streets])
    return Scene(roads, epochs_of(truth, gnss(truth, seed=seed), at, course=0.05))


def fork(degrees: float, seed: int) -> Scene:
    """A fork in an outage that begins 20 m before it; either road is taken."""
    a = math.radians(degrees)
    node = (150.0, 0.0)
    ahead, aside = (450.0, 0.0), (150.0 + 300.0 * math.cos(a), -300.0 * math.sin(a))
    corners = [(0.0, 0.0), ahead] if seed % 2 else [(0.0, 0.0), node, aside]
    return _drive([[(0.0, 0.0), node], [node, ahead], [node, aside]], corners, seed, dark=_DARK)


def parallel(gap: float, seed: int, *, from_start: bool = False) -> Scene:
    """One road becomes two beside each other, with fixes; or the drive begins on one of them."""
    node, end = (150.0, 0.0), 700.0 if from_start else 450.0
    ahead = [node, (end, 0.0)]
    aside = [node, (150.0 + 6.0 * gap, -gap), (end, -gap)]
    corners = [(0.0, 0.0), (end, 0.0)] if seed % 2 else [(0.0, 0.0), *aside]
    margin = 260.0 if from_start else _MARGIN
    return _drive([[(0.0, 0.0), node], ahead, aside], corners, seed, dark=math.inf, margin=margin)


def grid(seed: int) -> Scene:
    """Turns in a town of crooked blocks of 60 m, dark from before the first one."""
    streets = grid_town(4, 4, 60.0)
    corners = [(0.0, 60.0), (60.0, 60.0), (60.0, 120.0), (150.0, 120.0)]
    if seed % 2:
        corners = [(0.0, 60.0), (120.0, 60.0), (120.0, 0.0), (180.0, 0.0)]
    crooked = [(x + 10.0 * math.sin(y / 60.0), y + 8.0 * math.cos(x / 60.0)) for x, y in corners]
    return _drive(streets, crooked, seed, dark=10.0, radius=9.0, margin=15.0)


def roundabout(seed: int) -> Scene:
    """In from the west, out to the south or the east, dark; ring of 15 m radius."""
    angle = np.linspace(-math.pi, math.pi, 33)  # counter-clockwise, from the west
    ring = 15.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    arcs = [ring[8 * i : 8 * i + 9] for i in range(4)]  # west, south, east, north
    arms = [[arc[0], 8.0 * arc[0]] for arc in arcs]
    arms[0] = [8.0 * ring[0], ring[0]]
    out = 1 + seed % 2
    corners = [8.0 * ring[0], *ring[0 : 8 * out + 1 : 4], 8.0 * ring[8 * out]]
    return _drive([*arms, *arcs], corners, seed, dark=40.0, radius=6.0, margin=30.0)


def plain(settings: Settings) -> Settings:
    """Without what the filter learns or doubts by its most probable hypothesis alone."""
    return replace(settings, gnss_adapt_time=1e12, gnss_gate=1e6, gnss_lost=0.0)


SCENES: dict[str, Callable[[int], Scene]] = {
    "fork of 5 degrees, dark": lambda seed: fork(5.0, seed),
    "fork of 15 degrees, dark": lambda seed: fork(15.0, seed),
    "fork of 25 degrees, dark": lambda seed: fork(25.0, seed),
    "parallel roads, 8 m": lambda seed: parallel(8.0, seed),
    "parallel roads, 12 m": lambda seed: parallel(12.0, seed),
    "parallel roads, 8 m, from a cold start": lambda seed: parallel(8.0, seed, from_start=True),
    "grid, dark": grid,
    "roundabout, dark": roundabout,
}


def filtered(scene: Scene, settings: Settings) -> tuple[list[dict[int, float]], list[int]]:
    """The filter's P of each edge after every epoch, and how many hypotheses it kept."""
    found, kept = [], []
    for _, belief, _ in steps(scene.roads, scene.epochs, settings=settings):
        alive = living(belief)
        p: dict[int, float] = {}
        for edge, share in zip(alive.edge.tolist(), alive.weight, strict=True):
            p[edge] = p.get(edge, 0.0) + float(share)
        found.append(p)
        kept.append(len(alive))
    return found, kept


def apart(a: dict[int, float], b: dict[int, float]) -> float:
    """Total variation."""
    return 0.5 * sum(abs(a.get(e, 0.0) - b.get(e, 0.0)) for e in {*a, *b})
