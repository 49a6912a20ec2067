"""What was found of drives, as columns: points, path, summary."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from .._compile import Records
from ..filter.estimate import AMBIGUOUS, Output
from ..filter.state import NO_EDGE, OFF_ROAD
from ..geodesy.angles import axis_bearing_of, bearing_of, degrees
from ..graph.network import AGAINST_ONE_WAY, NO_ACCESS, TURN_BANNED, U_TURN
from ..observations import Array
from ..roadmap import RoadMap
from ..sensors.gnss import ellipse
from ..traversals import Traversals
from .schema import ATTRIBUTES, PATH, POINTS, line_wkb, times
from .status import COUNTS, RECENT, STATUS, far_off, reason, title

_RULES = (
    (AGAINST_ONE_WAY, "against_one_way"),
    (TURN_BANNED, "turn_banned"),
    (NO_ACCESS, "no_access"),
    (U_TURN, "u_turn"),
)
XX, XY, XH, YY, YH, HH = range(6)  # elements of the covariance of x, y, heading
_GAP = 1 << 20  # flag of a gap, above all rules
_STATUS = pa.array(STATUS)
_SHARES = pa.array([f"({0.01 * cents:.2f})" for cents in range(101)])


class _Estimates(NamedTuple):
    """Columns of `filter.estimate.ESTIMATE` without gaps: all that follows takes them whole."""

    x: Array  # (n,)
    y: Array
    heading: Array
    cov: Array  # (6, n)
    p_edge: Array
    p_way: Array
    p_off_road: Array
    s: Array
    lateral: Array
    map_x: Array
    map_y: Array
    match_x: Array
    match_y: Array
    speed: Array
    protection_level: Array
    level_along: NDArray[np.float32]
    level_across: NDArray[np.float32]
    gnss_scale: Array
    edge: NDArray[np.int32]
    live: NDArray[np.int32]
    alt_edge: NDArray[np.int32]  # (n, ALTERNATIVES)
    alt_p: NDArray[np.float32]
    status: NDArray[np.uint8]


def _columns(output: Output) -> _Estimates:
    columns = {name: output.rows[name] for name in _Estimates._fields}
    columns["cov"] = columns["cov"].T
    return _Estimates(**{name: np.ascontiguousarray(c) for name, c in columns.items()})


def _nullable(values: Array, absent: NDArray[np.bool_]) -> pa.Array:
    return pa.array(values, mask=absent if absent.any() else None)


def _distinct(values: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """A row of each value of (n,) that differs, and which of those each row has.

    By a hash, which takes a fifth of the time that sorting does.
    """
    which = pa.array(values).dictionary_encode()
    at = which.indices.to_numpy().copy()
    one = np.empty(len(which.dictionary), np.int64)
    one[at] = np.arange(len(at))
    return one, at


def points_table(
    drive_id: str | Sequence[str], epochs: Records, output: Output, roads: RoadMap, *,
    attributes: bool = False, first: Sequence[int] = (0,),
) -> pa.Table:  # fmt: skip
    """One row per epoch; what is not known yet is null.

    Args:
        drive_id: Its name, or those of d drives one behind the other.
        epochs: (n,) the measurements.
        output: (n,) the estimates.
        roads: The map.
        attributes: Whether name, class and speed limit of the road are added.
        first: (d,) the row at which each drive begins.

    Returns:
        A table with the columns of `tables.schema.POINTS`.
    """
    names = [drive_id] if isinstance(drive_id, str) else drive_id
    plane, v = roads.plane, _columns(output)
    none, (lat, lon) = v.live == 0, plane.to_geodetic(v.x, v.y)
    map_lat, map_lon = plane.to_geodetic(v.map_x, v.map_y)
    match_lat, match_lon = plane.to_geodetic(v.match_x, v.match_y)
    turn = plane.convergence(v.x, v.y)
    bearing = bearing_of(v.heading - turn, 0.0)
    c, s = np.cos(turn), np.sin(turn)  # plane axes back to east and north
    xx, xy, yy = v.cov[XX], v.cov[XY], v.cov[YY]
    ee = c * c * xx + 2 * c * s * xy + s * s * yy
    nn = s * s * xx - 2 * c * s * xy + c * c * yy
    en = c * s * (yy - xx) + (c * c - s * s) * xy
    major, minor, axis = ellipse(ee, en, nn)
    off = none | (v.edge < 0)
    edge, s = np.where(off, 0, v.edge), np.where(off, 0.0, v.s)
    source, forward = _sources(roads, edge, s, off)
    columns = {
        "drive_id": _repeated(names, np.diff(first, append=len(epochs))),
        "time": times(epochs.time),
        "lat": _nullable(lat, none),
        "lon": _nullable(lon, none),
        "bearing_deg": _nullable(bearing, none),
        "speed_mps": _nullable(v.speed, none),
        "cov_ee_m2": _nullable(ee, none),
        "cov_en_m2": _nullable(en, none),
        "cov_nn_m2": _nullable(nn, none),
        "sigma_bearing_deg": _nullable(degrees(np.sqrt(np.maximum(v.cov[HH], 0))), none),
        "ellipse_major_m": _nullable(major, none),
        "ellipse_minor_m": _nullable(minor, none),
        "ellipse_bearing_deg": _nullable(axis_bearing_of(axis, 0.0), none),
        "edge_id": pa.array(v.edge.astype(np.int64), mask=off),
        "source_id": source,
        "forward": forward,
        "abscissa_m": _nullable(v.s, off),
        "lateral_m": _nullable(v.lateral, off),
        "matched_lat": _nullable(match_lat, off),
        "matched_lon": _nullable(match_lon, off),
        "map_lat": _nullable(map_lat, none),
        "map_lon": _nullable(map_lon, none),
        "p_road": _nullable(v.p_edge, none),
        "p_way": _nullable(v.p_way, none),
        "p_off_road": _nullable(v.p_off_road, none),
        "status": _STATUS.take(pa.array(v.status)),
        "reason": _reasons(epochs, v, roads, first),
        "alternatives": _alternatives(v),
        "protection_level_m": _nullable(v.protection_level, none),
        "level_along_m": _nullable(v.level_along.astype(float), none),
        "level_across_m": _nullable(v.level_across.astype(float), none),
        "gnss_scale": _nullable(v.gnss_scale, none | (v.gnss_scale == 0.0)),
    }
    table = pa.Table.from_arrays([columns[name] for name in POINTS.names], schema=POINTS)
    if attributes:
        for name, column in _attributes(roads, edge, off).items():
            table = table.append_column(name, column)
    return table


def _sources(
    roads: RoadMap, edge: NDArray[Any], s: Array, absent: NDArray[np.bool_]
) -> tuple[pa.Array, pa.Array]:
    """Source ids as text and directions; few streets differ, so each is asked for once."""
    piece = pa.array(roads.piece(edge, s), mask=absent).dictionary_encode()
    ids, forward = roads.drawn_as(piece.dictionary.to_numpy())
    texts = pa.array(ids).cast(pa.string())
    return texts.take(piece.indices), pa.array(forward).take(piece.indices)


def _attributes(
    roads: RoadMap, edge: NDArray[Any], absent: NDArray[np.bool_]
) -> dict[str, pa.Array]:
    unique, at = np.unique(edge, return_inverse=True)
    rows = [roads.attributes(int(e)) for e in unique]
    return {
        field.name: pa.array([row.get(field.name) for row in rows], field.type).take(
            pa.array(at, mask=absent)
        )
        for field in ATTRIBUTES
    }


def _alternatives(v: _Estimates) -> pa.Array:
    on = np.flatnonzero(v.alt_edge >= 0)  # in the order of rows
    n, width = v.alt_edge.shape
    ends = np.zeros(n + 1, np.int32)
    np.cumsum(np.bincount(on // width, minlength=n), out=ends[1:])
    rows = pa.StructArray.from_arrays(
        [
            pa.array(v.alt_edge.take(on).astype(np.int64)),
            pa.array(v.alt_p.take(on).astype(np.float64)),
        ],
        names=["edge_id", "p"],
    )
    return pa.ListArray.from_arrays(pa.array(ends), rows)


def _reasons(epochs: Records, v: _Estimates, roads: RoadMap, begins: Sequence[int]) -> pa.Array:
    """Why each epoch's status is what it is; epochs of the same reason are put into words once."""
    n, status = len(epochs), v.status
    if not n:
        return pa.array([], pa.string())
    away = np.rint(_disbelieved(epochs, v, begins))
    scale = np.rint(10.0 * v.gnss_scale)
    scale[away > 0.0] = 0.0
    vie = (status == AMBIGUOUS) & (v.alt_edge[:, 0] != NO_EDGE)  # each names its roads
    key = (1e3 * away + scale) * 40.0 + 4.0 * status + 2.0 * vie + (v.live > 0)
    one, at = _distinct(key)
    texts = [
        reason(
            "on_road" if vie[k] else STATUS[status[k]],
            disbelieved=away[k],
            scale=0.1 * scale[k],
            answered=v.live[k] > 0,
        )
        for k in one
    ]
    rows = np.flatnonzero(vie)
    usual = pa.array(texts, pa.string())
    also = pa.array([text or None for text in texts], pa.string()).take(pa.array(at[rows]))
    words = _competing(v.alt_edge[rows], v.alt_p[rows].astype(np.float64), roads)
    words = pc.binary_join_element_wise(words, also, "; ", null_handling="skip")
    at[rows] = len(texts) + np.arange(len(rows))
    return pa.concat_arrays([usual, words]).take(pa.array(at))


