"""Pictures: the worst drives on their maps, and the Stanford diagram."""

from pathlib import Path
from typing import Any

import numpy as np

from .drives import Run
from .maps import Chart
from .scoring import Decision

_AROUND = 90.0  # m about a wrong declaration


def _pyplot() -> Any:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt


def drive_picture(run: Run, path: Path) -> None:
    """A drive: its map, its worst place, error and level over time with faults.

    Args:
        run: The drive.
        path: Of the PNG.
    """
    plt = _pyplot()
    figure, axes = plt.subplot_mosaic(
        [["map", "place"], ["time", "time"]], figsize=(12, 9), height_ratios=[2.2, 1],
        layout="constrained",
    )  # fmt: skip
    said, one = run.said, run.scored
    size = np.hypot(*said.error.T)
    wrong = [d for d in one.decisions if d.wrong]
    k = wrong[0].epoch if wrong else int(np.argmax(size - said.level))
    for name in ("map", "place"):
        _streets(axes[name], run, said.top[k], said.true_road[k])
        axes[name].plot(run.truth.x, run.truth.y, color="black", lw=1.2, label="truth")
        axes[name].plot(*(run.fixes.x, run.fixes.y), ".", color="#30a5bf", ms=2.5, label="fixes")
        axes[name].plot(*run.position.T, color="#d1495b", lw=0.9, label="filter")
        axes[name].plot(*run.position[k], "*", color="#d1495b", ms=12)
        axes[name].plot(*(run.position[k] - said.error[k]), "*", color="black", ms=10)
        axes[name].set_aspect("equal", adjustable="box")
        axes[name].tick_params(labelsize=7)
    middle = run.position[k] - 0.5 * said.error[k]
    reach = max(_AROUND, 0.8 * float(size[k]))
    axes["place"].set(
        xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach)
    )
    box = np.vstack([np.column_stack([run.truth.x, run.truth.y]), run.position])
    low, high = box.min(0) - 60.0, box.max(0) + 60.0
    axes["map"].set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes["map"].legend(fontsize=8, loc="best")
    _over_time(axes["time"], run, size, wrong)
    faults = ", ".join(sorted({e.name for e in one.events})) or "none"
    figure.suptitle(
        f"{one.name}, {one.place}, sensors: {one.suite}, faults: {faults}\n"
        f"{len(wrong)} wrong of {sum(d.declared for d in one.decisions)} declared; stars at "
        f"{said.time[k]:.0f} s: filter (red) says road {said.top[k]} (red) with P "
        f"{said.p_top[k]:.4f}, truth is {said.true_road[k]} (green; -1: not on the map)",
        fontsize=10,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def _streets(axis: Any, run: Run, declared: int, true: int) -> None:
    """The true streets dotted, the map's grey, the road that was declared red, the true one green.

    The picture is in the net's metres; the map's roads are drawn where the map has them.
    """
    from matplotlib.collections import LineCollection

    chart = run.world.chart
    true_lines = [s.line for s in run.world.net.streets]
    axis.add_collection(LineCollection(true_lines, colors="#1b6ca8", lw=0.5, ls=":"))
    drawn = _map_lines(chart)
    axis.add_collection(LineCollection(drawn, colors="0.75", lw=0.7))
    for road, color in ((declared, "#d1495b"), (true, "#3a9a4f")):
        lines = [drawn[e] for e in np.flatnonzero(chart.road_of_edge == road)]
        axis.add_collection(LineCollection(lines, colors=color, lw=3.0, alpha=0.5))


def _map_lines(chart: Chart) -> list[np.ndarray]:
    """Where each edge of the map runs, (n, 2) m in the net's plane."""
    roads = chart.roads
    lines = [roads.edge_line(edge) for edge in range(len(roads))]
    flat = np.vstack(lines)
    lat, lon = roads.plane.to_geodetic(flat[:, 0], flat[:, 1])
    ends = np.cumsum([len(p) for p in lines])[:-1]
    return list(np.split(chart.plane.metres(lon, lat), ends))


def _over_time(axis: Any, run: Run, size: np.ndarray, wrong: list[Decision]) -> None:
    said = run.said
    axis.semilogy(said.time, size.clip(0.05), color="#d1495b", lw=0.9, label="error, m")
    axis.semilogy(said.time, said.level.clip(0.05), color="black", lw=0.9, label="level, m")
    astray = (said.top != said.true_road) & (said.p_top >= 0.999)
    axis.plot(said.time[astray], np.full(astray.sum(), 0.06), "|", color="#d1495b", ms=5)
    for d in wrong:
        axis.axvline(d.when, color="#d1495b", lw=0.6, ls="--")
    for e in run.scored.events:
        if e.end - e.begin < 0.95 * said.time[-1]:
            axis.axvspan(e.begin, max(e.end, e.begin + 1.0), color="#e8963c", alpha=0.25)
            axis.text(e.begin, 0.08, e.name, fontsize=7, rotation=90)
    axis.set(xlabel="s (dashes: wrong declarations; red marks: P >= 0.999 on another road)")
    axis.legend(fontsize=8, loc="upper right")


def stanford(points: np.ndarray, path: Path) -> None:
    """Error against protection level.

    Args:
        points: (k, 2) error and level, m.
        path: Of the PNG.
    """
    plt = _pyplot()
    figure, axis = plt.subplots(figsize=(5, 4.6), layout="constrained")
    top = float(np.clip(np.quantile(points, 0.999) if len(points) else 20.0, 20.0, 120.0))
    inside = points.clip(0.0, top * 0.999)
    axis.hist2d(*inside.T, bins=60, range=((0, top), (0, top)), cmap="Blues", norm="log")
    axis.plot([0, top], [0, top], color="#d1495b", lw=1)
    below = 1e3 * float((points[:, 0] > points[:, 1]).mean())
    axis.text(0.97, 0.05, f"below the line: {below:.2g} per mille", ha="right", fontsize=8,
              transform=axis.transAxes)  # fmt: skip
    axis.set(xlabel="position error, m", ylabel="protection level, m")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90, metadata={"Software": None})
    plt.close(figure)
