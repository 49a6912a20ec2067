"""What an answer is worth: the harness's scores, and ours of what no peer says."""

from collections.abc import Callable
from typing import Any

import numpy as np

from whichroad.evaluate import calibration_error

CHI2_95 = 5.991  # two degrees of freedom
SAME_M = 1.0  # a true position is at most so far from the edge that it is on
TIE_M = 0.02  # and nearer to that by so much than to the edges that follow or lead to it
SAME_TURN = 0.5  # cosine between the edge and the true course
DRAWS = 200  # of what would happen if what is said were exactly true
BESIDE = 2  # edges of the path, before and behind
KEPT = ("d_minus", "d_plus", "d0", "n", "missing", "right", "directed", "sq")


def answers(condition: dict[str, Any], traces: list[Any]) -> list[dict[str, Any]]:
    """The answer to each trace, an empty one where the matcher raised an error."""
    found = condition["results"]
    empty: dict[str, Any] = {"route": [], "points": []}
    return [found.get(str(t.id), {**empty, "points": [None] * len(t.t)}) for t in traces]


def pooled(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Scores of many traces as shares, and the RMSE of matched points in m."""
    total = {k: float(sum(r[k] for r in rows)) for k in KEPT}
    got = total["n"] - total["missing"]
    return {
        "rmf": (total["d_minus"] + total["d_plus"]) / total["d0"],
        "missed": total["d_minus"] / total["d0"],
        "extra": total["d_plus"] / total["d0"],
        "directed": total["directed"] / total["n"],
        "missing": total["missing"] / total["n"],
        "rmse": float(np.sqrt(total["sq"] / got)) if total["sq"] and got else 0.0,
        "traces": len(rows),
        "points": total["n"],
    }


def brief(row: dict[str, Any]) -> dict[str, float]:
    """A trace's score without its lists."""
    return {k: float(row[k]) for k in KEPT}


def at_fixes(said: dict[str, Any], t: np.ndarray) -> np.ndarray:
    """Rows of what was said at the times of the fixes; -1 where nothing was."""
    time = np.asarray(said["time"])
    k = np.clip(np.searchsorted(time, t - 1e-4), 0, len(time) - 1)
    return np.where(np.abs(time[k] - t) < 1e-3, k, -1)


def unanswered(answer: dict[str, Any], t: np.ndarray) -> int:
    """Fixes of which nothing is said: no pose of ours, no matched point of a peer."""
    if "said" not in answer:
        return sum(q is None for q in answer["points"]) if answer["points"] else len(t)
    lat = answer["said"]["lat"]
    return sum(k < 0 or lat[k] is None for k in at_fixes(answer["said"], t))


def decisions(
    said: dict[str, Any], t: np.ndarray, is_right: Callable[[int, int], bool]
) -> tuple[list[float], list[bool]]:
    """P of what was held most probable at each fix, and whether it was so.

    Args:
        said: As the adapter gives it.
        t: (n,) times of the fixes.
        is_right: Whether edge e was driven at fix i.
    """
    p, right = [], []
    for i, k in enumerate(at_fixes(said, t)):
        if k < 0 or said["p_road"][k] is None:
            continue
        edge, road, off = said["edge_id"][k], said["p_road"][k], said["p_off_road"][k]
        if edge is None or off > road:
            p.append(float(off))
            right.append(False)  # every true position here is on a road
        else:
            p.append(float(road))
            right.append(is_right(i, edge))
    return p, right


def road_decisions(
    said: dict[str, Any], t: np.ndarray, on_route: np.ndarray
) -> tuple[list[float], list[bool]]:
    """P of the road that the path takes at each fix, and whether the true route takes it.

    Where only the route is known, not the edge at a moment, the probabilities of the path's
    edges next to each other are one: which of them a fix is on is not told by the truth.

    Args:
        said: As the adapter gives it.
        t: (n,) times of the fixes.
        on_route: (n,) whether the matched point lies on the true route.
    """
    p, right = [], []
    path, entered = said["path"], np.asarray(said["entered"])
    for i, k in enumerate(at_fixes(said, t)):
        if k < 0 or said["p_road"][k] is None:
            continue
        here = int(np.searchsorted(entered, t[i], side="right")) - 1
        near = set(path[max(here - BESIDE, 0) : here + BESIDE + 1]) | {said["edge_id"][k]}
        p.append(min(sum(q for edge, q in said["alternatives"][k] if edge in near), 1.0))
        right.append(bool(on_route[i]))
    return p, right


def driven_edges(
    roads: Any, lat: np.ndarray, lon: np.ndarray, bearing: np.ndarray
) -> list[set[int]]:
    """Our edges under true positions on the map's centre lines, by course.

    One each, two at a node: with a tolerance of a metre both edges at a node would count as
    driven, of which the answer gives its probability to one.

    Args:
        roads: Our map.
        lat: (n,) degrees.
        lon: (n,) degrees.
        bearing: (n,) degrees.
    """
    x, y = roads.plane.from_geodetic(np.asarray(lat, float), np.asarray(lon, float))
    course = np.asarray(roads.plane.heading(np.asarray(bearing, float), x, y))
    found = []
    for a, b, heading in zip(x.tolist(), y.tolist(), course.tolist(), strict=True):
        near = roads.near(a, b, SAME_M)
        along = [
            (float(d), int(e))
            for e, s, d in zip(near.edge, near.s, near.distance, strict=True)
            if np.cos(roads.at(int(e), float(s))[2] - heading) > SAME_TURN
        ]
        least = min(along, default=(0.0, -1))[0]
        found.append({e for d, e in along if d <= least + TIE_M})
    return found


def calibration(p: list[float], right: list[bool]) -> dict[str, Any]:
    """The calibration error, what chance makes of it, and the reliability in ten bins.

    `chance` is the error that P which are exactly true would stay below 19 times in 20.
    """
    said, was = np.asarray(p), np.asarray(right, bool)
    if not len(said):
        return {"error": None, "n": 0, "bins": []}
    bins = np.minimum((said * 10).astype(int), 9)
    rows = [
        (float(said[bins == b].mean()), float(was[bins == b].mean()), int((bins == b).sum()))
        for b in range(10)
        if (bins == b).any()
    ]
    draws = np.random.default_rng(0).random((DRAWS, len(said))) < said
    chance = np.percentile([calibration_error(said, draw) for draw in draws], 95)
    error = float(calibration_error(said, was))
    return {"error": error, "chance": float(chance), "n": len(said), "bins": rows}


def together(told: list[dict[str, Any]]) -> dict[str, Any]:
    """The calibration error over the decisions of several, in the ten bins."""
    gap: dict[int, float] = {}
    n = 0
    for one in told:
        for said, was, count in one["bins"]:
            b = min(int(said * 10), 9)
            gap[b] = gap.get(b, 0.0) + count * (said - was)
            n += count
    return {"error": sum(abs(v) for v in gap.values()) / n if n else None, "n": n}
