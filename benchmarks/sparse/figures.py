"""From what was measured to figures with goals."""

from typing import Any

from .. import Figure, interval, share
from . import city, harness, real, runner, scores

QUARTER = ("2", "1s/10m/white")  # a seed and condition with a goal of its own
RATIOS = {"1s/5m/gm": 3.3, "10s/5m/gm": 2.7, "60s/5m/gm": 3.4}  # times OSRM
TRUE = 0.02  # calibration error
BELOW = 0.75  # of every peer's RMSE


def figures_of(store: dict[str, Any], sets: dict[int, dict[str, str]]) -> list[Figure]:
    """All figures of the parts that were measured."""
    found: list[Figure] = []
    if "real" in store:
        found += _real(store["real"], sets)
    for seed, conditions in store.get("city", {}).items():
        found += _city(seed, conditions)
        found += _speed(seed, conditions)
    found += _together(store.get("city", {}))
    if "drives" in store:
        found += _drives(store["drives"])
    if "cost" in store:
        found += _cost(store["cost"])
    return found


def _real(found: dict[str, Any], sets: dict[int, dict[str, str]]) -> list[Figure]:
    out = []
    for name, by_interval in real.pools(found, sets).items():
        for every, row in by_interval.items():
            ours = row[runner.OURS]
            goal = f"<= {100 * row['best']['rmf']:.2f}" if "best" in row else ""
            title = f"route mismatch, {name}, {every} s"
            spread = interval(share, ours["each"])  # over tracks
            out.append(Figure(title, 100 * ours["rmf"], goal, "%", ours["traces"], spread))
    for every, matchers in found.items():
        mine = matchers.get(runner.OURS)
        if mine is None:
            continue
        n, none = len(mine["tracks"]), mine["unanswered"]
        out.append(Figure(f"real tracks that failed, {every} s", mine["fails"], "<= 0", "", n))
        out.append(Figure(f"real fixes without an answer, {every} s", none, "<= 0", "", n))
        off = 100 * scores.pooled(list(mine["tracks"].values()))["missing"]
        out.append(Figure(f"real fixes answered by: on no road, {every} s", off, "", "%", n))
        out += _calibration(mine, f"real, {every} s")
    return out


def _calibration(row: dict[str, Any], where: str) -> list[Figure]:
    told = row.get("calibration")
    if not told or told["error"] is None:
        return []
    title = f"calibration error of P(edge), {where}"
    return [Figure(title, told["error"], f"<= {TRUE}", "", told["n"])]


def _together(found: dict[str, Any]) -> list[Figure]:
    """Over all decisions in Heidelberg at one interval."""
    by_interval: dict[str, list[dict[str, Any]]] = {}
    for conditions in found.values():
        for text, row in conditions.items():
            told = row.get(runner.OURS, {}).get("calibration")
            if told and told["error"] is not None:
                by_interval.setdefault(text.split("/")[0], []).append(told)
    out = []
    for every, rows in by_interval.items():
        told = scores.together(rows)
        title = f"calibration error of P(edge), Heidelberg, {every}, all together"
        out.append(Figure(title, told["error"], f"<= {TRUE}", "", told["n"]))
    return out


def _city(seed: str, conditions: dict[str, Any]) -> list[Figure]:
    out = []
    for text, row in conditions.items():
        ours = row.get(runner.OURS)
        if ours is None:
            continue
        where, n = f"{text}, seed {seed}", ours["traces"]
        peers = {p: v for p, v in row.items() if p in harness.PEERS}
        bound = min((100 * v["rmf"] for v in peers.values()), default=None)
        if (seed, text) == QUARTER and "valhalla" in peers:
            bound = min(bound or 1e9, 25 * peers["valhalla"]["rmf"])
        goal = f"<= {bound:.3f}" if bound is not None else ""
        out.append(Figure(f"route mismatch, {where}", 100 * ours["rmf"], goal, "%", n))
        bound = max((100 * v["directed"] for v in peers.values()), default=None)
        goal = f">= {bound:.2f}" if bound is not None else ""
        out.append(Figure(f"right directed edge, {where}", 100 * ours["directed"], goal, "%", n))
        title = f"fixes without an answer, {where}"
        out.append(Figure(title, ours["unanswered"], "<= 0", "", n))
        out += _calibration(ours, where)
    return out


