"""docs/benchmarks.md: method, tables, pictures, misses; with words of two files."""

from pathlib import Path
from typing import Any

from .. import Figure
from . import city, doubt, harness, plots, real, runner
from .figures import figures_of

METHOD = Path(__file__).with_name("method.md")  # the words at the page's beginning
NOTES = Path(__file__).with_name("notes.md")  # and at its end


def write_page(path: Path, store: dict[str, Any], sets: dict[int, dict[str, str]]) -> None:
    """Write the page and its pictures, which lie in `img` beside it."""
    found = figures_of(store, sets)
    asked = [f for f in found if f.goal]
    missed = [f for f in asked if not f.met]
    parts = [METHOD.read_text().format(missed=len(missed), asked=len(asked))]
    if "real" in store:
        parts.append(_real(store["real"], sets))
    if "city" in store:
        parts.append(_city(store["city"]))
        parts.append(_speed(store["city"]))
    if "drives" in store:
        parts.append(_drives(store["drives"]))
    parts.append(_honesty(store))
    if "cost" in store:
        parts.append(_cost(store["cost"]))
    parts.append(_misses(missed))
    parts.append(NOTES.read_text())
    _pictures(path.parent / "img", store, sets)
    path.write_text("\n".join(p.rstrip() + "\n" for p in parts if p))


def _pictures(folder: Path, store: dict[str, Any], sets: dict[int, dict[str, str]]) -> None:
    if "real" in store:
        plots.real_plot(store["real"], sets, folder / "sparse-real.png")
        plots.tracks_plot(store["real"], folder / "sparse-tracks.png")
    if "city" in store:
        title = "Heidelberg: route mismatch"
        plots.city_plot(store["city"], "rmf", title, folder / "sparse-city.png")
        title = "Heidelberg: points on the right directed edge"
        plots.city_plot(store["city"], "directed", title, folder / "sparse-directed.png")
        plots.speed_plot(store["city"], folder / "sparse-speed.png")
    plots.honesty_plot(store, folder / "sparse-honesty.png")


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _percent(row: dict[str, Any] | None, what: str) -> str:
    if row is None:
        return "-"
    return f"{100 * row[what]:.2f}{'*' if row.get('stored') else ''}"


def _real(found: dict[str, Any], sets: dict[int, dict[str, str]]) -> str:
    names = [runner.OURS, "best", *harness.PEERS]
    out = ["## Real tracks\n", "Route mismatch in %, pooled by length.\n"]
    for title, by_interval in real.pools(found, sets).items():
        rows = []
        for every, row in by_interval.items():
            stored = {m for m, v in found[every].items() if v.get("stored")}
            rows.append(
                [f"{every} s"]
                + [_percent(row.get(m), "rmf") + ("*" if m in stored else "") for m in names]
            )
        head = [title, runner.OURS, "best peer of each track", *harness.PEERS]
        out.append(_table(head, rows))
    out.append("![Route mismatch of the real tracks](img/sparse-real.png)\n")
    out.append(_undoubted(found, sets))
    out.append(_rest(found))
    out.append(_worst(found))
    out.append("![Tracks one by one](img/sparse-tracks.png)\n")
    return "\n".join(out)


