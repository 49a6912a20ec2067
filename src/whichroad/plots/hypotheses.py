"""Hypotheses of a stretch of road, each with its ellipse, and their probabilities beneath.

A road has one colour in every panel; opacity is probability.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..geodesy.angles import degrees
from .panels import OFF, RANKS, ROAD, TRUTH, scale_bar, shade_masked
from .scene import CHI2_95, LIVE, Scene, Window

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..observations import Array

MOST_MOMENTS = 14  # shown of a stretch: more would hide each other
_APART = 1.15  # moments are drawn so many mean diameters of their ellipses apart
_WIDTH = 6.4  # inches of one column
_AROUND = 0.12  # of the ellipses' extent, left free about them
_FLATTEST, _STEEPEST = 0.22, 0.9  # height of a frame over its width
_FIX = "#5b5f66"  # of the crosses: roads have the colours
DASHES: tuple[Any, ...] = ("-", (0, (4, 2)), (0, (1, 1.5)))  # of each method's P


def page_of_hypotheses(
    answers: Sequence[tuple[str, Scene]], windows: Sequence[Window], title: str
) -> Figure:
    """The paper's Figures 10 and 11: a column for each window, a row for each answer, P beneath.

    All frames have one scale, so that ellipses can be compared.
    """
    rows = len(answers)
    colours = [road_colours([scene for _, scene in answers], window) for window in windows]
    drawn = [[drawn_of(scene, window) for window in windows] for _, scene in answers]
    across, up = _frame([one for row in drawn for one in row])
    height = _WIDTH * up / across
    figure = Figure(figsize=(_WIDTH * len(windows) + 0.3, (height + 0.08) * rows + 3.2))
    axes = figure.subplots(
        rows + 1, len(windows), squeeze=False, height_ratios=[height] * rows + [1.9]
    )
    for column, window in enumerate(windows):
        for row, (name, scene) in enumerate(answers):
            one = axes[row, column]
            draw_moments(one, scene, window, drawn[row][column], colours[column])
            _place(one, drawn[row][column], across, up)
            if row == 0:
                scale_bar(one, across, "lower left")
            one.set_title(f"{'ABCDEF'[column]}  {window.title}" if row == 0 else "")
            one.set_ylabel(name if column == 0 else "", weight="bold")
        draw_choices(axes[rows, column], answers, window, colours[column])
    figure.legend(handles=_legend(answers[0][1]), loc="upper right", ncols=3, borderpad=0.2)
    figure.suptitle(title, x=0.01, ha="left", weight="bold", fontsize=12)
    return figure


def draw_zoom(axes: "Axes", scene: Scene, window: Window) -> None:
    """Every hypothesis of a window, in the colours of their roads, in axes of any shape."""
    rows = drawn_of(scene, window)
    draw_moments(axes, scene, window, rows, road_colours([scene], window))
    across, up = _frame([rows])
    _place(axes, rows, across, up, adjustable="datalim")
    scale_bar(axes, across, "lower left")
    axes.legend(handles=_legend(scene), loc="upper left", ncols=3, borderaxespad=0.2)


def road_colours(scenes: Sequence[Scene], window: Window) -> dict[int, str]:
    """Edge -> colour; the edges that were most probable in the window first."""
    mass: dict[int, float] = {}
    for scene in scenes:
        for edge, p in _chances(scene, window).items():
            mass[edge] = mass.get(edge, 0.0) + float(p.mean())
    leading = sorted(mass, key=lambda edge: -mass[edge])
    return {-1: OFF} | dict(zip(leading, RANKS, strict=False))


def _chances(scene: Scene, window: Window) -> "dict[int, Array]":
    """P of each road over the window; only those that once were more than `LIVE`."""
    epochs = scene.within(window)
    edge = scene.hypotheses["edge"][epochs]
    p = np.where(edge == -2, 0.0, scene.hypotheses["p"][epochs])
    mass = {int(e): np.where(edge == e, p, 0).sum(axis=1) for e in np.unique(edge) if e >= 0}
    return {e: of for e, of in mass.items() if of.max(initial=0.0) > LIVE}


def drawn_of(scene: Scene, window: Window) -> dict[str, Any]:
    """The hypotheses that are drawn, one row each: those of moments whose ellipses are apart."""
    inside = scene.within(window)
    live = scene.hypotheses["edge"] != -2
    if len(inside) > 1:
        spread = scene.hypotheses["cov_xx"][inside] + scene.hypotheses["cov_yy"][inside]
        diameter = 2 * np.sqrt(CHI2_95 * 0.5 * spread[live[inside]].mean())
        steps = np.hypot(*np.diff(scene.xy[inside], axis=0).T)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        count = int(np.clip(along[-1] / (_APART * diameter) + 1, 2, MOST_MOMENTS))
        wanted = np.linspace(0, along[-1], count)
        chosen = np.searchsorted(along, wanted).clip(max=len(inside) - 1)
        inside = inside[np.unique(chosen)]
    rows = {name: values[inside].ravel() for name, values in scene.hypotheses.items()}
    rows["epoch"] = np.repeat(inside, live.shape[1])
    keep = (rows["edge"] != -2) & (rows["p"] > LIVE / 2)
    order = np.flatnonzero(keep)[np.argsort(rows["p"][keep])]  # the most probable on top
    return {name: values[order] for name, values in rows.items()}


def draw_moments(
    axes: "Axes", scene: Scene, window: Window, rows: dict[str, Any], colours: dict[int, str]
) -> None:
    """Roads, truth, fixes, and the rows of `drawn_of` with their ellipses."""
    axes.add_collection(LineCollection(scene.roads, colors=ROAD, linewidths=5, zorder=1))
    if scene.truth is not None:
        axes.plot(*scene.truth[scene.within(window)].T, color=TRUTH, lw=1.1, zorder=5)
    if len(scene.fixes):
        axes.plot(*scene.fixes.T, "+", color=_FIX, ms=7, mew=1.3, zorder=5)
    draw_ellipses(axes, rows, colours)
    shade = [colours.get(int(edge), OFF) for edge in rows["edge"]]
    axes.scatter(
        rows["x"], rows["y"], c=shade, s=12 + 22 * rows["p"], edgecolors="white",
        linewidths=0.6, zorder=7,
    )  # fmt: skip
    _label_last(axes, rows, colours)


def _label_last(axes: "Axes", rows: dict[str, Any], colours: dict[int, str]) -> None:
    """P beside each hypothesis of the last moment."""
    if len(rows["p"]) == 0:
        return
    for row in np.flatnonzero(rows["epoch"] == rows["epoch"].max()):
        edge = float(rows["x"][row] + np.sqrt(CHI2_95 * rows["cov_xx"][row]))
        axes.annotate(
            f"{100 * rows['p'][row]:.0f} %", (edge, float(rows["y"][row])), (3, 0),
            textcoords="offset points", va="center", fontsize=8, weight="bold", zorder=8,
            color=colours.get(int(rows["edge"][row]), OFF),
        )  # fmt: skip


def draw_ellipses(axes: "Axes", rows: dict[str, Any], colours: dict[int, str]) -> None:
    """The 95 % ellipse of each row, as opaque as it is probable."""
    covs = _covariances(rows)
    squares, axes_of = np.linalg.eigh(covs)
    minor, major = 2 * np.sqrt(CHI2_95 * squares.T)
    angle = degrees(np.arctan2(axes_of[:, 1, 1], axes_of[:, 0, 1]))
    ellipses = EllipseCollection(
        major, minor, angle, units="xy", offset_transform=axes.transData,
        offsets=np.column_stack([rows["x"], rows["y"]]), linewidths=1.3, zorder=6,
    )  # fmt: skip
    edges = rows.get("edge", np.zeros(len(rows["p"]), int))
    shades = [colours.get(int(edge), OFF) for edge in edges]
    p = np.clip(rows["p"], 0.0, 1.0)
    ellipses.set_edgecolor([to_rgba(s, 0.3 + 0.7 * q) for s, q in zip(shades, p, strict=True)])
    ellipses.set_facecolor([to_rgba(s, 0.04 + 0.26 * q) for s, q in zip(shades, p, strict=True)])
    axes.add_collection(ellipses)


def draw_choices(
    axes: "Axes",
    answers: Sequence[tuple[str, Scene]],
    window: Window,
    colours: dict[int, str],
) -> None:
    """P of each road over a window: a colour a road, a kind of dashes an answer."""
    names = {edge: name for _, scene in answers for edge, name in scene.names.items()}
    for (_, scene), dashes in zip(answers, DASHES, strict=False):
        time = scene.time[scene.within(window)]
        for edge, p in _chances(scene, window).items():
            if edge in colours:
                axes.plot(time, p, color=colours[edge], ls=dashes, lw=1.9)
        off = scene.p_off_road[scene.within(window)]
        if len(off) and off.max() > LIVE:
            axes.plot(time, off, color=OFF, ls=dashes, lw=1.4)
    shade_masked(axes, answers[0][1])
    for begin, end in answers[0][1].masked:
        low, high = max(begin, window.begin), min(end, window.end)
        if high > low:
            axes.text(
                high, 0.32, "without GPS  ", color=OFF, fontsize=8, style="italic", ha="right"
            )
    axes.set(xlim=(window.begin, window.end), ylim=(-0.02, 1.05), ylabel="probability")
    axes.set_xlabel("time since the start (s)")
    handles = [
        Line2D([], [], color=colour, lw=3, label=names.get(edge, "off road"))
        for edge, colour in colours.items()
        if edge >= 0
    ]
    if len(answers) > 1:
        handles += [
            Line2D([], [], color=TRUTH, lw=1.5, ls=dashes, label=name)
            for (name, _), dashes in zip(answers, DASHES, strict=False)
        ]
    axes.legend(handles=handles, loc="best", handlelength=2.2)


def _covariances(rows: dict[str, Any]) -> "Array":
    covs = np.empty((len(rows["p"]), 2, 2))
    covs[:, 0, 0], covs[:, 1, 1] = rows["cov_xx"], rows["cov_yy"]
    covs[:, 0, 1] = covs[:, 1, 0] = rows["cov_xy"]
    return covs


def _extent(rows: dict[str, Any]) -> "tuple[Array, Array] | None":
    """Lowest and highest x and y of the ellipses; None where there is none."""
    if len(rows["p"]) == 0:
        return None
    reach = np.sqrt(CHI2_95 * np.column_stack([rows["cov_xx"], rows["cov_yy"]]))
    at = np.column_stack([rows["x"], rows["y"]])
    return (at - reach).min(axis=0), (at + reach).max(axis=0)


def _frame(drawn: Sequence[dict[str, Any]]) -> tuple[float, float]:
    """Width and height, m, that hold the ellipses of each."""
    sizes = [high - low for low, high in filter(None, map(_extent, drawn))]
    across, up = (1.0 + 2 * _AROUND) * np.max(sizes, axis=0) if sizes else (100.0, 50.0)
    return float(across), float(np.clip(up, _FLATTEST * across, _STEEPEST * across))


def _place(
    axes: "Axes", rows: dict[str, Any], across: float, up: float, *,
    adjustable: Literal["box", "datalim"] = "box",
) -> None:  # fmt: skip
    """Put a frame of that size about the ellipses, without ticks."""
    extent = _extent(rows)
    if extent is not None:
        middle, half = 0.5 * (extent[0] + extent[1]), 0.5 * np.array([across, up])
        axes.dataLim.set_points(np.array([middle - half, middle + half]))
        axes.margins(0)
        axes.autoscale(True)
    axes.set_aspect("equal", adjustable=adjustable)
    axes.set(xticks=[], yticks=[])
    for side in axes.spines.values():
        side.set_visible(True)


def _legend(scene: Scene) -> list[Any]:
    handles: list[Any] = [
        Line2D([], [], color=RANKS[0], marker="o", ls="", label="hypothesis, 95 % ellipse")
    ]
    if len(scene.fixes):
        handles.append(Line2D([], [], color=_FIX, marker="+", mew=1.3, ls="", label="GNSS fix"))
    if scene.truth is not None:
        handles.append(Line2D([], [], color=TRUTH, lw=1.1, label="truth"))
    return handles
