"""Figures of a comparison: errors, honesty, right roads."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import DriveError, SettingError
from ..geodesy.angles import degrees
from ..observations import Array
from ..wording import counted
from .compare import Comparison, compare
from .input_tables import Bools, Table, read_table, read_truth_table, renamed

COVERAGE = (0.5, 0.9, 0.95, 0.99)
SURE = 0.999
"""A road declared with this probability should be wrong once in a thousand cases."""

_STRANGE_M = 100.0  # m; a median error that suggests two different drives
_IN_BOTH = frozenset(("edge_id", "abscissa_m"))  # columns that both tables must have
_OF_ROADS = frozenset(("abscissa_m", "p_road"))  # columns that say something of a road only
_BINS = np.array([0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 0.999])


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Figures of one or many drives; shares are between 0 and 1.

    What the tables do not give is NaN: figures of edges without edges in both, of covariances
    and probabilities without these in the answer.
    """

    epochs: int
    rmse_m: float
    median_m: float
    p95_m: float
    along_rmse_m: float
    cross_rmse_m: float
    heading_rmse_deg: float
    anees: float  # position; 1 is consistent, more is over-confident
    anees_pose: float
    coverage: tuple[float, ...]  # share inside the `COVERAGE` ellipses
    map_rmse_m: float  # in the map's frame; infinite where the tables do not have it
    right_edge: float
    right_edge_strict: float
    abscissa_rmse_m: float
    brier: float
    calibration_error: float  # mean gap between P(road) and how often it is right
    sure: float  # share declared at `SURE` or more
    sure_wrong: float  # share of those that are wrong
    p_off_on_road: float  # mean P(off-road) while on mapped roads
    p_off_off_road: float  # and while off them; 0 where the truth never is
    outage: "Evaluation | None" = None  # the same inside outages

    def figures(self) -> dict[str, float | int]:
        """Names and numbers that are known, those of outages behind `outage_`."""
        out: dict[str, float | int] = {}
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name == "coverage":
                shares = zip(COVERAGE, value, strict=True)
                out |= {f"inside_{100 * c:g}": v for c, v in shares if np.isfinite(v)}
            elif f.name != "outage":
                out |= {f.name: value} if np.isfinite(value) else {}
            elif value is not None:
                out |= {f"outage_{name}": v for name, v in value.figures().items()}
        return out


def evaluate(
    points: Any,
    truth: Any,
    *,
    mask: Sequence[tuple[float, float]] = (),
    skip_s: float = 0.0,
    moving: bool = False,
) -> Evaluation:
    """Compare one drive's points with its truth.

    Args:
        points: The answer, as pandas, GeoPandas, Arrow or a dict: time, lat, lon, and whatever
            is known of the points table (docs/reference/columns.md).  Each adds its figures:
            bearing_deg; cov_ee_m2, cov_en_m2, cov_nn_m2 or sigma_m; sigma_bearing_deg; edge_id
            or source_id; abscissa_m; p_road; p_off_road; map_lat, map_lon.
        truth: time, lat, lon, and if known bearing_deg (else the course), edge_id or source_id,
            abscissa_m, speed_mps, on_road, map_lat, map_lon, travelled_m, outage.
        mask: Outages as (from, to), s since 1970, besides the truth's own.
        skip_s: Leave out so much of the drive's beginning.
        moving: Leave out standstill.

    Returns:
        Figures over all epochs with a position, and inside outages.

    Raises:
        DriveError: No epoch has both a position and a truth.
        ReadError: A column is missing or not of its kind.
    """
    c = compare(points, truth, mask=mask)
    keep = c.since >= skip_s
    if moving:
        keep &= ~c.stopped
    return score(c, keep)


class Scored(NamedTuple):
    """What files gave."""

    figures: dict[str, float | int]  # by name
    notes: tuple[str, ...]  # on what was not compared, a sentence each
    further: dict[str, str]  # columns that would add figures -> these figures


def evaluate_files(
    result: str | PathLike[str],
    truth: str | PathLike[str],
    *,
    mask: Sequence[tuple[Any, Any]] = (),
    columns: Mapping[str, str] | None = None,
) -> Mapping[str, float | int]:
    """`evaluate` for tables in files (.parquet, .arrow, .csv, .geojson): names and figures.

    Args:
        result: The answer's file.
        truth: The truth's file, or the folder that `whichroad simulate` wrote.
        mask: Outages besides the truth's own, as `match` takes them: seconds since the first
            epoch of the result, or times.
        columns: Own names of columns of either table: {"time": "ts"}.

    Raises:
        ReadError: A file is not such a table, or lacks a column.
        DriveError: The tables have no epoch in common.
        SettingError: The mask holds no epoch.
    """
    return score_files(result, truth, mask=mask, columns=columns).figures


