"""A matched trace as the answers of Valhalla's `trace_attributes` and `trace_route`."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from .matched_trace import Matched, Piece
from .osrm_answer import ARRIVED, Options, estimates, instruction, osrm_answer
from .polylines import encoded
from .refusal import valhalla_error
from .route_steps import Step, bearings, drawn, lengths, modifier, names_of, steps_of
from .signs import both_names, signs_of
from .valhalla_edges import Edges, reached, use_of

UNITS = {"kilometers": 1000.0, "miles": 1609.344}
_START, _CONTINUE, _DESTINATION = 1, 8, 4  # types of manoeuvres
_TURNS = {"slight right": 9, "right": 10, "sharp right": 11, "uturn": 13, "sharp left": 14,
          "left": 15, "slight left": 16, "straight": _CONTINUE}  # fmt: skip
_FOOT = 0.3048  # m
_UNTIMED = 900  # code of a warning; Valhalla's own are smaller
_LEAST_MILES = 0.15  # below it a distance is told in feet
_AT_ONCE = 200.0  # m up to which the next manoeuvre is told with this one


@dataclass(frozen=True, slots=True)
class Wish:
    """What of the answer is wanted, by Valhalla's names."""

    units: str = "kilometers"
    use_timestamps: bool = False
    included: frozenset[str] | None = None  # names of attributes; None: all
    excluded: frozenset[str] = frozenset()
    breaks: tuple[int, ...] | None = None  # points at which legs end; None: the first and last
    form: str = "json"
    instructions: bool = True
    id: str | None = None

    def wants(self, name: str) -> bool:
        """Whether an attribute is."""
        return name not in self.excluded and (self.included is None or name in self.included)


def attributes_answer(matched: Matched, wish: Wish) -> dict[str, Any]:
    """The answer of `trace_attributes`.

    Args:
        matched: The trace on the map.
        wish: What of it is wanted.

    Raises:
        AnswerError: Nothing is matched.
    """
    pieces = _all_pieces(matched)
    size, line = lengths(matched, pieces), drawn(matched, pieces)
    edges = Edges(matched, pieces, size, line, *bearings(line), UNITS[wish.units])
    begin = float(matched.driven.enter_time[pieces[0].at])
    timed = wish.use_timestamps and matched.trace.time is not None
    told = edges.all(reached(matched, pieces, begin) if timed else None)
    lat, lon = line.vertices(0, len(pieces))
    p = math.prod(run.confidence for run in matched.runs)
    top: dict[str, Any] = {
        "osm_changeset": 0, "shape": encoded(lat, lon, 6), "confidence_score": round(p, 6),
        "raw_score": round(-math.log(max(p, 1e-300)), 3) + 0.0,
    }  # fmt: skip
    answer = {"units": wish.units}
    answer |= {name: value for name, value in top.items() if wish.wants(name)}
    if wish.included is None or any(name.startswith("admin.") for name in wish.included):
        answer["admins"] = [{"country_text": "None", "state_text": "None"}]  # type: ignore[assignment]
    answer["edges"] = [_filtered(edge, wish) for edge in told]  # type: ignore[assignment]
    answer["matched_points"] = _points(matched, pieces, wish)  # type: ignore[assignment]
    answer["alternate_paths"] = []  # type: ignore[assignment]
    answer["whichroad"] = estimates(matched)  # type: ignore[assignment]
    answer |= _warnings(matched)
    return answer | ({} if wish.id is None else {"id": wish.id})


def _warnings(matched: Matched) -> dict[str, Any]:
    """What of the request was not used, as Valhalla warns."""
    if not matched.trace.untimed:
        return {}
    text = f"The times of the points are not used: {matched.trace.untimed}."
    return {"warnings": [{"code": _UNTIMED, "text": text}]}


def _all_pieces(matched: Matched) -> list[Piece]:
    """Pieces of all runs.

    Raises:
        AnswerError: There is no run.
    """
    if not matched.runs:
        raise valhalla_error(444)
    ends = [(run.points[0], run.points[-1]) for run in matched.runs]
    return [piece for first, last in ends for piece in matched.pieces(first, last)]


