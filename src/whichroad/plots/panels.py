"""The panels of the pictures: each draws one thing on the axes that it is given."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.lines import Line2D
from matplotlib.offsetbox import AnchoredOffsetbox, AuxTransformBox, TextArea, VPacker
from matplotlib.patches import Patch

from .scene import Scene, Window

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PROBABLE = LinearSegmentedColormap.from_list(
    "probable", ["#c51b1b", "#ee7d2f", "#eec143", "#5aa6cf", "#0b4f9e"]
)
UNIT = Normalize(0, 1)
ROAD, FIX, TRUTH, RECKONING, HIDDEN = "#cdd1d7", "#e0861a", "#16181b", "#8e44ad", "#8f9bb8"
RANKS = ["#0b4f9e", "#ee7d2f", "#4dac76", "#b565a7", "#c9a227"]
OFF = "#7d838b"
STATUS = {
    "on_road": "#0b4f9e",
    "ambiguous": "#eec143",
    "outage": "#8f9bb8",
    "stopped": "#bcd7ea",
    "off_road": "#8e6bb1",
    "lost": "#c51b1b",
}


def draw_map(axes: "Axes", scene: Scene, windows: list[Window]) -> None:
    """The whole drive: roads, fixes, truth, and the answer coloured by P(way)."""
    axes.add_collection(LineCollection(scene.roads, colors=ROAD, linewidths=0.9, zorder=1))
    hidden = np.where(scene.is_masked()[:, None], scene.xy, np.nan)
    axes.plot(*hidden.T, color=HIDDEN, alpha=0.35, lw=13, solid_capstyle="round", zorder=2)
    if scene.reckoning is not None:
        axes.plot(*scene.reckoning.T, color=RECKONING, lw=1.2, ls=(0, (4, 3)), zorder=3)
    pieces = np.stack([scene.xy[:-1], scene.xy[1:]], axis=1)
    line = LineCollection(list(pieces), cmap=PROBABLE, norm=UNIT, linewidths=4, zorder=5)
    line.set_array(scene.p_way[1:])
    line.set_capstyle("round")
    axes.add_collection(line)
    if scene.truth is not None:
        axes.plot(*scene.truth.T, color=TRUTH, lw=0.6, zorder=6)
    axes.plot(*scene.fixes.T, ".", color=FIX, ms=2.6, mew=0, zorder=6)
    for letter, window in zip("ABCDEF", windows, strict=False):
        _mark_window(axes, scene, window, letter)
    _ends(axes, scene)
    _metres(axes, *_box(scene.xy, 120))
    axes.legend(handles=_map_legend(scene), loc="best")


def _ends(axes: "Axes", scene: Scene) -> None:
    known = np.flatnonzero(np.isfinite(scene.xy[:, 0]))
    for index, marker, word in ((known[0], "o", "start"), (known[-1], "s", "end")):
        axes.plot(*scene.xy[index], marker, color="white", mec=TRUTH, ms=6, mew=1.4, zorder=8)
        axes.annotate(
            word, scene.xy[index], (7, 6), textcoords="offset points", fontsize=8, zorder=9
        )


def _mark_window(axes: "Axes", scene: Scene, window: Window, letter: str) -> None:
    """A frame with a letter around a zoom's area."""
    inside = scene.within(window)
    if len(inside) == 0:
        return
    (west, east), (south, north) = _box(scene.xy[inside], 30)
    frame = [(west, south), (east, south), (east, north), (west, north), (west, south)]
    axes.plot(*np.array(frame).T, color=TRUTH, lw=0.9, zorder=7)
    axes.annotate(
        letter,
        (west, north),
        (0, 3),
        textcoords="offset points",
        weight="bold",
        fontsize=10,
        zorder=9,
    )


def _map_legend(scene: Scene) -> list[Any]:
    handles: list[Any] = [
        Line2D([], [], color=PROBABLE(0.97), lw=4, label="estimate, coloured by P(way)"),
        Line2D([], [], color=ROAD, lw=1.2, label="road map"),
    ]
    if len(scene.fixes):
        handles.append(Line2D([], [], color=FIX, marker=".", ls="", label="GNSS fix"))
    if scene.masked:
        handles.append(Patch(color=HIDDEN, alpha=0.35, label="GNSS masked"))
    if scene.truth is not None:
        handles.append(Line2D([], [], color=TRUTH, lw=0.8, label="truth"))
    if scene.reckoning is not None:
        handles.append(
            Line2D([], [], color=RECKONING, lw=1.2, ls=(0, (4, 3)), label="wheels alone")
        )
    return handles


def draw_probability(axes: "Axes", scene: Scene, windows: list[Window]) -> None:
    """P of the most probable way, of all other roads, and P(off-road), over the drive."""
    others = np.clip(1.0 - scene.p_way - scene.p_off_road, 0.0, 1.0)
    for rank, (word, p) in enumerate((("most probable way", scene.p_way), ("others", others))):
        axes.plot(scene.time, p, color=RANKS[rank], lw=1.1, label=word)
    axes.plot(scene.time, scene.p_off_road, color=OFF, lw=1.2, ls=":", label="off road")
    shade_masked(axes, scene)
    _letters(axes, windows)
    axes.set(xlim=(0, scene.time[-1]), ylim=(-0.02, 1.05), ylabel="probability")
    axes.legend(loc="lower right", ncols=4, bbox_to_anchor=(1, 1.04), borderpad=0)


