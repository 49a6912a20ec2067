"""A drive with a fork during an outage, a stop, an off-road part and outliers."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyproj
import shapely
from numpy.typing import NDArray

import whichroad
from laws.public import CAR, GNSS, START, WHEELS, degrees, geo_fixes, metres, readings, road_map
from scenes import Truth, brake, drive_along

Array = NDArray[np.float64]

GEOD = pyproj.Geod(ellps="WGS84")
SHIFT = (2.0, -3.0)  # m, the map's error
SETTINGS = whichroad.Settings(protection_risk=1e-2, gnss_inflation=1.0)  # errs as it says

# as drawn: the second one against the drive, the second and third are one edge
STREETS: dict[str, dict[str, Any]] = {
    "stem": {"line": [(0, 0), (200, 60), (400, 150)], "from": 1, "to": 2, "name": "Stem Road",
             "maxspeed": 50.0, "lanes": 2, "highway": "tertiary"},
    "left": {"line": [(580, 260), (490, 205), (400, 150)], "from": 3, "to": 2,
             "name": "Left Street", "maxspeed": 30.0, "lanes": 2, "highway": "residential"},
    "last": {"line": [(580, 260), (700, 290), (800, 290), (1200, 300)], "from": 3, "to": 4,
             "name": "Last Street", "maxspeed": 70.0, "lanes": 2, "highway": "residential",
             "layer": 1, "bridge": 1},
    "right": {"line": [(400, 150), (590, 213), (800, 240)], "from": 2, "to": 5,
              "name": "Right Street", "lanes": 1, "highway": "residential", "tunnel": 1},
    # far away: the convergence and the scale of the plane matter on the other streets
    "far": {"line": [(70_000, 0), (70_300, 0)], "from": 8, "to": 9, "name": "Far Street"},
}  # fmt: skip
IDS = {"stem": 101, "left": 102, "last": 103, "right": 104, "far": 105}
EDGES = {"stem": ["stem"], "branch": ["-left", "last"], "right": ["right"]}  # driving direction


@cache
def roads() -> whichroad.RoadMap:
    """The map, with a constant position error."""
    streets = STREETS.values()
    columns = {
        "id": list(IDS.values()),
        **{name: [s.get(name) for s in streets] for name in (
            "from", "to", "name", "maxspeed", "lanes", "highway",
        )},
        **{name: [s.get(name, 0) for s in streets] for name in ("layer", "bridge", "tunnel")},
    }  # fmt: skip
    return road_map([np.add(s["line"], SHIFT) for s in streets], **columns)


def drawn(street: str) -> Array:
    """Longitude and latitude of a street's vertices, as drawn, (n, 2)."""
    return np.column_stack(degrees(*np.add(STREETS[street]["line"], SHIFT).T))


def edge_line(name: str) -> Array:
    """Longitude and latitude of an edge's vertices in driving direction, (n, 2)."""
    parts = [drawn(s.removeprefix("-"))[:: -1 if s[0] == "-" else 1] for s in EDGES[name]]
    return np.vstack([parts[0], *(part[1:] for part in parts[1:])])


class Foot(NamedTuple):
    """A position relative to a line."""

    along: float  # geodesic m from the line's start
    right: float  # m right of the line
    away: float  # m from the line


def foot(lon: float, lat: float, line: Array) -> Foot:
    """Project a position on a line of geodesics."""
    x, y = metres(*line.T)
    px, py = metres(lon, lat)
    path = shapely.LineString(np.column_stack([x, y]))
    along = path.project(shapely.Point(float(px), float(py)))
    at = np.array(path.interpolate(along).coords[0])
    ahead = np.array(path.interpolate(along + 0.01).coords[0])
    behind = np.array(path.interpolate(max(along - 0.01, 0.0)).coords[0])
    t = (ahead - behind) / np.hypot(*(ahead - behind))
    off = np.array([float(px), float(py)]) - at
    right = t[1] * off[0] - t[0] * off[1]
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    true = np.concatenate([[0.0], np.cumsum(GEOD.inv(*line[:-1].T, *line[1:].T)[2])])
    return Foot(float(np.interp(along, ends, true)), float(right), float(np.hypot(*off)))


BEFORE = 20  # epochs of wheels before the first fix
OUTAGE = (330.0, 470.0)  # m driven
STOP = 700.0  # m driven, for 3 s, and 2 s of braking before and starting behind
FALSE = 6  # outliers at the end, one a second


@cache
def truth() -> Truth:
    """In the right lane, with a stop, and off the roads at the end."""
    names = ["stem", "left", "last"]
    lines = [np.array(STREETS[n]["line"], float) for n in names]
    field = [(950.0, 120.0), (1000.0, -200.0)]
    way = np.vstack([lines[0], lines[1][::-1][1:], lines[2][1:3], field])
    way = np.array(shapely.LineString(way).offset_curve(-1.75, join_style="mitre").coords)
    moving = drive_along(way, radius=15.0)
    at = int(np.searchsorted(moving.s, STOP))
    return brake(moving, at, 30, goes_on=True)[0]


@cache
def observed(mode: str) -> tuple[Any, ...]:
    """All observations in time order.

    Wheels at 10 Hz, and fixes half-way between two readings where neither speed nor turn
    changes, so that a recorded drive has the epochs that one has on line; or fixes alone.
    """
    t = truth()
    step, swing = np.diff(t.s), np.diff(t.heading)
    steady = np.zeros(len(t.s), bool)
    steady[1:-1] = (np.abs(np.diff(step)) < 1e-9) & (np.abs(np.diff(swing)) < 1e-9)
    middle = Truth(*(0.5 * (c[:-1] + c[1:]) for c in t))
    n = len(middle.s)
    wave = np.column_stack([np.sin(middle.time / 9.0), np.cos(middle.time / 7.0)])
    error = np.random.default_rng(5).normal(0.0, 1.0, (n, 2)) + 2.0 * wave
    error[-10 * FALSE :, 1] += 400.0
    sigma = np.full((n, 2), 1.5)
    fix = np.column_stack([middle.x + error[:, 0], middle.y + error[:, 1], sigma, np.zeros(n)])
    out = (middle.s > OUTAGE[0]) & (middle.s < OUTAGE[1])
    at = [k for k in range(BEFORE, n, 10) if not out[k] and (mode == GNSS or steady[k])]
    seen = [*geo_fixes(middle, fix, at, doppler=mode == WHEELS), *readings(t, mode)]
    return tuple(sorted(seen, key=lambda o: o.time))


class Seen(NamedTuple):
    """Estimates, observations and truth of every epoch."""

    result: whichroad.Result
    points: pa.Table
    path: pa.Table
    estimates: list[whichroad.Estimate]  # on line, at the same epochs
    fixes: list[whichroad.GeoFix | None]
    truth: Truth  # at these epochs


@cache
def seen(mode: str) -> Seen:
    """The estimates of the drive, recorded and on line."""
    all_of_it = observed(mode)
    result = whichroad.match(
        list(all_of_it), roads(), vehicle=CAR, settings=SETTINGS, attributes=True
    )
    online = whichroad.Localizer(roads(), vehicle=CAR, settings=SETTINGS)
    t = truth()
    time = np.array([o.time for o in all_of_it]) - START
    return Seen(
        result, result.to_arrow(), result.path_arrow(),
        [online.update(o) for o in all_of_it],
        [o if isinstance(o, whichroad.GeoFix) else None for o in all_of_it],
        Truth(time, *(np.interp(time, t.time, column) for column in t[1:])),
    )  # fmt: skip
