"""What was found of drives, as columns: points, path, summary."""

import math
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .._compile import Records
from ..filter.state import OFF_ROAD
from ..filter.summary.estimate import Output
from ..geodesy.angles import axis_bearing_of, bearing_of, degrees
from ..graph.network import AGAINST_ONE_WAY, NO_ACCESS, TURN_BANNED, U_TURN
from ..lookback.traversals import Traversals
from ..observations import Array
from ..ragged import row_and_place
from ..roadmap import RoadMap
from ..roadmap.edge_tables import on_sources
from ..roadmap.source_places import on_source
from ..sensors.gnss import ellipse
from .estimates import HH, XX, XY, YY, Estimates, columns_of, distinct, reasons
from .schema import ATTRIBUTES, PATH, POINTS, line_wkb, times
from .status import STATUS

_RULES = (
    (AGAINST_ONE_WAY, "against_one_way"),
    (TURN_BANNED, "turn_banned"),
    (NO_ACCESS, "no_access"),
    (U_TURN, "u_turn"),
)
_SUMS = ("epochs", "fixes", "epochs_without_answer", "duration_s", "path_m", "edges", "gaps",
         "fixes_masked", "off_road_epochs")  # figures of drives that add up  # fmt: skip
_MEANS = ("mean_p_road", "mean_p_off_road", "mean_p_way", "mean_live_hypotheses")  # of answers
_GAP = 1 << 20  # flag of a gap, above all rules


@lru_cache(maxsize=1)
def _statuses() -> pa.Array:
    """The words of `STATUS`.  Arrow's first array brings pandas: not where this is imported."""
    return pa.array(STATUS)


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
    plane, v, n = roads.plane, columns_of(output), len(epochs)
    none = v.live == 0
    places = plane.to_geodetic(  # in one call: of short drives each takes as long as its rows
        np.concatenate([v.x, v.map_x, v.match_x]), np.concatenate([v.y, v.map_y, v.match_y])
    )
    (lat, map_lat, match_lat), (lon, map_lon, match_lon) = (c.reshape(3, n) for c in places)
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
    piece = roads.piece(edge, s)
    off, none = (absent if absent.any() else None for absent in (off, none))
    source, forward = _sources(roads, piece, off)
    place = on_source(roads, edge, piece, s)
    columns = {
        "drive_id": _repeated(names, np.diff([*first, n])),
        "time": times(epochs.time),
        "lat": pa.array(lat, mask=none),
        "lon": pa.array(lon, mask=none),
        "bearing_deg": pa.array(bearing, mask=none),
        "speed_mps": pa.array(v.speed, mask=none),
        "cov_ee_m2": pa.array(ee, mask=none),
        "cov_en_m2": pa.array(en, mask=none),
        "cov_nn_m2": pa.array(nn, mask=none),
        "sigma_bearing_deg": pa.array(degrees(np.sqrt(np.maximum(v.cov[HH], 0))), mask=none),
        "ellipse_major_m": pa.array(major, mask=none),
        "ellipse_minor_m": pa.array(minor, mask=none),
        "ellipse_bearing_deg": pa.array(axis_bearing_of(axis, 0.0), mask=none),
        "edge_id": pa.array(v.edge.astype(np.int64), mask=off),
        "source_id": source,
        "forward": forward,
        "abscissa_m": pa.array(v.s, mask=off),
        "lateral_m": pa.array(v.lateral, mask=off),
        "matched_lat": pa.array(match_lat, mask=off),
        "matched_lon": pa.array(match_lon, mask=off),
        "map_lat": pa.array(map_lat, mask=none),
        "map_lon": pa.array(map_lon, mask=none),
        "p_road": pa.array(v.p_edge, mask=none),
        "p_way": pa.array(v.p_way, mask=none),
        "p_off_road": pa.array(v.p_off_road, mask=none),
        "status": _statuses().take(pa.array(v.status)),
        "reason": reasons(epochs, v, roads, first),
        "alternatives": _alternatives(v),
        "protection_level_m": pa.array(v.protection_level, mask=none),
        "level_along_m": pa.array(v.level_along.astype(float), mask=none),
        "level_across_m": pa.array(v.level_across.astype(float), mask=none),
        "gnss_scale": pa.array(v.gnss_scale, mask=(v.live == 0) | (v.gnss_scale == 0.0)),
        "map_scale": pa.array(v.map_scale, mask=none),
        "source_m": pa.array(place.m, mask=off),
        "source_share": pa.array(place.share, mask=off),
    }
    table = pa.Table.from_arrays([columns[name] for name in POINTS.names], schema=POINTS)
    if attributes:
        for name, column in _attributes(roads, edge, s, off).items():
            table = table.append_column(name, column)
    return table


def _sources(
    roads: RoadMap, piece: NDArray[Any], absent: NDArray[np.bool_] | None = None
) -> tuple[pa.Array, pa.Array]:
    """Source ids of `pieces` as text, and directions; rows on end share a street's text."""
    new = np.ones(len(piece), bool)
    new[1:] = piece[1:] != piece[:-1]
    ids, forward = roads.drawn_as(piece[new])
    texts = pa.array([None if one is None else str(one) for one in ids], pa.string())
    if absent is None and len(texts) == len(piece):
        return texts, pa.array(forward)
    at = np.cumsum(new) - 1
    return texts.take(pa.array(at, mask=absent)), pa.array(forward[at], mask=absent)