def _filtered(edge: dict[str, Any], wish: Wish) -> dict[str, Any]:
    """An edge with the attributes that are wanted."""
    if wish.included is None and not wish.excluded:
        return edge
    node = edge.pop("end_node")
    beside = [
        {k: v for k, v in one.items() if wish.wants(f"node.intersecting_edge.{k}")}
        for one in node.pop("intersecting_edges", [])
    ]
    found = {k: v for k, v in edge.items() if wish.wants(f"edge.{k}")}
    node = {k: v for k, v in node.items() if wish.wants(f"node.{k}")}
    node |= {"intersecting_edges": beside} if any(beside) else {}
    return found | ({"end_node": node} if node else {})


def _points(matched: Matched, pieces: list[Piece], wish: Wish) -> list[dict[str, Any]]:
    """One for each point of the trace."""
    number = {piece.at: k for k, piece in enumerate(pieces)}
    length = matched.roads.arrays.edges.length[matched.driven.edge[matched.at]].tolist()
    firsts = {run.points[0] for run in matched.runs[1:]}
    lasts = {run.points[-1] for run in matched.runs[:-1]}
    lat, lon = np.round(matched.lat, 6).tolist(), np.round(matched.lon, 6).tolist()
    at, along, away = matched.at.tolist(), matched.along.tolist(), matched.away.tolist()
    found = []
    for k, on in enumerate(matched.on.tolist()):
        if on:
            point: dict[str, Any] = {
                "lon": lon[k], "lat": lat[k], "type": "matched",
                "edge_index": _nearest(number, at[k]),
                "distance_along_edge": round(along[k] / length[k], 6),
                "distance_from_trace_point": round(away[k], 6),
            }  # fmt: skip
            point |= {"begin_route_discontinuity": True} if k in firsts else {}
            point |= {"end_route_discontinuity": True} if k in lasts else {}
        else:
            place = matched.trace
            point = {"lon": round(float(place.lon[k]), 6), "lat": round(float(place.lat[k]), 6),
                     "type": "unmatched"}  # fmt: skip
        if wish.included is not None or wish.excluded:
            named = {"lon": "point", "lat": "point"}
            point = {n: v for n, v in point.items() if wish.wants(f"matched.{named.get(n, n)}")}
        found.append(point)
    return found


def _nearest(number: dict[int, int], at: int) -> int:
    """The piece of a row of the path, which may have been left out where it has no length."""
    return number[at] if at in number else number[min(number, key=lambda row: abs(row - at))]


def route_answer(matched: Matched, wish: Wish) -> dict[str, Any]:
    """The answer of `trace_route`, in Valhalla's own form or, by `format`, in OSRM's.

    Args:
        matched: The trace on the map.
        wish: What of it is wanted.

    Raises:
        AnswerError: Nothing is matched.
    """
    if not matched.runs:
        raise valhalla_error(444)
    last = len(matched.trace) - 1
    stops = wish.breaks if wish.breaks is not None else (0, last)
    if wish.form == "osrm":
        waypoints = tuple(k for k in stops if matched.on[k])
        options = Options("polyline6", "full", steps=True, waypoints=waypoints, by_valhalla=True)
        return osrm_answer(matched, options) | _warnings(matched)
    legs, locations = [], []
    for run in matched.runs:
        inner = [k for k in run.points[1:-1] if k in stops]
        ends = [run.points[0], *inner, run.points[-1]]
        legs += [_leg(matched, a, b, wish) for a, b in pairwise(ends)]
        for k in ends:
            locations.append(
                {"type": "break", "lat": round(float(matched.lat[k]), 6),
                 "lon": round(float(matched.lon[k]), 6), "original_index": k}
            )  # fmt: skip
    trip: dict[str, Any] = {
        "locations": locations, "legs": legs,
        "summary": _sum_of([leg["summary"] for leg in legs]),
        "status_message": "Found route between points", "status": 0, "units": wish.units,
        "language": "en-US",
    } | _warnings(matched)  # fmt: skip
    p = math.prod(run.confidence for run in matched.runs)
    more = {"confidence_score": round(p, 6), "whichroad": estimates(matched)}
    return {"trip": trip, **more, **({} if wish.id is None else {"id": wish.id})}


