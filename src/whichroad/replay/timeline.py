"""A whole film in a few columns: what the page's strip and the report are drawn from."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..records import Array

if TYPE_CHECKING:
    from .recorded_messages import Film

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


def timeline(film: "Film", rows: int = ROWS) -> dict[str, Any]:
    """Columns of a film for JSON, times in seconds from its beginning.

    Args:
        film: Of one drive.
        rows: At most so many epochs.
    """
    c = film.columns
    at = thinned(film.time, c["p_road"], rows)
    edge, p = film.choices.edge[at], film.choices.p[at]
    return {
        "begin": round(float(film.time[0]), 6),
        "t": _rounded(film.time[at] - film.time[0], 3),
        "lat": _rounded(c["lat"][at], 7),
        "lon": _rounded(c["lon"][at], 7),
        "p": _rounded(np.nan_to_num(c["p_road"][at]), 4),
        "off": _rounded(np.nan_to_num(c["p_off_road"][at]), 4),
        "status": np.where(np.isfinite(c["lat"][at]), film.status[at], -1).tolist(),
        "masked": film.is_masked(film.time[at]).astype(int).tolist(),
        "roads": [
            [
                [e, round(share, 4)]
                for e, share in zip(es, ps, strict=True)
                if e >= -1 and share >= _LEAST
            ]
            for es, ps in zip(edge.tolist(), p.tolist(), strict=True)
        ],
        "ways": film.between(at),
        "fixes": _fixes(film),
        "reckoning": _reckoning(film, at),
    }


def _fixes(film: "Film") -> list[list[float | None]]:
    """Fixes: seconds from the beginning, position, ellipse, whether masked."""
    count = len(film.signals.fix_times)
    rows: list[list[float | None]] = []
    for i in range(0, count, max(1, -(-count // _FIXES))):
        fix = film.signals.fix_at(i, 0.0)
        shape = fix["ellipse"] or {"major_m": None, "minor_m": None, "bearing_deg": None}
        rows.append(
            [
                round(fix["epoch_s"] - float(film.time[0]), 2), round(fix["lat"], 7),
                round(fix["lon"], 7), *shape.values(), int(film.is_masked(fix["epoch_s"])),
            ]
        )  # fmt: skip
    return rows


def _reckoning(film: "Film", at: NDArray[Any]) -> list[list[float] | None]:
    """Wheels alone, where they are shown: position, bearing, since when."""
    rows: list[list[float] | None] = []
    for k in at.tolist():
        one = film.reckoning.at(k)
        rows.append(
            None
            if one is None
            else [
                round(one["lat"], 7), round(one["lon"], 7), round(one["bearing_deg"], 1),
                round(one["since_epoch_s"] - float(film.time[0]), 2),
            ]
        )  # fmt: skip
    return rows


def _rounded(values: Array, digits: int) -> list[float | None]:
    return [None if v != v else v for v in np.round(values, digits).tolist()]
