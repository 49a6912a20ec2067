"""The experiments' pictures: the paper's figure, the lanes of hypotheses, many drives."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..lineage import Hypothesis
from ..lineage.lanes import Stretch, draw_lanes, lanes_of, legend_of_lanes
from ..plots.pages import STYLE, print_png
from ..plots.panels import FIX, HIDDEN, PROBABLE, RECKONING, TRUTH, UNIT, probability_bar
from .curves import ABOVE, COLOURS, Line, draw_band, draw_errors, draw_survival
from .example_drive import ExampleDrive
from .gst import FIXED, NOISES, PER_FIX, Kind
from .map_drawings import (
    Place,
    draw_hypotheses,
    draw_roads,
    driven_at,
    frame,
    legend_of_map,
    name_roads,
)
from .runs import MODELS, Run
from .scenes import CANYON_M, Scene
from .wheels_alone import wheels_alone


class Picture(NamedTuple):
    """A file, and what is in it."""

    path: Path
    caption: str


def draw_scene(
    scene: Scene, runs: Mapping[Kind, Sequence[Run]], example: ExampleDrive, out: Path
) -> list[Picture]:
    """All pictures of a scene.

    Args:
        scene: Which.
        runs: One per seed, by model and noise.
        example: The drive that is drawn.
        out: Folder.

    Returns:
        First what the paper draws, then the lifetimes of its hypotheses, then many drives.
    """
    by_model = {model: runs[model, PER_FIX] for model in MODELS}
    count, seed = len(by_model["default"]), example.drive.seed
    of_one, of_all = f"One drive, seed {seed}", f"{count} drives"

    def save(name: str, draw: Callable[[], Figure], caption: str) -> Picture:
        path = out / f"{name}.png"
        print_png(draw(), path)
        return Picture(path, caption)

    with matplotlib.rc_context(STYLE):
        if scene.name == "gst":
            return [
                save("gst", lambda: _gst_page(example), f"{of_one}: {_GST_CAPTION}"),
                save("gst-seeds", lambda: _gst_seeds(scene, runs), f"{of_all}: {_ERRORS_CAPTION}"),
            ]
        dark = scene.name == "outage"
        page, seeds = (_outage_page, _outage_seeds) if dark else (_zoom_page, _seeds_page)
        caption = _OUTAGE_CAPTION if dark else _ZOOM_CAPTION
        curves = _DARK_CAPTION if dark else _CURVES_CAPTION
        return [
            save(scene.name, lambda: page(example), f"{of_one}: {caption}"),
            save(
                f"{scene.name}-lives", lambda: _lanes_page(example), f"{of_one}: {_LANES_CAPTION}"
            ),
            save(
                f"{scene.name}-seeds",
                lambda: seeds(scene, by_model),
                f"{of_all}: {curves}",
            ),
        ]


_ZOOM_CAPTION = (
    "every hypothesis of P >= 0.01 with its 95 % ellipse, once a second. The road map has an error "
    "of its own, so that the truth lies beside its line."
)
_OUTAGE_CAPTION = (
    "the whole drive, and the estimates where GPS comes back, once a second, with their 95 % "
    "ellipses."
)
_LANES_CAPTION = (
    "the lifetimes of the hypotheses. A lane for every road in one direction, coloured by its "
    "probability."
)
_CURVES_CAPTION = "P of the true road along the route, and how long wrong roads count (P >= 0.01)."
_ERRORS_CAPTION = (
    "the position error that 63 % of the drives stay below (of Gaussian errors their RMS), dashed "
    "the RMS error that the filter states."
)
_DARK_CAPTION = f"{_ERRORS_CAPTION[:-1]}; {_CURVES_CAPTION}"
_GST_CAPTION = (
    "fixes under open sky and between houses, and what whichroad makes of them with the "
    "covariance of each fix and with one for all."
)


def _zoom_page(example: ExampleDrive) -> Figure:
    figure = Figure(figsize=(12, 8.0))
    panels = figure.subplots(2, 1)
    place = Place(example.scene)
    for axes, model in zip(panels, MODELS, strict=True):
        draw_roads(axes, place, 5.0)
        draw_hypotheses(axes, example, place, example.results[model], example.scene.near_m)
        axes.set_title(MODELS[model])
    _same_frame(panels, place)
    _fit(figure, panels)
    panels[0].legend(handles=legend_of_map(), ncols=4, **ABOVE)
    probability_bar(figure, panels)
    return figure


def _same_frame(panels: Sequence[matplotlib.axes.Axes], place: Place) -> None:
    """The same stretch of map in all, with the names of its roads."""
    across, up = (
        np.array([getattr(axes, get)() for axes in panels]) for get in ("get_xlim", "get_ylim")
    )
    for axes in panels:
        axes.set(xlim=(across[:, 0].min(), across[:, 1].max()))
        axes.set(ylim=(up[:, 0].min(), up[:, 1].max()))
        name_roads(axes, place)


def _fit(figure: Figure, panels: Sequence[matplotlib.axes.Axes]) -> None:
    """As high as panels one above the other need to be."""
    (west, east), (south, north) = panels[0].get_xlim(), panels[0].get_ylim()
    width = figure.get_figwidth()
    each = 0.86 * width * (north - south) / (east - west) + 0.75
    figure.set_figheight(len(panels) * each + 0.2)


def _outage_page(example: ExampleDrive) -> Figure:
    """The paper's Figure 9, and what cannot be seen in it: the estimates at the mask's end."""
    figure = Figure(figsize=(13, 4.9))
    whole, *panels = figure.subplots(1, 3, width_ratios=[5.2, 1, 1])
    place = Place(example.scene)
    _draw_route(whole, example, place)
    for axes, model in zip(panels, MODELS, strict=True):
        draw_roads(axes, place, 5.0)
        draw_hypotheses(axes, example, place, example.results[model], example.scene.near_m)
        axes.set_title(MODELS[model])
    _same_frame(panels, place)
    probability_bar(figure, panels)
    return figure


def _draw_route(axes: matplotlib.axes.Axes, example: ExampleDrive, place: Place) -> None:
    truth, (begin, end) = example.drive.truth, example.drive.outages[0]
    draw_roads(axes, place, 1.6)
    path = place.here(truth.x, truth.y)
    hidden = (truth.time >= begin) & (truth.time <= end)
    axes.plot(*path[hidden].T, color=HIDDEN, alpha=0.35, lw=13, solid_capstyle="round", zorder=2)
    axes.plot(*path.T, color=TRUTH, lw=2.4, zorder=3)
    for model in MODELS:
        points = example.results[model].to_arrow()
        lat, lon = (points[name].to_numpy() for name in ("lat", "lon"))
        axes.plot(*place.at(lat, lon).T, color=COLOURS[model], lw=1.0, zorder=4)
    alone = wheels_alone(example.drive)
    axes.plot(*place.here(*alone.T).T, color=RECKONING, lw=1.4, ls=(0, (4, 3)), zorder=5)
    fixes = example.drive.drive.fixes
    assert fixes is not None
    axes.plot(*place.at(fixes.lat_deg, fixes.lon_deg).T, ".", color=FIX, ms=3, mew=0, zorder=3)
    low, high = path.min(axis=0) - 170.0, path.max(axis=0) + 170.0
    frame(axes, np.array([low, high]))
    axes.set_title("1.5 km without GPS")
    axes.legend(handles=_legend_of_route(), loc="upper left")


def _legend_of_route() -> list[Line2D | Patch]:
    return [
        Line2D([], [], color=TRUTH, lw=2.4, label="truth"),
        *(Line2D([], [], color=COLOURS[m], lw=1.4, label=called) for m, called in MODELS.items()),
        Line2D([], [], color=RECKONING, lw=1.4, ls=(0, (4, 3)), label="wheels alone"),
        Line2D([], [], color=FIX, marker=".", ls="", label="GNSS fix"),
        Patch(color=HIDDEN, alpha=0.35, label="GPS masked"),
    ]


def _lanes_page(example: ExampleDrive) -> Figure:
    window = example.scene.far_m
    shown = {m: Stretch(log.past, log.hypotheses, window) for m, log in example.logs.items()}
    lanes = [len(lanes_of(shown[model])) for model in MODELS]
    figure = Figure(figsize=(12, 1.7 + 0.29 * sum(lanes)))
    panels = figure.subplots(2, 1, sharex=True, height_ratios=lanes)
    for axes, model in zip(panels, MODELS, strict=True):
        draw_lanes(axes, shown[model], PROBABLE, UNIT, _names)
        axes.set_title(MODELS[model])
        axes.legend(handles=legend_of_lanes(model), ncols=4, **ABOVE)
    panels[-1].set_xlabel(f"m driven past {example.scene.zero}")
    probability_bar(figure, panels)
    return figure


def _names(counting: Sequence[Hypothesis], lanes: Mapping[int, int]) -> list[str]:
    """Streets; the direction that was entered second is marked."""
    names, taken = [""] * len(lanes), set()
    for edge, lane in lanes.items():
        street = next(h.street for h in counting if h.edge == edge)
        names[lane] = f"{street}, back" if street in taken else street
        taken.add(street)
    return names


def _seeds_page(scene: Scene, runs: Mapping[str, Sequence[Run]]) -> Figure:
    figure = Figure(figsize=(12, 5.6))
    grid = figure.add_gridspec(2, 2, width_ratios=[1.6, 1])
    _draw_bands(figure, [grid[0, 0], grid[1, 0]], scene, runs)
    side = figure.add_subplot(grid[:, 1])
    draw_survival(side, scene, runs)
    side.set_title("How long a wrong road counted")
    return figure


def _draw_bands(
    figure: Figure, places: Sequence[matplotlib.gridspec.SubplotSpec], scene: Scene,
    runs: Mapping[str, Sequence[Run]],
) -> None:  # fmt: skip
    first = None
    for place, (model, answered) in zip(places, runs.items(), strict=True):
        axes = figure.add_subplot(place, sharex=first)
        draw_band(axes, model, answered, scene.far_m)
        axes.set_title(MODELS[model])
        first = first or axes
        if place is not places[-1]:
            axes.tick_params(labelbottom=False)
    axes.set_xlabel(f"m driven past {scene.zero}")


def _outage_seeds(scene: Scene, runs: Mapping[str, Sequence[Run]]) -> Figure:
    figure = Figure(figsize=(12, 8.4))
    grid = figure.add_gridspec(3, 2, width_ratios=[1.6, 1], height_ratios=[1.3, 1, 1])
    above = figure.add_subplot(grid[0, :])
    draw_errors(above, [(MODELS[m], COLOURS[m], r) for m, r in runs.items()], scene.far_m)
    above.axvspan(*scene.counted_m, color=HIDDEN, alpha=0.18, lw=0, zorder=0)
    above.set_title("How far from the truth; GPS masked where shaded")
    above.set_xlabel(f"m driven past {scene.zero}")
    _draw_bands(figure, [grid[1, 0], grid[2, 0]], scene, runs)
    side = figure.add_subplot(grid[1:, 1])
    draw_survival(side, scene, runs)
    side.set_title("How long a wrong road counted")
    return figure


_NOISE_COLOURS = {PER_FIX: "#0b4f9e", FIXED: "#c9a227"}


def _gst_page(example: ExampleDrive) -> Figure:
    """The route with its fixes, and the middle of it enlarged."""
    assert example.fixed is not None
    figure = Figure(figsize=(13, 3.0))
    whole, near = figure.subplots(1, 2, width_ratios=[1.9, 1])
    place, truth = Place(example.scene), example.drive.truth
    answers = {PER_FIX: example.results["default"], FIXED: example.fixed}
    path = place.here(truth.x, truth.y)
    begin, end = driven_at(example, example.scene.near_m)
    houses = path[(truth.time >= begin) & (truth.time <= end)]
    for axes, width in ((whole, 1.0), (near, 1.6)):
        draw_roads(axes, place, width)
        axes.plot(*houses.T, color=HIDDEN, alpha=0.3, lw=18 * width, zorder=1)
        axes.plot(*path.T, color=TRUTH, lw=1.2, zorder=4)
        fixes = example.drive.drive.fixes
        assert fixes is not None
        spots = place.at(fixes.lat_deg, fixes.lon_deg)
        axes.plot(*spots.T, ".", color=FIX, ms=4 * width, mew=0, zorder=3)
    for noise, result in answers.items():
        points = result.to_arrow()
        lat, lon = (points[name].to_numpy() for name in ("lat", "lon"))
        near.plot(*place.at(lat, lon).T, color=_NOISE_COLOURS[noise], lw=1.8, zorder=5)
    frame(whole, np.array([path.min(axis=0) - 90.0, path.max(axis=0) + 90.0]))
    frame(near, np.array([houses.min(axis=0) - 40.0, houses.max(axis=0) + 40.0]))
    whole.set_title("The route")
    near.set_title("Between the houses")
    whole.legend(handles=_legend_of_gst(), ncols=5, **ABOVE)
    return figure


def _legend_of_gst() -> list[Line2D | Patch]:
    return [
        Line2D([], [], color=TRUTH, lw=1.2, label="truth"),
        *(Line2D([], [], color=_NOISE_COLOURS[n], lw=1.8, label=t) for n, t in NOISES.items()),
        Line2D([], [], color=FIX, marker=".", ls="", label="GNSS fix"),
        Patch(color=HIDDEN, alpha=0.35, label="houses"),
    ]


def _gst_seeds(scene: Scene, runs: Mapping[Kind, Sequence[Run]]) -> Figure:
    figure = Figure(figsize=(12, 6.4))
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    most = 0.0
    for axes, model in zip(panels, MODELS, strict=True):
        lines: list[Line] = [
            (text, _NOISE_COLOURS[noise], runs[model, noise]) for noise, text in NOISES.items()
        ]
        most = max(most, draw_errors(axes, lines, scene.far_m))
        axes.axvspan(0.0, CANYON_M[1] - CANYON_M[0], color=HIDDEN, alpha=0.18, lw=0, zorder=0)
        axes.set_title(MODELS[model])
    panels[0].set_ylim(0.0, 1.06 * most)
    panels[-1].set_xlabel(f"m driven past {scene.zero} (shaded)")
    return figure
