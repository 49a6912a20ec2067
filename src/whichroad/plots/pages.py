"""The pages: which panels stand together."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from .hypotheses import draw_zoom, page_of_hypotheses
from .panels import draw_error, draw_map, draw_probability, draw_status, probability_bar
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
    "svg.hashsalt": "whichroad",  # the same identifiers in every run
    "svg.fonttype": "none",  # text stays text
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
            _save(page(scene, windows, title), out, name)
    return [out / f"{name}.png" for name in pages]


def draw_methods(
    answers: Sequence[tuple[str, Scene]], windows: list[Window], title: str, out: Path
) -> list[Path]:
    """Draw the same windows of several answers, one above the other; returns the files."""
    with matplotlib.rc_context(STYLE):
        return _save(page_of_hypotheses(answers, windows, title), out, "methods")


def _save(figure: Figure, out: Path, name: str) -> list[Path]:
    """As PNG and as SVG; the same picture is the same file."""
    png, svg = out / f"{name}.png", out / f"{name}.svg"
    print_png(figure, png)
    figure.set_layout_engine("none")  # what was laid out stays where it is
    canvas: Any = FigureCanvasSVG(figure)
    canvas.print_svg(svg, metadata={"Date": None})
    return [png, svg]


def print_png(figure: Figure, path: Path) -> None:
    """Draw a figure once, which lays it out; `Figure.savefig` draws it for its layout before."""
    usual, figure.dpi = figure.dpi, DPI
    canvas: Any = FigureCanvasAgg(figure)
    canvas.print_png(path)
    figure.dpi = usual


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
    return page_of_hypotheses([("", scene)], windows, "Every hypothesis with its own 95 % ellipse")


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
    wide = across > 1.8 * up
    figure = Figure(figsize=(14, (13 if known else 10.5) - 1.8 * wide))
    heights = [2.6, 1.4 if wide else 2.6, 1.5, 0.16, 1.5][: 5 if known else 4]
    if wide:
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
