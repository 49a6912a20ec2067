"""OpenStreetMap extracts: drivable ways, their nodes and turn restrictions."""

import math
from array import array
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MapError
from ..geodesy.units import mps_of_kmh
from ..graph.network import AGAINST_ONE_WAY, NO_ACCESS
from . import tags as meaning
from .link import middle_plane
from .shelf import laid
from .streets import Column, Restriction, Streets, Texts, attributes

SUFFIXES = (".osm.pbf", ".pbf", ".osm", ".osm.gz", ".osm.bz2", ".osm.xml", ".xml")
_Node = tuple[int, int, int]  # id, longitude and latitude in osmium's units of 1e-7 degrees
_Box = tuple[int, int, int, int]  # west, south, east, north, in the same units
_UNDEFINED = 2**31 - 1  # osmium's coordinate of a node that the extract lacks
_CARS = ("motorcar", "motor_vehicle")
# what no car passes; gates and their like may stand open
_BARRIERS = ("bollard", "block", "jersey_barrier", "log", "cycle_barrier", "debris")


def read_osm(path: Path, bbox: Any = None) -> Streets:
    """Streets of an OpenStreetMap file.

    Args:
        path: One of `SUFFIXES`.
        bbox: West, south, east and north, degrees: segments outside are left out.  None: all
            are read.

    Returns:
        The drivable ways, over nodes that carry OSM ids.

    Raises:
        MapError: The file cannot be read, or holds no drivable way.
    """
    import osmium

    if not path.is_file():
        raise MapError(
            f"{path}: the file does not exist; an OpenStreetMap extract was expected; "
            "check the name"
        )
    ways = _Ways(None if bbox is None else _box(bbox))
    try:
        for item in _processor(path):
            if item.is_way():
                ways.add(item)
            elif item.is_node():
                if meaning.access({"access": "no", **dict(item.tags)}) != meaning.OPEN:
                    ways.blocked.append(item.id)
            else:
                ways.add_relation(item)
    except (RuntimeError, OSError, ValueError, osmium.InvalidLocationError) as error:
        reason = " ".join(str(error).split())
        raise MapError(
            f"{path}: {reason}; an OpenStreetMap file ({', '.join(SUFFIXES)}) was expected; "
            "check that it is one and complete"
        ) from error
    if not ways.ids and ways.outside is not None:
        edges = ", ".join(f"{value / 1e7:.4f}" for value in ways.outside)
        raise MapError(
            f"{path}: no drivable way is in the box {bbox}; the file's lie within {edges}; west, "
            "south, east, north in degrees were expected; check their order"
        )
    if not ways.ids:
        raise MapError(
            f"{path}: no drivable way was found; ways with highway=motorway ... service were "
            "expected; check that the extract holds roads and their nodes"
        )
    return ways.streets()


def date_of(path: Path) -> str | None:
    """The date of an extract's data, as its header says it; None: it does not."""
    import osmium

    try:
        with osmium.io.Reader(str(path), osmium.osm.osm_entity_bits.NOTHING) as reader:
            header = reader.header()
            return header.get("osmosis_replication_timestamp") or header.get("timestamp") or None
    except (RuntimeError, OSError):
        return None


def _processor(path: Path) -> Any:
    """Iterator over drivable ways with their nodes' places, and restriction relations."""
    import osmium

    f, kinds = osmium.filter, osmium.osm
    return (
        osmium.FileProcessor(str(path))
        .with_locations("flex_mem")
        .with_filter(f.EntityFilter(kinds.NODE | kinds.WAY | kinds.RELATION))
        .with_filter(_of(kinds.NODE, *(("barrier", b) for b in _BARRIERS)))
        .with_filter(_of(kinds.WAY, *(("highway", c) for c in meaning.CLASS_SPEED_KMH)))
        .with_filter(_of(kinds.RELATION, ("type", "restriction")))
    )


def _of(kind: Any, *tags: tuple[str, str]) -> Any:
    """A filter that lets pass things of a kind that have one of some tags."""
    import osmium

    chosen = osmium.filter.TagFilter(*tags)
    chosen.enable_for(kind)
    return chosen


def _box(bbox: Any) -> _Box:
    """A box in osmium's units.

    Raises:
        MapError: It is none.
    """
    try:
        west, south, east, north = (float(value) for value in bbox)
    except (TypeError, ValueError):
        west = south = east = north = math.nan
    if not (-180.0 <= west < east <= 180.0 and -90.0 <= south < north <= 90.0):
        raise MapError(
            f"bbox is {bbox!r}; west, south, east, north in degrees were expected, such as "
            "(8.6, 49.3, 8.8, 49.5)"
        )
    return round(west * 1e7), round(south * 1e7), round(east * 1e7), round(north * 1e7)


def _within(run: list[_Node], box: _Box) -> list[list[_Node]]:
    """The parts of a line of nodes whose segments may touch a box."""
    west, south, east, north = box
    parts: list[list[_Node]] = [[]]
    for a, b in pairwise(run):
        (_, ax, ay), (_, bx, by) = a, b
        if max(ax, bx) < west or min(ax, bx) > east or max(ay, by) < south or min(ay, by) > north:
            parts.append([])
        else:
            parts[-1] += [b] if parts[-1] else [a, b]
    return parts


