"""Figures over many runs through one scene."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .numbers import Row, binomial, median, ratio
from .runs import STEP_S, SURE, Run, lifetimes
from .scenes import Scene

SEVEN = 7.0 * STEP_S
"""The paper's seven steps, s."""

BELIEVED = 0.95
_CHI2_95 = 5.991  # 95 % quantile of chi-square, two degrees of freedom
_WARM_UP = 10.0  # s at the start that are not scored


class Rows:
    """Collects rows of one scene and model."""

    def __init__(self, scene: str, model: str) -> None:
        self.scene, self.model = scene, model
        self.rows: list[Row] = []

    def share(self, figure: str, hits: Sequence[bool]) -> None:
        """A share of drives, %."""
        k, n = int(np.sum(hits)), len(hits)
        low, high = binomial(k, n)
        self._add(figure, 100.0 * k / n, "% of drives", n, (100.0 * low, 100.0 * high), None)

    def median(self, figure: str, groups: Sequence[Sequence[float]], unit: str) -> None:
        """A median over values that come in groups, one a drive."""
        n = sum(len(g) for g in groups)
        if n == 0:
            self._add(figure, None, unit, 0, None, None)
            return
        value, interval, spread = median(groups)
        self._add(figure, value, unit, n, interval, spread)

    def ratio(
        self, figure: str, top: Sequence[float], below: Sequence[float], unit: str,
        root: bool = False,
    ) -> None:  # fmt: skip
        """A pooled mean, or its root."""
        value, interval = ratio(top, below, root)
        self._add(figure, value, unit, len(top), interval, None)

    def _add(
        self, figure: str, value: float | None, unit: str, n: int,
        interval: tuple[float, float] | None, spread: tuple[float, float] | None,
    ) -> None:  # fmt: skip
        self.rows.append(Row(self.scene, self.model, figure, value, unit, n, interval, spread))


def moving(r: Run) -> NDArray[np.bool_]:
    """The epochs that count: not the first seconds, not standing."""
    kept: NDArray[np.bool_] = (r.since > _WARM_UP) & ~r.answer.stopped
    return kept


def honesty(
    rows: Rows, runs: Sequence[Run], where: Callable[[Run], NDArray[np.bool_]], note: str, *,
    spread: bool = True,
) -> None:  # fmt: skip
    """Error of the position, and whether its covariance (`spread`: it is known) is true."""
    kept = [moving(r) & where(r) for r in runs]
    size = [int(k.sum()) for k in kept]
    error = [r.answer.along**2 + r.answer.cross**2 for r in runs]

    def sums(values: Sequence[NDArray[Any]]) -> list[float]:
        return [float(v[k].sum()) for v, k in zip(values, kept, strict=True)]

    rows.ratio(f"position error{note}", sums(error), size, "m RMS", root=True)
    if not spread:
        return
    rows.ratio(f"as stated{note}", sums([r.sigma**2 for r in runs]), size, "m RMS", True)
    nees = [r.answer.nees for r in runs]
    rows.ratio(f"ANEES{note}", sums(nees), [2 * s for s in size], "1 is consistent")
    inside = [100.0 * (v < _CHI2_95) for v in nees]
    rows.ratio(f"truth in the 95 % ellipse{note}", sums(inside), size, "% of epochs")


def everywhere(r: Run) -> NDArray[np.bool_]:
    """Every epoch."""
    return np.ones(len(r.past), bool)


def life_times(rows: Rows, scene: Scene, runs: Sequence[Run]) -> None:
    """The paper's "seven steps"."""
    found = [lifetimes(scene, r) for r in runs]
    steps = [[lifetime.seconds / STEP_S for lifetime in one] for one in found]
    rows.median("a wrong road counted for", steps, "steps of 1 s")
    rows.median(
        "a wrong road counted over", [[lifetime.metres for lifetime in one] for one in found], "m"
    )
    rows.median("wrong roads that counted", [[float(len(one))] for one in found], "per drive")
    longest = [max((lifetime.seconds for lifetime in one), default=0.0) for one in found]
    rows.share("a wrong road counted for seven steps or more", [s >= SEVEN for s in longest])
    rows.share(
        "a wrong road still counted at the end",
        [not all(lifetime.ended for lifetime in one) for one in found],
    )


def believed_after(r: Run) -> float:
    """From where on the true road is believed for good, m past the decision, 0 at least."""
    uncertain = np.flatnonzero((r.right <= BELIEVED) & (r.past > 0.0))
    return float(max(r.past[uncertain[-1]], 0.0)) if len(uncertain) else 0.0