def _competing(edges: NDArray[Any], p: Array, roads: RoadMap) -> pa.Array:
    """`status.competing` of (n, ALTERNATIVES) roads and their P, words made once for each."""
    row, rank = np.nonzero((edges != NO_EDGE) & ((p >= COUNTS) | (np.arange(p.shape[1]) < 2)))
    road = pa.array(edges[row, rank]).dictionary_encode()
    cents = np.rint(100.0 * p[row, rank]).astype(np.int64)  # as two decimals are rounded
    competitors = pc.binary_join_element_wise(
        _titles(road.dictionary, roads).take(road.indices), _SHARES.take(pa.array(cents)), " "
    )
    ends = np.searchsorted(row, np.arange(len(edges) + 1)).astype(np.int32)
    return pc.binary_join(pa.ListArray.from_arrays(pa.array(ends), competitors), " or ")


def _titles(edge: pa.Array, roads: RoadMap) -> pa.Array:
    """`status.title` of (n,) edges."""
    on = pc.greater_equal(edge, 0)
    number = pc.binary_join_element_wise("edge", edge.cast(pa.string()), " ")
    street = roads.names(np.maximum(edge.to_numpy(), 0))
    named = pc.binary_join_element_wise(street, number, ", ", null_handling="skip")
    return pc.if_else(on, named, title(OFF_ROAD, lambda _: None))


