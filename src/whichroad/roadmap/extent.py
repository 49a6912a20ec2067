"""Whether places lie on a map: near one of its roads."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError, SettingError
from ..geodesy.angles import radians
from ..geodesy.units import EARTH_RADIUS
from ..graph import index
from ..graph.network import records
from ..observations import Array, StartPose
from .roadmap import RoadMap

NEAR = 1000.0
"""Distance from the nearest road up to which a place is on the map, true m."""

_PLANE = 100_000.0  # m from the map beyond which distances are measured on the sphere
_CIRCLE = 1.01  # of the circle's radius, more than the sphere differs from the Earth
_SIGMAS = 3.0  # of a start pose, by which it may be off the map
_TRIED = 20  # fixes of which the nearest is named
_CAUSE = {  # by whether it is on the map with latitude and longitude exchanged
    True: "were latitude and longitude swapped?",
    False: "is this the right extract?",
}
_HALF = 2**31  # rows of cells count from -2³¹, as in `graph.index.cell_key`


def are_near(
    lat_deg: Array, lon_deg: Array, roads: RoadMap, at: Array | None = None
) -> NDArray[np.bool_]:
    """Whether each of (n,) places is within `NEAR` of a road of the map.

    Args:
        lat_deg: (n,)
        lon_deg: (n,)
        roads: The map.
        at: (n, 2) the same in the map's plane, where they are known there.
    """
    near = np.zeros(len(lat_deg), np.bool_)
    some = np.flatnonzero(beyond(roads, lat_deg, lon_deg) <= NEAR)
    if at is None:
        x, y = roads.plane.from_geodetic(lat_deg[some], lon_deg[some])
    else:
        x, y = at[some, 0], at[some, 1]
    held = _beside_full_cells(roads, x, y)
    near[some] = held
    for k in np.flatnonzero(~held).tolist():
        found = records(1, index.CANDIDATE)
        near[some[k]] = index.near(roads.arrays, float(x[k]), float(y[k]), NEAR, found) > 0
    return near


def are_swapped(lat_deg: Array, lon_deg: Array, roads: RoadMap) -> bool:
    """Whether (n,) places off the map lie on it with latitude and longitude exchanged."""
    return bool((np.abs(lon_deg) <= 90.0).all() and are_near(lon_deg, lat_deg, roads).all())


def fixes_outside(name: str, lat_deg: Array, lon_deg: Array, roads: RoadMap) -> int:
    """How many of a drive's fixes are off the map.

    Args:
        name: Of the drive.
        lat_deg: (n,) of its fixes, n > 0.
        lon_deg: (n,)
        roads: The map.

    Raises:
        MapError: All of them are.
    """
    near = are_near(lat_deg, lon_deg, roads)
    outside = len(near) - int(np.count_nonzero(near))
    if outside == len(near):
        raise MapError(_refusal(name, lat_deg, lon_deg, roads))
    return outside


def outside_note(outside: int, fixes: int) -> str:
    """What to say of a drive of which some fixes are off the map."""
    return (
        f"{outside:,} of {fixes:,} fixes ({100.0 * outside / fixes:.1f} %) are farther than "
        f"{NEAR / 1e3:g} km from every road of the map: no road can be matched there; a map of the "
        "whole drive would hold them"
    )


def check_start(start: StartPose | None, roads: RoadMap) -> StartPose | None:
    """A start pose that lies on the map, within three times its sigma; None: there is none.

    Raises:
        SettingError: It does not.
    """
    if start is None:
        return None
    x, y = (float(v) for v in roads.plane.from_geodetic(start.lat_deg, start.lon_deg))
    reach = NEAR + _SIGMAS * start.sigma_m
    if not index.near(roads.arrays, x, y, reach, records(1, index.CANDIDATE)):
        away = distance(roads, start.lat_deg, start.lon_deg)
        raise SettingError(
            f"start: lat {start.lat_deg:.4f}, lon {start.lon_deg:.4f} is {_text(away)} from the "
            "map; a place on the map was expected; is it the right map, and latitude first?"
        )
    return start


def start_note(start: StartPose, lat_deg: float, lon_deg: float) -> str | None:
    """What to say of a start pose that the first fix contradicts; None: it does not.

    Args:
        start: The pose.
        lat_deg: Of the first fix.
        lon_deg: Likewise.
    """
    away = float(on_sphere(start.lat_deg, start.lon_deg, lat_deg, lon_deg))
    if away <= NEAR + _SIGMAS * start.sigma_m:
        return None
    return (
        f"the start pose is {_text(away)} from the drive's first fix, and is given up where fixes "
        "contradict it"
    )


def distance(roads: RoadMap, lat_deg: float, lon_deg: float) -> float:
    """Distance of a place from the nearest road, true m; far away on the sphere, at the least."""
    least = float(beyond(roads, lat_deg, lon_deg))
    if not least <= _PLANE:
        return least
    x, y = (float(v) for v in roads.plane.from_geodetic(lat_deg, lon_deg))
    found, radius = records(1, index.CANDIDATE), NEAR
    while not index.near(roads.arrays, x, y, radius, found):
        radius *= 2.0
    return float(found[0].distance)


def outside_reason(lat_deg: Array, lon_deg: Array, roads: RoadMap) -> str:
    """How far some fixes are from the map that are all off it, and what may be the cause.

    Args:
        lat_deg: (n,) of the fixes, n > 0.
        lon_deg: (n,)
        roads: The map.
    """
    tried = np.unique(np.linspace(0, len(lat_deg) - 1, _TRIED).round().astype(int))
    tried = np.append(tried, np.argmin(beyond(roads, lat_deg, lon_deg)))
    places = [(float(lat_deg[k]), float(lon_deg[k])) for k in tried.tolist()]
    away, lat, lon = min((distance(roads, *place), *place) for place in places)
    return (
        f"the nearest, lat {lat:.4f}, lon {lon:.4f}, is {_text(away)} from the map; a map that "
        f"holds the drive was expected; {_CAUSE[_is_swapped(roads, lat, lon)]}"
    )


class OffMap(NamedTuple):
    """A place that is not on the map."""

    away: float  # m from it, at least
    swapped: bool  # with latitude and longitude exchanged it is on the map
    text: str  # for people


def off_map(roads: RoadMap, lat_deg: float, lon_deg: float, away: float) -> OffMap | None:
    """How far a place is from the map, and what may be the cause; None: it is on the map.

    Args:
        roads: The map.
        lat_deg: Of the place.
        lon_deg: Likewise.
        away: Its `distance`, or how far it is `beyond`, m.
    """
    if not away > NEAR:
        return None
    swapped = _is_swapped(roads, lat_deg, lon_deg)
    return OffMap(away, swapped, (
        f"lat {lat_deg:.4f}, lon {lon_deg:.4f} is at least {_text(away)} from the map; a map that "
        f"holds the drive was expected; {_CAUSE[swapped]}"
    ))  # fmt: skip


def outside_map(roads: RoadMap, x: float, y: float) -> OffMap | None:
    """As `off_map`, of a place in the map's plane."""
    if index.near(roads.arrays, x, y, NEAR, records(1, index.CANDIDATE)):
        return None
    place = roads.plane.to_geodetic(x, y)
    return off_map(roads, *place, distance(roads, *place))