def score_files(
    result: str | PathLike[str],
    truth: str | PathLike[str],
    *,
    mask: Sequence[tuple[Any, Any]] = (),
    columns: Mapping[str, str] | None = None,
) -> Scored:
    """The same with notes and with what further columns would add."""
    tables = {Path(result).name: read_table(Path(result))}
    tables[f"truth {Path(truth).name}"] = read_truth_table(Path(truth))
    answer, true = renamed(tables, columns or {})
    times = Table(answer, Path(result).name).times()
    windows = absolute_windows(mask, times)
    figures = evaluate(answer, true, mask=windows).figures()
    notes = notes_on(figures, len(times))
    return Scored(figures, notes, further_columns(figures, set(answer), set(true)))


def absolute_windows(mask: Sequence[tuple[Any, Any]], times: Array) -> list[tuple[float, float]]:
    """Windows in seconds since 1970; numbers count from the first epoch.

    Raises:
        SettingError: A window holds no epoch.
    """
    windows = []
    for begin, end in mask:
        low, high = (
            float(t.timestamp()) if hasattr(t, "timestamp") else float(times.min() + t)
            for t in (begin, end)
        )
        if not ((times >= low) & (times <= high)).any():
            since = times.min()
            raise SettingError(
                f"mask: no epoch of the result is between {low - since:,.0f} and "
                f"{high - since:,.0f} s after its first, and the last is at "
                f"{times.max() - since:,.0f} s; a window within the result was expected"
            )
        windows.append((low, high))
    return windows


def notes_on(figures: Mapping[str, float | int], epochs: int) -> tuple[str, ...]:
    """What a reader of the figures should know.

    Args:
        figures: Of a comparison.
        epochs: How many epochs the answer has.
    """
    notes = []
    compared = int(figures["epochs"])
    if compared < epochs:
        notes.append(
            f"{epochs - compared:,} of {counted(epochs, 'epoch')} of the result are left out: "
            "without a position, or without a truth at their time"
        )
    if figures["median_m"] > _STRANGE_M:
        notes.append(
            f"half of the epochs are more than {figures['median_m']:,.0f} m from the truth; "
            "a result and a truth of one drive were expected"
        )
    return tuple(notes)


FURTHER = {
    "bearing_deg": "heading_rmse_deg",
    "cov_ee_m2": "anees, inside_95",
    "edge_id": "right_edge",
    "p_road": "brier, calibration_error, sure_wrong",
    "abscissa_m": "abscissa_rmse_m",
    "p_off_road": "p_off_on_road",
    "sigma_bearing_deg": "anees_pose",
}
"""Columns that an answer may lack, and the figures that each would add."""

MEANINGS = {
    "epochs": "rows that were compared",
    "rmse_m": "position error (RMS)",
    "median_m": "half of the errors are smaller",
    "p95_m": "95 % of the errors are smaller",
    "along_rmse_m": "error along the direction of motion (RMS)",
    "cross_rmse_m": "error across it (RMS)",
    "heading_rmse_deg": "error of the bearing (RMS)",
    "anees": "squared error over the stated one: 1 is right, more is too sure",
    "anees_pose": "the same with the bearing",
    "inside_50": "share of the truth inside the 50 % ellipse",
    "inside_90": "inside the 90 % ellipse",
    "inside_95": "inside the 95 % ellipse",
    "inside_99": "inside the 99 % ellipse",
    "map_rmse_m": "position error in the map's frame (RMS)",
    "right_edge": "share of epochs on the right road, within 10 m of travel",
    "right_edge_strict": "the same without those 10 m",
    "abscissa_rmse_m": "error of the place along the road (RMS)",
    "brier": "squared error of P(road): 0 is best",
    "calibration_error": "gap between P(road) and how often it is right",
    "sure": "share of epochs with P(road) of 0.999 or more",
    "sure_wrong": "share of those on a wrong road",
    "p_off_on_road": "mean P(off road) while on mapped roads",
    "p_off_off_road": "mean P(off road) while off them",
}
"""What the figures mean, in words."""


