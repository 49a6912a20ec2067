"""A drive and the streets about it, and the map that the filter has of them."""

from dataclasses import dataclass

import numpy as np

from whichroad import RoadMap

from ..worlds.maps import Plane, chain_roads, roads_of_codes
from .motion import Motion

OFFSET = 1.5  # m of each axis, sigma, by which the map is off as a whole
_PLACE = (49.4, 8.7)  # degrees


@dataclass(frozen=True, slots=True)
class Plan:
    """Streets as the map draws them, and a drive.

    A directed street has the code 2 k as it is drawn and 2 k + 1 against it.
    """

    lines: list[np.ndarray]  # of each street, (k, 2) m
    motion: Motion
    missing: frozenset[int] = frozenset()  # streets that the map lacks


@dataclass(frozen=True, slots=True)
class Ground:
    """The filter's map, and what its roads are in truth."""

    roads: RoadMap
    road_of_edge: np.ndarray  # (E,) chain of edges without a decision
    road_of_code: np.ndarray  # (codes,) -1: not mapped
    plane: Plane


def draw_map(plan: Plan, random: np.random.Generator) -> Ground:
    """The map of a plan, off by `OFFSET`, compiled from a table."""
    import geopandas
    import shapely

    plane = Plane(*_PLACE)
    moved = random.normal(0.0, OFFSET, 2)
    ids = [k for k in range(len(plan.lines)) if k not in plan.missing]
    geometry = [shapely.LineString(plane.degrees(np.asarray(plan.lines[k]) + moved)) for k in ids]
    table = geopandas.GeoDataFrame({"id": ids}, geometry=geometry, crs="EPSG:4326")
    roads = RoadMap.from_edges(table, directed=False, gap_m=0.0)  # scenes have gaps on purpose
    chains = chain_roads(roads.arrays.edges)
    return Ground(roads, chains, roads_of_codes(roads, chains, 2 * len(plan.lines)), plane)
