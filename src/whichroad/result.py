"""What a matched drive says, as tables: points, path, summary."""

import math
from collections.abc import Callable
from functools import cache, cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .core.belief import NO_EDGE, OFF_ROAD
from .core.epoch import Epochs
from .core.network import AGAINST_ONE_WAY, NO_ACCESS, TURN_BANNED, U_TURN
from .core.output import (
    AMBIGUOUS,
    V_GNSS_SCALE,
    V_H,
    V_HH,
    V_LATERAL,
    V_MAP_X,
    V_MAP_Y,
    V_MATCH_X,
    V_MATCH_Y,
    V_OFF,
    V_P,
    V_PROTECTION,
    V_S,
    V_SPEED,
    V_X,
    V_XX,
    V_XY,
    V_Y,
    V_YY,
    Output,
)
from .diagnosis import Finding
from .errors import SettingError
from .localizer import Recorded
from .reasons import RECENT, STATUS, far_off, reason
from .records import Array
from .roadmap import RoadMap
from .route import Traversal, traversals
from .sensors.gnss import ellipse
from .tables import PATH, POINTS, geo_frame, line_wkb, times
from .ways import Alternative, Way, best_ways
from .writers import write_table

_RULES = (
    (AGAINST_ONE_WAY, "against_one_way"),
    (TURN_BANNED, "turn_banned"),
    (NO_ACCESS, "no_access"),
    (U_TURN, "u_turn"),
)


class Result:
    """A matched drive (or several): tables of points and path, and a summary.

    What is given as a function is put together when it is first asked for.

    Args:
        points: Points, one row per epoch.
        path: Path, one row per traversed edge.
        summary: What happened, in numbers.
        hypotheses: Poses of the alternatives per epoch, when they were asked for.
        diagnosis: Settings that do not fit the data.
    """

    def __init__(
        self,
        points: pa.Table | Callable[[], pa.Table],
        path: pa.Table | Callable[[], pa.Table],
        summary: dict[str, Any] | Callable[[], dict[str, Any]],
        hypotheses: dict[str, NDArray[Any]] | None = None,
        diagnosis: tuple[Finding, ...] | Callable[[], tuple[Finding, ...]] = (),
        ways: Callable[[], list[Alternative]] | None = None,
    ) -> None:
        self.ways = ways
        self._late: dict[str, Any] = {
            "points": points, "path": path, "summary": summary, "diagnosis": diagnosis
        }  # fmt: skip
        self.hypotheses = hypotheses

    def _made(self, name: str) -> Any:
        value = self._late[name]
        if callable(value):
            value = self._late[name] = value()
        return value

    @property
    def summary(self) -> dict[str, Any]:
        """What happened, in numbers."""
        return cast(dict[str, Any], self._made("summary"))

    @property
    def diagnosis(self) -> tuple[Finding, ...]:
        """Settings that do not fit the data."""
        return cast(tuple[Finding, ...], self._made("diagnosis"))

    @property
    def points(self) -> Any:
        """Points as a GeoDataFrame in EPSG:4326."""
        return geo_frame(self.to_arrow())

    @property
    def path(self) -> Any:
        """Path as a GeoDataFrame in EPSG:4326."""
        return geo_frame(self.path_arrow())

    def to_arrow(self) -> pa.Table:
        """Points as an Arrow table."""
        return self._made("points")

    def path_arrow(self) -> pa.Table:
        """Path as an Arrow table, geometry as WKB."""
        return self._made("path")

    @cached_property
    def _parts(self) -> list[Alternative]:
        if self.ways is None:
            raise SettingError('no lag, or several drives; one with lag="full" was expected')
        return self.ways()

    @property
    def alternatives(self) -> list[Alternative]:
        """Parts of the drive whose route is not sure, with the ways that compete; see `routes`."""
        return [part for part in self._parts if len(part.ways) > 1 and part.ways[1].p >= 0.001]

    def routes(self, k: int = 3) -> list[Way]:
        """The k most probable routes from the drive's start to its end, connected edges with P.

        Raises:
            SettingError: The drive was matched without a lag, or there are several drives.
        """
        return best_ways(self._parts, k)

    def write(self, path: str | Path, *, force: bool = False) -> None:
        """Write the points; the suffix chooses GeoParquet, GeoJSON, CSV or GPX.

        Raises:
            WriteError: The file exists and `force` is not set, or the suffix is unknown.
        """
        write_table(self.to_arrow(), path, force=force)

    def write_path(self, path: str | Path, *, force: bool = False) -> None:
        """Write the path likewise.

        Raises:
            WriteError: The file exists and `force` is not set, or the suffix is unknown.
        """
        write_table(self.path_arrow(), path, force=force)


