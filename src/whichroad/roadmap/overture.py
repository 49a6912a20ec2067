"""Overture's transportation segments: connectors, rules over parts of a segment, transitions.

A segment becomes one street for each part on which all rules are the same.  All of its streets
have the segment's GERS id.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import MapError
from ..geodesy.units import mps_of_kmh
from ..graph.network import AGAINST_ONE_WAY, NO_ACCESS
from ..observations import Array
from ..wording import by_reason
from . import tags as meaning
from .overture_rows import rows_of
from .overture_rules import Rules, items, parts_between
from .sheet import Sheet
from .streets import Column, Restriction, Streets, Texts, attributes

_SNAP = 0.5  # m, within which a connector or an end of a range is at a vertex
_HEADINGS = {"forward": 1, "backward": 0}


def read_overture(table: Any) -> tuple[Streets, str]:
    """Streets of Overture's segments.

    Args:
        table: As `overture_rows.segments_in` gives it.

    Returns:
        The streets, and what to call the table.

    Raises:
        MapError: The file cannot be read, or has no segment for cars.
    """
    import pyarrow as pa
    from shapely.errors import ShapelyError

    where = str(table) if isinstance(table, str | Path) else "Overture's segments"
    where = table.where if isinstance(table, Sheet) else where
    found = _Segments()
    try:
        for row in rows_of(table):
            found.add(row)
    except (pa.ArrowException, ShapelyError, OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise MapError(
            f"{where}: {reason}; GeoParquet or GeoJSON of Overture's theme transportation, type "
            "segment, was expected; fetch it again"
        ) from error
    if not found.first[1:]:
        reasons = by_reason(found.skipped) or "no row"
        raise MapError(
            f"{where}: no road for cars ({reasons}); segments of the classes motorway ... service "
            "were expected; is it the type segment of the theme transportation?"
        )
    return found.streets(), where


class _Kind(NamedTuple):
    """What a part of a segment is, apart from its name."""

    highway: str
    rule_forward: int
    rule_backward: int
    access: int
    limit: float  # km/h
    width: float  # m
    layer: int
    bridge: bool
    tunnel: bool


class _Segments:
    """Collects streets and nodes."""

    def __init__(self) -> None:
        self.lat: list[Array] = []
        self.lon: list[Array] = []
        self.nodes = 0
        self.node_words: list[str] = []
        self.connectors: dict[str, int] = {}
        self.first, self.node = [0], list[int]()
        self.ids: list[str] = []
        self.names: list[str] = []
        self.kinds: list[_Kind] = []
        self.start: list[float] = []  # m along the segment
        self.length: list[float] = []  # m of the whole segment
        self.transitions: list[tuple[str, dict[str, Any]]] = []
        self.skipped: Counter[str] = Counter()

    def add(self, row: Mapping[str, Any]) -> None:
        """Keep a segment that is for cars."""
        if (row.get("subtype") or "road") != "road":
            self.skipped["segments of rail and water"] += 1
            return
        word = str(row.get("class") or "")
        word = "road" if word == "unknown" else word
        if word not in meaning.CLASS_SPEED_KMH:
            self.skipped["segments of classes not for cars"] += 1
            return
        xy = _line(row["geometry"])
        if xy is None or not row.get("id"):
            self.skipped["segments without a line or an id"] += 1
            return
        identity = str(row["id"])
        at = np.concatenate([[0.0], np.cumsum(_steps(xy))])
        if at[-1] <= 0.0:
            self.skipped["segments without length"] += 1
            return
        rules = Rules(row, self.skipped)
        joints = self._joints(row, float(at[-1]))
        breaks = [share * float(at[-1]) for share in rules.breaks]
        xy, at, breaks = _with_vertices(xy, at, [m for _, m in joints], breaks)
        node = self._number(xy, at, joints)
        self._parts(identity, word, row, rules, at, node, breaks)
        for one in items(row.get("prohibited_transitions")):
            self.transitions.append((identity, one))

    def _joints(self, row: Mapping[str, Any], length: float) -> list[tuple[str, float]]:
        """Connectors, and where they are, m."""
        joints, told = [], items(row["connectors"])
        if not told:
            self.skipped["segments without connectors"] += 1
        for one in told:
            share = one.get("at")
            if one.get("connector_id") and share is not None and 0.0 <= share <= 1.0:
                joints.append((str(one["connector_id"]), float(share) * length))
            else:
                self.skipped["connectors without a place"] += 1
        return joints

    def _number(self, xy: Array, at: Array, joints: list[tuple[str, float]]) -> list[int]:
        """Numbers of the nodes at the vertices; those of connectors are shared."""
        number = np.full(len(at), -1, np.int64)
        for word, place in joints:
            k = int(np.abs(at - place).argmin())
            if word not in self.connectors:
                self.connectors[word] = self._new(xy[k : k + 1], [word])
            number[k] = self.connectors[word]
        rest = np.flatnonzero(number < 0)
        number[rest] = self._new(xy[rest], [""] * len(rest)) + np.arange(len(rest))
        return [int(one) for one in number]

    def _new(self, xy: Array, words: list[str]) -> int:
        """The number of the first of some new nodes."""
        begin = self.nodes
        self.lon.append(xy[:, 0])
        self.lat.append(xy[:, 1])
        self.node_words += words
        self.nodes += len(words)
        return begin

    def _parts(
        self, identity: str, word: str, row: Mapping[str, Any], rules: Rules, at: Array,
        node: list[int], breaks: list[float],
    ) -> None:  # fmt: skip
        """One street for each part on which the rules are the same."""
        before: tuple[_Kind, str] | None = None
        for begin, end in parts_between(at, breaks):
            middle = 0.5 * (at[begin] + at[end]) / at[-1]
            kind = _kind(word, rules, middle)
            if kind is None:
                self.skipped["parts under construction or abandoned"] += 1
                before = None
                continue
            name = rules.name(middle)
            if before == (kind, name):
                self.node += node[begin + 1 : end + 1]
                self.first[-1] = len(self.node)
                continue
            before = kind, name
            self.node += node[begin : end + 1]
            self.first.append(len(self.node))
            self.ids.append(identity)
            self.names.append(name)
            self.kinds.append(kind)
            self.start.append(float(at[begin]))
            self.length.append(float(at[-1]))

    def streets(self) -> Streets:
        """Everything as arrays."""
        kinds, source_id, node_id = self.kinds, Texts.of(self.ids), Texts.of(self.node_words)
        usual = [k.limit or meaning.CLASS_SPEED_KMH[k.highway] for k in kinds]
        both = [not (k.rule_forward ^ k.rule_backward) & AGAINST_ONE_WAY for k in kinds]
        return Streets(
            np.concatenate(self.lat), np.concatenate(self.lon), node_id,
            np.array(self.first), np.array(self.node),
            rule_forward=np.array([k.rule_forward for k in kinds], dtype=np.uint8),
            rule_backward=np.array([k.rule_backward for k in kinds], dtype=np.uint8),
            speed=np.array([mps_of_kmh(max(kmh, 5.0)) for kmh in usual]),
            lane=np.array([
                meaning.lane_offset(k.highway, two, 0.0, k.width, False)
                for k, two in zip(kinds, both, strict=True)
            ]),
            lane_sigma=np.array([
                meaning.lane_sigma(k.highway, two, 0.0) for k, two in zip(kinds, both, strict=True)
            ]),
            service=np.array([k.highway == "service" for k in kinds], dtype=np.uint8),
            highway=Texts.of([k.highway for k in kinds]),
            columns={"source_id": source_id, "name": Texts.of(self.names), **self._columns()},
            restrictions=list(self._restrictions(source_id, node_id)),
            skipped=dict(self.skipped), start=np.array(self.start), whole=np.array(self.length),
        )  # fmt: skip

    def _columns(self) -> dict[str, Column]:
        kinds = self.kinds
        oneway = [
            bool(k.rule_backward & AGAINST_ONE_WAY) - bool(k.rule_forward & AGAINST_ONE_WAY)
            for k in kinds
        ]  # fmt: skip
        none = np.zeros(len(kinds), np.uint8)
        return attributes(
            limit=[k.limit for k in kinds], lanes=none, width=[k.width for k in kinds],
            layer=[k.layer for k in kinds], bridge=[k.bridge for k in kinds],
            tunnel=[k.tunnel for k in kinds], oneway=oneway, roundabout=none,
            access=[k.access for k in kinds],
        )  # fmt: skip

    def _restrictions(self, source_id: Texts, node_id: Texts) -> Iterable[Restriction]:
        """Prohibited transitions, ids by their codes."""
        ways = dict(zip(self.ids, source_id.code.tolist(), strict=True))
        nodes = {w: int(node_id.code[k]) for w, k in self.connectors.items()}
        for origin, one in self.transitions:
            steps = [
                (s.get("connector_id"), s.get("segment_id")) for s in items(one.get("sequence"))
            ]
            when = one.get("when") or {}
            if not Rules.for_cars(when) or items(when.get("vehicle")) or when.get("during"):
                self.skipped["transitions for other vehicles or at certain times"] += 1
            elif (
                not steps
                or any(n not in nodes or w not in ways for n, w in steps)
                or (origin not in ways)
            ):
                self.skipped["transitions to what is not in the map"] += 1
            else:
                heading = _HEADINGS.get(when.get("heading") or "", -1)
                final = _HEADINGS.get(one.get("final_heading") or "", -1)
                last = str(steps[-1][1])
                yield Restriction(
                    False,
                    last == origin and len(steps) == 1 and (heading < 0 or heading != final),
                    (ways[origin],),
                    nodes[str(steps[0][0])],
                    (ways[last],),
                    tuple(ways[str(way)] for _, way in steps[:-1]),
                    heading,
                    final,
                )


def _line(geometry: Any) -> Array | None:
    """Longitudes and latitudes of a line, (n, 2); None: it is none."""
    import shapely

    shape = shapely.from_wkb(geometry) if isinstance(geometry, bytes) else geometry
    if shape is not None and shape.geom_type == "MultiLineString" and len(shape.geoms) == 1:
        shape = shape.geoms[0]  # as a GeoPackage has them
    if shape is None or shape.geom_type != "LineString" or shape.is_empty:
        return None
    xy = shapely.get_coordinates(shape)
    possible = np.isfinite(xy).all() and np.abs(xy[:, 1]).max() <= 90.0
    return xy if possible and np.abs(xy[:, 0]).max() <= 360.0 else None


def _steps(xy: Array) -> Array:
    """Metres between vertices."""
    import pyproj

    geod = pyproj.Geod(ellps="WGS84")
    return np.asarray(geod.inv(xy[:-1, 0], xy[:-1, 1], xy[1:, 0], xy[1:, 1])[2])


def _with_vertices(
    xy: Array, at: Array, joints: list[float], breaks: list[float]
) -> tuple[Array, Array, list[float]]:
    """The line with a vertex at each connector and at each end of a range.

    Returns:
        Vertices, their places along the line, and the ends of ranges, each at a vertex.
    """
    moved = []
    for place in (*joints, *breaks):
        near = int(np.abs(at - place).argmin())
        if abs(at[near] - place) > _SNAP:
            after = int(np.searchsorted(at, place))
            t = (place - at[after - 1]) / (at[after] - at[after - 1])
            xy = np.insert(xy, after, xy[after - 1] + t * (xy[after] - xy[after - 1]), axis=0)
            at = np.insert(at, after, place)
            near = after
        moved.append(float(at[near]))
    return xy, at, moved[len(joints) :]


def _kind(word: str, rules: Rules, share: float) -> _Kind | None:
    """What a segment is at a place; None: it cannot be driven."""
    flags = rules.flags(share)
    if flags & {"is_under_construction", "is_abandoned"}:
        return None
    link = "is_link" in flags or rules.subclass(share) == "link"
    highway = f"{word}_link" if link and f"{word}_link" in meaning.CLASS_SPEED_KMH else word
    access, against_forward, against_backward = rules.access(share)
    closed = NO_ACCESS if access == meaning.CLOSED else 0
    return _Kind(
        highway,
        closed | (AGAINST_ONE_WAY if against_forward else 0),
        closed | (AGAINST_ONE_WAY if against_backward else 0),
        access,
        rules.limit_kmh(share),
        rules.width(share),
        rules.level(share),
        "is_bridge" in flags,
        "is_tunnel" in flags,
    )
