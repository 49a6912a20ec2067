"""Score only ourselves on the harness's data: a look in seconds while the filter is changed.

    python -m benchmarks.sparse.quick kubicka    [--every 1,10,60] [--tracks 0-49]
    python -m benchmarks.sparse.quick heidelberg [--conditions 1s/10m/white,60s/10m/gm] [--seed 2]

The real tracks are pooled by their sets, beside the best of the peers on each track in hindsight.
"""

import argparse
import time
import warnings
from pathlib import Path
from typing import Any

from .. import Options, data_folder
from ..kubicka import numbers
from . import harness

CONDITIONS = (
    "1s/5m/gm,1s/10m/gm,1s/10m/white,5s/10m/white,10s/5m/gm,10s/10m/gm,10s/10m/white,"
    "30s/10m/gm,60s/10m/gm"
)


def answer(adapter: Any, trace: Any) -> tuple[dict[str, Any], float, str]:
    """The decoded answer, the seconds it took, and what went wrong."""
    start = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            raw = adapter.match(trace)
            spent = time.perf_counter() - start
            return adapter.decode(raw, trace), spent, ""
    except Exception as error:  # a bench counts what fails
        nothing = {"points": [None] * len(trace.t), "route": []}
        return nothing, time.perf_counter() - start, f"{type(error).__name__}: {error}"


def kubicka(options: Options, every: list[int], wanted: list[int], worst: int, lag: Any) -> None:
    tracks, graph = harness.real_tracks(options)
    sets = harness.sets(options)
    stored = harness.stored(options, "kubicka-dev")["peers"]
    score_route = harness.module(options, "metrics").score_route
    pbf, _ = harness.real_map(options)
    adapter = harness.our_adapter(options, pbf, lag)
    for k in every:
        rows, fixes, seconds = {}, 0, 0.0
        for n in (n for n in wanted if n in tracks):
            trace = harness.real_trace(options, tracks[n], k)
            result, spent, wrong = answer(adapter, trace)
            score = score_route(graph, tracks[n]["route"], result)
            rows[n] = (score, _best(stored, n, k), wrong)
            fixes, seconds = fixes + len(trace.t), seconds + spent
        print(f"\n{k} s: {fixes} fixes, {fixes / seconds:,.0f}/s, {len(rows)} tracks")
        for name, ids in (
            ("clean", [n for n in rows if sets[n]["clean"] == "1"]),
            ("usable without 43", [n for n in rows if sets[n]["usable"] == "1" and n != 43]),
        ):
            if ids:
                _say_pool(name, [rows[n] for n in ids])
        _say_worst(rows, worst)


def _best(stored: dict[str, Any], n: int, every: int) -> dict[str, Any]:
    """The stored score of the peer that was best on a track."""
    found = [
        dict(stored[p]["conditions"][f"{every}s/real"]["per_trace"][str(n)], peer=p)
        for p in harness.PEERS
        if str(n) in stored[p]["conditions"][f"{every}s/real"]["per_trace"]
    ]
    return min(found, key=_wrong)


def _wrong(score: dict[str, Any]) -> float:
    return float(score["d_minus"] + score["d_plus"])


def _say_pool(name: str, rows: list[Any]) -> None:
    driven = sum(s["d0"] for s, _, _ in rows)
    minus = 100 * sum(s["d_minus"] for s, _, _ in rows) / driven
    plus = 100 * sum(s["d_plus"] for s, _, _ in rows) / driven
    theirs = 100 * sum(_wrong(b) for _, b, _ in rows) / driven
    points = sum(s["n"] for s, _, _ in rows)
    on = 100 * sum(s["directed"] for s, _, _ in rows) / points
    none = sum(s["missing"] for s, _, _ in rows)
    print(
        f"  {name:18} {minus + plus:6.2f} %  (missed {minus:.2f}, extra {plus:.2f})   "
        f"best peer per track {theirs:.2f} %   points on the route {on:.2f} %   "
        f"fixes without answer {none}"
    )


def _say_worst(rows: dict[int, Any], count: int) -> None:
    """The tracks that cost most against the best peer there, and those that failed."""
    cost = sorted(rows, key=lambda n: _wrong(rows[n][1]) - _wrong(rows[n][0]))
    for n in cost[:count]:
        s, b, _ = rows[n]
        print(
            f"    track {n:2}  {100 * _wrong(s) / s['d0']:6.2f} % (missed {s['d_minus']:6.0f} m, "
            f"extra {s['d_plus']:6.0f} m of {s['d0'] / 1e3:5.1f} km)   {b['peer']:9} "
            f"{100 * _wrong(b) / b['d0']:5.2f} %   {_wrong(b) - _wrong(s):+7.0f} m"
        )
    for n, (_, _, wrong) in rows.items():
        if wrong:
            print(f"    track {n:2}  failed: {wrong}")


