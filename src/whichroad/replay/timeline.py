"""A whole drive in a few columns, for the page's timeline and the report."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..observations import Array

if TYPE_CHECKING:
    from .recorded_messages import RecordedMessages
    from .truth import Truth

ROWS = 12_000
_FIXES = 4_000
_LEAST = 0.005  # P below which a road is not listed


def thinned(time: Array, p: Array, rows: int = ROWS) -> NDArray[np.int64]:
    """At most so many epochs: of each stretch the one whose road is least probable.

    Args:
        time: (n,) s.
        p: (n,) P(road), NaN where there is no answer.
        rows: How many.

    Returns:
        Indices, rising.
    """
    n = len(time)
    if n <= rows:
        return np.arange(n)
    cell = np.floor((time - time[0]) / (time[-1] - time[0]) * (rows - 1e-6)).astype(np.int64)
    order = np.lexsort((np.nan_to_num(p, nan=2.0), cell))
    first = np.flatnonzero(np.diff(cell[order], prepend=-1))
    chosen: NDArray[np.int64] = np.sort(order[first])
    return chosen


def timeline(
    recorded: "RecordedMessages", rows: int = ROWS, truth: "Truth | None" = None
) -> dict[str, Any]:
    """Columns of a drive for JSON, times in seconds from its beginning.

    Args:
        recorded: Of one drive.
        rows: At most so many epochs.
        truth: Where the vehicle really was.
    """
    c = recorded.columns
    at = thinned(recorded.time, c["p_way"], rows)
    edge, p = recorded.choices.edge[at], recorded.choices.p[at]
    return {
        "begin": round(float(recorded.time[0]), 6),
        "t": rounded(recorded.time[at] - recorded.time[0], 3),
        "lat": rounded(c["lat"][at], 7),
        "lon": rounded(c["lon"][at], 7),
        "p": rounded(np.nan_to_num(c["p_way"][at]), 4),
        "off": rounded(np.nan_to_num(c["p_off_road"][at]), 4),
        "status": np.where(np.isfinite(c["lat"][at]), recorded.status[at], -1).tolist(),
        "masked": recorded.is_masked(recorded.time[at]).astype(int).tolist(),
        "roads": [
            [
                [e, round(share, 4)]
                for e, share in zip(es, ps, strict=True)
                if e >= -1 and share >= _LEAST
            ]
            for es, ps in zip(edge.tolist(), p.tolist(), strict=True)
        ],
        "ways": recorded.between(at),
        "fixes": _fixes(recorded),
        "reckoning": _reckoning(recorded, at),
        "truth": None if truth is None else truth.beside(recorded, at),
    }


def _fixes(recorded: "RecordedMessages") -> list[list[float | None]]:
    """Fixes: seconds from the beginning, position, ellipse, whether masked."""
    count = len(recorded.signals.fix_times)
    rows: list[list[float | None]] = []
    for i in range(0, count, max(1, -(-count // _FIXES))):
        fix = recorded.signals.fix_at(i, 0.0)
        shape = fix["ellipse"] or {"major_m": None, "minor_m": None, "bearing_deg": None}
        rows.append(
            [
                round(fix["epoch_s"] - float(recorded.time[0]), 2), round(fix["lat"], 7),
                round(fix["lon"], 7), *shape.values(), int(recorded.is_masked(fix["epoch_s"])),
            ]
        )  # fmt: skip
    return rows


def _reckoning(recorded: "RecordedMessages", at: NDArray[Any]) -> list[list[float] | None]:
    """Wheels alone, where they are shown: position, bearing, since when."""
    rows: list[list[float] | None] = []
    for k in at.tolist():
        one = recorded.reckoning.at(k)
        rows.append(
            None
            if one is None
            else [
                round(one["lat"], 7), round(one["lon"], 7), round(one["bearing_deg"], 1),
                round(one["since_epoch_s"] - float(recorded.time[0]), 2),
            ]
        )  # fmt: skip
    return rows


def rounded(values: Array, digits: int) -> list[float | None]:
    """Numbers for JSON, None where one is not known."""
    return [None if v != v else v for v in np.round(values, digits).tolist()]
