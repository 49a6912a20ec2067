"""The pictures of docs/honesty.md: few colours, small files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .figures import ECE_BINS, Summary

GROUPS = {
    "junction": "#1b6ca8",
    "parallel, wheels": "#d1495b",
    "parallel, GNSS": "#e8963c",
    "roundabout": "#5b8e7d",
    "grid": "#8d6a9f",
    "ramp": "#3d3d3d",
    "off-map": "#a0a0a0",
    "tunnel": "#30a5bf",
}
LEVELS = (50, 90, 95, 99)


def group(name: str) -> str:
    """Which colour a class has."""
    if name.startswith("parallel"):
        return "parallel, GNSS" if name.endswith(("-gnss", "-fixes")) else "parallel, wheels"
    return name


def _panels(noises: list[str], path: Path, title: str, draw: Callable[[Any, str], None]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        1, len(noises), figsize=(4.1 * len(noises), 3.9), squeeze=False, layout="constrained"
    )
    for axis, noise in zip(axes[0], noises, strict=True):
        draw(axis, noise)
        axis.set_title(noise, fontsize=11)
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=8)
    handles, labels = axes[0][0].get_legend_handles_labels()
    if labels:
        figure.legend(handles, labels, fontsize=8, frameon=False, loc="outside right center")
    figure.suptitle(title, fontsize=12, x=0.01, ha="left")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=80, metadata={"Software": None})
    plt.close(figure)


def _each_group(summaries: list[Summary], noise: str) -> dict[str, list[Summary]]:
    found: dict[str, list[Summary]] = {}
    for s in summaries:
        if s.noise == noise:
            found.setdefault(group(s.name), []).append(s)
    return found


def reliability_plot(summaries: list[Summary], noises: list[str], path: Path) -> None:
    """Share of right decisions against their probability."""

    def draw(axis: Any, noise: str) -> None:
        axis.plot([0.3, 1], [0.3, 1], color="0.8", lw=1)
        for name, members in _each_group(summaries, noise).items():
            parts = [s.decisions(("near", "far")) for s in members]
            p = np.concatenate([q[0] for q in parts])
            right = np.concatenate([q[1] for q in parts])
            at = np.digitize(p, ECE_BINS[:-2])
            rows = [
                (p[at == b].mean(), right[at == b].mean(), (at == b).sum())
                for b in np.unique(at)
                if (at == b).sum() >= 30
            ]
            if rows:
                x, y, n = np.array(rows).T
                sigma = np.sqrt(np.maximum(x * (1 - x), 1e-6) / n)
                axis.errorbar(x, y, 2 * sigma, fmt="o-", ms=3, lw=1, elinewidth=0.7,
                              color=GROUPS[name], label=name)  # fmt: skip
        axis.set(xlim=(0.4, 1.01), ylim=(0.3, 1.02), xlabel="P of the most probable road")
        axis.set_ylabel("share right")

    _panels(noises, path, "Reliability of decisions, 30 m and 100 m beyond the branch", draw)


def coverage_plot(summaries: list[Summary], noises: list[str], path: Path) -> None:
    """Share of truths in ellipses of 50, 90, 95 and 99 %."""

    def draw(axis: Any, noise: str) -> None:
        axis.plot([-1, 4], [0, 0], color="0.8", lw=1)
        for name, members in _each_group(summaries, noise).items():
            posed = sum(s.row.posed.sum() for s in members)
            share = [
                100 * sum(getattr(s.row, f"inside_{v}").sum() for s in members) / posed - v
                for v in LEVELS
            ]
            axis.plot(range(4), share, "o-", ms=3, lw=1, color=GROUPS[name], label=name)
        axis.set_xticks(range(4), [f"{v} %" for v in LEVELS])
        axis.set(xlim=(-0.3, 3.3), xlabel="ellipse")
        axis.set_ylabel("share of truths inside, less that, %")

    _panels(noises, path, "Coverage of the position's ellipses", draw)


def declare_plot(summaries: list[Summary], noises: list[str], path: Path) -> None:
    """Share of drives that have declared a road, over the distance beyond the branch."""

    def draw(axis: Any, noise: str) -> None:
        for name, members in _each_group(summaries, noise).items():
            metres = np.concatenate([s.row.metres[s.row.declared > 0] for s in members])
            drives = sum(s.drives for s in members)
            x = np.sort(metres)
            y = 100 * np.arange(1, len(x) + 1) / drives
            keep = np.unique(np.linspace(0, len(x) - 1, 200).astype(int)) if len(x) else []
            axis.plot(x[keep], y[keep], lw=1.3, color=GROUPS[name], label=name)
        axis.set(xlim=(0, 200), ylim=(0, 101), xlabel="m beyond the branch")
        axis.set_ylabel("drives that have declared, %")

    _panels(noises, path, "When a road is declared with P >= 0.999", draw)


def stanford_plot(summaries: list[Summary], noises: list[str], path: Path) -> None:
    """Error against protection level, one point a drive."""

    def draw(axis: Any, noise: str) -> None:
        level = np.concatenate([s.row.level for s in summaries if s.noise == noise])
        error = np.concatenate([s.row.error for s in summaries if s.noise == noise])
        top = 60.0
        axis.hist2d(
            np.minimum(error, top - 0.1), np.minimum(level, top - 0.1), bins=60,
            range=((0, top), (0, top)), cmap="Blues", norm="log",
        )  # fmt: skip
        axis.plot([0, top], [0, top], color="#d1495b", lw=1)
        below = 1e3 * float((error > level).mean())
        axis.text(0.97, 0.05, f"below the line: {below:.2g} per mille", ha="right", fontsize=8,
                  transform=axis.transAxes)  # fmt: skip
        axis.set(xlabel="position error, m")
        axis.set_ylabel("protection level, m")

    _panels(noises, path, "Stanford diagram, one point a drive", draw)
