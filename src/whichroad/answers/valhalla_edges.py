"""Edges of the path as Valhalla's `trace_attributes` tells them.

What the map does not hold (surface, grades, tolls) has the value that Valhalla gives where its
data has none.  Sidewalks are an empty word: routingpy refuses Valhalla's own "none".
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geodesy.angles import bearing_of
from ..geodesy.units import KMH
from ..graph.network import AGAINST_ONE_WAY, NO_ACCESS
from .matched_trace import Matched, Piece
from .route_steps import Lengths, Line, whole
from .signs import both_names

KILOMETRE = 1000.0  # m
_NO_GRADE = -500  # Valhalla's mark
_CLASSES = {
    "living_street": "residential", "service": "service_other", "road": "unclassified"
}  # fmt: skip
_UNKNOWN = {
    "truck_route": False, "density": 0, "sac_scale": 0, "shoulder": False, "sidewalk": "",
    "bicycle_network": 0, "cycle_lane": "none", "max_downward_grade": _NO_GRADE,
    "max_upward_grade": _NO_GRADE, "weighted_grade": 0.0, "travel_mode": "drive",
    "vehicle_type": "car", "surface": "paved_smooth", "internal_intersection": False,
    "unpaved": False, "toll": False, "country_crossing": False, "traffic_signal": False,
}  # fmt: skip


class Edges:
    """The edges of a path.

    Args:
        matched: The trace on the map.
        pieces: The path in order.
        size: Their lengths and usual times.
        line: The pieces as lines.
        begins: Bearings with which they begin.
        ends: And end.
        unit: Kilometres or miles, in m.
    """

    def __init__(
        self, matched: Matched, pieces: list[Piece], size: Lengths, line: Line,
        begins: list[int], ends: list[int], unit: float,
    ) -> None:  # fmt: skip
        self._matched, self._pieces, self._size, self._line = matched, pieces, size, line
        self._begins, self._ends, self._unit = begins, ends, unit
        roads = matched.roads
        edge = np.array([piece.edge for piece in pieces], np.int64)
        middle = np.array([0.5 * (piece.start + piece.end) for piece in pieces])
        self._source, self._forward = roads.sources(edge, middle)
        self._of = [roads.attributes(int(e), float(s)) for e, s in zip(edge, middle, strict=True)]

    def all(self, seconds: list[float] | None = None) -> list[dict[str, Any]]:
        """Every edge.

        Args:
            seconds: When the end of each was reached; None: at the usual speeds.
        """
        found = []
        elapsed = np.cumsum(self._size.seconds).tolist() if seconds is None else seconds
        for k in range(len(self._pieces)):
            edge = self._edge(k)
            after = self._pieces[k + 1].edge if k + 1 < len(self._pieces) else -1
            edge["end_node"] = self._end_node(k, after, round(elapsed[k], 3))
            found.append(edge)
        return found

    def _edge(self, k: int) -> dict[str, Any]:
        piece, of = self._pieces[k], self._of[k]
        row = self._matched.roads.arrays.edges[piece.edge]
        highway = of.get("highway") or ""
        other = int(row["opposite"])
        both = other >= 0 and not self._matched.roads.arrays.edges.rule[other]
        speed = round(float(row["speed"]) / (KMH * self._unit / KILOMETRE))
        limit = of.get("speed_limit_kmh") or 0.0
        found = {
            **_UNKNOWN,
            "speed_limit": round(limit * KILOMETRE / self._unit),
            "lane_count": max(int(of.get("lanes") or 1), 1), "id": piece.edge,
            "drive_on_right": self._matched.driving_side == "right",
            "roundabout": bool(of.get("roundabout")), "bridge": bool(of.get("bridge")),
            "tunnel": bool(of.get("tunnel")), "use": use_of(highway),
            "traversability": "both" if both else "forward",
            "begin_shape_index": self._line.begin[k],
            "end_shape_index": self._line.end(k),
            "begin_heading": self._begins[k], "end_heading": self._ends[k],
            "road_class": class_of(highway), "speed": speed,
            "speed_type": "tagged" if limit else "classified",
            "speeds_non_faded": {"no_flow": speed}, "forward": bool(self._forward[k]),
            "length": round(self._size.metres[k] / self._unit, 3),
        }  # fmt: skip
        source = self._source[k]
        if isinstance(source, int):
            found["way_id"] = source
        found["source_id"] = str(source)
        found["p"] = round(float(self._matched.driven.p[piece.at]), 6)
        length = float(row["length"])
        if piece.start > 1e-3:
            found["source_percent_along"] = round(piece.start / length, 3)
        if piece.end < length - 1e-3:
            found["target_percent_along"] = round(piece.end / length, 3)
        names = both_names(of.get("name"), of.get("ref"))
        if names:
            found["names"] = names
        if found["use"] == "ramp":
            found["sign"] = {}
        return found

    def _end_node(self, k: int, after: int, elapsed: float) -> dict[str, Any]:
        roads = self._matched.roads
        found: dict[str, Any] = {
            "elapsed_time": elapsed, "elapsed_cost": elapsed, "admin_index": 0,
            "type": "street_intersection", "traffic_signal": False, "fork": False,
            "transition_time": 0.0,
        }  # fmt: skip
        row = roads.arrays.edges[self._pieces[k].edge]
        turns = roads.arrays.turns.edge[int(row["first_turn"]) : int(row["end_turn"])].tolist()
        others = [edge for edge in turns if edge not in (after, int(row["opposite"]))]
        if others and after >= 0:
            found["intersecting_edges"] = [self._beside(edge, k) for edge in others]
        return found

    def _beside(self, edge: int, k: int) -> dict[str, Any]:
        """A road that meets the path and is not taken."""
        roads, edges = self._matched.roads, self._matched.roads.arrays.edges
        x, y, heading = roads.at(edge, 0.0)
        turn = float(roads.plane.convergence(np.array([x]), np.array([y]))[0])
        of = roads.attributes(edge)
        rule, other = int(edges.rule[edge]), int(edges.opposite[edge])
        into = not rule & (AGAINST_ONE_WAY | NO_ACCESS)
        back = other >= 0 and not edges.rule[other]
        highway, name = of.get("highway") or "", of.get("name")
        walk = "none" if highway.startswith("motorway") else "both"
        now = self._of[k].get("name")
        then = self._of[k + 1].get("name") if k + 1 < len(self._of) else None
        found = {
            "walkability": walk, "cyclability": walk,
            "from_edge_name_consistency": name is not None and name == now,
            "to_edge_name_consistency": name is not None and name == then,
            "begin_heading": whole(bearing_of(heading - turn, 0.0)),
            "use": use_of(highway), "road_class": class_of(highway),
        }  # fmt: skip
        if into or back:
            found["driveability"] = "both" if into and back else "forward" if into else "backward"
        return found


def use_of(highway: str) -> str:
    """Valhalla's word for what a road is for."""
    return "ramp" if highway.endswith("_link") else "road"  # words that routingpy knows, too


def class_of(highway: str) -> str:
    """Valhalla's class of a road."""
    plain = highway.removesuffix("_link")
    return _CLASSES.get(plain, plain or "unclassified")


def reached(matched: Matched, pieces: list[Piece], begin: float) -> list[float]:
    """Seconds after which the end of each piece was reached, by the trace's own times."""
    times: NDArray[Any] = matched.driven.exit_time[[piece.at for piece in pieces]] - begin
    return np.maximum(times, 0.0).tolist()  # type: ignore[no-any-return]