def _is_swapped(roads: RoadMap, lat_deg: float, lon_deg: float) -> bool:
    """Whether a place off the map is on it with latitude and longitude exchanged."""
    return abs(lon_deg) <= 90.0 and distance(roads, lon_deg, lat_deg) <= NEAR


def _refusal(name: str, lat_deg: Array, lon_deg: Array, roads: RoadMap) -> str:
    """That none of some fixes lies on the map, and what may be the cause."""
    fixes = "its fix" if len(lat_deg) == 1 else f"its {len(lat_deg):,} fixes"
    return (
        f"{name}: none of {fixes} is within {NEAR / 1e3:g} km of a road; "
        f"{outside_reason(lat_deg, lon_deg, roads)}"
    )


def _text(away: float) -> str:
    return f"{away / 1e3:,.0f} km" if away >= 1e5 else f"{away / 1e3:.1f} km"


def _beside_full_cells(roads: RoadMap, x: Array, y: Array) -> NDArray[np.bool_]:
    """Whether a segment touches the cell of each place, or one beside it: False is no answer."""
    keys, size = roads.arrays.cell_key, float(roads.arrays.plane["cell_size"][0])
    if 2.0 * math.sqrt(2.0) * size > NEAR or not len(keys):  # a plane metre is a true one or less
        return np.zeros(len(x), np.bool_)
    column, row = (np.floor(v / size).astype(np.int64) for v in (x, y))
    first = (column + np.arange(-1, 2)[:, None]) * (2 * _HALF) + row + _HALF  # of three columns
    at = np.searchsorted(keys, first - 1)
    held = (at < len(keys)) & (keys[np.minimum(at, len(keys) - 1)] <= first + 1)
    return np.asarray(held.any(axis=0))


def beyond(roads: RoadMap, lat_deg: Any, lon_deg: Any) -> Any:
    """Metres from the circle around the map on the sphere, negative inside."""
    away = on_sphere(roads.plane.lat0_deg, roads.plane.lon0_deg, lat_deg, lon_deg)
    return away - roads.reach * _CIRCLE


def on_sphere(lat0_deg: Any, lon0_deg: Any, lat_deg: Any, lon_deg: Any) -> Any:
    """Great-circle distance of places from one place, or from one for each, m."""
    lat0, lon0, lat, lon = map(radians, (lat0_deg, lon0_deg, lat_deg, lon_deg))
    half = (
        np.sin(0.5 * (lat - lat0)) ** 2
        + np.cos(lat) * np.cos(lat0) * np.sin(0.5 * (lon - lon0)) ** 2
    )
    return 2.0 * EARTH_RADIUS * np.arcsin(np.sqrt(np.clip(half, 0.0, 1.0)))
