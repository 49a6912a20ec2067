"""Panels of the experiments' pictures: the lanes of hypotheses, and what many drives did."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from ..plots.panels import PROBABLE, TRUTH, UNIT
from ..records import Array
from .rides import ALIVE, STEP_S, Ride, lives
from .watch import OFF, Hypothesis, Log

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"paper": "#d9730d", "default": "#0b4f9e"}
CALLED = {"paper": "the paper's method", "default": "whichroad"}
LIGHT = "#9aa0a8"
DIED = {"outweighed": "x", "left behind": ">", "out of reach": "D", "merged": "o", "pruned": "x"}
_GRID = 400


def draw_lanes(axes: "Axes", log: Log, window: tuple[float, float]) -> None:
    """A lane for every road, coloured by its probability; who came from whom; who died why."""
    low, high = window
    inside = np.flatnonzero((log.past >= low) & (log.past <= high))
    if len(inside) == 0:
        return
    first, last = int(inside[0]), int(inside[-1])
    shown = [
        h for h in log.lives
        if h.born <= last and h.last >= first and max(_within(h, first, last)) >= ALIVE
    ]  # fmt: skip
    lanes: dict[int, int] = {}
    for h in sorted(shown, key=lambda h: h.born):
        lanes.setdefault(h.edge, len(lanes))
    for edge, lane in lanes.items():
        _draw_lane(axes, log, [h for h in log.lives if h.edge == edge], lane, first, last)
    for h in shown:
        _draw_birth_and_death(axes, log, h, lanes, first, last)
    axes.set(xlim=window, ylim=(len(lanes) - 0.4, -0.6))
    axes.set_yticks(range(len(lanes)), _lane_names(shown, lanes))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def _within(h: Hypothesis, first: int, last: int) -> list[float]:
    return h.p[max(first - h.born, 0) : last - h.born + 1]


def _lane_names(shown: Sequence[Hypothesis], lanes: Mapping[int, int]) -> list[str]:
    """Streets; the direction that was not entered first is marked."""
    names, taken = [""] * len(lanes), set()
    for edge, lane in lanes.items():
        street = next(h.street for h in shown if h.edge == edge)
        names[lane] = f"{street}, back" if street in taken else street
        taken.add(street)
    return [name if name == OFF else f"road {name}" for name in names]


def _draw_lane(
    axes: "Axes", log: Log, lives_: Sequence[Hypothesis], lane: int, first: int, last: int
) -> None:
    """What the hypotheses of one edge weigh together, as a coloured line."""
    p = np.zeros(len(log.past))
    for h in lives_:
        p[h.born : h.last + 1] += h.p
    part = slice(first, last + 1)
    x, y = log.past[part], np.full(last + 1 - first, float(lane))
    points = np.column_stack([x, y])
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    weight = 0.5 * (p[part][1:] + p[part][:-1])
    kept = (p[part][1:] > 0.0) & (p[part][:-1] > 0.0)
    faint = LineCollection(list(pieces[kept]), colors=LIGHT, linewidths=1.2, zorder=2)
    axes.add_collection(faint)
    counts = kept & (weight >= ALIVE)
    line = LineCollection(list(pieces[counts]), cmap=PROBABLE, norm=UNIT, linewidths=11, zorder=3)
    line.set_array(weight[counts])
    line.set_capstyle("butt")
    axes.add_collection(line)


def _draw_birth_and_death(
    axes: "Axes", log: Log, h: Hypothesis, lanes: Mapping[int, int], first: int, last: int
) -> None:
    parent = next((o for o in log.lives if o.number == h.parent), None)
    lane = lanes[h.edge]
    if parent is not None and parent.edge in lanes and first <= h.born <= last:
        x, up = log.past[h.born], lanes[parent.edge]
        if up != lane:
            axes.plot([x, x], [up, lane], color=TRUTH, lw=0.7, ls=":", zorder=1)
    if h.why in ("alive", "merged") or not first <= h.last <= last:
        return
    axes.plot(
        log.past[h.last], lane, DIED[h.why], color=TRUTH, ms=6, mew=1.6, mfc="white", zorder=5
    )


def lane_legend(model: str) -> list[Line2D]:
    """Signs of the lanes."""

    def sign(why: str, text: str) -> Line2D:
        return Line2D([], [], color=TRUTH, marker=DIED[why], mfc="white", ms=6, ls="", label=text)

    born = Line2D([], [], color=TRUTH, lw=0.7, ls=":", label="born from")
    below = Line2D([], [], color=LIGHT, lw=1.2, label=f"P < {ALIVE}")
    if model == "paper":
        return [born, below, sign("out of reach", "farther than 30 m")]
    return [born, below, sign("outweighed", "outweighed"), sign("left behind", "left behind")]


def on_grid(r: Ride, values: Array, metres: Array) -> Array:
    """Values of a ride at metres past the decision: those of the next epoch."""
    at = np.clip(np.searchsorted(r.past, metres), 0, len(r.past) - 1)
    picked: Array = values[at]
    return picked


def draw_band(
    axes: "Axes", rides: Mapping[str, Sequence[Ride]], window: tuple[float, float]
) -> None:
    """P of the true road over the way: median, and between which nine in ten drives lie."""
    metres = np.linspace(*window, _GRID)
    for model, ridden in rides.items():
        p = np.array([on_grid(r, r.right, metres) for r in ridden])
        low, middle, high = np.quantile(p, [0.05, 0.5, 0.95], axis=0)
        colour = COLOURS[model]
        axes.fill_between(metres, low, high, color=colour, alpha=0.18, lw=0)
        axes.plot(metres, middle, color=colour, lw=2, label=CALLED[model])
    axes.set(xlim=window, ylim=(-0.02, 1.03), ylabel="P(true road)")
    axes.legend(loc="lower right", title="median; band: 90 % of drives", title_fontsize=8)


def draw_survival(axes: "Axes", rides: Mapping[str, Sequence[Ride]], last_m: float) -> None:
    """Share of the wrong roads that still count so many steps after they began to."""
    most = 14.0
    for model, ridden in rides.items():
        steps = np.array([x.seconds / STEP_S for r in ridden for x in lives(r, -150.0, last_m)])
        if len(steps) == 0:
            continue
        grid = np.linspace(0.0, max(most, float(np.quantile(steps, 0.99))), _GRID)
        share = (steps[None, :] > grid[:, None]).mean(axis=1)
        axes.plot(grid, 100.0 * share, color=COLOURS[model], lw=2, label=CALLED[model])
    axes.axvline(7.0, color=TRUTH, lw=0.9, ls=":")
    axes.annotate(
        "the paper's\nseven steps", (7.0, 98.0), (4, 0), textcoords="offset points", fontsize=8,
        va="top",
    )  # fmt: skip
    axes.set(xlabel="steps of 1 s since it first counted", ylabel="% of wrong roads", ylim=(0, 102))
    axes.set_xlim(left=0.0)
    axes.legend(loc="upper right")


Line = tuple[str, str, Sequence[Ride]]
"""Label, colour, rides."""


def draw_errors(axes: "Axes", lines: Sequence[Line], window: tuple[float, float]) -> None:
    """Position error over the way, RMS over the drives; dashed what the covariance says."""
    metres = np.linspace(*window, _GRID)
    for label, colour, ridden in lines:

        def over(values: Callable[[Ride], Array], ridden: Sequence[Ride] = ridden) -> Array:
            rows = np.array([on_grid(r, values(r), metres) for r in ridden])
            mean: Array = np.sqrt(rows.mean(axis=0))
            return mean

        error = over(lambda r: r.answer.along**2 + r.answer.cross**2)
        axes.plot(metres, error, color=colour, lw=1.8, label=label)
        axes.plot(metres, over(lambda r: r.sigma**2), color=colour, lw=1.4, ls=(0, (4, 2)))
    axes.set(xlim=window, ylabel="position error (m)")
    axes.set_ylim(bottom=0.0)
    handles, labels = axes.get_legend_handles_labels()
    stated = Line2D([], [], color=LIGHT, lw=1.4, ls=(0, (4, 2)))
    axes.legend([*handles, stated], [*labels, "dashed: as stated"], loc="upper left")
