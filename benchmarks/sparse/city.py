"""The harness's trips in Heidelberg: its noise, its truth on the centre lines."""

from typing import Any

from .. import Options
from . import harness, runner, scores

ALL = (*harness.PEERS, runner.OURS)
CONDITIONS = [
    harness.key(interval, sigma, tau)
    for interval in harness.INTERVALS
    for sigma in (5, 10)
    for tau in (0.0, harness.TAU)
]


def measure(options: Options, seed: int, conditions: list[str], trips: int = 20) -> dict[str, Any]:
    """Pooled scores by condition and matcher, rates, and what only we say."""
    graph, drives = harness.heidelberg(options, seed)
    drives = drives[:trips]
    simulate = harness.module(options, "simulate")
    pbf = options.need("maps", "heidelberg.osm.pbf")
    traces: dict[str, list[Any]] = {}
    index: dict[str, list[Any]] = {}
    for text in conditions:
        made = [simulate.make_trace(graph, d, *harness.condition(text), seed=seed) for d in drives]
        traces[text], index[text] = [m[0] for m in made], [m[1] for m in made]
    found: dict[str, Any] = {text: {} for text in conditions}
    for name in runner.present(options, ALL):
        done = runner.run(options, name, pbf, traces, options.more.get("seconds", 1e9))
        if done is None:
            continue
        for text, condition in done.conditions.items():
            given = scores.answers(condition, traces[text])
            found[text][name] = _scored(options, graph, drives, index[text], traces[text], given)
            found[text][name] |= {
                "fails": len(condition["errors"]),
                "rate": condition["points"] / max(condition["wall"], 1e-9),
                "peak_mib": condition["peak_mib"],
            }
        options.say(f"{name}: seed {seed} done")
    _add_stored(options, found, seed)
    return found


def _scored(
    options: Options, graph: Any, drives: list[Any], index: list[Any], traces: list[Any],
    given: list[dict[str, Any]],
) -> dict[str, Any]:  # fmt: skip
    metrics = harness.module(options, "metrics")
    rows = [
        metrics.score_trace(graph, d, i, a) for d, i, a in zip(drives, index, given, strict=True)
    ]
    out: dict[str, Any] = scores.pooled(rows)
    out["unanswered"] = sum(scores.unanswered(a, t.t) for a, t in zip(given, traces, strict=True))
    if any("said" in a for a in given):
        p, right = [], []
        pbf = options.need("maps", "heidelberg.osm.pbf")
        roads = harness.our_adapter(options, pbf).maps[0][2]
        for drive, i, trace, answer in zip(drives, index, traces, given, strict=True):
            if "said" in answer:
                lat, lon = graph.latlon(drive.x[i], drive.y[i])
                driven = scores.driven_edges(roads, lat, lon, drive.heading[i])
                a, b = scores.decisions(
                    answer["said"], trace.t, lambda k, edge, on=driven: edge in on[k]
                )
                p, right = p + a, right + b
        out["calibration"] = scores.calibration(p, right)
    return out


def _add_stored(options: Options, found: dict[str, Any], seed: int) -> None:
    """Fill in peers that did not run here with what the harness had stored for the seed."""
    for file in ("heidelberg", "heidelberg-seed2"):
        stored = harness.stored(options, file)
        if stored.get("trips", {}).get("seed", 1) != seed:
            continue
        for text, row in found.items():
            for name in harness.PEERS:
                theirs = stored["peers"].get(name, {}).get("conditions", {}).get(text)
                if name not in row and theirs and "rmf" in theirs:
                    row[name] = {
                        "rmf": theirs["rmf"], "missed": theirs["d_minus"],
                        "extra": theirs["d_plus"], "directed": theirs["edge_directed"],
                        "missing": theirs["missing"], "rmse": theirs["rmse"],
                        "traces": theirs["traces"], "points": theirs["points"],
                        "rate": theirs["pts_per_s"], "fails": theirs["fails"], "stored": True,
                    }  # fmt: skip


def rates(found: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Fixes per second by matcher for the three conditions whose speed is asked for."""
    wanted = ("1s/5m/gm", "10s/5m/gm", "60s/5m/gm")
    out: dict[str, dict[str, float]] = {}
    for text in wanted:
        for name, row in found.get(text, {}).items():
            if "rate" in row and not row.get("stored"):
                out.setdefault(name, {})[text] = float(row["rate"])
    return out
