"""Curves over many drives: P of the true road, lifetimes, true and stated errors."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D

from ..lineage.lanes import FAINT
from ..observations import Array
from ..plots.panels import TRUTH
from .runs import MODELS, STEP_S, Run, lifetimes
from .scenes import Scene
from .scores import SEVEN

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"paper": "#d9730d", "default": "#0b4f9e"}
ABOVE: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderpad": 0.0}
"""Where a legend stands: above its axes, at the right."""

_GRID = 500
_ONE_SIGMA = 1.0 - math.exp(-1.0)  # probability of a plane Gaussian within its RMS
_PLOTTED_STEPS = 14.0  # s, shortest time axis


def on_grid(r: Run, values: Array, metres: Array) -> Array:
    """Values of a run at metres past the decision: those of the next epoch."""
    at = np.clip(np.searchsorted(r.past, metres), 0, len(r.past) - 1)
    picked: Array = values[at]
    return picked


def draw_band(axes: "Axes", model: str, runs: Sequence[Run], window: tuple[float, float]) -> None:
    """P of the true road over the distance: median, and the range of nine in ten drives."""
    metres = np.linspace(*window, _GRID)
    p = np.array([on_grid(r, r.right, metres) for r in runs])
    low, middle, high = np.quantile(p, [0.05, 0.5, 0.95], axis=0)
    axes.fill_between(
        metres, low, high, color=COLOURS[model], alpha=0.22, lw=0, label="90 % of the drives"
    )
    axes.plot(metres, middle, color=COLOURS[model], lw=2, label="median")
    axes.set(xlim=window, ylim=(-0.03, 1.03), ylabel="P(true road)")
    axes.legend(ncols=2, **ABOVE)


def draw_survival(axes: "Axes", scene: Scene, runs: Mapping[str, Sequence[Run]]) -> None:
    """Share of the wrong roads that still count so many steps after they began to."""
    found = {
        model: np.array([x.seconds / STEP_S for r in answered for x in lifetimes(scene, r)])
        for model, answered in runs.items()
    }
    longest = max((float(np.quantile(s, 0.99)) for s in found.values() if len(s)), default=0.0)
    grid = np.linspace(0.0, max(_PLOTTED_STEPS, longest), _GRID)
    for model, steps in found.items():
        if len(steps):
            share = (steps[None, :] > grid[:, None]).mean(axis=1)
            axes.plot(grid, 100.0 * share, color=COLOURS[model], lw=2, label=MODELS[model])
    seven = SEVEN / STEP_S
    axes.axvline(seven, color=TRUTH, lw=1.0, ls=(0, (1, 1.5)), label=f"the paper's {seven:g} steps")
    axes.set(xlabel="steps of 1 s since it began to count", ylabel="% of the wrong roads")
    axes.set(xlim=(0.0, grid[-1]), ylim=(0.0, 103.0))
    axes.legend(loc="upper right")


Line = tuple[str, str, Sequence[Run]]
"""Label, colour, runs."""


def draw_errors(axes: "Axes", lines: Sequence[Line], window: tuple[float, float]) -> float:
    """Position error over the distance, and dashed the RMS error by the covariances.

    The error is what 63 % of the drives stay below: of Gaussian errors that is their RMS,
    and one drive that was lost does not hide the others.

    Returns:
        The largest value drawn, m.
    """
    metres = np.linspace(*window, _GRID)

    def over(runs: Sequence[Run], values: Callable[[Run], Array]) -> Array:
        return np.array([on_grid(r, values(r), metres) for r in runs])

    most = 0.0
    for label, colour, runs in lines:
        errors = over(runs, lambda r: np.hypot(r.answer.along, r.answer.cross))
        error = np.quantile(errors, _ONE_SIGMA, axis=0)
        stated = np.sqrt(np.mean(over(runs, lambda r: r.sigma**2), axis=0))
        axes.plot(metres, error, color=colour, lw=1.8, label=label)
        axes.plot(metres, stated, color=colour, lw=1.4, ls=(0, (4, 2)))
        most = max(most, float(error.max()), float(stated.max()))
    axes.set(xlim=window, ylim=(0.0, 1.06 * most), ylabel="position error (m)")
    handles, labels = axes.get_legend_handles_labels()
    dashed = Line2D([], [], color=FAINT, lw=1.4, ls=(0, (4, 2)))
    axes.legend([*handles, dashed], [*labels, "dashed: as stated"], ncols=3, **ABOVE)
    return most
