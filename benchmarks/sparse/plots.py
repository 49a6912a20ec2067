"""The pictures of docs/benchmarks.md."""

from pathlib import Path
from typing import Any

from . import city, harness, real, runner

COLOURS = {
    runner.OURS: "#d1495b",
    "valhalla": "#1b6ca8",
    "osrm": "#e8963c",
    "osrm-tidy": "#e8c23c",
    "fastmm": "#5b8e7d",
    "best": "#3d3d3d",
}
SHADES = {1: "#440154", 5: "#3b528b", 10: "#21918c", 30: "#5ec962", 60: "#e8c23c"}  # by interval
LABELS = {"best": "best peer of each track"}


def _axes(count: int, title: str, width: float = 4.3) -> tuple[Any, list[Any]]:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        1, count, figsize=(width * count, 3.6), squeeze=False, layout="constrained"
    )
    for axis in axes[0]:
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=8)
    figure.suptitle(title, fontsize=12, x=0.01, ha="left")
    return figure, list(axes[0])


def _save(figure: Any, axes: list[Any], path: Path) -> None:
    import matplotlib.pyplot as plt

    handles: dict[str, Any] = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(
        handles.values(), handles.keys(), fontsize=8, frameon=False, loc="outside right center"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=80, metadata={"Software": None})
    plt.close(figure)


def _line(axis: Any, name: str, points: list[tuple[float, float]]) -> None:
    if points:
        x, y = zip(*sorted(points), strict=True)
        style = "--" if name == "best" else "-"
        width = 2.4 if name == runner.OURS else 1.3
        axis.plot(
            x,
            y,
            style,
            color=COLOURS[name],
            lw=width,
            marker="o",
            ms=3,
            label=LABELS.get(name, name),
        )


def _intervals(axis: Any, title: str, label: str, *, log: bool = True) -> None:
    axis.set_xscale("log")
    axis.set_xticks(harness.INTERVALS, [str(k) for k in harness.INTERVALS])
    axis.minorticks_off()
    if log:
        axis.set_yscale("log")
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter("")
    axis.set_title(title, fontsize=10)
    axis.set_xlabel("seconds between fixes", fontsize=8)
    axis.set_ylabel(label, fontsize=8)


def real_plot(found: dict[str, Any], sets: dict[int, dict[str, str]], path: Path) -> None:
    """Route mismatch against the interval, by set."""
    pools = real.pools(found, sets)
    figure, axes = _axes(len(pools), "Real tracks: route mismatch")
    for axis, (name, by_interval) in zip(axes, pools.items(), strict=True):
        for matcher in COLOURS:
            points = [
                (float(k), 100 * row[matcher]["rmf"])
                for k, row in by_interval.items()
                if matcher in row
            ]
            _line(axis, matcher, points)
        _intervals(axis, name, "%")
    _save(figure, axes, path)


def tracks_plot(found: dict[str, Any], path: Path) -> None:
    """Each track: our mismatch against that of its best peer."""
    figure, axes = _axes(len(found), "Real tracks one by one, route mismatch in %", 3.2)
    for axis, (every, matchers) in zip(axes, found.items(), strict=True):
        peers = [v["tracks"] for m, v in matchers.items() if m in harness.PEERS]
        ours = matchers.get(runner.OURS, {"tracks": {}})["tracks"]
        points = []
        for n, row in ours.items():
            theirs = [p[n] for p in peers if n in p]
            if theirs:
                best = min(theirs, key=real.wrong)
                points.append((real.wrong(best) / best["d0"], real.wrong(row) / row["d0"]))
        if points:
            x, y = zip(*points, strict=True)
            axis.scatter(
                [max(100 * a, 0.02) for a in x], [max(100 * b, 0.02) for b in y],
                s=12, color=COLOURS[runner.OURS], label="one track",
            )  # fmt: skip
        axis.plot([0.02, 100], [0.02, 100], color="#a0a0a0", lw=0.8)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_title(f"{every} s", fontsize=10)
        axis.set_xlabel("best peer", fontsize=8)
    axes[0].set_ylabel("whichroad", fontsize=8)
    _save(figure, axes, path)


def city_plot(found: dict[str, Any], what: str, title: str, path: Path) -> None:
    """A score of the first seed against the interval, for each noise."""
    conditions = next(iter(found.values()))
    noises = list(dict.fromkeys(text.split("/", 1)[1] for text in conditions))
    figure, axes = _axes(len(noises), title, 3.4)
    for axis, noise in zip(axes, noises, strict=True):
        for matcher in COLOURS:
            points = [
                (float(text.split("s/")[0]), max(100 * row[matcher][what], 0.01))
                for text, row in conditions.items()
                if text.endswith(noise) and matcher in row
            ]
            _line(axis, matcher, points)
        words = noise.replace("/gm", ", correlated").replace("/white", ", white")
        _intervals(axis, words, "%", log=what == "rmf")
    _save(figure, axes, path)


def speed_plot(found: dict[str, Any], path: Path) -> None:
    """Fixes per second of each matcher."""
    rates: dict[str, dict[str, float]] = {}
    for conditions in found.values():
        rates = rates or city.rates(conditions)
    figure, axes = _axes(1, "Fixes per second, one thread")
    for matcher in COLOURS:
        points = [(float(t.split("s/")[0]), r) for t, r in rates.get(matcher, {}).items()]
        _line(axes[0], matcher, points)
    _intervals(axes[0], "Heidelberg, 5 m, correlated", "1/s")
    _save(figure, axes, path)


def honesty_plot(store: dict[str, Any], path: Path) -> None:
    """Reliability of P(edge): how often what was said so sure was so."""
    panels: dict[str, dict[str, Any]] = {}
    if "real" in store:
        panels["real tracks"] = {
            f"{k}s": v[runner.OURS]["calibration"]["bins"]
            for k, v in store["real"].items()
            if "calibration" in v.get(runner.OURS, {})
        }
    for seed, conditions in list(store.get("city", {}).items())[:1]:
        panels[f"Heidelberg, seed {seed}"] = {
            text: row[runner.OURS]["calibration"]["bins"]
            for text, row in conditions.items()
            if "calibration" in row.get(runner.OURS, {})
        }
    if "drives" in store:
        panels["our own drives"] = {
            k: v[runner.OURS]["calibration"]["bins"]
            for k, v in store["drives"].items()
            if "calibration" in v.get(runner.OURS, {})
        }
    if not panels:
        return
    figure, axes = _axes(len(panels), "Is P(edge) true?  (dashed: white noise)", 3.6)
    for axis, (title, lines) in zip(axes, panels.items(), strict=True):
        axis.plot([0, 1], [0, 1], color="#a0a0a0", lw=0.8)
        for label, bins in lines.items():
            every = int(label.split("s")[0])
            some = [(p, share) for p, share, n in bins if n >= 20]
            if some:
                p, share = zip(*some, strict=True)
                style = "--" if label.endswith("white") else "-"
                axis.plot(p, share, style, color=SHADES[every], lw=1, marker="o", ms=2.5,
                          label=f"{every} s")  # fmt: skip
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("said", fontsize=8)
    axes[0].set_ylabel("was so", fontsize=8)
    _save(figure, axes, path)