def _undoubted(found: dict[str, Any], sets: dict[int, dict[str, str]]) -> str:
    """Mismatch without the stretches where the truth contradicts its own fixes."""
    rows, sure = [], 1.0
    names = (runner.OURS, "best here", *real.HERE[:-1])
    for title, by_interval in real.pools(found, sets).items():
        for every, row in by_interval.items():
            if "undoubted" in row[runner.OURS]:
                sure = min(sure, row[runner.OURS]["sure"])
                told = [row.get(m, {}).get("undoubted") for m in names]
                rows.append(
                    [title, f"{every} s", *("-" if v is None else f"{100 * v:.2f}" for v in told)]
                )
    if not rows:
        return ""
    words = (
        f"The same without the stretches, at most {100 * (1 - sure):.1f} % of the way, where the "
        f"fixes at 1 Hz run more than {doubt.FAR:.0f} m beside the hand-made truth. There the map "
        "that the truth was drawn on lacked the road that was driven, or its connection, and who "
        "follows the fixes is counted wrong. Only matchers that ran here; *best here* is the best "
        "peer among them of each track, in hindsight.\n\n"
    )
    return words + _table(["tracks", "every", *names], rows)


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def _rest(found: dict[str, Any]) -> str:
    """Track by track: what is wrong at the densest interval, and how much everybody shares."""
    every = next(iter(found))
    ours = found[every].get(runner.OURS, {"tracks": {}})["tracks"]
    rows = [
        [n, f"{row['d0'] / 1e3:.1f}", f"{100 * real.wrong(row) / row['d0']:.2f}",
         _metres(real.wrong(row)), _metres(row.get("shared"))]
        for n, row in sorted(ours.items(), key=lambda item: int(item[0]))
        if real.wrong(row) > 0.01 * row["d0"]
    ]  # fmt: skip
    if not rows or not any("shared" in row for row in ours.values()):
        return ""
    total = sum(real.wrong(r) for r in ours.values())
    shared = sum(r.get("shared", 0.0) for r in ours.values())
    words = (
        f"Tracks with more than 1 % at {every} s. *Shared* are metres of our mismatch that every "
        f"other matcher of this run has too, mostly the truth's own error: "
        f"{100 * shared / total:.0f} % of all.\n\n"
    )
    return words + _table(["track", "km", "mismatch %", "m", "shared m"], rows)


def _worst(found: dict[str, Any]) -> str:
    """The tracks on which most metres are lost against their best peer."""
    rows = []
    for every, matchers in found.items():
        peers = {m: v["tracks"] for m, v in matchers.items() if m in harness.PEERS}
        lost = []
        for n, row in matchers.get(runner.OURS, {"tracks": {}})["tracks"].items():
            theirs = {m: t[n] for m, t in peers.items() if n in t}
            if theirs:
                name = min(theirs, key=lambda m: real.wrong(theirs[m]))
                lost.append(
                    (real.wrong(row) - real.wrong(theirs[name]), n, row, name, theirs[name])
                )
        for metres, n, row, name, best in sorted(lost, key=lambda r: -r[0])[:3]:
            rows.append([
                f"{every} s", n, f"{100 * real.wrong(row) / row['d0']:.2f}",
                f"{row['d_minus']:.0f}", f"{row['d_plus']:.0f}", _metres(row.get("shared")),
                f"{100 * real.wrong(best) / best['d0']:.2f} ({name})", f"{metres:+.0f}",
            ])  # fmt: skip
    head = ["every", "track", "mismatch %", "missed m", "extra m", "shared m", "best peer %",
            "m worse"]  # fmt: skip
    return "Where most is lost against the best peer of the track:\n\n" + _table(head, rows)


def _city(found: dict[str, Any]) -> str:
    out = ["## Heidelberg\n"]
    for seed, conditions in found.items():
        for what, title in (("rmf", "route mismatch %"), ("directed", "right directed edge %")):
            names = [runner.OURS, *harness.PEERS]
            rows = [
                [text, *(_percent(row.get(m), what) for m in names)]
                for text, row in conditions.items()
            ]
            out.append(_table([f"seed {seed}: {title}", *names], rows))
    out.append("![Route mismatch in Heidelberg](img/sparse-city.png)\n")
    out.append("![Right directed edge in Heidelberg](img/sparse-directed.png)\n")
    return "\n".join(out)


def _speed(found: dict[str, Any]) -> str:
    out = ["## Speed\n", "Fixes per second, one thread, map loaded, kernels compiled.\n"]
    for seed, conditions in found.items():
        rates = city.rates(conditions)
        keys = list(rates.get(runner.OURS, {}))
        if not keys:
            continue
        rows = [[m, *(f"{r[k]:,.0f}" if k in r else "-" for k in keys)] for m, r in rates.items()]
        ours, osrm = rates[runner.OURS], rates.get("osrm", {})
        ratio = [f"{ours[k] / osrm[k]:.2f}" if k in osrm else "-" for k in keys]
        out.append(_table([f"seed {seed}", *keys], [*rows, ["ratio to osrm", *ratio]]))
    out.append("![Fixes per second](img/sparse-speed.png)\n")
    return "\n".join(out)


