"""SUMO's road networks, `.net.xml`: edges, junctions, and connections that are missing."""

import gzip
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ..errors import MapError
from ..geodesy.units import kmh_of_mps
from .lines import NoSystem
from .road_tables import streets_of
from .sheet import Sheet
from .streets import Restriction, Streets, Texts

SUFFIXES = (".net.xml", ".net.xml.gz")
_CAR = "passenger"  # SUMO's class of vehicles
_ALL = frozenset(("all", _CAR, "custom1", "custom2"))
_NO_ROADS = frozenset(("internal", "crossing", "walkingarea"))


@dataclass(slots=True)
class _Net:
    """What a file holds."""

    offset: tuple[float, float] = (0.0, 0.0)
    projection: str = "!"
    junctions: dict[str, tuple[float, float]] = field(default_factory=dict)
    edges: list[dict[str, Any]] = field(default_factory=list)
    connected: set[tuple[str, str]] = field(default_factory=set)
    skipped: Counter[str] = field(default_factory=Counter)


def is_net(table: Any) -> bool:
    """Whether this is the path of a network of SUMO."""
    return isinstance(table, str | Path) and str(table).lower().endswith(SUFFIXES)


def read_net(path: Path, crs: Any = None) -> tuple[Streets, str]:
    """Streets of a network of SUMO.

    Args:
        path: `.net.xml` or `.net.xml.gz`.
        crs: Reference system of its coordinates where the file does not name it.

    Returns:
        The streets, and what to call the file.

    Raises:
        MapError: It cannot be read, has no edge for cars, or nobody knows where it lies.
    """
    net = _Net()
    try:
        _collect(path, net)
    except (OSError, EOFError, ElementTree.ParseError, ValueError) as error:
        raise MapError(
            f"{path}: {error}; a network of SUMO (.net.xml) was expected; check that it is one and "
            "complete"
        ) from error
    if not net.edges:
        raise MapError(
            f"{path}: no edge for cars was found; a network of SUMO with lanes that passenger cars "
            "may use was expected; was it written by netconvert?"
        )
    if crs is None and net.projection in ("!", "-", "."):
        raise NoSystem(
            f"{path}: its coordinates have no projection (projParameter is {net.projection!r}); a "
            'network with one was expected; give crs="EPSG:..." (--crs)'
        )
    streets, skipped = streets_of(_sheet(net, path, crs or net.projection), None, True)
    skipped.update(net.skipped)
    banned = list(_banned(net, streets))
    return replace(streets, restrictions=banned, skipped=dict(skipped)), str(path)


def _collect(path: Path, net: _Net) -> None:
    """All of a file that is needed."""
    if not path.is_file():
        raise OSError("the file does not exist")
    with path.open("rb") as raw:
        packed = raw.read(2) == b"\x1f\x8b"
    with gzip.open(path) if packed else path.open("rb") as file:
        root = None
        for event, element in ElementTree.iterparse(file, events=("start", "end")):
            if event == "start":
                root = element if root is None else root
                continue
            kind = element.tag
            if kind == "location":
                x, y = element.get("netOffset", "0,0").split(",")
                net.offset = float(x), float(y)
                net.projection = element.get("projParameter", "!")
            elif kind == "junction" and element.get("type") != "internal":
                place = float(element.get("x", "nan")), float(element.get("y", "nan"))
                net.junctions[element.get("id", "")] = place
            elif kind == "edge":
                _edge(element, net)
            elif kind == "connection" and _for_cars(element):
                net.connected.add((element.get("from", ""), element.get("to", "")))
            if kind in ("edge", "junction", "connection", "tlLogic") and root is not None:
                root.clear()


def _for_cars(element: ElementTree.Element) -> bool:
    """Whether a lane or a connection is for passenger cars."""
    allow, disallow = element.get("allow"), element.get("disallow")
    if allow:
        return bool(_ALL & set(allow.split()))
    return not (disallow and {"all", _CAR} & set(disallow.split()))