def _disbelieved(epochs: Records, v: _Estimates, first: Sequence[int]) -> Array:
    """How far away (m) the last fix lies that is not believed, 0 where it is, or none is recent."""
    n, k = len(epochs), np.flatnonzero(epochs.has_fix)
    if not len(k):
        return np.zeros(n)
    every = len(k) == n
    at = slice(None) if every else k
    fix = epochs.fix
    dx, dy = fix[at, 0] - v.x[at], fix[at, 1] - v.y[at]
    away = np.sqrt(dx * dx + dy * dy)
    own = fix[at, 2] * np.maximum(v.gnss_scale[at], 1.0)
    far = far_off(away, np.sqrt(own**2 + v.cov[XX, at] + v.cov[YY, at])) & (v.live[at] > 0)
    away = np.where(far, away, 0.0)
    if every:
        return away
    time = epochs.time
    last = np.searchsorted(k, np.arange(n), side="right") - 1
    begin = np.repeat(first, np.diff(first, append=n))  # of the row's own drive
    recent = (last >= 0) & (k[last] >= begin) & (time - time[k[last]] <= RECENT)
    return np.where(recent, away[last], 0.0)


def path_table(
    names: Sequence[str], driven: Traversals, roads: RoadMap, first: Sequence[int] | None = None
) -> pa.Table:
    """One row per traversed edge, in driving order, drive after drive.

    Args:
        names: (d,) of the drives.
        driven: Their routes, one behind the other.
        roads: The map.
        first: (d + 1,) where each begins, and the number of edges; None: there is one.

    Returns:
        A table with the columns of `tables.schema.PATH`.
    """
    count = np.diff(first if first is not None else [0, len(driven.edge)])
    edges, enter, leave, rows = driven.edge, driven.enter_m, driven.exit_m, len(driven.edge)
    source, forward = _sources(roads, edges, 0.5 * (enter + leave), np.zeros(rows, bool))
    duration = driven.exit_time - driven.enter_time
    passed = duration > 0.0
    speed = np.divide(leave - enter, duration, out=np.zeros(rows), where=passed)
    of_edges = roads.arrays.edges
    columns = {
        "drive_id": _repeated(names, count),
        "seq": pa.array(np.arange(rows) - np.repeat(np.cumsum(count) - count, count)),
        "edge_id": pa.array(edges, pa.int64()),
        "source_id": source,
        "from_node": pa.array(of_edges.from_node[edges].astype(np.int64)),
        "to_node": pa.array(of_edges.to_node[edges].astype(np.int64)),
        "forward": forward,
        "enter_time": times(driven.enter_time),
        "exit_time": times(driven.exit_time),
        "enter_m": pa.array(enter),
        "exit_m": pa.array(leave),
        "duration_s": pa.array(duration),
        "mean_speed_mps": _nullable(speed, ~passed),
        "p": pa.array(driven.p),
        "broken_rule": _broken(driven),
        "geometry": _lines(edges, enter, leave, roads),
    }
    return pa.Table.from_arrays([columns[name] for name in PATH.names], schema=PATH)