def _nullable(values: Array, absent: NDArray[np.bool_]) -> pa.Array:
    return pa.array(values, mask=absent)


def points_table(
    drive_id: str, epochs: Epochs, output: Output, roads: RoadMap, *, attributes: bool = False
) -> pa.Table:
    """One row per epoch; what is not known yet is null.

    Args:
        drive_id: Its name.
        epochs: (n,) what the sensors said.
        output: (n,) what the filter said.
        roads: The map.
        attributes: Whether name, class and speed limit of the road are added.

    Returns:
        A table with the columns of `tables.POINTS`.
    """
    plane, v = roads.plane, output.value
    none = output.live == 0
    x, y = v[:, V_X], v[:, V_Y]
    lat, lon = plane.to_geodetic(x, y)
    map_lat, map_lon = plane.to_geodetic(v[:, V_MAP_X], v[:, V_MAP_Y])
    match_lat, match_lon = plane.to_geodetic(v[:, V_MATCH_X], v[:, V_MATCH_Y])
    turn = plane.convergence(x, y)
    bearing = np.degrees(math.pi / 2 - (v[:, V_H] - turn)) % 360.0
    c, s = np.cos(turn), np.sin(turn)  # plane axes back to east and north
    xx, xy, yy = v[:, V_XX], v[:, V_XY], v[:, V_YY]
    ee = c * c * xx + 2 * c * s * xy + s * s * yy
    nn = s * s * xx - 2 * c * s * xy + c * c * yy
    en = c * s * (yy - xx) + (c * c - s * s) * xy
    major, minor, axis = ellipse(ee, en, nn)
    off = none | (output.edge < 0)
    edge, s = np.where(off, 0, output.edge), np.where(off, 0.0, v[:, V_S])
    source, forward = _sources(roads, edge, s, off)
    status = np.array(STATUS)[output.status]
    columns = {
        "drive_id": pa.array([drive_id]).take(pa.array(np.zeros(len(x), np.int32))),
        "time": times(epochs.time),
        "lat": _nullable(lat, none),
        "lon": _nullable(lon, none),
        "bearing_deg": _nullable(bearing, none),
        "speed_mps": _nullable(v[:, V_SPEED], none),
        "cov_ee_m2": _nullable(ee, none),
        "cov_en_m2": _nullable(en, none),
        "cov_nn_m2": _nullable(nn, none),
        "sigma_bearing_deg": _nullable(np.degrees(np.sqrt(np.maximum(v[:, V_HH], 0))), none),
        "ellipse_major_m": _nullable(major, none),
        "ellipse_minor_m": _nullable(minor, none),
        "ellipse_bearing_deg": _nullable((90.0 - np.degrees(axis)) % 180.0, none),
        "edge_id": pa.array(output.edge.astype(np.int64), mask=off),
        "source_id": source,
        "forward": forward,
        "abscissa_m": _nullable(v[:, V_S], off),
        "lateral_m": _nullable(v[:, V_LATERAL], off),
        "matched_lat": _nullable(match_lat, off),
        "matched_lon": _nullable(match_lon, off),
        "map_lat": _nullable(map_lat, none),
        "map_lon": _nullable(map_lon, none),
        "p_road": _nullable(v[:, V_P], none),
        "p_off_road": _nullable(v[:, V_OFF], none),
        "status": pa.array(status),
        "reason": _reasons(epochs, output, roads),
        "alternatives": _alternatives(output),
        "protection_level_m": _nullable(v[:, V_PROTECTION], none),
        "gnss_scale": _nullable(v[:, V_GNSS_SCALE], none | (v[:, V_GNSS_SCALE] == 0.0)),
    }
    table = pa.table(columns).cast(POINTS)
    if attributes:
        for name, column in _attributes(roads, edge, off).items():
            table = table.append_column(name, column)
    return table


