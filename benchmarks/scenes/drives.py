"""What every scene does: drives over some processes, the filter's answer beside the truth, rows."""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whichroad._compile import Records
from whichroad.epochs import build_timeline
from whichroad.lookback.smoothing import Lag
from whichroad.observations import StartPose
from whichroad.recorded import localize_recorded
from whichroad.roadmap import RoadMap
from whichroad.settings import Settings
from whichroad.simulate import SimulatedDrive, drivable

from .. import Figure, Options, interval, seeds_text
from ..exact_bounds import clopper_pearson
from ..processes import spread

SURE = 0.95  # P beyond which a road counts as decided

Row = dict[str, float]
Mask = NDArray[np.bool_]

world: dict[str, Any] = {}  # maps and the like, of this process


class Answer(NamedTuple):
    """The filter's output at the times of the truth, n rows."""

    rows: Records  # (n,) filter.estimate.ESTIMATE
    started: Mask  # False before the first fix

    def p_of(self, road: Mask) -> NDArray[np.float64]:
        """P of a road, a mask over the map's edges."""
        edge = self.rows.alt_edge
        on = (edge >= 0) & road[np.maximum(edge, 0)]
        return np.where(on, self.rows.alt_p, 0.0).sum(axis=1, dtype=float)


def answer(
    roads: RoadMap, drive: SimulatedDrive, settings: Settings, start: StartPose | None = None,
    lag: Lag | None = None,
) -> Answer:  # fmt: skip
    """Localize a drive; between epochs the last answer holds."""
    timeline = build_timeline(drive.drive, roads.plane, drive.vehicle)
    rows = localize_recorded(
        roads, timeline, vehicle=drive.vehicle, settings=settings, start=start, lag=lag
    ).output.rows
    at = np.searchsorted(timeline.epochs.time, drive.truth.time + 1e-3) - 1
    known = np.maximum(at, 0)
    return Answer(rows[known], (rows.live[known] > 0) & (at >= 0))


def map_error(roads: RoadMap, drive: SimulatedDrive, said: Answer) -> NDArray[np.float64]:
    """Distance in the map's frame between answer and truth, true m, (n,)."""
    x, y = drive.truth.map_x, drive.truth.map_y
    apart = np.hypot(said.rows.map_x - x, said.rows.map_y - y)
    return apart / roads.plane.scale(x, y)


def named(roads: RoadMap, *names: str) -> Mask:
    """The edges of streets of these names, both directions."""
    return np.isin(np.array([n or "" for n in roads.column("name")]), names)


def eastward(roads: RoadMap, name: str) -> int:
    """The edge of a street of one stretch that is driven to the east."""
    edges = np.flatnonzero(named(roads, name)).tolist()
    (edge,) = (e for e in edges if abs(roads.at(e, 0.0)[2]) < 0.5 * np.pi)
    return int(edge)


def read_town(map_file: Path) -> None:
    """The map of this process, and where in it one can drive."""
    world["roads"] = RoadMap.from_osm(map_file)
    world["allowed"] = drivable(world["roads"].arrays, np.random.default_rng(0))


def each(
    work: Callable[[int], Row | None],
    seeds: range,
    options: Options,
    prepare: Callable[..., None] | None = None,
    arguments: Sequence[Any] = (),
) -> list[Row]:
    """Rows of all seeds, in their order; a seed that gave none is left out.

    Args:
        work: One seed to a row; what `prepare` left in `world` is there.
        seeds: Of the drives.
        options: For `--processes` and `--progress`.
        prepare: Run once in each process.
        arguments: Of `prepare`.
    """
    rows, begun, told = [], time.perf_counter(), 0
    for done, row in enumerate(spread(work, seeds, options, prepare, arguments), start=1):
        if row is not None:
            rows.append({"seed": float(seeds[done - 1]), **row})
        if options.more.get("progress"):
            text = ", ".join(f"{k} {v:.4g}" for k, v in (row or {"skipped": 1.0}).items())
            options.say(f"seed {seeds[done - 1]}: {text}")
        elif 10 * done // len(seeds) > told:
            told = 10 * done // len(seeds)
            spent = time.perf_counter() - begun
            sys.stderr.write(f"{done} of {len(seeds)} drives, {spent:.0f} s\n")
    return rows


class Table:
    """Rows of independent drives, and the figures made of them."""

    def __init__(self, rows: list[Row], seeds: range) -> None:
        self.rows = rows
        self.seeds = seeds_text(seeds)

    def _pair(self, top: str, below: str | None) -> NDArray[np.float64]:
        pairs = [(r[top], r[below] if below else 1.0) for r in self.rows if top in r]
        return np.array(pairs, float).reshape(-1, 2)

    def share(
        self, figure: str, top: str, below: str | None = None, goal: str = "", unit: str = "%",
        factor: float = 100.0,
    ) -> Figure:  # fmt: skip
        """Sum of a column over the sum of another (of the drives, where there is none).

        Whole drives are judged by Clopper and Pearson, sums by resampling drives.
        """
        table = self._pair(top, below)
        if not len(table) or table[:, 1].sum() == 0:
            return Figure(figure, None, goal, unit, len(table), None, self.seeds)

        def ratio(t: NDArray[np.float64]) -> float:
            return float(factor * t[:, 0].sum() / max(t[:, 1].sum(), 1e-300))

        if np.isin(table, (0.0, 1.0)).all():
            n = int(table[:, 1].sum())
            low, high = clopper_pearson(int((table[:, 0] * table[:, 1]).sum()), n)
            bounds: tuple[float, float] | None = (factor * low, factor * high)
        else:
            n, bounds = len(table), interval(ratio, table)
        return Figure(figure, ratio(table), goal, unit, n, bounds, self.seeds)

    def root(self, figure: str, top: str, below: str, unit: str = "m") -> Figure:
        """Square root of the ratio of two sums."""
        square = self.share(figure, top, below, "", unit, 1.0)
        if square.value is None:
            return square
        bounds = square.ci95 and (square.ci95[0] ** 0.5, square.ci95[1] ** 0.5)
        return replace(square, value=square.value**0.5, ci95=bounds)

    def quantile(
        self, figure: str, column: str, q: float, goal: str = "", unit: str = "m"
    ) -> Figure:
        """A quantile over drives."""
        values = np.array([[r[column]] for r in self.rows if np.isfinite(r.get(column, np.nan))])
        if not len(values):
            return Figure(figure, None, goal, unit, 0, None, self.seeds)

        def at(t: NDArray[np.float64]) -> float:
            return float(np.quantile(t[:, 0], q))

        bounds = interval(at, values)
        return Figure(figure, at(values), goal, unit, len(values), bounds, self.seeds)