def _drives(found: dict[str, Any]) -> str:
    rows = []
    for every, row in found.items():
        for m, v in row.items():
            there = v.get("rmse_ours_there")
            rows.append([
                every, m, f"{v['rmse']:.2f}", f"{there:.2f}" if there else "",
                f"{100 * v['rmf']:.2f}", f"{100 * v['missing']:.1f}",
                f"{100 * v['ellipse']:.1f}" if "ellipse" in v else "",
            ])  # fmt: skip
    head = ["every", "matcher", "RMSE m", "ours at the same fixes", "route mismatch %",
            "fixes without answer %", "in the 95 % ellipse %"]  # fmt: skip
    words = (
        "RMSE of the position: of the pose for whichroad, of the matched point for the others, at "
        "the fixes that both answer.\n"
    )
    return "## Drives with lanes and map errors\n\n" + words + "\n" + _table(head, rows)


def _honesty(store: dict[str, Any]) -> str:
    chance = {
        f"{text}, seed {seed}": row[runner.OURS]["calibration"]["chance"]
        for seed, conditions in store.get("city", {}).items()
        for text, row in conditions.items()
        if "chance" in row.get(runner.OURS, {}).get("calibration", {})
    }
    rows = []
    for figure in figures_of(store, {}):
        if figure.figure.startswith("calibration") and figure.value is not None:
            where = figure.figure.split(", ", 1)[1]
            by_chance = f"{chance[where]:.4f}" if where in chance else ""
            rows.append([where, f"{figure.value:.4f}", by_chance, f"{figure.n:,}"])
    if not rows:
        return ""
    table = _table(["P(edge)", "calibration error", "by chance alone below", "fixes"], rows)
    return "## Probabilities\n\n" + table + "\n![Reliability of P(edge)](img/sparse-honesty.png)\n"


def _cost(found: dict[str, Any]) -> str:
    rows = []
    for name, v in found["maps"].items():
        build, load = v["build"], v["load"]
        rows.append([
            name, f"{build['wall']:.1f}", f"{build['peak_mib']:.0f}", f"{build['disk_mib']:.0f}",
            f"{load['wall']:.2f}", f"{load['rss'] - load['rss_before']:.0f}",
        ])  # fmt: skip
    head = ["Heidelberg", "build s", "build peak MiB", "on disk MiB", "load s", "loaded MiB"]
    out = ["## Costs\n", "Load counts the import of the package.\n", _table(head, rows)]
    if "open_ms" in found:
        rates = [[text, f"{a:,.0f}", f"{b:,.0f}"] for text, (a, b) in found["rates"].items()]
        out.append(_table(["match, fixes/s", "the answer", "with points and path tables"], rates))
        osrm = found.get("osrm", {})
        many = [
            [text, f"{rate:,.0f}", f"{osrm[text]:,.0f}", f"{rate / osrm[text]:.2f}"]
            for text, rate in found["many"].items()
            if text in osrm
        ]
        if many:
            head = ["fixes/s, one thread", "match_many, no lag, tables built", "osrm", "ratio"]
            out.append(_table(head, many))
        words = (
            "Python, its libraries and the compiled kernels take {libraries_mib:.0f} MiB where "
            "drives are matched; a map is built without the kernels and their "
            "compiler. The map itself is {map_mib:.0f} MiB of arrays. "
            "`RoadMap.open` takes {open_ms:.1f} ms. `match_many` over {fixes:,} fixes: "
            "{one_thread:,.0f} fixes/s with one thread, {two_threads:,.0f} with two (threads "
            "pinned to cores), all tables built; beside the map it needs {one_thread_mib:.0f} MiB "
            "with one thread and {two_threads_mib:.0f} MiB with two, however many trips there "
            "are.\n"
        )
        out.append(words.format(**found))
    return "\n".join(out)


def _misses(missed: list[Figure]) -> str:
    if not missed:
        return "## Misses\n\nNone.\n"
    rows = [
        [f.figure, "-" if f.value is None else f"{f.value:,.4g}", f"{f.goal} {f.unit}".strip()]
        for f in missed
    ]
    return "## Misses\n\n" + _table(["figure", "measured", "goal"], rows)