def _edge(element: ElementTree.Element, net: _Net) -> None:
    """Keep an edge that cars may use."""
    if element.get("function") in _NO_ROADS:
        return
    lanes = [lane for lane in element.iter("lane") if _for_cars(lane)]
    if not lanes:
        net.skipped["edges not for cars"] += 1
        return
    words = element.get("type", "").split("|")[0].split(".")
    highway = words[1] if len(words) > 1 and words[0] == "highway" else ""
    widths = [float(lane.get("width", 0.0)) for lane in lanes]
    net.edges.append(
        {
            "edge_id": element.get("id", ""),
            "from": element.get("from", ""),
            "to": element.get("to", ""),
            "name": element.get("name"),
            "highway": highway or None,
            "maxspeed": round(kmh_of_mps(max(float(lane.get("speed", 0.0)) for lane in lanes)), 3),
            "lanes": len(lanes),
            "width": sum(widths) if all(widths) else None,
            "shape": element.get("shape"),
        }
    )


def _sheet(net: _Net, path: Path, crs: Any) -> Sheet:
    """The edges as a table, a row for each direction.

    Raises:
        MapError: An edge has neither a shape nor junctions.
    """
    import shapely

    lines = []
    for edge in net.edges:
        shape = edge.pop("shape")
        try:
            if shape:
                places = [tuple(map(float, xy.split(",")[:2])) for xy in shape.split()]
            else:
                places = [net.junctions[edge[end]] for end in ("from", "to")]
            if not np.isfinite(places).all():
                raise ValueError
            lines.append(shapely.LineString(places))
        except (KeyError, ValueError, shapely.errors.ShapelyError):
            net.skipped["edges without a place"] += 1
            lines.append(None)
    geometry = np.full(len(lines), None, dtype=object)
    geometry[:] = lines
    there = np.array([line is not None for line in lines], dtype=bool)
    x, y = net.offset
    moved = shapely.transform(geometry[there], lambda xy: xy - (x, y))
    geometry[there] = moved
    columns = {}
    for name in net.edges[0]:
        column = np.full(len(net.edges), None, dtype=object)
        column[:] = [edge.get(name) for edge in net.edges]
        columns[name] = column
    return Sheet(str(path), columns, geometry, crs, directed=True)


def _banned(net: _Net, streets: Streets) -> Iterator[Restriction]:
    """A restriction for each turn between edges that have no connection."""
    nodes = streets.node_id
    if not isinstance(nodes, Texts):
        return
    code = {nodes.word(int(c)): int(c) for c in np.unique(nodes.code)}
    ways = _directions(streets)
    out: dict[str, list[str]] = {}
    ends = {edge["edge_id"]: (edge["from"], edge["to"]) for edge in net.edges}
    for name, (begin, _) in ends.items():
        out.setdefault(begin, []).append(name)
    for origin, (_, via) in ends.items():
        for target in out.get(via, ()):
            if (origin, target) in net.connected or ends[target][1] == ends[origin][0]:
                continue
            if origin in ways and target in ways and via in code:
                (a, forth), (b, on) = ways[origin], ways[target]
                yield Restriction(False, False, (a,), code[via], (b,), (), forth, on)


def _directions(streets: Streets) -> dict[str, tuple[int, int]]:
    """Of each edge of SUMO the code of its street, and whether it runs as that was drawn."""
    ids, back = streets.columns["source_id"], streets.columns.get("back_id")
    ways: dict[str, tuple[int, int]] = {}
    if not isinstance(ids, Texts):
        return ways
    paired = streets.columns.get("paired")
    for row in range(len(ids)):
        code = int(ids.code[row])
        ways[ids[row]] = code, 1
        if isinstance(back, Texts) and isinstance(paired, np.ndarray) and paired[row]:
            ways.setdefault(back[row], (code, 0))
    return ways
