"""Lanes of hypotheses: the probability of every road over the distance, births and deaths."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D

from ..plots.panels import PROBABLE, TRUTH, UNIT
from .lifetime_log import Hypothesis, LifetimeLog
from .runs import ALIVE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FAINT = "#9aa0a8"
_HALF = 0.22  # half width of a strip, in lanes
_SIGNS = {"outweighed": "X", "pruned": "X", "left behind": ">", "out of reach": "D"}


def lanes_of(log: LifetimeLog, window: tuple[float, float]) -> dict[int, int]:
    """The edges that count somewhere in a stretch (m), in order of birth: edge to lane."""
    lanes: dict[int, int] = {}
    for h in sorted(_counting(log, *_inside(log, window)), key=lambda h: h.created):
        lanes.setdefault(h.edge, len(lanes))
    return lanes


def _inside(log: LifetimeLog, window: tuple[float, float]) -> tuple[int, int]:
    """First and last epoch of a stretch."""
    inside = np.flatnonzero((log.past >= window[0]) & (log.past <= window[1]))
    return int(inside[0]), int(inside[-1])


def _counting(log: LifetimeLog, first: int, last: int) -> list[Hypothesis]:
    """The hypotheses that count in some epoch between two."""

    def most(h: Hypothesis) -> float:
        return max(h.p[max(first - h.created, 0) : last - h.created + 1], default=0.0)

    return [h for h in log.hypotheses if h.created <= last and h.last >= first and most(h) >= ALIVE]


def draw_lanes(axes: "Axes", log: LifetimeLog, window: tuple[float, float]) -> None:
    """One lane per directed edge."""
    first, last = _inside(log, window)
    lanes, counting = lanes_of(log, window), _counting(log, first, last)
    for edge, lane in lanes.items():
        _draw_lane(axes, log, edge, lane, first, last)
        _draw_death(axes, log, [h for h in counting if h.edge == edge], lane, last)
    _draw_births(axes, log, counting, lanes, first, last)
    axes.set(xlim=window, ylim=(len(lanes) - 0.45, -0.55))
    axes.set_yticks(range(len(lanes)), _names(counting, lanes))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def _names(counting: Sequence[Hypothesis], lanes: Mapping[int, int]) -> list[str]:
    """Streets; the direction that was entered second is marked."""
    names, taken = [""] * len(lanes), set()
    for edge, lane in lanes.items():
        street = next(h.street for h in counting if h.edge == edge)
        names[lane] = f"{street}, back" if street in taken else street
        taken.add(street)
    return names


def _draw_lane(axes: "Axes", log: LifetimeLog, edge: int, lane: int, first: int, last: int) -> None:
    """What the hypotheses of one edge weigh together, as a coloured strip."""
    p = np.zeros(len(log.past))
    for h in log.hypotheses:
        if h.edge == edge:
            p[h.created : h.last + 1] += h.p
    x, p = log.past[first : last + 1], p[first : last + 1]
    axes.plot(x, np.where(p > 0.0, float(lane), np.nan), color=FAINT, lw=1.2, zorder=2)
    borders = np.concatenate([x, 2.0 * x[-1:] - x[-2:-1]])
    strip = np.ma.masked_less(p[None, :], ALIVE)
    axes.pcolormesh(
        borders, [lane - _HALF, lane + _HALF], strip, cmap=PROBABLE, norm=UNIT, zorder=3
    )


def _draw_death(
    axes: "Axes", log: LifetimeLog, on_edge: Sequence[Hypothesis], lane: int, last: int
) -> None:
    """The sign of why the edge's last hypothesis died."""
    h = max(on_edge, key=lambda h: h.last)
    if h.why in _SIGNS and h.last <= last:
        axes.plot(
            log.past[h.last], lane, _SIGNS[h.why], color=TRUTH, ms=6.5, mew=1.0, mfc="white",
            zorder=5, clip_on=False,
        )  # fmt: skip


def _draw_births(
    axes: "Axes", log: LifetimeLog, counting: Sequence[Hypothesis], lanes: Mapping[int, int],
    first: int, last: int,
) -> None:  # fmt: skip
    """A line from the parent's lane to the child's, once for each pair of lanes."""
    edges = {h.number: h.edge for h in log.hypotheses}
    drawn = set()
    for h in sorted(counting, key=lambda h: h.created):
        pair = edges.get(h.parent, h.edge), h.edge
        if pair in drawn or pair[0] == pair[1] or pair[0] not in lanes or h.created <= first:
            continue
        drawn.add(pair)
        if h.created <= last:
            x = log.past[h.created]
            ends = [lanes[pair[0]], lanes[pair[1]]]
            axes.plot([x, x], ends, color=TRUTH, lw=0.8, ls=(0, (1, 1.5)), zorder=1)


def legend_of_lanes(model: str) -> list[Line2D]:
    """What the signs mean."""

    def sign(why: str, text: str) -> Line2D:
        return Line2D(
            [], [], color=TRUTH, marker=_SIGNS[why], mfc="white", ms=6.5, ls="", label=text
        )

    created = Line2D([], [], color=TRUTH, lw=0.8, ls=(0, (1, 1.5)), label="created from")
    below = Line2D([], [], color=FAINT, lw=1.2, label=f"P < {ALIVE}")
    if model == "paper":
        return [created, below, sign("out of reach", "dead: beyond 30 m")]
    return [
        created,
        below,
        sign("outweighed", "dead: outweighed"),
        sign("left behind", "dead: left behind"),
    ]