def _along(way: Any, runs: list[list[_Node]]) -> tuple[list[float], float]:
    """Where runs of a way's nodes begin along it, and its length, m; NaN: that of its only run.

    Nodes that the extract lacks are passed over in a straight line.
    """
    if len(runs) == 1 and len(runs[0]) == len(way.nodes):
        return [0.0], math.nan
    nodes = [(n.ref, n.x, n.y) for n in way.nodes if n.x != _UNDEFINED]
    lon, lat = (np.array([node[k] for node in nodes]) / 1e7 for k in (1, 2))
    plane = middle_plane(lat, lon)
    x, y = plane.from_geodetic(lat, lon)
    place = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    starts, after = [], 0
    for run in runs:  # in the order of the way, which may visit a node twice
        after = nodes.index(run[0], after)
        starts.append(float(place[after]))
    return starts, float(place[-1])


class _Ways:
    """Collects what the file holds, as flat arrays; equal tags are understood once."""

    def __init__(self, box: _Box | None) -> None:
        self.box = box
        self.outside: _Box | None = None  # bounds of the ways that the box leaves out
        self.ids, self.count = array("q"), array("i")
        self.kinds: dict[tuple[str | None, ...], _Kind] = {}
        self.rows: list[_Kind] = []
        self.names: list[str] = []
        self.words: dict[str, str] = {}  # each name once
        self.told: dict[str, list[str]] = {name: [] for name in _TOLD}
        self.ref, self.x, self.y = array("q"), array("i"), array("i")
        self.start, self.whole = array("d"), array("d")  # m along the way, m
        self.restrictions: list[Restriction] = []
        self.blocked: list[int] = []
        self.skipped: Counter[str] = Counter()

    def add(self, way: Any) -> None:
        """Keep a way (osmium's object lives only during this call)."""
        tags = dict(way.tags)
        if tags.get("area") == "yes":
            self.skipped["ways that are areas"] += 1
            return
        runs: list[list[_Node]] = [[]]
        for node in way.nodes:
            if node.x != _UNDEFINED:
                runs[-1].append((node.ref, node.x, node.y))
            else:  # the extract was cut here: what follows does not hang together
                self.skipped["nodes of ways missing in the extract"] += 1
                runs.append([])
        long = [run for run in runs if len(run) > 1]
        if not long:
            self.skipped["ways of fewer than two nodes"] += 1
            return
        if self.box is not None:
            inside = [part for run in long for part in _within(run, self.box) if part]
            if not inside:
                self._leave_out(long)
                return
            long = inside
        starts, whole = _along(way, long)
        values = tuple(map(tags.get, _KEYS))
        kind = self.kinds.get(values) or self.kinds.setdefault(values, _Kind(tags))
        name = tags.get("name") or tags.get("ref") or ""
        name = self.words.setdefault(name, name)
        told = [_told(tags, keys) for keys in _TOLD.values()]
        for run, start in zip(long, starts, strict=True):
            self.start.append(start)
            self.whole.append(whole)
            ref, x, y = zip(*run, strict=True)
            self.ref.extend(ref)
            self.x.extend(x)
            self.y.extend(y)
            self.ids.append(way.id)
            self.rows.append(kind)
            self.names.append(name)
            for words, word in zip(self.told.values(), told, strict=True):
                words.append(word)
            self.count.append(len(run))

    def _leave_out(self, runs: list[list[_Node]]) -> None:
        """Count a way outside the box."""
        self.skipped["ways outside the box"] += 1
        _, x, y = zip(*(node for run in runs for node in run), strict=True)
        west, south, east, north = self.outside or (x[0], y[0], x[0], y[0])
        self.outside = min(west, *x), min(south, *y), max(east, *x), max(north, *y)

    def add_relation(self, relation: Any) -> None:
        """Keep a turn restriction that concerns cars and turns at one node."""
        tags = dict(relation.tags)
        keys = (*(f"restriction:{car}" for car in _CARS), "restriction")
        kind = next((tags[key] for key in keys if key in tags), "")
        if not kind.startswith(("no_", "only_")):
            self.skipped["restrictions for other vehicles or at certain times"] += 1
            return
        if any(word.strip() in _CARS for word in tags.get("except", "").split(";")):
            self.skipped["restrictions that except cars"] += 1
            return
        members: dict[str, list[tuple[str, int]]] = {"from": [], "via": [], "to": []}
        for member in relation.members:
            members.setdefault(member.role, []).append((member.type, member.ref))
        via, kinds = members["via"], {kind_ for kind_, _ in members["via"]}
        if not via or (kinds != {"w"} and (kinds != {"n"} or len(via) > 1)):
            self.skipped["restrictions via neither one node nor ways"] += 1
            return
        origin = tuple(ref for kind_, ref in members["from"] if kind_ == "w")
        target = tuple(ref for kind_, ref in members["to"] if kind_ == "w")
        if not origin or not target:
            self.skipped["restrictions without from or to"] += 1
            return
        self.restrictions.append(
            Restriction(
                kind.startswith("only_"),
                "u_turn" in kind,
                origin,
                via[0][1] if kinds == {"n"} else -1,
                target,
                tuple(ref for _, ref in via) if kinds == {"w"} else (),
            )
        )

    def streets(self) -> Streets:
        """Everything as arrays."""
        ref = np.frombuffer(self.ref, dtype=np.int64)
        node_id, place, node = np.unique(ref, return_index=True, return_inverse=True)
        # osmium counts in 1e-7 degrees
        lat = laid(np.frombuffer(self.y, dtype=np.int32)[place] / 1e7)
        lon = laid(np.frombuffer(self.x, dtype=np.int32)[place] / 1e7)
        node_id, node = laid(node_id), laid(node)
        rows = self.rows
        return Streets(
            lat, lon, node_id, np.concatenate([[0], np.cumsum(self.count)]), node,
            rule_forward=np.array([r.forward for r in rows], dtype=np.uint8),
            rule_backward=np.array([r.backward for r in rows], dtype=np.uint8),
            speed=np.array([r.speed for r in rows]),
            lane=np.array([r.lane for r in rows]),
            lane_sigma=np.array([r.lane_sigma for r in rows]),
            service=np.array([r.highway == "service" for r in rows], dtype=np.uint8),
            highway=Texts.of([r.highway for r in rows]),
            columns={
                "source_id": np.array(self.ids, dtype=np.int64),
                "name": Texts.of(self.names),
                **_columns(rows),
                **{name: Texts.of(words) for name, words in self.told.items() if any(words)},
            },
            restrictions=self.restrictions,
            blocked=np.array(self.blocked, dtype=np.int64),
            skipped=dict(self.skipped),
            start=np.array(self.start),
            whole=np.array(self.whole),
        )  # fmt: skip


