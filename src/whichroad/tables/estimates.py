"""The filter's estimates as whole columns, and in words why a status is what it is."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .._compile import Records
from ..filter.state import NO_EDGE
from ..filter.summary.estimate import AMBIGUOUS, Output
from ..observations import Array
from ..roadmap import RoadMap
from .status import COUNTS, RECENT, STATUS, far_off, reason, title

XX, XY, XH, YY, YH, HH = range(6)  # elements of the covariance of x, y, heading
_SHARES = [f"({0.01 * cents:.2f})" for cents in range(101)]  # probabilities in hundredths


class Estimates(NamedTuple):
    """Columns of `filter.summary.estimate.ESTIMATE` without gaps: what follows takes them whole."""

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
    map_scale: Array
    edge: NDArray[np.int32]
    live: NDArray[np.int32]
    alt_edge: NDArray[np.int32]  # (n, ALTERNATIVES)
    alt_p: NDArray[np.float32]
    status: NDArray[np.uint8]


def columns_of(output: Output) -> Estimates:
    """The columns of (n,) estimates."""
    rows = output.rows.view(np.ndarray)  # of which a field is had at once
    columns = {name: rows[name] for name in Estimates._fields}
    columns["cov"] = columns["cov"].T
    return Estimates(**{name: np.ascontiguousarray(c) for name, c in columns.items()})


def distinct(values: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """A row of each value of (n,) that differs, and which of those each row has.

    By a hash, which takes a fifth of the time that sorting does.
    """
    which = pa.array(values).dictionary_encode()
    at = which.indices.to_numpy().copy()
    one = np.empty(len(which.dictionary), np.int64)
    one[at] = np.arange(len(at))
    return one, at


def reasons(epochs: Records, v: Estimates, roads: RoadMap, begins: Sequence[int]) -> pa.Array:
    """Why each epoch's status is what it is; epochs of the same reason are put into words once."""
    n, status = len(epochs), v.status
    if not n:
        return pa.array([], pa.string())
    away = np.rint(_disbelieved(epochs, v, begins))
    scale = np.rint(10.0 * v.gnss_scale)
    scale[away > 0.0] = 0.0
    vie = (status == AMBIGUOUS) & (v.alt_edge[:, 0] != NO_EDGE)  # each names its roads
    key = (1e3 * away + scale) * 40.0 + 4.0 * status + 2.0 * vie + (v.live > 0)
    one, at = distinct(key)
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
    also = [texts[k] for k in at[rows].tolist()]
    words = _competing(v.alt_edge[rows], v.alt_p[rows].astype(np.float64), roads)
    at[rows] = len(texts) + np.arange(len(rows))
    texts += [f"{text}; {more}" if more else text for text, more in zip(words, also, strict=True)]
    return pa.array(texts, pa.string()).take(pa.array(at))


def _competing(edges: NDArray[Any], p: Array, roads: RoadMap) -> list[str]:
    """`status.competing` of (n, ALTERNATIVES) roads and their P, titles made once for each."""
    row, rank = np.nonzero((edges != NO_EDGE) & ((p >= COUNTS) | (np.arange(p.shape[1]) < 2)))
    road = edges[row, rank].tolist()
    cents = np.rint(100.0 * p[row, rank]).astype(np.int64)  # as two decimals are rounded
    known = list(dict.fromkeys(road))
    street = dict(zip(known, roads.names(np.maximum(known, 0)), strict=True)) if known else {}
    titles = {edge: title(edge, street.get) for edge in known}
    words = [f"{titles[e]} {_SHARES[c]}" for e, c in zip(road, cents.tolist(), strict=True)]
    ends = np.searchsorted(row, np.arange(len(edges) + 1)).tolist()
    return [" or ".join(words[begin:end]) for begin, end in pairwise(ends)]


def _disbelieved(epochs: Records, v: Estimates, first: Sequence[int]) -> Array:
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