def heidelberg(options: Options, conditions: list[str], seed: int, trips: int, lag: Any) -> None:
    metrics, simulate = harness.module(options, "metrics"), harness.module(options, "simulate")
    graph, drives = harness.heidelberg(options, seed)
    stored: dict[str, Any] = {}
    for name in ("heidelberg", "heidelberg-seed2"):
        found = harness.stored(options, name)
        if found.get("trips", {}).get("seed", 1) == seed:
            stored = found["peers"]
    pbf = options.need("maps", "heidelberg.osm.pbf")
    adapter = harness.our_adapter(options, pbf, lag)
    print(
        "condition        RMF %  missed   extra  directed %   RMSE m  fixes/s  none"
        "   best peer: RMF %     directed %    RMSE m"
    )
    for text in conditions:
        c = harness.condition(text)
        rows, fixes, seconds, wrongs = [], 0, 0.0, []
        for i, trip in enumerate(drives[:trips]):
            trace, index = simulate.make_trace(graph, trip, *c, seed=seed)
            if i == 0:
                answer(adapter, trace)  # warm
            result, spent, wrong = answer(adapter, trace)
            rows.append(metrics.score_trace(graph, trip, index, result))
            fixes, seconds = fixes + len(trace.t), seconds + spent
            wrongs += [wrong] if wrong else []
        p = metrics.pool(rows)
        rmse = "-" if p["rmse"] is None else f"{p['rmse']:.2f}"
        print(
            f"{text:14} {100 * p['rmf']:7.2f} {100 * p['d_minus']:7.2f} {100 * p['d_plus']:7.2f}"
            f" {100 * p['edge_directed']:11.2f} {rmse:>8} {fixes / seconds:8,.0f}"
            f" {sum(r['missing'] for r in rows):5}   {_peers(stored, text)}"
        )
        for wrong in sorted(set(wrongs)):
            print(f"    failed {wrongs.count(wrong)} times: {wrong}")


def _peers(stored: dict[str, Any], text: str) -> str:
    found = {p: v["conditions"][text] for p, v in stored.items() if text in v["conditions"]}
    found = {p: c for p, c in found.items() if p in harness.PEERS}
    if not found:
        return "-"
    a = min(found, key=lambda p: found[p]["rmf"])
    b = max(found, key=lambda p: found[p]["edge_directed"])
    c = min(found, key=lambda p: found[p]["rmse"])
    return (
        f"{100 * found[a]['rmf']:.2f} {a}   {100 * found[b]['edge_directed']:.2f} {b}"
        f"   {found[c]['rmse']:.2f} {c}"
    )


def main() -> None:
    command = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    command.add_argument("data", choices=("kubicka", "heidelberg"))
    command.add_argument("--every", default="1,5,10,30,60", help="kubicka: seconds between fixes")
    command.add_argument("--tracks", default="0-49", help="kubicka")
    command.add_argument("--worst", type=int, default=8, help="kubicka: so many tracks are told")
    command.add_argument("--conditions", default=CONDITIONS, help="heidelberg, or `all`")
    command.add_argument("--seed", type=int, default=2, help="heidelberg")
    command.add_argument("--trips", type=int, default=20, help="heidelberg: the first so many")
    command.add_argument("--lag", default="full", help="full, none, or seconds")
    command.add_argument("--data-folder", type=Path, default=data_folder())
    command.add_argument("--cache", type=Path, help="where maps and trips are kept")
    a = command.parse_args()
    options = Options(data=a.data_folder, more={"cache": a.cache} if a.cache else {})
    lag = {"none": None, "full": "full"}.get(a.lag) if a.lag in ("none", "full") else float(a.lag)
    if a.data == "kubicka":
        every = [int(s) for s in a.every.split(",")]
        kubicka(options, every, numbers(a.tracks), a.worst, lag)
    else:
        noises = [harness.key(i, s, t) for i in harness.INTERVALS
                  for s in (3, 5, 10, 20, 30) for t in (0.0, harness.TAU)]  # fmt: skip
        conditions = noises if a.conditions == "all" else a.conditions.split(",")
        heidelberg(options, conditions, a.seed, a.trips, lag)


if __name__ == "__main__":
    main()
