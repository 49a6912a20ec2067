"""A matched trace as the answer of OSRM's match service."""

import base64
import math
import struct
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ..filter.state import OFF_ROAD
from ..geodesy.angles import bearing_of
from ..observations import Array
from ..tables.status import STATUS
from .matched_trace import Matched, Piece, Run
from .polylines import encoded, pairs, rounded
from .refusal import osrm_error
from .route_steps import (
    HALF_TURN,
    Lengths,
    Line,
    Step,
    bearings,
    drawn,
    lengths,
    modifier,
    names_of,
    steps_of,
    whole,
)  # fmt: skip
from .signs import lanes_for, signs_of

ANNOTATIONS = ("nodes", "distance", "duration", "datasources", "weight", "speed")
_DETAIL = 1000.0  # extent of a simplified line over what may be left out


@dataclass(frozen=True, slots=True)
class Options:
    """What of the answer is wanted, by OSRM's names."""

    geometries: str = "polyline"
    overview: str = "simplified"
    annotations: tuple[str, ...] = ()
    steps: bool = False
    waypoints: tuple[int, ...] | None = None
    generate_hints: bool = True
    skip_waypoints: bool = False
    by_valhalla: bool = False  # with the keys that Valhalla adds to this form


def osrm_answer(matched: Matched, options: Options) -> dict[str, Any]:
    """The whole answer.

    Args:
        matched: The trace on the map.
        options: What of it is wanted.

    Raises:
        AnswerError: A waypoint is not matched, or nothing is.
    """
    if not matched.runs:
        raise osrm_error("NoMatch", "Could not match the trace.")
    wanted = None if options.waypoints is None else set(options.waypoints)
    if wanted is not None and not all(matched.on[k] for k in wanted):
        raise osrm_error("NoMatch", "Requested waypoint parameter could not be matched.")
    answer: dict[str, Any] = {"code": "Ok", "matchings": []}
    number: dict[int, tuple[int, int | None]] = {}  # of a point: its matching and waypoint
    for at, run in enumerate(matched.runs):
        stops = run.points
        if wanted is not None:
            stops = [k for k in run.points if k in wanted or k in (run.points[0], run.points[-1])]
        number |= dict.fromkeys(run.points, (at, None))
        number |= {k: (at, waypoint) for waypoint, k in enumerate(stops)}
        answer["matchings"].append(_matching(matched, run, stops, options))
    if not options.skip_waypoints:
        answer["tracepoints"] = _tracepoints(matched, number, options)
    answer["whichroad"] = estimates(matched)
    return answer


def _matching(matched: Matched, run: Run, stops: list[int], options: Options) -> dict[str, Any]:
    """A route object with its legs."""
    pieces: list[Piece] = []
    first = [0]
    for a, b in pairwise(stops):
        pieces += matched.pieces(a, b)
        first.append(len(pieces))
    size, names = lengths(matched, pieces), names_of(matched, pieces)
    legs = _Legs(matched, pieces, size, names, options)
    metres, seconds = math.fsum(size.metres), math.fsum(size.seconds)
    found: dict[str, Any] = {
        "confidence": round(run.confidence, 10),
        "legs": [legs.leg(a, b) for a, b in pairwise(first)],
        "weight_name": "auto" if options.by_valhalla else "duration",
        "weight": round(seconds, 1),
        "duration": round(seconds, 1),
        "distance": round(metres, 1),
    }
    if options.overview != "false":
        whole = matched.pieces(run.points[0], run.points[-1])
        lat, lon = drawn(matched, whole).vertices(0, len(whole))
        if options.overview == "simplified":
            lat, lon = _simplified(lat, lon)
        found["geometry"] = geometry(lat, lon, options.geometries)
    return found


