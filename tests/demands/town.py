"""A small town, and drives along its streets."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import whichroad
from whichroad.geodesy.plane import Plane
from whichroad.simulate import MapBuilder
from whichroad.simulate.map_builder import ORIGIN

Array = NDArray[np.float64]
PLANE = Plane(*ORIGIN)
BLOCK = 150.0  # m


@cache
def roads() -> whichroad.RoadMap:
    """Five by five crossings `rc`, a dead end north of `42`, a field in the south."""
    builder = MapBuilder()
    for r in range(5):
        for c in range(5):
            builder.node(f"{r}{c}", c * BLOCK, r * BLOCK)
    builder.node("end", 2 * BLOCK, 4 * BLOCK + 250.0)
    for k in range(5):
        builder.way([f"{k}{c}" for c in range(5)], "residential", name=f"Row {k}")
        builder.way([f"{r}{k}" for r in range(5)], "residential", name=f"Column {k}")
    builder.way(["42", "end"], "residential", name="Dead end")
    return builder.compiled()


def corners(*names: str) -> Array:
    """Plane points of crossings."""
    return np.array([[int(n[1]) * BLOCK, int(n[0]) * BLOCK] for n in names])


def along(points: ArrayLike, speed: float = 10.0, every: float = 1.0) -> tuple[Array, Array]:
    """Times and true places (n, 2) of a drive along a polyline."""
    line = np.asarray(points, float)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    end = s[-1] / speed
    time = np.append(np.arange(0.0, end - 0.2 * every, every), end)
    at = time * speed
    return time, np.column_stack([np.interp(at, s, line[:, 0]), np.interp(at, s, line[:, 1])])


def fixes(
    points: ArrayLike, *, speed: float = 10.0, every: float = 1.0, sigma: float = 3.0,
    seed: int = 0, white: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """A drive along a polyline as a table of fixes; errors last 45 s unless they are white."""
    time, place = along(points, speed, every)
    rng = np.random.default_rng(seed)
    error = rng.normal(0.0, sigma, place.shape)
    if not white:
        keep = np.exp(-every / 45.0)
        for k in range(1, len(error)):
            error[k] = keep * error[k - 1] + np.sqrt(1.0 - keep**2) * error[k]
    lat, lon = PLANE.to_geodetic(*(place + error).T)
    return {"time": 1.6e9 + time, "lat": lat, "lon": lon, "sigma_m": np.full(len(time), sigma)}


def streets(result: whichroad.Result) -> list[str]:
    """The crossings that the path passes, between its first and last edge."""
    path = result.path
    x, y = (np.array(v) for v in zip(*(g.coords[-1] for g in path.geometry), strict=True))
    x, y = PLANE.from_geodetic(y, x)
    names = [f"{round(b / BLOCK)}{round(a / BLOCK)}" for a, b in zip(x, y, strict=True)]
    return names[:-1]