def further_columns(
    figures: Mapping[str, float | int],
    result: Set[str] = frozenset(),
    truth: Set[str] = frozenset(),
) -> dict[str, str]:
    """Columns that would add figures to an answer's, and which these are.

    Args:
        figures: Of a comparison.
        result: Columns of the answer.
        truth: Columns of the truth; with both a column names the table that lacks it.
    """
    lacking = {
        column: adds for column, adds in FURTHER.items()
        if not any(name in figures for name in adds.split(", "))
    }  # fmt: skip
    if not truth:
        return lacking
    named = {}
    for column, adds in lacking.items():
        in_both = column in _IN_BOTH
        where = ["result"] if column not in result else []
        where += ["truth"] if in_both and column not in truth else []
        if column in _OF_ROADS and "edge_id" in lacking:
            continue  # without roads in both tables it adds nothing
        if where:
            named[f"{column} of the {' and of the '.join(where)}"] = adds
    return named


def score(c: Comparison, keep: Bools | None = None) -> Evaluation:
    """Figures of a comparison, or of those of its rows that are to be kept (n,).

    Raises:
        DriveError: No row is kept.
    """
    if keep is not None:
        c = c.rows(keep)
    if not len(c.since):
        raise DriveError("comparison: no epoch is left; at least one was expected; keep more")
    inside = _figures(c.rows(c.outage)) if c.outage.any() else None
    return _figures(c, inside)


def _figures(c: Comparison, outage: Evaluation | None = None) -> Evaluation:
    error = np.hypot(c.along, c.cross)
    named = (c.p_road > 0.0) & c.edge_known
    sure = named & (c.p_road >= SURE)
    exact = c.strict & c.on_road & c.edge_known
    # what is not in the tables gives no figures
    some = _or_nan(c.edge_known)
    stated, placed, spread = (_or_nan(np.isfinite(v)) for v in (c.p_road, c.along_error, c.nees))
    return Evaluation(
        epochs=len(error),
        rmse_m=_rms(error),
        median_m=float(np.median(error)),
        p95_m=float(np.quantile(error, 0.95)),
        along_rmse_m=_rms(c.along),
        cross_rmse_m=_rms(c.cross),
        heading_rmse_deg=float(degrees(_rms(c.heading))),
        anees=float(np.mean(c.nees) / 2.0),
        anees_pose=float(np.mean(c.nees_pose) / 3.0),
        # two degrees of freedom: P(chi2 < x) = 1 - exp(-x / 2)
        coverage=tuple(spread * float(np.mean(c.nees < -2.0 * np.log(1.0 - q))) for q in COVERAGE),
        map_rmse_m=_rms(c.map_error),
        right_edge=some * _mean(c.right[c.edge_known]),
        right_edge_strict=some * _mean(c.strict[c.edge_known]),
        abscissa_rmse_m=some * placed * _rms(c.along_error[exact]),
        brier=some * stated * _mean((c.p_road - c.right)[named] ** 2),
        calibration_error=some * stated * calibration_error(c.p_road[named], c.right[named]),
        sure=some * stated * _mean(sure[c.edge_known]),
        sure_wrong=some * stated * _mean(~c.right[sure]),
        p_off_on_road=_or_nan(np.isfinite(c.p_off)) * _mean(c.p_off[c.on_road]),
        p_off_off_road=_or_nan(np.isfinite(c.p_off)) * _mean(c.p_off[~c.on_road]),
        outage=outage,
    )


def calibration_error(p: Array, right: Bools) -> float:
    """Expected calibration error: mean |stated P - frequency| over bins of stated P.

    The bins are finer towards 1, where honesty matters most.

    Args:
        p: (n,) probabilities.
        right: (n,) what happened.
    """
    if len(p) == 0:
        return 0.0
    k = np.searchsorted(_BINS, p, side="right")
    gap = np.bincount(k, p) - np.bincount(k, right)
    return float(np.abs(gap).sum() / len(p))


def anees_band(epochs: int, freedom: int = 2, z: float = 1.96) -> tuple[float, float]:
    """Where the ANEES of an honest filter lies, for independent epochs.

    The sum of n chi-squares of d degrees has mean n d and variance 2 n d, and is nearly
    normal from a few dozen on.

    Args:
        epochs: How many independent ones; those of one drive are not.
        freedom: 2 for a position, 3 for a pose.
        z: Quantile of the normal distribution, 1.96 for 95 %.
    """
    half = z * np.sqrt(2.0 / (epochs * freedom))
    return float(1.0 - half), float(1.0 + half)


def _or_nan(known: Bools) -> float:
    """1 where anything is known, else NaN."""
    return 1.0 if known.any() else np.nan


def _mean(values: NDArray[Any]) -> float:
    return float(np.mean(values)) if len(values) else 0.0


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