class _Legs:
    """Legs between the stops of a matching."""

    def __init__(
        self, matched: Matched, pieces: list[Piece], size: Lengths, names: list[str],
        options: Options,
    ) -> None:  # fmt: skip
        self._matched, self._pieces, self._size = matched, pieces, size
        self._names, self._options = names, options
        edge = np.array([piece.edge for piece in pieces], np.int64)
        edges = matched.roads.arrays.edges
        if options.annotations:
            self._from = matched.roads.node_ids(edges.from_node[edge])
            self._to = matched.roads.node_ids(edges.to_node[edge])
        if options.steps:
            self._line: Line = drawn(matched, pieces)
            self._begins, self._ends = bearings(self._line)
            self._signs = signs_of(matched, pieces)
            of = {e: _classes(matched.roads.attributes(e)) for e in set(edge.tolist())}
            self._classes = [of[piece.edge] for piece in pieces]

    def leg(self, a: int, b: int) -> dict[str, Any]:
        """The leg of pieces a to b - 1."""
        options = self._options
        metres, seconds = sum(self._size.metres[a:b]), sum(self._size.seconds[a:b])
        streets = list(dict.fromkeys(name for name in self._names[a:b] if name))
        leg: dict[str, Any] = {
            "steps": self._steps(a, b) if options.steps else [],
            "weight": round(seconds, 1),
            "distance": round(metres, 1),
            "summary": ", ".join(streets[:2]) if options.steps else "",
            "duration": round(seconds, 1),
        }
        if options.annotations:
            leg["annotation"] = self._annotation(a, b)
        if options.by_valhalla:
            leg |= {"via_waypoints": [], "admins": [{"iso_3166_1": ""}]}
        return leg

    def _annotation(self, a: int, b: int) -> dict[str, Any]:
        """Of each edge between junctions; the nodes are the junctions."""
        metres, seconds = self._size.metres[a:b], self._size.seconds[a:b]
        all_of = {
            "metadata": {"datasource_names": ["whichroad"]},
            "datasources": [0] * (b - a),
            "weight": rounded(seconds, 1),
            "nodes": [*self._from[a:b], self._to[b - 1]],
            "distance": rounded(metres, 3),
            "duration": rounded(seconds, 1),
            "speed": [
                round(m / s, 1) if s > 0.0 else 0.0 for m, s in zip(metres, seconds, strict=True)
            ],
        }
        wanted = self._options.annotations
        return {
            name: value
            for name, value in all_of.items()
            if name in wanted or (name == "metadata" and "datasources" in wanted)
        }

    def _steps(self, a: int, b: int) -> list[dict[str, Any]]:
        steps = steps_of(self._names, self._begins, self._ends, a, b)
        found = [self._step(step, index) for index, step in enumerate(steps)]
        return [*found, self._arrival(steps[-1], b)]

    def _step(self, step: Step, index: int) -> dict[str, Any]:
        low, high = step.low, step.high
        lat, lon = self._line.vertices(low, high)
        seconds = sum(self._size.seconds[low:high])
        manoeuvre: dict[str, Any] = {
            "bearing_after": step.after, "bearing_before": step.before,
            "location": pairs(lat[:1], lon[:1])[0], "type": "depart",
        }  # fmt: skip
        if index:
            same = step.name == self._names[low - 1]
            word = modifier(step.turn)
            kind = "continue" if same else "new name" if word == "straight" else "turn"
            manoeuvre |= {"type": kind, "modifier": word}
        if self._options.by_valhalla:
            manoeuvre["instruction"] = instruction(step, index)
        ref, towards = self._signs.ref[low], self._signs.destinations[low]
        more = {"ref": ref} if ref else {}
        more |= {"destinations": towards} if towards else {}
        return more | {
            "intersections": [self._intersection(k, first=k == low and not index)
                              for k in range(low, high)],
            "driving_side": self._side(), "geometry": self._geometry(lat, lon),
            "maneuver": manoeuvre, "name": step.name, "mode": "driving",
            "weight": round(seconds, 1), "duration": round(seconds, 1),
            "distance": round(sum(self._size.metres[low:high]), 1),
        }  # fmt: skip

    def _intersection(self, k: int, first: bool) -> dict[str, Any]:
        """The road that is come from and the one that is taken; none where the leg begins."""
        at = self._line.first[k]
        place = pairs(self._line.lat[at : at + 1], self._line.lon[at : at + 1])[0]
        out = self._begins[k]
        found: dict[str, Any] = {"out": 0, "entry": [True], "bearings": [out], "location": place}
        if not first:
            back = whole(self._ends[k - 1] + HALF_TURN)
            order = sorted([(back, False), (out, True)])
            found |= {
                "in": order.index((back, False)), "out": order.index((out, True)),
                "entry": [enters for _, enters in order], "bearings": [b for b, _ in order],
            }  # fmt: skip
            turn = float(out - self._ends[k - 1])
            lanes = self._signs.lanes[k - 1]
            told = lanes_for(lanes, turn, by_valhalla=self._options.by_valhalla)
            found |= {"lanes": told} if told else {}
        if self._classes[k]:
            found["classes"] = self._classes[k]
        if self._options.by_valhalla:
            seconds = round(self._size.seconds[k], 3)
            found |= {"duration": seconds, "weight": seconds, "admin_index": 0,
                      "geometry_index": at}  # fmt: skip
            found |= {} if first else {"turn_duration": 0.0, "turn_weight": 0.0}
        return found

    def _arrival(self, step: Step, b: int) -> dict[str, Any]:
        lat, lon = (v[self._line.first[b] - 1 : self._line.first[b]] for v in self._line[:2])
        place, before = pairs(lat, lon)[0], self._ends[b - 1]
        manoeuvre: dict[str, Any] = {
            "bearing_after": 0, "bearing_before": before, "location": place, "type": "arrive"
        }  # fmt: skip
        node: dict[str, Any] = {"in": 0, "entry": [True], "bearings": [whole(before + HALF_TURN)],
                                "location": place}  # fmt: skip
        if self._options.by_valhalla:
            manoeuvre["instruction"] = ARRIVED
            node |= {"admin_index": 0, "geometry_index": self._line.first[b] - 1}
        return {
            "intersections": [node], "driving_side": self._side(),
            "geometry": self._geometry(np.repeat(lat, 2), np.repeat(lon, 2)),
            "maneuver": manoeuvre, "name": step.name, "mode": "driving",
            "weight": 0.0, "duration": 0.0, "distance": 0.0,
        }  # fmt: skip

    def _geometry(self, lat: Array, lon: Array) -> Any:
        return geometry(lat, lon, self._options.geometries)

    def _side(self) -> str:
        return self._matched.driving_side


