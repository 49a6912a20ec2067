"""What scored drives say together: rates with exact bounds, per situation, worst first."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from .. import interval
from ..exact_bounds import clopper_pearson
from .drives import Scored
from .scoring import AFTER, PoseSums

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Declarations:
    """Decisions of some kind."""

    kind: str
    drives: int
    decisions: int
    declared: int
    wrong: int
    wrong_drives: int  # drives with a wrong declaration
    seconds: float  # median time to declare

    @property
    def per_mille(self) -> float:
        """Wrong ones among those declared."""
        return 1e3 * self.wrong / max(self.declared, 1)


@dataclass(frozen=True, slots=True)
class Poses:
    """Epochs of some drives; rates and intervals have each drive with its weight."""

    kind: str
    drives: int
    right: float  # share of epochs on the right road, where the map has it
    exceeded: float  # share beyond the level, each drive with the same weight
    exceeded_ci: Pair | None
    anees: float
    anees_ci: Pair | None
    inside: float  # share in the 95 % ellipse
    rmse: float  # m
    level: float  # m, median over drives of their medians


def kinds_of(one: Scored) -> list[set[str]]:
    """Situations of each decision of a drive, with its place, its sensors, and current faults."""
    out = []
    for d, about in zip(one.decisions, one.situations, strict=True):
        faults = {
            f"fault: {e.name}" for e in one.events if e.begin <= d.when and d.time <= e.end + AFTER
        }
        out.append({"all", *about, f"place: {one.place}", f"sensors: {one.suite}", *faults})
    return out


def declarations(drives: Iterable[Scored]) -> list[Declarations]:
    """A row for each kind of decision, the worst first."""
    rows: dict[str, dict[str, list[tuple[bool, bool, float]]]] = {}
    for one in drives:
        for d, kinds in zip(one.decisions, kinds_of(one), strict=True):
            for kind in kinds:
                rows.setdefault(kind, {}).setdefault(one.name, []).append(
                    (d.declared, d.wrong, d.when - d.time)
                )
    out = []
    for kind, by_drive in rows.items():
        flat = [r for each in by_drive.values() for r in each]
        seconds = [s for declared, _, s in flat if declared]
        out.append(
            Declarations(
                kind, len(by_drive), len(flat), sum(r[0] for r in flat), sum(r[1] for r in flat),
                sum(any(r[1] for r in each) for each in by_drive.values()),
                float(np.median(seconds)) if seconds else float("nan"),
            )
        )  # fmt: skip
    return sorted(
        out, key=lambda r: (-clopper_pearson(r.wrong, max(r.declared, 1))[0], -r.per_mille, r.kind)
    )


def wrong_by_world(drives: Iterable[Scored]) -> tuple[float, Pair | None]:
    """Wrong ones among those declared, and its interval over worlds, per mille.

    Drives of a world share its map and its streets, so that their errors come together.
    """
    worlds: dict[str, np.ndarray] = {}
    for one in drives:
        counts = [sum(d.wrong for d in one.decisions), sum(d.declared for d in one.decisions)]
        world = one.name.partition("/")[0]
        worlds[world] = worlds.get(world, np.zeros(2)) + counts
    table = np.array([row for row in worlds.values() if row[1] > 0])

    def rate(t: np.ndarray) -> float:
        return float(1e3 * t[:, 0].sum() / t[:, 1].sum())

    return (rate(table), interval(rate, table)) if len(table) else (0.0, None)


def poses(kind: str, sums: list[PoseSums]) -> Poses | None:
    """What the sums of some drives say; None where there is no epoch."""
    rows = np.array(
        [(s.epochs, s.exceeded, s.nees, s.inside, s.square, s.right, s.roads, s.level)
         for s in sums if s.epochs]
    )  # fmt: skip
    if not len(rows):
        return None
    n, exceeded, nees, inside, square, right, roads, level = rows.T

    def rate(t: np.ndarray) -> float:
        return float((t[:, 0] / t[:, 1]).mean())

    def anees(t: np.ndarray) -> float:
        return float(t[:, 0].sum() / t[:, 1].sum() / 2.0)

    both, chi = np.column_stack([exceeded, n]), np.column_stack([nees, n])
    return Poses(
        kind, len(rows), float(right.sum() / max(roads.sum(), 1.0)), rate(both),
        interval(rate, both, 400), anees(chi), interval(anees, chi, 400),
        float(inside.sum() / n.sum()), float(np.sqrt(square.sum() / n.sum())),
        float(np.median(level)),
    )  # fmt: skip


def pose_rows(drives: list[Scored]) -> list[Poses]:
    """A row for all, for each place, sensors and fault; the level most often exceeded first."""
    groups: dict[str, list[PoseSums]] = {}
    for one in drives:
        for kind in ("all", f"place: {one.place}", f"sensors: {one.suite}"):
            groups.setdefault(kind, []).append(one.all)
        for name, sums in one.under.items():
            groups.setdefault(f"fault: {name}", []).append(sums)
    found = [poses(kind, sums) for kind, sums in groups.items()]
    return sorted((p for p in found if p is not None), key=lambda p: -p.exceeded)


def badness(one: Scored) -> tuple[int, float, float]:
    """By which the worst drives are found."""
    share = one.all.exceeded / max(one.all.epochs, 1)
    return sum(d.wrong for d in one.decisions), share, one.all.square / max(one.all.epochs, 1)
