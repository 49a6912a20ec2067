"""A folder of compiled maps, and which of them holds a trip.

The outline of a map is the cells of its grid that hold a road, four by four as one.  A place is
on a map where such a cell, or one beside it, holds a road: some 250 to 500 m.  At the edge of a
map, where another has roads close by and this one has none, it is not.
"""

import hashlib
import itertools
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError
from ..observations import Array
from . import checked
from .extent import on_sphere
from .roadmap import RoadMap
from .store import is_compiled

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

_FINE = 2  # bits of a cell's column and row that a cell of an outline leaves out
_HALF = 2**31  # rows of cells count from -2³¹, as in `graph.index.cell_key`
_CIRCLE = 1.01  # of a circle's radius, more than the sphere differs from the Earth
_WITHIN = 4  # cells of an outline to each side, in which its roads are counted: some 1 km
_SIDE = 3  # cells of an outline to one side, in which a map that goes on there has a road
_TRIED = 16  # places of a trip about which they are counted


class Share(NamedTuple):
    """Consecutive fixes of a trip that are matched on one map."""

    low: int
    high: int
    map: int  # place among the maps


class Outline:
    """Where a map has roads.

    Args:
        roads: The map.
    """

    def __init__(self, roads: RoadMap) -> None:
        self._roads = roads
        plane = roads.plane
        self.lat_deg, self.lon_deg, self.reach = plane.lat0_deg, plane.lon0_deg, roads.reach

    @cached_property
    def _keys(self) -> Ints:
        """Cells with a road, column by column, as `graph.index.cell_key` counts them."""
        fine = self._roads.arrays.cell_key
        column, row = fine >> 32, (fine & (2**32 - 1)) - _HALF
        return np.unique(_key(column >> _FINE, row >> _FINE))

    def holds(self, lat_deg: Array, lon_deg: Array) -> Bools:
        """Whether each of (n,) places is on the map."""
        column, row = self._cells(lat_deg, lon_deg)
        return self._roads_about(column, row, 1) > 0

    def has_close(self, lat_deg: Array, lon_deg: Array) -> Bools:
        """Whether a road lies within some 60 to 120 m of each of (n,) places."""
        fine = self._roads.arrays.cell_key
        column, row = self._cells(lat_deg, lon_deg, 0)
        return _in_block(fine, column - 1, column + 1, row - 1, row + 1) > 0

    def surrounds(self, lat_deg: Array, lon_deg: Array) -> Bools:
        """Whether the map has roads to all four sides of each of (n,) places, within some 800 m."""
        column, row = self._cells(lat_deg, lon_deg)
        around: Bools = np.ones(len(lat_deg), np.bool_)
        for low, high in ((-_SIDE, -1), (1, _SIDE)):
            around &= _in_block(self._keys, column + low, column + high, row - 1, row + 1) > 0
            around &= _in_block(self._keys, column - 1, column + 1, row + low, row + high) > 0
        return around

    def roads_near(self, lat_deg: Array, lon_deg: Array) -> int:
        """How many cells with a road lie within a kilometre of (n,) places, all in all."""
        return int(self._roads_about(*self._cells(lat_deg, lon_deg), _WITHIN).sum())

    def _cells(self, lat_deg: Array, lon_deg: Array, coarse: int = _FINE) -> tuple[Ints, Ints]:
        size = float(self._roads.arrays.plane.cell_size[0]) * 2.0**coarse
        x, y = self._roads.plane.from_geodetic(lat_deg, lon_deg)
        column, row = (np.floor(v / size).astype(np.int64) for v in (x, y))
        return column, row

    def _roads_about(self, column: Ints, row: Ints, sides: int) -> Ints:
        """Cells with a road within so many columns and rows of some cells."""
        return _in_block(self._keys, column - sides, column + sides, row - sides, row + sides)


def _in_block(keys: Ints, west: Ints, east: Ints, south: Ints, north: Ints) -> Ints:
    """How many of some keys, ascending, are of cells in each of (n,) blocks of equal width."""
    beside = west[:, None] + np.arange(east[0] - west[0] + 1)
    low = np.searchsorted(keys, _key(beside, south[:, None]))
    high = np.searchsorted(keys, _key(beside, north[:, None]), "right")
    found: Ints = (high - low).sum(axis=1)
    return found


def _key(column: Ints, row: Ints) -> Ints:
    return column * (2 * _HALF) + (row + _HALF)