def _attributes(
    roads: RoadMap, edge: NDArray[Any], s: Array, absent: NDArray[np.bool_] | None
) -> dict[str, pa.Array]:
    """Those of the street at each place, as `source_id` is."""
    _, first, at = np.unique(roads.piece(edge, s), return_index=True, return_inverse=True)
    rows = [roads.attributes(int(e), float(a)) for e, a in zip(edge[first], s[first], strict=True)]
    return {
        field.name: pa.array([row.get(field.name) for row in rows], field.type).take(
            pa.array(at, mask=absent)
        )
        for field in ATTRIBUTES
    }


def _alternatives(v: Estimates) -> pa.Array:
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
    rows, of_edges = len(driven), roads.arrays.edges.view(np.ndarray)
    driven = driven.view(np.ndarray)  # of which a field is had at once
    edges, enter, leave = driven["edge"], driven["enter_m"], driven["exit_m"]
    count = np.diff([0, rows] if first is None else first)
    piece = roads.piece(edges, 0.5 * (enter + leave))
    source, forward = _sources(roads, piece)
    duration = driven["exit_time"] - driven["enter_time"]
    passed = duration > 0.0
    speed = np.divide(leave - enter, duration, out=np.zeros(rows), where=passed)
    columns = {
        "drive_id": _repeated(names, count),
        "seq": pa.array(row_and_place(count)[1]),
        "edge_id": pa.array(edges, pa.int64()),
        "source_id": source,
        "from_node": pa.array(of_edges["from_node"][edges].astype(np.int64)),
        "to_node": pa.array(of_edges["to_node"][edges].astype(np.int64)),
        "forward": forward,
        "enter_time": times(driven["enter_time"]),
        "exit_time": times(driven["exit_time"]),
        "enter_m": pa.array(enter),
        "exit_m": pa.array(leave),
        "duration_s": pa.array(duration),
        "mean_speed_mps": pa.array(speed, mask=~passed),
        "p": pa.array(driven["p"]),
        "p_route": pa.array(driven["p_route"]),
        "broken_rule": _broken(driven),
        **on_sources(roads, edges, piece, enter, leave),
        "geometry": (_lines if len(count) == 1 else _shared_lines)(edges, enter, leave, roads),
    }
    return pa.Table.from_arrays([columns[name] for name in PATH.names], schema=PATH)


def _lines(edges: NDArray[Any], enter: Array, leave: Array, roads: RoadMap) -> pa.Array:
    """Edges as they were driven, as WKB."""
    if not len(edges):
        return pa.array([], pa.binary())
    x, y, vertex = roads.edge_lines(edges, enter, leave)
    lat, lon = roads.plane.to_geodetic(x, y)
    return line_wkb(lon, lat, vertex)


def _shared_lines(edges: NDArray[Any], enter: Array, leave: Array, roads: RoadMap) -> pa.Array:
    """The same; an edge that several drives drove as a whole is drawn once."""
    whole = (enter <= 0.0) & (leave >= roads.arrays.edges["length"][edges])
    key = np.where(whole, edges, len(roads) + np.arange(len(edges)))
    one, at = distinct(key)
    return _lines(edges[one], enter[one], leave[one], roads).take(pa.array(at))


def _repeated(names: Sequence[str], count: NDArray[Any]) -> pa.Array:
    """Each name, repeated as often as given."""
    if len(names) == 1:
        return pa.repeat(pa.scalar(names[0], pa.string()), count[0])
    return pa.array(names, pa.string()).take(pa.array(np.repeat(np.arange(len(names)), count)))


def _broken(driven: NDArray[Any]) -> pa.Array:
    """Names of the rules that driving each edge broke, or `gap`, or None."""
    rules = np.where(driven["gap"], _GAP, driven["rules"])
    if not rules.any():
        return pa.nulls(len(rules), pa.string())
    one, at = distinct(rules)
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
        "mean_p_way": _mean(rows.p_way[rows.live > 0]),
        "fixes_masked": masked,
        "mean_live_hypotheses": _mean(rows.live[rows.live > 0]),
        "status": {k: v for k, v in shares.items() if v > 0},
        "off_road_epochs": int((rows.alt_edge[:, 0] == OFF_ROAD).sum()),
    }


def summary_of_several(summaries: Sequence[dict[str, Any]], failed: list[str]) -> dict[str, Any]:
    """The figures of several drives as of one, over all their epochs.

    Args:
        summaries: Of each that was answered; kept as `each`.
        failed: The names of the others, each with the reason.
    """
    epochs = [one["epochs"] for one in summaries]
    answered = [one["epochs"] - one["epochs_without_answer"] for one in summaries]
    skipped: Counter[str] = Counter()
    for one in summaries:
        skipped.update(one["skipped"])
    figures: dict[str, Any] = {"drives": len(summaries), "failed": failed}
    for name in _SUMS:
        values = [one[name] for one in summaries]
        figures[name] = math.fsum(values) if isinstance(values[0], float) else sum(values)
    for name in _MEANS:
        figures[name] = _shared([one[name] for one in summaries], answered)
    words = [word for word in STATUS if any(word in one["status"] for one in summaries)]
    figures["status"] = {
        word: _shared([one["status"].get(word, 0.0) for one in summaries], epochs) for word in words
    }
    notes = dict.fromkeys(note for one in summaries for note in one["notes"])
    return figures | {"skipped": dict(skipped), "notes": list(notes), "each": list(summaries)}


def _shared(means: Sequence[float], counts: Sequence[int]) -> float:
    """The mean of parts as one, each with its mean and its count."""
    return math.fsum(m * n for m, n in zip(means, counts, strict=True)) / max(sum(counts), 1)