def _sources(
    roads: RoadMap, edge: NDArray[Any], s: Array, absent: NDArray[np.bool_]
) -> tuple[pa.Array, pa.Array]:
    """Source ids as text and directions; few streets differ, so each is asked for once."""
    if not len(edge):
        return pa.array([], pa.string()), pa.array([], pa.bool_())
    _, first, at = np.unique(roads.piece(edge, s), return_index=True, return_inverse=True)
    ids, forward = roads.sources(edge[first], s[first])
    texts = pa.array([str(i) for i in ids], pa.string())
    return texts.take(pa.array(at, mask=absent)), pa.array(forward[at], mask=absent)


_ATTRIBUTES = ("name", "highway", "speed_limit_kmh", "lanes", "layer", "bridge", "tunnel")


def _attributes(
    roads: RoadMap, edge: NDArray[Any], absent: NDArray[np.bool_]
) -> dict[str, pa.Array]:
    unique, at = np.unique(edge, return_inverse=True)
    rows = [roads.attributes(int(e)) for e in unique]
    return {
        name: pa.array([row.get(name) for row in rows]).take(pa.array(at, mask=absent))
        for name in _ATTRIBUTES
    }


def _alternatives(output: Output) -> pa.Array:
    on = output.alt_edge >= 0
    ends = np.concatenate([[0], np.cumsum(on.sum(axis=1))]).astype(np.int32)
    rows = pa.StructArray.from_arrays(
        [
            pa.array(output.alt_edge[on].astype(np.int64)),
            pa.array(output.alt_p[on].astype(np.float64)),
        ],
        names=["edge_id", "p"],
    )
    return pa.ListArray.from_arrays(pa.array(ends), rows)


def _reasons(epochs: Epochs, output: Output, roads: RoadMap) -> pa.Array:
    """Why each epoch's status is what it is; epochs of the same reason are put into words once."""
    n, status = len(epochs.time), output.status
    if not n:
        return pa.array([], pa.string())
    away = np.rint(_disbelieved(epochs, output))
    scale = np.rint(10.0 * output.value[:, V_GNSS_SCALE])
    scale[away > 0.0] = 0.0
    key = (1e3 * away + scale) * 20.0 + 2.0 * status + (output.live > 0)
    key = np.where(status == AMBIGUOUS, -1.0 - np.arange(n), key)  # the roads that compete
    _, first, at = np.unique(key, return_index=True, return_inverse=True)

    @cache
    def name(edge: int) -> str | None:
        return roads.name(edge)

    texts = [
        reason(
            STATUS[status[k]],
            roads=_shares(output, k),
            name=name,
            disbelieved=away[k],
            scale=0.1 * scale[k],
            answered=output.live[k] > 0,
        )
        for k in first
    ]
    return pa.array(texts, pa.string()).take(pa.array(at))


def _shares(output: Output, k: int) -> list[tuple[int, float]]:
    """The alternatives of epoch k and their P."""
    pairs = zip(output.alt_edge[k].tolist(), output.alt_p[k].tolist(), strict=True)
    return [(edge, p) for edge, p in pairs if edge != NO_EDGE]


def _disbelieved(epochs: Epochs, output: Output) -> Array:
    """How far away (m) the last fix lies that is not believed, 0 where it is, or none is recent."""
    v, k = output.value, np.flatnonzero(epochs.has_fix)
    if not len(k):
        return np.zeros(len(v))
    away = np.hypot(epochs.fix[k, 0] - v[k, V_X], epochs.fix[k, 1] - v[k, V_Y])
    own = epochs.fix[k, 2] * np.maximum(v[k, V_GNSS_SCALE], 1.0)
    far = far_off(away, np.sqrt(own**2 + v[k, V_XX] + v[k, V_YY])) & (output.live[k] > 0)
    last = np.searchsorted(k, np.arange(len(v)), side="right") - 1
    recent = (last >= 0) & (epochs.time - epochs.time[k[last]] <= RECENT)
    return np.where(recent, np.where(far, away, 0.0)[last], 0.0)