class RoadMaps(Mapping[str, RoadMap]):
    """Maps by the names of their files.

    Args:
        maps: By name; at least one.
        origin: What they are called together.
    """

    def __init__(self, maps: Mapping[str, RoadMap], origin: str) -> None:
        self._maps = dict(maps)
        self.names = list(self._maps)
        self.origin = origin
        self.outlines = [Outline(roads) for roads in self._maps.values()]

    @classmethod
    def open(cls, folder: str | Path) -> "RoadMaps":
        """The compiled maps of a folder, by the names of their files.

        Raises:
            MapError: There is none, or one is damaged.
        """
        maps = {path.name: RoadMap.open(path) for path in compiled_in(Path(folder))}
        if not maps:
            raise MapError(
                f"{folder}: no compiled map is in this folder; files that `whichroad map build` "
                "made were expected; build them, or name one map"
            )
        return cls(maps, str(folder))

    def __getitem__(self, name: str) -> RoadMap:
        return self._maps[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._maps)

    def __len__(self) -> int:
        return len(self._maps)

    def __repr__(self) -> str:
        return f"RoadMaps({self.origin!r}, {', '.join(self.names)})"

    @property
    def identity(self) -> dict[str, Any]:
        """As of `RoadMap.identity`: of all together, and under `maps` of each by name."""
        each = {name: roads.identity for name, roads in self._maps.items()}
        prints = repr([(name, one["fingerprint"]) for name, one in each.items()])
        dates = [one["source_date"] for one in each.values() if one["source_date"]]
        return {"fingerprint": hashlib.sha256(prints.encode()).hexdigest()[:32],
                "source": self.origin, "source_date": min(dates, default=None),
                "maps": each}  # fmt: skip

    def shares(self, lat_deg: Array, lon_deg: Array, first: Ints) -> list[list[Share]]:
        """Which map takes each trip, or which parts of it.

        A trip takes the map that holds all its fixes that any map holds; of several the one
        with most roads about it, of equals the smaller one.  If none does, it is cut into as
        few parts as possible, in the middle of what two maps share.  A single fix away from
        those before and after it cuts nothing.

        Args:
            lat_deg: (n,) of the fixes of all trips, in the order of time, n > 0.
            lon_deg: (n,)
            first: (t + 1,) where each trip begins, ascending, and n.
        """
        count = np.diff(first)
        start = first[:-1]
        away = on_sphere(
            np.repeat(lat_deg[start], count), np.repeat(lon_deg[start], count), lat_deg, lon_deg
        )
        radius = np.maximum.reduceat(away, start) * _CIRCLE
        beyond = np.array([
            on_sphere(one.lat_deg, one.lon_deg, lat_deg[start], lon_deg[start])
            - one.reach * _CIRCLE for one in self.outlines
        ])  # fmt: skip
        near = beyond <= radius
        held = np.zeros((len(self), len(lat_deg)), np.bool_)
        close = held.copy()
        several = near.sum(axis=0) > 1
        for k, outline in enumerate(self.outlines):
            rows = np.flatnonzero(np.repeat(near[k] & several, count))
            if len(rows):
                held[k, rows] = outline.holds(lat_deg[rows], lon_deg[rows])
                close[k, rows] = outline.has_close(lat_deg[rows], lon_deg[rows])
        strict = held.copy()
        for k, outline in enumerate(self.outlines):  # who has the roads there beside its border
            rows = np.flatnonzero(held[k] & ~close[k] & close.any(axis=0))
            if len(rows):
                strict[k, rows] = outline.surrounds(lat_deg[rows], lon_deg[rows])
        found = []
        for trip, (low, high) in enumerate(zip(start.tolist(), first[1:].tolist(), strict=True)):
            if several[trip] and held[:, low:high].any():
                at = slice(low, high)
                shares = self._shares(strict[:, at], lat_deg[at], lon_deg[at])
                if len(shares) > len({one.map for one in shares}):  # fixes scatter over a border
                    shares = self._shares(held[:, at], lat_deg[at], lon_deg[at])
                found.append(shares)
            else:
                found.append([Share(0, high - low, int(np.argmin(beyond[:, trip])))])
        return found

    def _shares(self, held: Bools, lat_deg: Array, lon_deg: Array) -> list[Share]:
        """Of one trip, of which (maps, n) places are held."""
        n = held.shape[1]
        held = held | ~held.any(axis=0)
        held[:, 1:-1] |= held[:, :-2] & held[:, 2:]
        whole = np.flatnonzero(held.all(axis=1)).tolist()
        if len(whole) > 1:
            tried = np.unique(np.linspace(0, n - 1, _TRIED).round().astype(int))
            maps = list(self._maps.values())
            whole.sort(
                key=lambda k: (
                    -self.outlines[k].roads_near(lat_deg[tried], lon_deg[tried]), len(maps[k])
                )
            )  # fmt: skip
        return [Share(0, n, whole[0])] if whole else _parts(held)


def _parts(held: Bools) -> list[Share]:
    """The fewest runs of places that one map holds each."""
    n = held.shape[1]
    runs: list[tuple[int, int]] = []  # map, and the first place that it does not hold
    at = 0
    while at < n:
        ends = [at + _length(row[at:]) for row in held]
        best = int(np.argmax(ends))
        runs.append((best, ends[best]))
        at = ends[best]
    bounds = [0]
    for (_, end), (after, _) in itertools.pairwise(runs):
        shared = _length(held[after, bounds[-1] + 1 : end][::-1])
        bounds.append(end - shared // 2)
    bounds.append(n)
    return [Share(bounds[k], bounds[k + 1], one) for k, (one, _) in enumerate(runs)]


def _length(held: Bools) -> int:
    """How many of the first places are held."""
    return len(held) if held.all() else int(np.argmin(held))


def compiled_in(folder: Path) -> list[Path]:
    """The compiled maps in a folder, by name."""
    return sorted(path for path in folder.iterdir() if path.is_file() and is_compiled(path))


_open: dict[tuple[str | None, ...], RoadMaps] = {}  # the folder that was asked for last


def shared_maps(folder: Path) -> RoadMaps:
    """The maps of a folder, which this process opens once, as `checked.shared_map` does.

    Raises:
        MapError: There is none, or one is damaged.
    """
    key = (str(folder.resolve()), *map(checked.stamp, compiled_in(folder)))
    found = _open.get(key)
    if found is None:
        found = RoadMaps.open(folder)
        if None not in key:
            _open.clear()
            _open[key] = found
    return found
