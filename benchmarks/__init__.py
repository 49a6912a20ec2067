"""Speed and accuracy, measured: `python -m benchmarks NAME`.  Never part of the tests."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured number beside what it should be."""

    figure: str
    value: float | None  # None: nothing could be measured
    goal: str = ""  # "<= 2.3", ">= 98", "0.8..1.3", or "" where nothing is asked
    unit: str = ""
    n: int = 1  # how many drives, calls or epochs stand behind it
    ci95: tuple[float, float] | None = None
    seeds: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the goal is met; None where there is no goal."""
        if not self.goal:
            return None
        if self.value is None:
            return False
        if ".." in self.goal:
            low, high = self.goal.split("..")
            return float(low) <= self.value <= float(high)
        sign, bound = self.goal.split()
        return self.value <= float(bound) if sign == "<=" else self.value >= float(bound)


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line asked for."""

    data: Path = ROOT.parent / "shared" / "data"
    seeds: range | None = None
    say: Callable[[str], None] = print  # progress, one line at a time
    more: dict[str, Any] = field(default_factory=dict)  # options of one benchmark

    def settings(self) -> Any:
        """The model's numbers, with those that `--set` changed."""
        from whichroad import Settings

        return Settings(**self.more.get("settings", {}))

    def need(self, *parts: str) -> Path:
        """The path of a data file, or a `Skipped` that names it."""
        path = self.data.joinpath(*parts)
        if not path.exists():
            raise Skipped(f"{path} is not here; set WHICHROAD_DATA or --data")
        return path


class Skipped(Exception):
    """The benchmark's data is not on this machine."""


def data_folder() -> Path:
    """Where the real data lies unless the command line says otherwise."""
    return Path(os.environ.get("WHICHROAD_DATA") or Options().data)


def seeds_text(seeds: range) -> str:
    """`range(1000, 1064)` as the command line writes it."""
    return f"{seeds.start}:{seeds.stop}"


def interval(
    statistic: Callable[[np.ndarray], float], rows: Sequence[Any], draws: int = 2000
) -> tuple[float, float] | None:
    """Bootstrap 95 % interval of `statistic` over independent rows (drives, tracks).

    Args:
        statistic: Takes rows as an array, (n, k), and gives one number.
        rows: One row of numbers per independent case.
        draws: Resamplings.

    Returns:
        The 2.5 % and 97.5 % quantiles, or None for fewer than three rows.
    """
    table = np.asarray(rows, float)
    if len(table) < 3:
        return None
    rng = np.random.default_rng(0)
    values = [statistic(table[rng.integers(0, len(table), len(table))]) for _ in range(draws)]
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


def share(rows: np.ndarray) -> float:
    """Pooled percentage: sum of the first column over the sum of the second."""
    return float(100.0 * rows[:, 0].sum() / rows[:, 1].sum())