# the tags that `_Kind` and what it calls read
_KEYS = (
    "highway", "junction", "oneway", "oneway:motor_vehicle", "motorcar", "motor_vehicle",
    "vehicle", "access", "maxspeed", "lanes", "width", "layer", "bridge", "tunnel",
)  # fmt: skip


# what signs and lanes tell, for answers that route: column -> tags, the first that is there
_TOLD = {
    "ref": ("ref",),
    "turn_lanes_forward": ("turn:lanes:forward", "turn:lanes"),
    "turn_lanes_backward": ("turn:lanes:backward", "turn:lanes"),
    "destination_forward": ("destination:forward", "destination"),
    "destination_backward": ("destination:backward", "destination"),
}


def _told(tags: dict[str, str], keys: tuple[str, ...]) -> str:
    """The first of some tags; one for a direction is of the whole way only where it is one-way."""
    both = len(keys) > 1 and meaning.oneway(tags) == 0
    return next((tags[key] for key in keys[: 1 if both else None] if key in tags), "")


class _Kind:
    """The meaning of a way's tags; a city's ways are of few kinds."""

    __slots__ = (
        "access", "backward", "bridge", "forward", "highway", "lane", "lane_sigma", "lanes",
        "layer", "limit", "oneway", "ring", "speed", "tunnel", "width",
    )  # fmt: skip

    def __init__(self, tags: dict[str, str]) -> None:
        self.highway = tags["highway"]
        self.oneway = meaning.oneway(tags)
        self.access = meaning.access(tags)
        self.ring = meaning.roundabout(tags)
        self.limit = meaning.speed_limit_kmh(tags.get("maxspeed"))
        self.lanes = meaning.number(tags.get("lanes"))
        self.width = meaning.number(tags.get("width"))
        self.layer = meaning.whole(tags.get("layer", 0))
        self.bridge = meaning.truth(tags.get("bridge"))
        self.tunnel = meaning.truth(tags.get("tunnel"))
        closed = NO_ACCESS if self.access == meaning.CLOSED else 0
        self.forward = closed | (AGAINST_ONE_WAY if self.oneway < 0 else 0)
        self.backward = closed | (AGAINST_ONE_WAY if self.oneway > 0 else 0)
        self.speed = mps_of_kmh(max(self.limit or meaning.CLASS_SPEED_KMH[self.highway], 5.0))
        self.lane = meaning.lane_offset(
            self.highway, self.oneway == 0, self.lanes, self.width, self.ring
        )
        self.lane_sigma = meaning.lane_sigma(self.highway, self.oneway == 0, self.lanes)


def _columns(rows: list[_Kind]) -> dict[str, Column]:
    return attributes(
        limit=[r.limit for r in rows], lanes=[r.lanes for r in rows],
        width=[r.width for r in rows], layer=[r.layer for r in rows],
        bridge=[r.bridge for r in rows], tunnel=[r.tunnel for r in rows],
        oneway=[r.oneway for r in rows], roundabout=[r.ring for r in rows],
        access=[r.access for r in rows],
    )  # fmt: skip
