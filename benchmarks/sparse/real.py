"""The real tracks of Kubicka et al., thinned: route mismatch beside the peers."""

from typing import Any

import numpy as np

from .. import Options
from . import harness, runner, scores
from .doubt import uncovered, undoubted

HERE = ("valhalla", "osrm", "osrm-tidy", runner.OURS)  # fastmm's table would not fit


def measure(options: Options, every: tuple[int, ...], wanted: list[int]) -> dict[str, Any]:
    """Scores by interval, matcher and track; peers that cannot run here as they were stored."""
    tracks, graph = harness.real_tracks(options)
    some = [tracks[n] for n in wanted if n in tracks]
    pbf, _ = harness.real_map(options)
    traces = {f"{k}s/real": [harness.real_trace(options, t, k) for t in some] for k in every}
    found: dict[str, Any] = {str(k): {} for k in every}
    lines: dict[str, dict[str, list[Any]]] = {str(k): {} for k in every}
    for name in runner.present(options, HERE):
        done = runner.run(options, name, pbf, traces, options.more.get("seconds", 1e9))
        if done is None:
            continue
        for k in every:
            condition = done.conditions[f"{k}s/real"]
            found[str(k)][name] = _scored(options, condition, traces[f"{k}s/real"], some, graph)
            given = scores.answers(condition, traces[f"{k}s/real"])
            lines[str(k)][name] = [_lines(graph, a["route"]) for a in given]
            options.say(f"{name} at {k} s: {condition['points'] / condition['wall']:,.0f} fixes/s")
    metrics = harness.module(options, "metrics")
    for i, track in enumerate(some):
        true = _lines(graph, [graph.nodes_latlon(r) for r in track["route"]])
        dense = harness.real_trace(options, track, 1)
        fixes = np.column_stack(graph.xy(np.asarray(dense.lat), np.asarray(dense.lon)))
        for k, by_name in lines.items():
            for name, given in by_name.items():
                row = found[k][name]["tracks"][str(track["id"])]
                row["undoubted"] = undoubted(metrics, fixes, true, given[i])
            others = [v[i] for name, v in by_name.items() if name != runner.OURS]
            if runner.OURS in by_name and others:
                row = found[k][runner.OURS]["tracks"][str(track["id"])]
                row["shared"] = _shared(metrics, true, by_name[runner.OURS][i], others)
    stored = harness.stored(options, "kubicka-dev")["peers"]
    for name in harness.PEERS:
        for k in every:
            if name in found[str(k)] or name not in stored:
                continue
            rows = stored[name]["conditions"][f"{k}s/real"]["per_trace"]
            rows = {n: scores.brief(r) for n, r in rows.items() if int(n) in wanted}
            found[str(k)][name] = {"tracks": rows, "stored": True}
    return found


def _scored(
    options: Options, condition: dict[str, Any], traces: list[Any], tracks: list[Any], graph: Any
) -> dict[str, Any]:
    metrics = harness.module(options, "metrics")
    rows, p, right, silent = {}, [], [], 0
    for trace, track, answer in zip(traces, tracks, scores.answers(condition, traces), strict=True):
        rows[str(track["id"])] = scores.brief(metrics.score_route(graph, track["route"], answer))
        silent += scores.unanswered(answer, trace.t)
        if "said" in answer:
            on = _on_route(metrics, graph, track["route"], answer)
            a, b = scores.road_decisions(answer["said"], trace.t, on)
            p, right = p + a, right + b
    out: dict[str, Any] = {
        "tracks": rows,
        "fails": len(condition["errors"]),
        "unanswered": silent,
        "rate": condition["points"] / max(condition["wall"], 1e-9),
        "peak_mib": condition["peak_mib"],
    }
    if p:
        out["calibration"] = scores.calibration(p, right)
    return out


def _lines(graph: Any, parts: Any) -> list[np.ndarray]:
    return [np.column_stack(graph.xy(*np.asarray(q, float).T)) for q in parts if len(q) > 1]