def _classes(of: dict[str, Any]) -> list[str]:
    """OSRM's classes of a road."""
    motorway = str(of.get("highway")).startswith("motorway")
    has = {
        "motorway": motorway, "tunnel": of.get("tunnel"),
        "restricted": of.get("access", "yes") != "yes",
    }  # fmt: skip
    return [name for name, is_so in has.items() if is_so]


ARRIVED = "You have arrived at your destination."
_COMPASS = ("north", "northeast", "east", "southeast", "south", "southwest", "west", "northwest")


def instruction(step: Step, index: int) -> str:
    """A manoeuvre in words.

    Args:
        step: What begins with it.
        index: Its number on the leg.
    """
    on = f" {{}} {step.name}" if step.name else ""
    if not index:
        return f"Drive {_COMPASS[round(step.after / 45.0) % 8]}{on.format('on')}."
    word = modifier(step.turn)
    if word == "straight":
        return f"Continue{on.format('on')}."
    if word == "uturn":
        return f"Make a U-turn{on.format('on')}."
    size, _, side = word.rpartition(" ")
    return f"{'Bear' if size == 'slight' else 'Turn'} {(size == 'sharp') * 'sharp '}{side}" + (
        f"{on.format('onto')}."
    )


def _tracepoints(
    matched: Matched, number: dict[int, tuple[int, int | None]], options: Options
) -> list[dict[str, Any] | None]:
    edge = matched.driven.edge[matched.at].astype(np.int64)
    names = [name or "" for name in matched.roads.names(edge)]
    places, others = pairs(matched.lat, matched.lon), matched.competitors().tolist()
    away, along = matched.away.tolist(), matched.along.tolist()
    found: list[dict[str, Any] | None] = []
    for k, of in enumerate(edge.tolist()):
        if k not in number:
            found.append(None)
            continue
        matching, waypoint = number[k]
        point: dict[str, Any] = {
            "alternatives_count": others[k], "waypoint_index": waypoint,
            "matchings_index": matching, "distance": round(away[k], 6), "name": names[k],
            "location": places[k],
        }  # fmt: skip
        if options.generate_hints and not options.by_valhalla:
            point["hint"] = base64.urlsafe_b64encode(struct.pack("<qd", of, along[k])).decode()
        found.append(point)
    return found