def _speed(seed: str, conditions: dict[str, Any]) -> list[Figure]:
    rates = city.rates(conditions)
    ours, theirs = rates.get(runner.OURS, {}), rates.get("osrm", {})
    out = []
    for text, times in RATIOS.items():
        if text in ours:
            out.append(Figure(f"fixes matched, {text}, seed {seed}", ours[text], "", "1/s"))
        if text in ours and text in theirs:
            title = f"fixes/s as a multiple of OSRM, {text}, seed {seed}"
            out.append(Figure(title, ours[text] / theirs[text], f">= {times}"))
    return out


def _drives(found: dict[str, Any]) -> list[Figure]:
    out = []
    for every, row in found.items():
        ours = row.get(runner.OURS)
        if ours is None:
            continue
        n = ours["traces"]
        for peer, theirs in row.items():
            if "rmse_ours_there" in theirs:
                part = theirs["rmse_ours_there"] / theirs["rmse"]
                goal = f"<= {BELOW}" if every == "1s" else ""
                title = f"position RMSE as a share of {peer}'s, our drives, {every}"
                out.append(Figure(title, part, goal, "", n))
        out.append(Figure(f"position RMSE, our drives, {every}", ours["rmse"], "", "m", n))
        title = f"truth in the 95 % ellipse, our drives, {every}"
        out.append(Figure(title, 100 * ours["ellipse"], "92..98", "%", n))
        peers = [100 * v["rmf"] for p, v in row.items() if p in harness.PEERS]
        goal = f"<= {min(peers):.3f}" if peers else ""
        title = f"route mismatch, our drives, {every}"
        out.append(Figure(title, 100 * ours["rmf"], goal, "%", n))
        out += _calibration(ours, f"our drives, {every}")
    return out


def _cost(found: dict[str, Any]) -> list[Figure]:
    out = []
    maps = found["maps"]
    peers = [maps[p]["build"]["wall"] for p in ("valhalla", "osrm") if p in maps]
    if runner.OURS in maps:
        goal = f"<= {min(peers):.2f}" if peers else ""
        wall = maps[runner.OURS]["build"]["wall"]
        out.append(Figure("build of the map of Heidelberg", wall, goal, "s"))
        peaks = [maps[p]["build"]["peak_mib"] for p in ("valhalla", "osrm") if p in maps]
        goal = f"<= {min(peaks):.0f}" if peaks else ""
        peak = maps[runner.OURS]["build"]["peak_mib"]
        out.append(Figure("memory of that build, with Python itself", peak, goal, "MiB"))
    if "open_ms" in found:
        for text, rate in found["many"].items():
            out.append(Figure(f"match_many, no lag, one thread, {text}", rate, "", "1/s"))
            if text in found.get("osrm", {}):
                title = f"the same as a multiple of OSRM, {text}"
                out.append(Figure(title, rate / found["osrm"][text], f">= {RATIOS[text]}"))
        for text, (alone, tables) in found["rates"].items():
            out.append(Figure(f"match, {text}, trip by trip", alone, "", "1/s"))
            out.append(Figure(f"the same, tables read out, {text}", tables, "", "1/s"))
        out += [
            Figure("open it, compiled", found["open_ms"], "<= 50", "ms", 20),
            Figure("memory beside the map, one thread", found["one_thread_mib"], "<= 100", "MiB"),
            Figure("the same, two threads", found["two_threads_mib"], "<= 200", "MiB"),
            Figure("match_many, tables built, one thread", found["one_thread"], "", "1/s"),
            Figure("gain by a second thread", found["two_threads"] / found["one_thread"]),
        ]
    return out