def _shared(metrics: Any, true: list[Any], ours: list[Any], others: list[list[Any]]) -> float:
    """Metres of our mismatch that every other matcher has too: the truth's own error, mostly."""
    driven, found = metrics.densify(true), metrics.densify(ours)
    if not len(found):
        return 0.0
    missed = uncovered(metrics, driven, found)
    extra = uncovered(metrics, found, driven)
    for lines in others:
        theirs = metrics.densify(lines)
        if not len(theirs):
            return 0.0
        missed &= uncovered(metrics, driven, theirs)
        extra &= ~uncovered(metrics, found, theirs)
    return float(driven[missed, 3].sum() + found[extra, 3].sum())


def _on_route(metrics: Any, graph: Any, route: Any, answer: dict[str, Any]) -> np.ndarray:
    """Whether each matched point lies on the true route, in its direction."""
    from scipy.spatial import cKDTree

    true = metrics.densify(_lines(graph, [graph.nodes_latlon(r) for r in route]))
    points = [
        None if q is None else tuple(float(v) for v in graph.xy(*q)) for q in answer["points"]
    ]
    heading = metrics.travel_headings(points, _lines(graph, answer["route"]))
    tree = cKDTree(true[:, :2])
    on = np.zeros(len(points), bool)
    for i, (point, h) in enumerate(zip(points, heading, strict=True)):
        if point is not None:
            near = tree.query_ball_point(point, metrics.ON_EDGE + metrics.STEP / 2)
            on[i] = bool(near) and bool(np.isfinite(h) and (np.cos(true[near, 2] - h) > 0).any())
    return on


def pools(
    found: dict[str, Any], sets: dict[int, dict[str, str]]
) -> dict[str, dict[str, dict[str, Any]]]:
    """By set and interval: each matcher's pooled score, and the best peer of each track."""
    chosen = {
        "clean": {str(n) for n, row in sets.items() if row["clean"] == "1"},
        "usable without 43": {
            str(n) for n, row in sets.items() if row["usable"] == "1" and n != 43
        },
    }
    for name in list(chosen):  # nothing was chosen on these
        chosen[f"{name}, odd tracks"] = {n for n in chosen[name] if int(n) % 2}
    out: dict[str, dict[str, dict[str, Any]]] = {}
    for name, members in chosen.items():
        out[name] = {}
        for every, matchers in found.items():
            ids = members & set(matchers.get(runner.OURS, {"tracks": {}})["tracks"])
            if not ids:
                continue
            row: dict[str, Any] = {
                m: scores.pooled([v["tracks"][i] for i in sorted(ids) if i in v["tracks"]])
                for m, v in matchers.items()
            }
            ours = [matchers[runner.OURS]["tracks"][i] for i in sorted(ids)]
            for m, v in matchers.items():
                told = [v["tracks"][i].get("undoubted") for i in sorted(ids) if i in v["tracks"]]
                if told and all(told):
                    row[m]["undoubted"] = _share(told)
                    row[m]["sure"] = sum(t["d0"] for t in told) / sum(
                        v["tracks"][i]["d0"] for i in ids
                    )
            row[runner.OURS]["each"] = [(wrong(t), t["d0"]) for t in ours]
            peers = [v["tracks"] for m, v in matchers.items() if m in harness.PEERS]
            told = [[p[i]["undoubted"] for p in peers if "undoubted" in p.get(i, {})] for i in ids]
            if told and all(told):
                best = [min(t, key=lambda u: u["wrong"]) for t in told]
                row["best here"] = {"undoubted": _share(best)}
            if peers:
                row["best"] = scores.pooled(
                    [min((p[i] for p in peers if i in p), key=wrong) for i in sorted(ids)]
                )
            out[name][every] = row
    return out


def _share(told: list[dict[str, float]]) -> float:
    return sum(t["wrong"] for t in told) / sum(t["d0"] for t in told)


def wrong(score: dict[str, float]) -> float:
    """Metres driven and not found, and found and not driven."""
    return score["d_minus"] + score["d_plus"]