def choice(
    rows: Rows, runs: Sequence[Run], asked_m: Sequence[float], *, stated: bool = True
) -> None:
    """Which road: how soon, how often, and, where probabilities are stated, how surely wrong."""
    for metres in asked_m:
        at = [min(int(np.searchsorted(r.past, metres)), len(r.past) - 1) for r in runs]
        leads = [r.right[k] > r.wrongest[k] for r, k in zip(runs, at, strict=True)]
        rows.share(f"true road the most probable, {metres:g} m on", leads)
    rows.share("true road the most probable all along", [right_all_along(r) for r in runs])
    if stated:
        rows.median(
            f"true road believed (P > {BELIEVED}) for good after",
            [[believed_after(r)] for r in runs], "m",
        )  # fmt: skip
    ends(rows, runs, stated=stated)


def ends(rows: Rows, runs: Sequence[Run], *, stated: bool = True) -> None:
    """Whether the drive ends well, and whether what is declared is true."""
    rows.share("true road the most probable at the end", [right_at_end(r) for r in runs])
    if not stated:
        return
    rows.share(f"a wrong road declared (P >= {SURE})", [declared_wrong(r) for r in runs])
    rows.share(
        f"a wrong road believed (P > {BELIEVED}) at the end",
        [r.wrongest[-1] > BELIEVED for r in runs],
    )


def right_all_along(r: Run) -> bool:
    """Whether the true road is the most probable one in every epoch from the decision on."""
    return bool((r.right > r.wrongest)[r.past > 0.0].all())


def right_at_end(r: Run) -> bool:
    """Whether the true road is the most probable one in the last epoch."""
    return bool(r.right[-1] > r.wrongest[-1])


def declared_wrong(r: Run) -> bool:
    """Whether a wrong road was ever declared, from the decision on."""
    return bool((r.wrongest[r.past > 0.0] >= SURE).any())


def through_mask(
    rows: Rows, runs: Sequence[Run], alone: Sequence[float], *, named: bool = True,
    spread: bool = True,
) -> None:  # fmt: skip
    """The paper's Figure 9: the mask, its end, and dead reckoning by wheels there.

    Args:
        rows: Where figures are added.
        runs: One per seed.
        alone: Error of wheels alone at the mask's end, m, one per seed; none: not known.
        named: Whether the answers name roads.
        spread: Whether they state covariances.
    """
    last = [int(np.flatnonzero(r.dark)[-1]) for r in runs]
    pairs = list(zip(runs, last, strict=True))
    if named:
        rows.ratio(
            "true road the most probable in the mask",
            [100.0 * float(r.answer.right[r.dark].sum()) for r in runs],
            [int(r.dark.sum()) for r in runs], "% of epochs",
        )  # fmt: skip
        rows.share(
            "true road the most probable at the mask's end", [r.answer.right[k] for r, k in pairs]
        )
    one = [1.0] * len(runs)
    error = [float(r.answer.along[k] ** 2 + r.answer.cross[k] ** 2) for r, k in pairs]
    rows.ratio("position error at the mask's end", error, one, "m RMS", root=True)
    rows.median("position error at the mask's end, median", [[e**0.5] for e in error], "m")
    if spread:
        stated = [float(r.sigma[k] ** 2) for r, k in pairs]
        rows.ratio("as stated at the mask's end", stated, one, "m RMS", root=True)
    if alone:
        squares = [a * a for a in alone]
        rows.ratio("wheels alone at the mask's end", squares, one, "m RMS", root=True)
    honesty(rows, runs, lambda r: r.dark, " in the mask", spread=spread)


ASKED = {
    "fork": (20.0, 50.0, 100.0),
    "parallel": (0.0, 50.0, 200.0),
    "junction": (20.0, 50.0, 100.0),
}
"""Where the most probable road is asked for, m past the decision."""


def score(scene: Scene, model: str, runs: Sequence[Run], alone: Sequence[float]) -> list[Row]:
    """All numbers of one model in one of the scenes of Figures 8 to 11.

    Args:
        scene: Which.
        model: Which.
        runs: One per seed.
        alone: Error of wheels alone at the mask's end, m, one per seed; `outage` only.
    """
    rows = Rows(scene.name, model)
    if scene.name == "outage":
        through_mask(rows, runs, alone)
        life_times(rows, scene, runs)
        ends(rows, runs)
    else:
        life_times(rows, scene, runs)
        choice(rows, runs, ASKED[scene.name])
        honesty(rows, runs, everywhere, "")
    return rows.rows
