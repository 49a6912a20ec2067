"""The lifetime log as tables: the hypotheses, and their weights over time."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ..lineage import Hypothesis
from .lifetime_log import LifetimeLog

HYPOTHESES = (
    "hypothesis", "street", "edge", "from", "born_s", "born_m", "born_p", "most_p", "died_s",
    "died_m", "last_p", "why", "into",
)  # fmt: skip
WEIGHTS = ("time_s", "past_m", "hypothesis", "p")


def write_log(out: Path, scene: str, model: str, log: LifetimeLog) -> list[Path]:
    """Write both tables of one drive under one model; returns the files."""
    about = out / f"{scene}-{model}-hypotheses.csv"
    weights = out / f"{scene}-{model}-weights.csv"
    _write(about, HYPOTHESES, (_row(log, h) for h in log.hypotheses))
    _write(weights, WEIGHTS, (row for h in log.hypotheses for row in _weights(log, h)))
    return [about, weights]


def _write(path: Path, heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(heads)
        table.writerows(rows)


def _row(log: LifetimeLog, h: Hypothesis) -> list[Any]:
    gone = h.why != "alive"
    return [
        h.number, h.street, h.edge, _number(h.parent), f"{log.since[h.created]:.2f}",
        f"{log.past[h.created]:.1f}", f"{h.p[0]:.6f}", f"{max(h.p):.6f}",
        f"{log.since[h.last]:.2f}" if gone else "", f"{log.past[h.last]:.1f}" if gone else "",
        f"{h.p[-1]:.6f}", h.why, _number(h.into),
    ]  # fmt: skip


def _weights(log: LifetimeLog, h: Hypothesis) -> Iterable[list[Any]]:
    for k, p in enumerate(h.p, start=h.created):
        yield [f"{log.since[k]:.2f}", f"{log.past[k]:.1f}", h.number, f"{p:.6f}"]


def _number(value: int) -> Any:
    return value if value >= 0 else ""
