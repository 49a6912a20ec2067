"""The experiments' pictures: the paper's figure, the lanes of hypotheses, many drives."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..plots.pages import DPI, STYLE
from ..plots.panels import HIDDEN, draw_map, draw_zoom, probability_bar
from ..plots.scene import Scene as Drawn
from ..plots.scene import Window, make_scene
from ..result import Result
from ..simulate import SimulatedDrive, truth_table
from .gst import FIXED, NOISES, PER_FIX, Kind
from .panels import (
    CALLED,
    COLOURS,
    Line,
    draw_band,
    draw_errors,
    draw_lanes,
    draw_survival,
    lane_legend,
)
from .reckon import wheels_alone
from .rides import MODELS, Ride
from .scenes import CANYON_M, Scene

if TYPE_CHECKING:
    import pyarrow as pa

    from .run import Shown


def _save(figure: Figure, path: Path) -> Path:
    FigureCanvasAgg(figure).print_figure(path, dpi=DPI)
    return path


def _drawn(scene: Scene, drive: SimulatedDrive, result: Result, alone: Any = None) -> Drawn:
    start = drive.truth.time[0]
    masked = [(a - start, b - start) for a, b in drive.outages]
    return make_scene(
        result, scene.roads, truth_table(drive, scene.roads), drive.drive.fixes, masked, alone
    )


def _window(scene: Scene, drive: SimulatedDrive) -> Window:
    """The stretch that is shown, in seconds."""
    metres = scene.decision_m + np.array(scene.shown_m)
    begin, end = np.interp(
        metres, drive.truth.travelled, drive.truth.time - drive.truth.time[0]
    ).tolist()
    return Window(scene.title, begin, end)


def draw_scene(
    scene: Scene, rides: Mapping[str, Sequence[Ride]], shown: "Shown", out: Path
) -> list[Path]:
    """The pictures of one of the scenes of Figures 8 to 11.

    Args:
        scene: Which.
        rides: One per seed and model.
        shown: The drive that is drawn.
        out: Folder.

    Returns:
        The figure that the paper draws, the lanes of its hypotheses, and what many drives did.
    """
    page = _outage_page if scene.name == "outage" else _zoom_page
    seeds = _outage_seeds if scene.name == "outage" else _seeds_page
    with matplotlib.rc_context(STYLE):
        return [
            _save(page(scene, shown), out / f"{scene.name}.png"),
            _save(_lanes_page(scene, shown), out / f"{scene.name}-lives.png"),
            _save(seeds(scene, rides), out / f"{scene.name}-seeds.png"),
        ]


def _title(scene: Scene, shown: "Shown", text: str) -> str:
    return f"{scene.figure}, seed {shown.drive.seed}: {text}"


def _zoom_page(scene: Scene, shown: "Shown") -> Figure:
    figure = Figure(figsize=(12, 5.2))
    panels = figure.subplots(1, 2)
    window = _window(scene, shown.drive)
    for axes, model in zip(panels, MODELS, strict=True):
        draw_zoom(axes, _drawn(scene, shown.drive, shown.results[model]), window)
        axes.set_title(CALLED[model])
    probability_bar(figure, panels[-1])
    _head(figure, _title(scene, shown, "every hypothesis with its 95 % ellipse"))
    return figure


def _outage_page(scene: Scene, shown: "Shown") -> Figure:
    figure = Figure(figsize=(13, 6.0))
    panels = figure.subplots(1, 2)
    alone = _track(scene, wheels_alone(shown.drive))
    for axes, model in zip(panels, MODELS, strict=True):
        draw_map(axes, _drawn(scene, shown.drive, shown.results[model], alone), [])
        axes.set_title(CALLED[model])
    probability_bar(figure, panels[-1])
    _head(figure, _title(scene, shown, "1.5 km by wheels and map"))
    return figure


def _track(scene: Scene, xy: Any) -> "pa.Table":
    import pyarrow as pa

    lat, lon = scene.roads.plane.to_geodetic(*xy.T)
    return pa.table({"lat": lat, "lon": lon})


def _head(figure: Figure, text: str) -> None:
    figure.suptitle(text, x=0.01, ha="left", weight="bold", fontsize=13)


def _lanes_page(scene: Scene, shown: "Shown") -> Figure:
    window = scene.shown_m
    figure = Figure(figsize=(12, 6.4))
    panels = figure.subplots(2, 1, sharex=True)
    for axes, model in zip(panels, MODELS, strict=True):
        draw_lanes(axes, shown.logs[model], window)
        axes.set_title(CALLED[model])
        axes.legend(handles=lane_legend(model), loc="lower left", ncols=2)
    panels[-1].set_xlabel(f"m driven past {scene.zero}")
    for axes in panels:
        probability_bar(figure, axes)
    _head(figure, _title(scene, shown, "the lives of the hypotheses"))
    return figure


def _seeds_page(scene: Scene, rides: Mapping[str, Sequence[Ride]]) -> Figure:
    figure = Figure(figsize=(12, 4.2))
    left, right = figure.subplots(1, 2, width_ratios=[1.5, 1])
    draw_band(left, rides, scene.shown_m)
    left.set_xlabel(f"m driven past {scene.zero}")
    left.set_title("How probable the true road was")
    draw_survival(right, rides, 1e9)
    right.set_title("How long a wrong road counted")
    _head(figure, f"{scene.figure}, {len(rides['default'])} drives")
    return figure


def _outage_seeds(scene: Scene, rides: Mapping[str, Sequence[Ride]]) -> Figure:
    figure = Figure(figsize=(12, 7.6))
    grid = figure.add_gridspec(2, 2, width_ratios=[1.5, 1])
    above = figure.add_subplot(grid[0, 0])
    draw_errors(above, [(CALLED[m], COLOURS[m], r) for m, r in rides.items()], scene.shown_m)
    above.set_title("How far from the truth, RMS over the drives")
    below = figure.add_subplot(grid[1, 0], sharex=above)
    draw_band(below, rides, scene.shown_m)
    below.set_xlabel(f"m driven past {scene.zero}")
    below.set_title("How probable the true road was")
    side = figure.add_subplot(grid[:, 1])
    draw_survival(side, rides, scene.shown_m[1])
    side.set_title("How long a wrong road counted")
    _head(figure, f"{scene.figure}, {len(rides['default'])} drives")
    return figure


def draw_gst(
    scene: Scene, rides: Mapping[Kind, Sequence[Ride]], shown: "Shown", out: Path
) -> list[Path]:
    """The pictures of the scene with noise that is not stationary; see `draw_scene`."""
    with matplotlib.rc_context(STYLE):
        return [
            _save(_gst_page(scene, shown), out / "gst.png"),
            _save(_gst_seeds(scene, rides), out / "gst-seeds.png"),
        ]


def _gst_page(scene: Scene, shown: "Shown") -> Figure:
    figure = Figure(figsize=(12, 5.0))
    axes = figure.subplots()
    draw_map(axes, _drawn(scene, shown.drive, shown.results["default"]), [])
    axes.set_title("Fixes of 2.7 m under open sky, of 11 m between houses")
    probability_bar(figure, axes)
    _head(figure, _title(scene, shown, "noise that is not stationary, whichroad"))
    return figure


_NOISE_COLOURS = {PER_FIX: "#0b4f9e", FIXED: "#c9a227"}


def _gst_seeds(scene: Scene, rides: Mapping[Kind, Sequence[Ride]]) -> Figure:
    figure = Figure(figsize=(12, 4.4))
    panels = figure.subplots(1, 2, sharey=True)
    for axes, model in zip(panels, MODELS, strict=True):
        lines: list[Line] = [
            (text, _NOISE_COLOURS[noise], rides[model, noise]) for noise, text in NOISES.items()
        ]
        draw_errors(axes, lines, scene.shown_m)
        axes.axvspan(0.0, CANYON_M[1] - CANYON_M[0], color=HIDDEN, alpha=0.18, lw=0, zorder=0)
        axes.set_title(CALLED[model])
        axes.set_xlabel(f"m driven past {scene.zero} (shaded)")
    panels[1].set_ylabel("")
    _head(figure, f"Position error, RMS over {len(rides['default', PER_FIX])} drives")
    return figure