def _leg(matched: Matched, a: int, b: int, wish: Wish) -> dict[str, Any]:
    pieces = matched.pieces(a, b)
    size, line = lengths(matched, pieces), drawn(matched, pieces)
    names = names_of(matched, pieces)
    begins, ends = bearings(line)
    lat, lon = line.vertices(0, len(pieces))
    unit = UNITS[wish.units]
    manoeuvres = []
    steps = steps_of(names, begins, ends, 0, len(pieces))
    refs = signs_of(matched, pieces).ref
    for index, step in enumerate(steps):
        span = slice(step.low, step.high)
        seconds, far = sum(size.seconds[span]), sum(size.metres[span])
        told = _manoeuvre(step, index, far, wish) | _streets(step, refs)
        told |= {
            "bearing_after": step.after, "time": round(seconds, 3),
            "length": round(far / unit, 3), "cost": round(seconds, 3),
            "begin_shape_index": line.begin[step.low],
            "end_shape_index": line.end(step.high - 1),
            "travel_mode": "drive", "travel_type": "car",
        }  # fmt: skip
        ramp = matched.roads.attributes(pieces[step.low].edge).get("highway") or ""
        told |= {"verbal_multi_cue": True} if far < _AT_ONCE and step.high < len(pieces) else {}
        manoeuvres.append(told | ({"sign": {}} if use_of(ramp) == "ramp" else {}))
    manoeuvres.append(_arrival(ends[-1], len(lat) - 1, wish))
    of = [matched.roads.attributes(piece.edge).get("highway") for piece in pieces]
    seconds = round(math.fsum(size.seconds), 3)
    summary = {
        "has_time_restrictions": False, "has_toll": False, "has_highway": "motorway" in of,
        "has_ferry": False, "min_lat": round(float(lat.min()), 6),
        "min_lon": round(float(lon.min()), 6), "max_lat": round(float(lat.max()), 6),
        "max_lon": round(float(lon.max()), 6), "time": seconds,
        "length": round(math.fsum(size.metres) / unit, 3), "cost": seconds,
    }  # fmt: skip
    return {"maneuvers": manoeuvres, "summary": summary, "shape": encoded(lat, lon, 6)}


def _manoeuvre(step: Step, index: int, metres: float, wish: Wish) -> dict[str, Any]:
    word = modifier(step.turn)
    text = instruction(step, index)
    told: dict[str, Any] = {"type": _TURNS[word] if index else _START, "instruction": text}
    if wish.instructions:
        told["verbal_pre_transition_instruction"] = text
        told["verbal_succinct_transition_instruction"] = instruction(step._replace(name=""), index)
        if index:
            told["verbal_transition_alert_instruction"] = text
        told["verbal_post_transition_instruction"] = f"Continue for {_far(metres, wish.units)}."
    return told | ({"bearing_before": step.before} if index else {})


def _far(metres: float, units: str) -> str:
    """A distance in words."""
    if units == "miles":
        miles = metres / UNITS["miles"]
        return f"{miles:.1f} miles" if miles >= _LEAST_MILES else f"{metres / _FOOT:.0f} feet"
    return f"{metres / 1000.0:.1f} kilometers" if metres >= 950 else f"{metres:.0f} meters"


def _streets(step: Step, refs: list[str]) -> dict[str, Any]:
    """What the street is called on all of a step; what at its start, if that is more."""
    first = both_names(step.name, refs[step.low])
    same = len(set(refs[step.low : step.high])) == 1
    always = first if same else both_names(step.name, "")
    told = {"street_names": always} if always else {}
    return told | ({"begin_street_names": first} if first != always else {})


def _arrival(before: int, vertex: int, wish: Wish) -> dict[str, Any]:
    told: dict[str, Any] = {"type": _DESTINATION, "instruction": ARRIVED}
    if wish.instructions:
        told |= {
            "verbal_pre_transition_instruction": ARRIVED,
            "verbal_transition_alert_instruction": "You will arrive at your destination.",
        }
    return told | {
        "bearing_before": before, "time": 0.0, "length": 0.0, "cost": 0.0,
        "begin_shape_index": vertex, "end_shape_index": vertex, "travel_mode": "drive",
        "travel_type": "car",
    }  # fmt: skip


def _sum_of(legs: list[dict[str, Any]]) -> dict[str, Any]:
    """The summary of a trip from those of its legs."""

    def all_of(name: str) -> Iterable[Any]:
        return (leg[name] for leg in legs)

    found: dict[str, Any] = {n: any(all_of(n)) for n in legs[0] if n.startswith("has_")}
    found |= {n: min(all_of(n)) for n in ("min_lat", "min_lon")}
    found |= {n: max(all_of(n)) for n in ("max_lat", "max_lon")}
    return found | {n: round(sum(all_of(n)), 3) for n in ("time", "length", "cost")}
