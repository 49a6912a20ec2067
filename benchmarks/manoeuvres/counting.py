"""What the answers of some drives come to: epochs pooled, intervals over drives.

Epochs count after 20 s, while the vehicle moves.  Under a fault those from its beginning until
120 s after its end count, 300 s at most.  A declared epoch has a road with P >= 0.999.  It is wrong
if the vehicle is not on that road, in that direction, within 10 m of travel.
"""

from dataclasses import dataclass

import numpy as np

from .. import Figure, interval
from ..worlds import scoring

WORDS = (
    ("wrong at P >= 0.999", "per mille"), ("declared", "%"), ("level exceeded", "per mille"),
    ("level", "m"), ("ANEES", ""), ("right road", "%"), ("named", "per mille"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Counted:
    """One drive."""

    declared: int  # epochs
    wrong: int  # of them
    pose: scoring.PoseSums
    named: tuple[str, ...] = ()  # what `diagnosis` warns of


def which(said: scoring.Said, begin: float, counts: tuple[float, float] | None) -> np.ndarray:
    """The epochs that count, (n,).

    Args:
        said: The drive.
        begin: When its fault begins, s.
        counts: s after that from when on they count, s for which it lasts; None: all count.
    """
    if counts is None:
        return scoring.counted(said)
    begin += counts[0]
    return scoring.counted(said) & scoring.under(said.time, begin, begin + counts[1])


def count(said: scoring.Said, at: np.ndarray, named: tuple[str, ...] = ()) -> Counted:
    """Some epochs of a drive, (n,) bool."""
    sure = at & (said.p_top >= scoring.DECLARED)
    wrong = sure & ~scoring.right_road(said)
    return Counted(int(sure.sum()), int(wrong.sum()), scoring.pose_sums(said, at), named)


def line(name: str, drives: list[Counted]) -> str:
    """One row of the table, as wide as `HEAD`."""
    declared, wrong = sum(d.declared for d in drives), sum(d.wrong for d in drives)
    worse = sum(d.wrong > 0 for d in drives)
    value = dict(zip((what for what, _ in WORDS), _values(drives), strict=True))
    return (
        f"{name:44} {len(drives):6} {declared:9,} {wrong:7,} {worse:6} {value['declared']:10.1f} "
        f"{value['level exceeded']:11.1f} {value['level']:8.1f} {value['ANEES']:7.2f} "
        f"{value['right road']:7.1f} {sum(bool(d.named) for d in drives):6}"
    )


HEAD = (
    f"{'scene':44} {'drives':>6} {'declared':>9} {'wrong':>7} {'drives':>6} {'declared %':>10} "
    f"{'exceeded ‰':>11} {'level m':>8} {'ANEES':>7} {'right %':>7} {'named':>6}"
)


def figures(name: str, drives: list[Counted], seeds: str) -> list[Figure]:
    """The same as figures; wrong roads and exceeded levels have a goal, and an interval."""
    table = np.array([(d.wrong, d.declared, d.pose.exceeded, d.pose.epochs) for d in drives], float)
    rates = {"wrong at P >= 0.999": table[:, :2], "level exceeded": table[:, 2:]}
    declared, epochs = int(table[:, 1].sum()), int(table[:, 3].sum())
    n = (declared, epochs, epochs, len(drives), epochs, epochs, len(drives))
    return [
        Figure(
            f"{name}: {what}", None if np.isnan(value) else value, "<= 1" if what in rates else "",
            unit, size, _over_drives(rates[what]) if what in rates else None, seeds,
        )
        for (what, unit), value, size in zip(WORDS, _values(drives), n, strict=True)
    ]  # fmt: skip


def _over_drives(table: np.ndarray) -> tuple[float, float] | None:
    """Interval of a rate, per mille; none where no epoch is bad, as few drives bound nothing."""

    def rate(rows: np.ndarray) -> float:
        return float(1e3 * rows[:, 0].sum() / max(rows[:, 1].sum(), 1.0))

    return interval(rate, table) if table[:, 0].any() else None


def _values(drives: list[Counted]) -> tuple[float, ...]:
    """In the order of `WORDS`; NaN where nothing counts."""
    pose = [d.pose for d in drives]
    declared, epochs = sum(d.declared for d in drives), sum(p.epochs for p in pose)
    levels = [p.level for p in pose if p.epochs]
    return (
        _ratio(sum(d.wrong for d in drives), declared, 1e3),
        _ratio(declared, epochs, 100.0),
        _ratio(sum(p.exceeded for p in pose), epochs, 1e3),
        float(np.median(levels)) if levels else float("nan"),
        _ratio(sum(p.nees for p in pose), epochs, 0.5),
        _ratio(sum(p.right for p in pose), sum(p.roads for p in pose), 100.0),
        _ratio(sum(bool(d.named) for d in drives), len(drives), 1e3),
    )


def _ratio(part: float, whole: int, times: float) -> float:
    return times * part / whole if whole else float("nan")