def path_table(drive_id: str, epochs: Epochs, recorded: Recorded, roads: RoadMap) -> pa.Table:
    """One row per traversed edge, in driving order.

    Args:
        drive_id: Its name.
        epochs: (n,) what the sensors said.
        recorded: The filter's output and most probable route.
        roads: The map.

    Returns:
        A table with the columns of `tables.PATH`.
    """
    rows = traversals(epochs, recorded, roads.arrays)
    edges = np.array([r.edge for r in rows], np.int64)
    middle = np.array([0.5 * (r.enter_m + r.exit_m) for r in rows])
    source, forward = _sources(roads, edges, middle, np.zeros(len(rows), bool))
    enter, leave = np.array([r.enter_m for r in rows]), np.array([r.exit_m for r in rows])
    x, y, first = roads.edge_lines(edges, enter, leave)
    lat, lon = roads.plane.to_geodetic(x, y)
    wkb = line_wkb(lon, lat, first) if rows else pa.array([], pa.binary())
    duration = np.array([r.exit_time - r.enter_time for r in rows])
    passed = duration > 0.0
    speed = np.divide(leave - enter, duration, out=np.zeros(len(rows)), where=passed)
    arrays = roads.arrays
    columns = {
        "drive_id": pa.array([drive_id] * len(rows), pa.string()),
        "seq": pa.array(np.arange(len(rows))),
        "edge_id": pa.array(edges, pa.int64()),
        "source_id": source,
        "from_node": pa.array(arrays.from_node[edges].astype(np.int64)),
        "to_node": pa.array(arrays.to_node[edges].astype(np.int64)),
        "forward": forward,
        "enter_time": times(np.array([r.enter_time for r in rows])),
        "exit_time": times(np.array([r.exit_time for r in rows])),
        "enter_m": pa.array(enter, pa.float64()),
        "exit_m": pa.array(leave, pa.float64()),
        "duration_s": pa.array(duration, pa.float64()),
        "mean_speed_mps": _nullable(speed, ~passed),
        "p": pa.array([r.p for r in rows], pa.float64()),
        "broken_rule": pa.array(
            [_broken(r, rows[i - 1] if i else None, roads) for i, r in enumerate(rows)], pa.string()
        ),
        "geometry": wkb,
    }
    return pa.table(columns).cast(PATH)


def _broken(row: Traversal, before: Traversal | None, roads: RoadMap) -> str | None:
    """Names of the rules that driving this row broke, or `gap`, or None."""
    if row.gap:
        return "gap"
    a = roads.arrays
    bits = int(a.rule[row.edge])
    if before is not None:
        for t in range(a.succ_first[before.edge], a.succ_first[before.edge + 1]):
            if a.succ[t] == row.edge:
                bits |= int(a.succ_rule[t])
    names = [name for bit, name in _RULES if bits & bit]
    return ",".join(names) or None


def summary_of(epochs: Epochs, output: Output, path: pa.Table, masked: int) -> dict[str, Any]:
    """The drive in numbers, for people and for JSON."""
    n = len(epochs.time)
    known = output.live > 0
    shares = {s: float(np.mean(output.status == i)) for i, s in enumerate(STATUS) if n}
    length = float(np.sum(np.abs(np.subtract(path["exit_m"], path["enter_m"]))))
    return {
        "epochs": n,
        "fixes": int(epochs.has_fix.sum()),
        "fixes_masked": masked,
        "epochs_without_answer": int((~known).sum()),
        "duration_s": float(epochs.time[-1] - epochs.time[0]) if n else 0.0,
        "path_m": length,
        "edges": path.num_rows,
        "gaps": int(sum(r == "gap" for r in path["broken_rule"].to_pylist())),
        "mean_p_road": float(output.value[known, V_P].mean()) if known.any() else 0.0,
        "mean_p_off_road": float(output.value[known, V_OFF].mean()) if known.any() else 0.0,
        "mean_live_hypotheses": float(output.live[known].mean()) if known.any() else 0.0,
        "status": {k: v for k, v in shares.items() if v > 0},
        "off_road_epochs": int((output.alt_edge[:, 0] == OFF_ROAD).sum()),
    }
