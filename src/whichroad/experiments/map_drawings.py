"""Drawings of maps in metres: roads, truth, fixes, and hypotheses with their ellipses."""

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ..geodesy.angles import degrees
from ..observations import Array
from ..plots.panels import FIX, PROBABLE, ROAD, TRUTH, UNIT
from ..plots.scene import CHI2_95
from ..tables.result import Result
from .example_drive import ExampleDrive
from .runs import ALIVE, STEP_S
from .scene_maps import ORIGIN, street_of
from .scenes import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_EDGE = 4.0  # m, margin of the map around the drawing


class Place:
    """The frame of a map: metres east and north of a scene's centre."""

    def __init__(self, scene: Scene) -> None:
        self.roads = scene.roads
        plane = self.roads.plane
        x, y = plane.from_geodetic(*ORIGIN.to_geodetic(*np.array(scene.centre)))
        self.centre = np.array([float(x), float(y)])

    def here(self, x: Array, y: Array) -> Array:
        """Plane coordinates as metres about the centre, (n, 2)."""
        about: Array = np.column_stack([x, y]) - self.centre
        return about

    def at(self, lat: Array, lon: Array) -> Array:
        """The same of positions."""
        return self.here(*self.roads.plane.from_geodetic(lat, lon))

    def streets(self) -> dict[str, Array]:
        """Each street's line once."""
        lines: dict[str, Array] = {}
        for e in range(len(self.roads)):
            lines.setdefault(street_of(self.roads, e), self.here(*self.roads.edge_line(e).T))
        return lines


def driven_at(example: ExampleDrive, metres: Sequence[float] | Array) -> Array:
    """When so many metres past the decision had been driven, s since 1970."""
    truth = example.drive.truth
    moved = truth.travelled + 1e-6 * np.arange(len(truth.travelled))
    when: Array = np.interp(np.asarray(metres) + example.scene.decision_m, moved, truth.time)
    return when


def draw_roads(axes: "Axes", place: Place, width: float) -> None:
    """The road map."""
    lines = list(place.streets().values())
    axes.add_collection(
        LineCollection(lines, colors=ROAD, linewidths=width, zorder=1, capstyle="round")
    )


def name_roads(axes: "Axes", place: Place) -> None:
    """Each street's name where its line leaves the picture."""
    box = np.array([axes.get_xlim(), axes.get_ylim()]).T
    for street, line in place.streets().items():
        fine = np.linspace(0.0, 1.0, 2000)[:, None]
        dense = np.concatenate([a + fine * (b - a) for a, b in itertools.pairwise(line)])
        inside = dense[((dense > box[0] + 3.0) & (dense < box[1] - 3.0)).all(axis=1)]
        if len(inside):
            end = inside[np.argmax(np.hypot(*inside.T))]
            axes.annotate(
                street, tuple(end), fontsize=8, color="#3a3f45", ha="right", va="center", zorder=9,
                bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75},
            )  # fmt: skip


def draw_hypotheses(
    axes: "Axes", example: ExampleDrive, place: Place, result: Result, window: tuple[float, float]
) -> None:
    """Every hypothesis at every step of a stretch (m), with its ellipse; truth and fixes."""
    begin, end = driven_at(example, window)
    truth = example.drive.truth
    part = (truth.time >= begin) & (truth.time <= end)
    path = place.here(truth.x[part], truth.y[part])
    axes.plot(*path.T, color=TRUTH, lw=1.1, zorder=4)
    fixes = example.drive.drive.fixes
    assert fixes is not None
    seen = (fixes.time >= begin) & (fixes.time <= end)
    spots = place.at(fixes.lat_deg[seen], fixes.lon_deg[seen])
    axes.plot(*spots.T, "+", color=FIX, ms=8, mew=1.6, zorder=8)
    drawn = _hypotheses(result, place, np.arange(begin, end, STEP_S))
    _ellipses(axes, drawn)
    axes.scatter(
        drawn["x"], drawn["y"], c=drawn["p"], cmap=PROBABLE, norm=UNIT, s=14 + 26 * drawn["p"],
        edgecolors="white", linewidths=0.6, zorder=7,
    )  # fmt: skip
    reach = np.sqrt(CHI2_95 * np.column_stack([drawn["cov_xx"], drawn["cov_yy"]]))
    spot = np.column_stack([drawn["x"], drawn["y"]])
    mapped = place.here(truth.map_x[part], truth.map_y[part])
    everything = np.concatenate([path, mapped, spots, spot - reach, spot + reach])
    box = np.array([everything.min(axis=0) - _EDGE, everything.max(axis=0) + _EDGE])
    frame(axes, box)


def frame(axes: "Axes", box: Array) -> None:
    """Equal scales about a box, in metres."""
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlim=box[:, 0], ylim=box[:, 1], xlabel="east (m)", ylabel="north (m)")


def _hypotheses(result: Result, place: Place, times: Array) -> dict[str, NDArray[Any]]:
    """The hypotheses that count at some times, the most probable last."""
    h = result.hypotheses
    assert h is not None
    rows = np.unique(np.searchsorted(h["time"], times - 1e-3).clip(max=len(h["time"]) - 1))
    flat = {
        name: h[name][rows].ravel()
        for name in ("edge", "p", "x", "y", "cov_xx", "cov_xy", "cov_yy")
    }
    counts = np.flatnonzero((flat["edge"] != -2) & (flat["p"] >= ALIVE))
    order = counts[np.argsort(flat["p"][counts])]
    chosen = {name: values[order] for name, values in flat.items()}
    chosen["x"], chosen["y"] = place.here(chosen["x"], chosen["y"]).T
    return chosen


def _ellipses(axes: "Axes", drawn: dict[str, NDArray[Any]]) -> None:
    cov = np.array(
        [[drawn["cov_xx"], drawn["cov_xy"]], [drawn["cov_xy"], drawn["cov_yy"]]]
    ).transpose(2, 0, 1)
    squares, directions = np.linalg.eigh(cov)
    minor, major = 2.0 * np.sqrt(CHI2_95 * np.maximum(squares.T, 0.0))
    angle = degrees(np.arctan2(directions[:, 1, 1], directions[:, 0, 1]))
    colours = PROBABLE(UNIT(drawn["p"]))
    ellipses = EllipseCollection(
        major, minor, angle, units="xy", offset_transform=axes.transData,
        offsets=np.column_stack([drawn["x"], drawn["y"]]), linewidths=1.0, zorder=6,
    )  # fmt: skip
    ellipses.set_edgecolor([(*colour[:3], 0.9) for colour in colours])
    ellipses.set_facecolor([(*colour[:3], 0.08) for colour in colours])
    axes.add_collection(ellipses)


def legend_of_map(*more: Line2D) -> list[Any]:
    """What is drawn on a map."""
    return [
        Line2D([], [], color=PROBABLE(0.97), marker="o", ls="", label="hypothesis, 95 % ellipse"),
        Line2D([], [], color=FIX, marker="+", mew=1.6, ms=8, ls="", label="GNSS fix"),
        Line2D([], [], color=TRUTH, lw=1.1, label="truth"),
        Line2D([], [], color=ROAD, lw=4, label="road of the map"),
        *more,
    ]