def draw_status(axes: "Axes", scene: Scene) -> None:
    """The status of each epoch, as a band of colours."""
    status = np.array(scene.status)
    cuts = np.flatnonzero(status[1:] != status[:-1]) + 1
    begin, end = np.append(0, cuts), np.append(cuts, len(status) - 1)
    handles = []
    for word, colour in STATUS.items():
        mine = status[begin] == word
        if mine.any():
            start = scene.time[begin[mine]]
            bars = np.column_stack([start, scene.time[end[mine]] - start])
            axes.broken_barh(list(map(tuple, bars)), (0, 1), color=colour, lw=0)
            handles.append(Patch(color=colour, label=word.replace("_", " ")))
    axes.set(xlim=(0, scene.time[-1]), ylim=(0, 1), yticks=[], ylabel="status")
    axes.tick_params(bottom=False, labelbottom=False)
    axes.yaxis.label.set(rotation=0, ha="right", va="center")
    axes.legend(
        handles=handles, loc="upper left",
        bbox_to_anchor=(-0.005, 0), ncols=6, handlelength=1, handleheight=1,
    )  # fmt: skip
    for side in axes.spines.values():
        side.set_visible(False)


def draw_error(axes: "Axes", scene: Scene) -> None:
    """How far from the truth, beside the error bound of the estimate."""
    assert scene.truth is not None
    assert scene.inside is not None
    held = f"holds the truth in {100 * scene.inside.mean():.1f} % of epochs"
    error = np.hypot(*(scene.truth - scene.xy).T)
    axes.fill_between(scene.time, 0, scene.bound, color=PROBABLE(0.75), alpha=0.25, lw=0,
                      label=f"95 % ellipse, semi-major axis ({held})")  # fmt: skip
    axes.plot(scene.time, error, color=TRUTH, lw=1.0, label="distance from the truth")
    shade_masked(axes, scene)
    axes.set(xlim=(0, scene.time[-1]), ylabel="metres", xlabel="time since the start (s)")
    axes.set_ylim(0, 1.15 * float(np.nanmax(np.concatenate([error, scene.bound]))))
    axes.legend(loc="lower right", ncols=2, bbox_to_anchor=(1, 1.0), borderpad=0)


def shade_masked(axes: "Axes", scene: Scene) -> None:
    """Shade the stretches without GNSS."""
    for begin, end in scene.masked:
        axes.axvspan(begin, min(end, scene.time[-1]), color=HIDDEN, alpha=0.18, lw=0, zorder=0)


def _letters(axes: "Axes", windows: list[Window]) -> None:
    for letter, window in zip("ABCDEF", windows, strict=False):
        middle = (window.begin + window.end) / 2
        axes.axvspan(window.begin, window.end, ymin=0.965, color=TRUTH, lw=0)
        axes.annotate(
            letter, (middle, 1.01), xycoords=("data", "axes fraction"), ha="center",
            weight="bold", fontsize=9,
        )  # fmt: skip


def _box(xy: Any, margin: float) -> tuple[tuple[float, float], tuple[float, float]]:
    low, high = np.nanmin(xy, axis=0) - margin, np.nanmax(xy, axis=0) + margin
    return (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))


def _metres(axes: "Axes", across: tuple[float, float], up: tuple[float, float]) -> None:
    """Equal scales, metre labels, and a bar for scale."""
    axes.dataLim.set_points(np.array([(across[0], up[0]), (across[1], up[1])]))
    axes.margins(0)
    axes.autoscale(True)
    axes.set(xlabel="east (m)", ylabel="north (m)")
    axes.set_aspect("equal", adjustable="datalim")
    scale_bar(axes, across[1] - across[0])


def scale_bar(axes: "Axes", span: float, place: str = "lower right") -> None:
    """A bar of 1, 2 or 5 times a power of ten metres, at most a third of the span."""
    power = 10.0 ** np.floor(np.log10(span / 3))
    length = max(step * power for step in (1, 2, 5) if step * power <= span / 3)
    text = f"{length:g} m" if length < 1000 else f"{length / 1000:g} km"
    bar = AuxTransformBox(axes.transData)
    bar.add_artist(Line2D([0, length], [0, 0], color=TRUTH, lw=2, solid_capstyle="butt"))
    label = TextArea(text, textprops={"fontsize": 8})
    both = VPacker(children=[bar, label], align="center", pad=2, sep=3)
    axes.add_artist(AnchoredOffsetbox(place, child=both, frameon=False, borderpad=0.6))


def probability_bar(figure: "Figure", axes: "Axes") -> None:
    """The key of the colours, beside the axes."""
    key = figure.colorbar(ScalarMappable(UNIT, PROBABLE), ax=axes, shrink=0.6, aspect=24, pad=0.02)
    key.set_label("probability")
    key.outline.set_visible(False)
