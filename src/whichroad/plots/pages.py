"""The pages: which panels stand together."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .panels import (
    draw_choice,
    draw_error,
    draw_map,
    draw_probability,
    draw_status,
    draw_zoom,
    probability_bar,
)
from .scene import Scene, Window

STYLE: dict[Any, Any] = {
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.edgecolor": "#9aa0a8",
    "axes.labelcolor": "#3a3f45",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": "#3a3f45",
    "ytick.color": "#3a3f45",
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "legend.fontsize": 8,
    "figure.constrained_layout.use": True,
}


DPI = 120


def draw_pages(scene: Scene, windows: list[Window], title: str, out: Path) -> list[Path]:
    """Draw every page into the folder; returns the files."""
    pages = {
        "overview": _overview,
        "hypotheses": _hypotheses,
        "probability": _probability,
        "drive": _drive,
    }
    with matplotlib.rc_context(STYLE):
        for name, page in pages.items():
            figure = page(scene, windows, title)
            FigureCanvasAgg(figure).print_figure(out / f"{name}.png", dpi=DPI)
    return [out / f"{name}.png" for name in pages]


def _overview(scene: Scene, windows: list[Window], title: str) -> Figure:
    """The paper's Figure 9."""
    across, up = np.nanmax(scene.xy, axis=0) - np.nanmin(scene.xy, axis=0)
    figure = Figure(figsize=(10, float(np.clip(2.5 + 8 * up / max(across, 1.0), 4.5, 9.5))))
    axes = figure.subplots()
    draw_map(axes, scene, windows)
    probability_bar(figure, axes)
    axes.set_title(title or "Where the vehicle was, and how sure its road is")
    return figure


def _hypotheses(scene: Scene, windows: list[Window], title: str) -> Figure:
    """The paper's Figures 10 and 11: above where, below how probable."""
    figure = Figure(figsize=(6 * len(windows), 7.4))
    axes = figure.subplots(2, len(windows), squeeze=False, height_ratios=[1.5, 1])
    for letter, window, above, below in zip("ABCDEF", windows, axes[0], axes[1], strict=False):
        draw_zoom(above, scene, window)
        above.set_title(f"{letter}  {window.title}")
        draw_choice(below, scene, window)
    probability_bar(figure, axes[0, -1])
    figure.suptitle(
        "Every hypothesis with its own 95 % ellipse", x=0.01, ha="left", weight="bold", fontsize=13
    )
    return figure


def _probability(scene: Scene, windows: list[Window], title: str) -> Figure:
    rows = 2 if scene.truth is None else 3
    figure = Figure(figsize=(10, 2.6 * rows))
    axes = figure.subplots(rows, 1, sharex=True, height_ratios=[3, 0.25, 3][:rows])
    draw_probability(axes[0], scene, windows)
    axes[0].set_title("How probable the road was", pad=16)
    draw_status(axes[1], scene)
    if scene.truth is not None:
        draw_error(axes[2], scene)
        axes[2].set_title("How far from the truth")
    axes[-1].set_xlabel("time since the start (s)")
    return figure


def _drive(scene: Scene, windows: list[Window], title: str) -> Figure:
    """Everything on one page; a drive wider than high lies above its zooms."""
    known = scene.truth is not None
    across, up = np.nanmax(scene.xy, axis=0) - np.nanmin(scene.xy, axis=0)
    figure = Figure(figsize=(14, 13 if known else 10.5))
    heights = [2.6, 2.6, 1.5, 0.16, 1.5][: 5 if known else 4]
    if across > 1.8 * up:
        grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
        places = [grid[0, :], grid[1, 0], grid[1, 1]]
    else:
        grid = figure.add_gridspec(len(heights), 2, height_ratios=heights, width_ratios=[1.5, 1])
        places = [grid[:2, 0], grid[0, 1], grid[1, 1]]
    whole = figure.add_subplot(places[0])
    draw_map(whole, scene, windows)
    probability_bar(figure, whole)
    whole.set_title("The drive")
    for letter, place, window in zip("AB", places[1:], windows, strict=False):
        zoom = figure.add_subplot(place)
        draw_zoom(zoom, scene, window)
        zoom.set_title(f"{letter}  {window.title}")
    chance = figure.add_subplot(grid[2, :])
    draw_probability(chance, scene, windows)
    chance.set_title("How probable the road was", pad=16)
    draw_status(figure.add_subplot(grid[3, :], sharex=chance), scene)
    if known:
        error = figure.add_subplot(grid[4, :], sharex=chance)
        draw_error(error, scene)
        error.set_title("How far from the truth")
    figure.suptitle(title, x=0.01, ha="left", weight="bold", fontsize=13)
    return figure