def _lines(edges: NDArray[Any], enter: Array, leave: Array, roads: RoadMap) -> pa.Array:
    """Edges as they were driven, as WKB; an edge that several drove as a whole is drawn once."""
    rows = len(edges)
    if not rows:
        return pa.array([], pa.binary())
    whole = (enter <= 0.0) & (leave >= roads.arrays.edges.length[edges])
    key = np.where(whole, edges, len(roads) + np.arange(rows))
    one, at = _distinct(key)
    x, y, vertex = roads.edge_lines(edges[one], enter[one], leave[one])
    lat, lon = roads.plane.to_geodetic(x, y)
    return line_wkb(lon, lat, vertex).take(pa.array(at))


def _repeated(names: Sequence[str], count: NDArray[Any]) -> pa.Array:
    """Each name, repeated as often as given."""
    return pa.array(names, pa.string()).take(pa.array(np.repeat(np.arange(len(names)), count)))


def _broken(driven: Traversals) -> pa.Array:
    """Names of the rules that driving each edge broke, or `gap`, or None."""
    rules = np.where(driven.gap, _GAP, driven.rules)
    one, at = _distinct(rules)
    words = [_rule_names(int(b)) for b in rules[one]]
    return pa.array(words, pa.string()).take(pa.array(at))


def _rule_names(bits: int) -> str | None:
    if bits == _GAP:
        return "gap"
    return ",".join(name for bit, name in _RULES if bits & bit) or None


def figures_of(
    epochs: Records, output: Output, first: Sequence[int], driven: Traversals, begins: Sequence[int]
) -> dict[str, NDArray[Any]]:
    """The numeric columns of `tables.schema.DRIVES`, (d,) each.

    Args:
        epochs: (n,) of the drives, one behind the other.
        output: (n,) their estimates.
        first: (d + 1,) the epoch at which each begins, and n.
        driven: (r,) their routes, one behind the other.
        begins: (d + 1,) where each begins, and r.
    """
    rows, time = output.rows, epochs.time
    known = rows.live > 0
    answered = _sums(known, first)
    low, high = np.array(first[:-1]), np.array(first[1:])
    some = high > low
    ends = time[np.where(some, high - 1, 0)] - time[np.where(some, low, 0)]
    return {
        "epochs": high - low,
        "fixes": _sums(epochs.has_fix > 0, first),
        "epochs_without_answer": high - low - answered,
        "duration_s": np.where(some, ends, 0.0),
        "path_m": _sums(np.abs(driven.exit_m - driven.enter_m), begins),
        "edges": np.diff(begins),
        "gaps": _sums(driven.gap > 0, begins),
        "mean_p_road": _sums(rows.p_edge * known, first) / np.maximum(answered, 1),
        "mean_p_off_road": _sums(rows.p_off_road * known, first) / np.maximum(answered, 1),
    }


def _sums(values: NDArray[Any], first: Sequence[int]) -> NDArray[Any]:
    """The sum of each part; parts begin at `first`, whose last number is where all end."""
    if values.dtype == np.bool_:
        values = values.astype(np.int64)
    begin = np.array(first)
    some = begin[1:] > begin[:-1]
    sums = np.zeros(len(some), values.dtype)
    if some.any():
        sums[some] = np.add.reduceat(values, begin[:-1][some])
    return sums


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if len(values) else 0.0


def summary_of(epochs: Records, output: Output, driven: Traversals, masked: int) -> dict[str, Any]:
    """The drive in numbers, for people and for JSON."""
    n, rows = len(epochs), output.rows
    shares = {s: float(np.mean(rows.status == i)) for i, s in enumerate(STATUS) if n}
    figures = figures_of(epochs, output, [0, n], driven, [0, len(driven.edge)])
    return {name: column[0].item() for name, column in figures.items()} | {
        "fixes_masked": masked,
        "mean_live_hypotheses": _mean(rows.live[rows.live > 0]),
        "status": {k: v for k, v in shares.items() if v > 0},
        "off_road_epochs": int((rows.alt_edge[:, 0] == OFF_ROAD).sum()),
    }
