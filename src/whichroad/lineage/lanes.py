"""Lanes of hypotheses: the probability of every road over the way or time, births and deaths."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.colors import Colormap, Normalize
from matplotlib.lines import Line2D

from ..observations import Array
from .lives import COUNTS, Hypothesis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FAINT, _INK = "#9aa0a8", "#16181b"
_HALF = 0.22  # half width of a strip, in lanes
_LANE, _MARGIN = 0.29, 0.9  # inches of a picture's height
_SIGNS = {
    "outweighed": "X", "pruned": "X", "left behind": ">", "restarted": "s", "out of reach": "D",
}  # fmt: skip


class Stretch(NamedTuple):
    """What is drawn: a stretch of x, and hypotheses."""

    x: Array  # (n,) of the epochs: s, or m
    hypotheses: Sequence[Hypothesis]
    window: tuple[float, float]  # of x
    least: float = COUNTS  # P that an edge has somewhere, to get a lane


def plot_lanes(ax: Any, shown: Stretch) -> Any:
    """See `Lineage.plot`."""
    if ax is None:
        import matplotlib.pyplot as plt

        lanes = max(len(lanes_of(shown)), 2)
        _, ax = plt.subplots(figsize=(10, _MARGIN + _LANE * lanes), layout="constrained")
    draw_lanes(ax, shown, "RdYlBu", Normalize(0, 1), _with_edge)
    ax.set_xlabel("s since the drive's start")
    paper = any(h.why == "out of reach" for h in shown.hypotheses)
    ax.legend(
        handles=legend_of_lanes("paper" if paper else "default"), loc="lower right", ncols=4,
        bbox_to_anchor=(1.0, 1.0), borderpad=0.0, frameon=False, fontsize="small",
    )  # fmt: skip
    return ax


def lanes_of(shown: Stretch) -> dict[int, int]:
    """The edges that count somewhere in the stretch, in order of birth: edge to lane."""
    lanes: dict[int, int] = {}
    for h in sorted(_counting(shown), key=lambda h: h.created):
        lanes.setdefault(h.edge, len(lanes))
    return lanes


def _inside(shown: Stretch) -> tuple[int, int]:
    """First and last epoch of the stretch."""
    inside = np.flatnonzero((shown.x >= shown.window[0]) & (shown.x <= shown.window[1]))
    return (int(inside[0]), int(inside[-1])) if len(inside) else (0, -1)


def _counting(shown: Stretch) -> list[Hypothesis]:
    """The hypotheses that count in some epoch of the stretch."""
    first, last = _inside(shown)

    def most(h: Hypothesis) -> float:
        return max(h.p[max(first - h.created, 0) : last - h.created + 1], default=0.0)

    return [
        h
        for h in shown.hypotheses
        if h.created <= last and h.last >= first and most(h) >= shown.least
    ]


def draw_lanes(
    axes: "Axes", shown: Stretch, colours: str | Colormap, norm: Normalize,
    names: Callable[[Sequence[Hypothesis], Mapping[int, int]], list[str]],
) -> None:  # fmt: skip
    """Draw one lane per directed edge.

    Args:
        axes: What is drawn on.
        shown: The hypotheses.
        colours: For P.
        norm: Of the colours.
        names: Gives the lanes' names, from the hypotheses that count and edge to lane.
    """
    lanes, counting = lanes_of(shown), _counting(shown)
    first, last = _inside(shown)
    for edge, lane in lanes.items():
        _draw_lane(axes, shown, edge, lane, colours, norm)
        _draw_death(axes, shown, [h for h in counting if h.edge == edge], lane, last)
    _draw_births(axes, shown, counting, lanes, first, last)
    axes.set(xlim=shown.window, ylim=(len(lanes) - 0.45, -0.55))
    axes.set_yticks(range(len(lanes)), names(counting, lanes))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def _with_edge(counting: Sequence[Hypothesis], lanes: Mapping[int, int]) -> list[str]:
    """Streets, with the number of the edge."""
    street = {h.edge: h.street for h in counting}
    return [f"{street[edge]} ({edge})" if edge >= 0 else street[edge] for edge in lanes]


def _draw_lane(
    axes: "Axes", shown: Stretch, edge: int, lane: int, colours: str | Colormap, norm: Normalize
) -> None:
    """What the hypotheses of one edge weigh together, as a coloured strip."""
    first, last = _inside(shown)
    p = np.zeros(len(shown.x))
    for h in shown.hypotheses:
        if h.edge == edge:
            p[h.created : h.last + 1] += np.asarray(h.p)
    x, p = shown.x[first : last + 1], p[first : last + 1]
    axes.plot(x, np.where(p > 0.0, float(lane), np.nan), color=FAINT, lw=1.2, zorder=2)
    borders = np.concatenate([x, 2.0 * x[-1:] - x[-2:-1]]) if len(x) > 1 else np.repeat(x, 2)
    strip = np.ma.masked_less(p[None, :], shown.least)
    axes.pcolormesh(borders, [lane - _HALF, lane + _HALF], strip, cmap=colours, norm=norm, zorder=3)


def _draw_death(
    axes: "Axes", shown: Stretch, on_edge: Sequence[Hypothesis], lane: int, last: int
) -> None:
    """The sign of why the edge's last hypothesis died."""
    h = max(on_edge, key=lambda h: h.last)
    if h.why in _SIGNS and h.last <= last:
        axes.plot(
            shown.x[h.last], lane, _SIGNS[h.why], color=_INK, ms=6.5, mew=1.0, mfc="white",
            zorder=5, clip_on=False,
        )  # fmt: skip


def _draw_births(
    axes: "Axes", shown: Stretch, counting: Sequence[Hypothesis], lanes: Mapping[int, int],
    first: int, last: int,
) -> None:  # fmt: skip
    """A line from the parent's lane to the child's, once for each pair of lanes."""
    edges = {h.number: h.edge for h in shown.hypotheses}
    drawn = set()
    for h in sorted(counting, key=lambda h: h.created):
        pair = edges.get(h.parent, h.edge), h.edge
        if pair in drawn or pair[0] == pair[1] or pair[0] not in lanes or h.created <= first:
            continue
        drawn.add(pair)
        if h.created <= last:
            x = shown.x[h.created]
            ends = [lanes[pair[0]], lanes[pair[1]]]
            axes.plot([x, x], ends, color=_INK, lw=0.8, ls=(0, (1, 1.5)), zorder=1)


def legend_of_lanes(model: str) -> list[Line2D]:
    """What the signs mean."""

    def sign(why: str, text: str) -> Line2D:
        return Line2D(
            [], [], color=_INK, marker=_SIGNS[why], mfc="white", ms=6.5, ls="", label=text
        )

    created = Line2D([], [], color=_INK, lw=0.8, ls=(0, (1, 1.5)), label="created from")
    below = Line2D([], [], color=FAINT, lw=1.2, label=f"P < {COUNTS}")
    if model == "paper":
        return [created, below, sign("out of reach", "dead: beyond 30 m")]
    return [
        created,
        below,
        sign("outweighed", "dead: outweighed"),
        sign("left behind", "dead: handed on"),
    ]
