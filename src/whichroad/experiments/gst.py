"""The receiver's covariance for each fix against one for all."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .numbers import Row, binomial
from .runs import MODELS, Run
from .scenes import CANYON_M, Scene
from .scores import Rows, everywhere, honesty, moving

PER_FIX, FIXED = "per fix", "fixed"
NOISES = {PER_FIX: "covariance of each fix", FIXED: "one covariance for all"}

Kind = tuple[str, str]
"""A model and a noise."""

KINDS: tuple[Kind, ...] = tuple((model, noise) for model in MODELS for noise in NOISES)


def between_houses(r: Run) -> NDArray[np.bool_]:
    """The epochs of the street canyon."""
    inside: NDArray[np.bool_] = (r.past >= 0.0) & (r.past < CANYON_M[1] - CANYON_M[0])
    return inside


def score_gst(scene: Scene, runs: dict[Kind, list[Run]]) -> list[Row]:
    """Errors and honesty of each model with each noise, and how often the fixes' own wins."""
    out = []
    for (model, noise), answered in runs.items():
        rows = Rows(scene.name, f"{model}, {noise}")
        honesty(rows, answered, everywhere, "")
        honesty(rows, answered, between_houses, " between houses")
        honesty(rows, answered, lambda r: ~between_houses(r), " under open sky")
        out += rows.rows
    for model in MODELS:
        pairs = zip(runs[model, PER_FIX], runs[model, FIXED], strict=True)
        out.append(_won(scene.name, model, [rms(a) < rms(b) for a, b in pairs]))
    return out


def rms(r: Run) -> float:
    """Position error of a drive, m."""
    kept = moving(r)
    return float(np.sqrt(np.mean((r.answer.along**2 + r.answer.cross**2)[kept])))


def _won(scene: str, model: str, better: Sequence[bool]) -> Row:
    low, high = binomial(sum(better), len(better))
    share = 100.0 * sum(better) / len(better)
    return Row(
        scene, f"{model}, {PER_FIX}", "drives in which the fixes' own covariance is better",
        share, "% of drives", len(better), (100.0 * low, 100.0 * high),
    )  # fmt: skip
