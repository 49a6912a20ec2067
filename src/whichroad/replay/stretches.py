"""Stretches of a drive worth attention: ambiguous ones, and broken traffic rules."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..tables.status import STATUS
from .recorded_messages import RecordedMessages

if TYPE_CHECKING:
    from ..roadmap import RoadMap

_APART = 3.0  # s, gap below which stretches are joined
_SHORT = 0.4  # s, shortest listed stretch
_PLACES = 30
_LEAST = 0.5  # s of certainty missed, smallest listed
_SURE = 0.9  # P of consecutive edges from which on only the position is unclear
_UNCLEAR = ("ambiguous", "outage", "off_road", "lost")
_WEIGHT = {"ambiguous": 1.0, "outage": 0.2, "off_road": 0.2, "lost": 1.0}  # of a second of it
_RULE_S = 5.0  # what a broken rule counts


def stretches_of(recorded: RecordedMessages, roads: "RoadMap | None") -> list[dict[str, Any]]:
    """The few stretches to check, worst first: unclear ones, and rules broken.

    The measure is the certainty missed, in seconds: the integral of 1 - P(way) where roads
    compete, a share of the time elsewhere.  Where P(way) is not known, as in tables of earlier
    versions, to pass from one edge to the next is no question.
    """
    found = [place for word in _UNCLEAR for place in _unclear_stretches(recorded, roads, word)]
    found += _broken(recorded)
    worst = sorted(found, key=lambda place: (-float(place["missed_s"]), float(place["begin"])))
    return worst[:_PLACES]


def _unclear_stretches(
    recorded: RecordedMessages, roads: "RoadMap | None", word: str
) -> list[dict[str, Any]]:
    """Stretches of one status."""
    time, p = recorded.time, np.nan_to_num(recorded.columns["p_way"])
    rows = np.flatnonzero(recorded.status == STATUS.index(word))
    if word == "ambiguous" and not recorded.has_way:
        rows = np.array([k for k in rows.tolist() if not _passes(recorded, roads, k)], np.int64)
    if not len(rows):
        return []
    # an epoch's estimate holds until the next one
    last = np.append(time[1:], time[-1] + np.diff(time[-2:]).sum())
    apart = (np.diff(rows) > 1) & (np.diff(time[rows]) > _APART)
    places = []
    for run in np.split(rows, np.flatnonzero(apart) + 1):
        begin, end = float(time[run[0]]), float(last[run[-1]])
        if end - begin < _SHORT:
            continue
        doubt = 1.0 - p[run] if word == "ambiguous" else np.ones(len(run))
        missed = _WEIGHT[word] * float(np.sum(doubt * (last[run] - time[run])))
        if missed < _LEAST:
            continue
        least = int(run[np.argmin(p[run])])
        worst = (float(time[least]), float(p[least]))
        place = _place(
            recorded, word, begin, min(end, float(time[-1])), worst, _contest(recorded, run)
        )
        places.append(place | {"missed_s": round(missed, 2)})
    return places


def _place(
    recorded: RecordedMessages,
    kind: str,
    begin: float,
    end: float,
    worst: tuple[float, float],
    roads: list[str],
) -> dict[str, Any]:
    """A place as the report's script reads it; times in s since 1970 until here."""
    since = float(recorded.time[0])
    return {
        "kind": kind, "begin": round(begin - since, 2), "end": round(end - since, 2),
        "worst": round(worst[0] - since, 2), "p": round(worst[1], 3), "roads": roads,
    }  # fmt: skip


def _passes(recorded: RecordedMessages, roads: "RoadMap | None", k: int) -> bool:
    """Whether nearly all of P is on edges that follow each other.

    Where the route is known they must do so on the route; else the best edge and one before
    or after it count.
    """
    edges, p = recorded.choices.edge[k].tolist(), recorded.choices.p[k].tolist()
    best = edges[0]
    if best < 0:
        return False
    if recorded.route is not None:
        along = recorded.route.near(float(recorded.time[k]), best)
        return math.fsum(share for e, share in zip(edges, p, strict=True) if e in along) >= _SURE
    if roads is None:
        return False
    arrays, edge = roads.arrays, roads.arrays.edges[best]
    after = set(arrays.turns.edge[edge["first_turn"] : edge["end_turn"]].tolist())
    into = slice(edge["first_predecessor"], edge["end_predecessor"])
    before = set(arrays.predecessors[into].tolist())
    joined = [share for e, share in zip(edges[1:], p[1:], strict=True) if e in after | before]
    return float(p[0]) + max(joined, default=0.0) >= _SURE


def _contest(recorded: RecordedMessages, run: NDArray[Any]) -> list[str]:
    """Names of the roads that compete in a stretch, most probable first."""
    edge, p = recorded.choices.edge[run], recorded.choices.p[run]
    mass: dict[int, float] = {}
    for one in np.unique(edge[p >= 0.05]).tolist():
        mass[one] = float(p[edge == one].sum())
    names: list[str] = []
    for one in sorted(mass, key=lambda e: -mass[e]):
        name = "off the roads" if one == -1 else _called(recorded, one)
        if name not in names:
            names.append(name)
    return names[:4]


def _called(recorded: RecordedMessages, edge: int) -> str:
    return recorded.street(edge).get("name") or f"edge {edge}"


def _broken(recorded: RecordedMessages) -> list[dict[str, Any]]:
    """Where the route breaks a rule, or breaks off; edges in a row that do so alike are one."""
    route = recorded.route
    if route is None:
        return []
    places, i = [], 0
    while i < len(route.edge):
        rule, begin = route.broken[i], i
        while i < len(route.edge) and route.broken[i] == rule:
            i += 1
        if rule is not None:
            names = list(dict.fromkeys(_called(recorded, int(e)) for e in route.edge[begin:i]))
            at, end = float(route.enter[begin]), float(route.exit[i - 1])
            k = min(int(np.searchsorted(recorded.time, at)), len(recorded) - 1)
            p = float(np.nan_to_num(recorded.columns["p_way"][k]))
            place = _place(recorded, rule, at, max(at, end), (at, p), names[:4])
            places.append(place | {"missed_s": _RULE_S})
    return places
