"""The paper's drive in the town of our own: Figures 9 to 11 with a known truth."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError
from .drive_files import prepare, write_drive
from .map_error_field import draw_map_error
from .route_choice import Edges, shortest_route
from .sensor_models import Pull
from .simulated_drive import SimulatedDrive, simulate_drive
from .simulation_settings import GOOD
from .town import draw_town, places

if TYPE_CHECKING:
    from ..roadmap import RoadMap

MASK_M = 1500.0  # m without GPS, as in the paper's Figure 9
_MASK_FROM = 300.0  # m behind the roundabout
_DARK_FORK = (-60.0, 400.0)  # m about the fork: no GPS after the junction, Figure 11
_TO_SIDE_LANE = 13.0  # m, where the mask ends the fixes lie on the road beside: Figure 10
_PULL_TIME = 15.0  # s, decay time of that offset
_PULL_REPORTED = 6.0  # m, sigma that the receiver reports meanwhile

THROUGH = (
    *("old 1 4", "old 0 3", "old 0 1", "old 1 1", "old 2 1", "old 2 2", "old 4 2"),
    *("ring west", "ring south", "vineyard", "crossroads", "quarry"),
    *("eastbound 1440", "eastbound 1520", "eastbound 2000", "east end", "fork"),
)
"""Junctions that are passed: streets of the old town, the roundabout, the long road with
its bends and a left turn at the crossroads, the boulevard's main carriageway, the fork."""

_LAST_STREET = "Route de la Forêt"  # the right-hand road behind the fork


@dataclass(frozen=True, slots=True)
class Scenes:
    """Where along the drive the paper's figures lie, m driven."""

    mask: tuple[float, float]  # Figure 9: no GPS for 1.5 km
    parallel: tuple[float, float]  # Figure 10: fixes pulled to the road beside
    junction: tuple[float, float]  # Figure 11: a fork without GPS


def demo_route(roads: "RoadMap", seed: int = 1) -> Edges:
    """The demo's edges on the map of `draw_town(seed)`.

    Raises:
        MapError: The map is another one.
    """
    junctions = _junctions(roads, seed)
    edges = shortest_route(roads.arrays, junctions.tolist())
    leaving = np.flatnonzero(roads.arrays.edges.from_node == junctions[-1])
    last = [e for e in leaving.tolist() if roads.attributes(e)["name"] == _LAST_STREET]
    return np.append(edges, last)


def _junctions(roads: "RoadMap", seed: int) -> NDArray[np.int64]:
    """The numbers of the junctions `THROUGH` which the demo goes."""
    ids = places(seed)
    wanted = np.array([ids[name] for name in THROUGH])
    known = roads.node_id if isinstance(roads.node_id, np.ndarray) else np.zeros(1, np.int64)
    junctions = np.searchsorted(known, wanted)
    if not np.array_equal(known[np.minimum(junctions, len(known) - 1)], wanted):
        raise MapError(
            f"{roads!r}: the demo's junctions are not there; the map of draw_town({seed}) was "
            "expected; compile that one"
        )
    return junctions


def demo_scenes(roads: "RoadMap", seed: int = 1) -> Scenes:
    """Where the paper's situations lie along the demo's drive."""
    edges = demo_route(roads, seed)
    ends = np.cumsum(roads.arrays.edges.length[edges]) - 0.2 * roads.arrays.edges.length[edges[0]]
    passed = dict(zip(roads.arrays.edges.to_node[edges].tolist(), ends.tolist(), strict=True))
    junctions = _junctions(roads, seed).tolist()

    def place(name: str) -> float:
        return float(passed[junctions[THROUGH.index(name)]])

    mask = place("ring south") + _MASK_FROM
    fork = place("fork")
    return Scenes(
        mask=(mask, mask + MASK_M),
        parallel=(mask + MASK_M, place("east end")),
        junction=(fork + _DARK_FORK[0], fork + _DARK_FORK[1]),
    )


def demo_drive(roads: "RoadMap", *, seed: int = 1) -> SimulatedDrive:
    """Simulate the paper's drive on the map of `draw_town(seed)`, about 5 km.

    GPS in the old town; none for 1.5 km of bends, a junction passed straight, one turned
    at, and a side lane passed by; then fixes pulled by a road's distance towards that side
    lane; at last a fork of 10 degrees without GPS.

    Args:
        roads: The compiled town.
        seed: The town's seed, and all chance.

    Raises:
        MapError: The map is another one.
    """
    scenes = demo_scenes(roads, seed)
    settings = replace(GOOD, lane_change_rate=0.0)
    error_field = draw_map_error(settings, np.random.default_rng(seed))
    # the boulevard runs east: what its map is too far south, the fixes must be pulled more
    x, y, _ = roads.at(int(demo_route(roads, seed)[-5]), 0.0)
    south = float(error_field.at(np.array([x]), np.array([y]))[0, 1])
    pull = Pull(scenes.mask[1], _TO_SIDE_LANE + south, _PULL_TIME, _PULL_REPORTED)
    return simulate_drive(
        roads,
        seed=seed,
        scenario=settings,
        route=demo_route(roads, seed).tolist(),
        outages_m=(scenes.mask, scenes.junction),
        pulls=(pull,),
        error_field=error_field,
        drive_id="demo",
    )


def write_demo(
    folder: str | os.PathLike[str], *, seed: int = 1, force: bool = False
) -> tuple[list[Path], "RoadMap"]:
    """Draw the town, drive the paper's drive in it, and write everything as files.

    Args:
        folder: Where to; made if it is not there.
        seed: Of the town and of the drive.
        force: Replace files that exist.

    Returns:
        The files, map.osm first and then those of `write_drive`; the compiled map.

    Raises:
        WriteError: A file exists already, or the system refuses.
    """
    from ..roadmap import RoadMap

    path = Path(folder) / "map.osm"
    prepare([path], force=force)
    path.write_text(draw_town(seed), encoding="utf-8")
    roads = RoadMap.from_osm(path)
    return [path, *write_drive(demo_drive(roads, seed=seed), roads, folder, force=force)], roads