def estimates(matched: Matched) -> dict[str, Any]:
    """What the services have no word for: columns with a value for each point, null: unknown.

    Returns:
        `lat`, `lon` (degrees), `cov_ee_m2`, `cov_en_m2`, `cov_nn_m2`, `p_road`, `p_way`,
        `p_off_road`, `status`, `edge_id` and `source_id`, as in the table of points.
    """
    rows, roads = matched.rows, matched.roads
    lat, lon = roads.plane.to_geodetic(rows.x, rows.y)
    turn = roads.plane.convergence(rows.x, rows.y)
    c, s = np.cos(turn), np.sin(turn)
    xx, xy, yy = rows.cov[:, 0], rows.cov[:, 1], rows.cov[:, 3]
    known, on = rows.live > 0, (rows.live > 0) & (rows.edge > OFF_ROAD)
    source, _ = roads.sources(np.where(on, rows.edge, 0), np.where(on, rows.s, 0.0))
    columns = {
        "lat": np.round(lat, 7), "lon": np.round(lon, 7),
        "cov_ee_m2": np.round(c * c * xx + 2 * c * s * xy + s * s * yy, 4),
        "cov_en_m2": np.round(c * s * (yy - xx) + (c * c - s * s) * xy, 4),
        "cov_nn_m2": np.round(s * s * xx - 2 * c * s * xy + c * c * yy, 4),
        "bearing_deg": np.round(bearing_of(rows.heading - turn, 0.0), 2),
        "p_road": np.round(rows.p_edge, 6), "p_way": np.round(rows.p_way, 6),
        "p_off_road": np.round(rows.p_off_road, 6),
    }  # fmt: skip
    found = {name: _or_null(values.tolist(), known) for name, values in columns.items()}
    return {
        **found,
        "status": [STATUS[k] for k in rows.status.tolist()],
        "edge_id": _or_null(rows.edge.tolist(), on),
        "source_id": _or_null([str(one) for one in source], on),
    }


def _or_null(values: list[Any], known: Any) -> list[Any]:
    return [v if k else None for v, k in zip(values, known.tolist(), strict=True)]


def geometry(lat: Array, lon: Array, kind: str) -> Any:
    """A line as `polyline`, `polyline6` or `geojson`."""
    if kind == "geojson":
        return {"coordinates": pairs(lat, lon), "type": "LineString"}
    return encoded(lat, lon, 6 if kind == "polyline6" else 5)


def _simplified(lat: Array, lon: Array) -> tuple[Array, Array]:
    """The line without what a picture of its whole extent does not show."""
    import shapely

    tolerance = max(float(np.ptp(lat)), float(np.ptp(lon))) / _DETAIL
    line = shapely.LineString(np.column_stack([lon, lat])).simplify(tolerance)
    kept = shapely.get_coordinates(line)
    return kept[:, 1], kept[:, 0]
