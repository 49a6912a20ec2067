"""Road networks as graphs, as OSMnx makes and stores them: MultiDiGraph and GraphML."""

from collections.abc import Hashable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError
from .sheet import Sheet, from_texts


class _Edge(NamedTuple):
    origin: Any
    target: Any
    tags: Mapping[str, Any]


def is_graph(thing: Any) -> bool:
    """Whether this is a graph of networkx, which need not be installed."""
    return all(hasattr(thing, name) for name in ("nodes", "edges", "graph", "is_directed"))


def sheet_of_graph(graph: Any) -> Sheet:
    """The edges of a graph of networkx as a table.

    Args:
        graph: As OSMnx has it: nodes with `x`, `y`, edges with the tags of their streets and a
            `geometry` where they bend, `graph.graph["crs"]`.

    Raises:
        MapError: It has no edges, or a node has no place.
    """
    places = {node: (tags.get("x"), tags.get("y")) for node, tags in graph.nodes(data=True)}
    edges = [_Edge(u, v, tags) for u, v, tags in graph.edges(data=True)]
    crs = graph.graph.get("crs")
    return _sheet("graph", places, edges, crs, directed=bool(graph.is_directed()))


def read_graphml(path: Path) -> Sheet:
    """The edges of a GraphML file as a table.

    Raises:
        MapError: It cannot be read, has no edges, or a node has no place.
    """
    places: dict[Any, tuple[Any, Any]] = {}
    edges: list[_Edge] = []
    names: dict[str, str] = {}
    about: dict[str, str] = {}
    directed = True
    try:
        for event, element in ElementTree.iterparse(path, events=("start", "end")):
            kind = element.tag.rpartition("}")[2]
            if event == "start":
                if kind == "graph":
                    directed = element.get("edgedefault", "directed") == "directed"
                continue
            if kind == "key":
                names[element.get("id", "")] = element.get("attr.name", "")
            elif kind == "node":
                tags = _tags(element, names)
                places[_name(element.get("id"))] = (tags.get("x"), tags.get("y"))
            elif kind == "edge":
                origin, target = (_name(element.get(end)) for end in ("source", "target"))
                edges.append(_Edge(origin, target, _tags(element, names)))
            elif kind == "graph":
                about |= _tags(element, names)
            if kind in ("node", "edge"):
                element.clear()
    except (OSError, ElementTree.ParseError, ValueError) as error:
        raise MapError(
            f"{path}: not readable as GraphML; a graph of a road network was expected; check that "
            "the file is complete"
        ) from error
    return _sheet(str(path), places, edges, about.get("crs"), directed=directed)


def _tags(element: ElementTree.Element, names: Mapping[str, str]) -> dict[str, str]:
    """The data of a node, an edge or the graph, by name."""
    return {
        names.get(data.get("key", ""), ""): data.text or ""
        for data in element if data.tag.rpartition("}")[2] == "data"
    }  # fmt: skip


def _name(text: str | None) -> int | str:
    """A node's id: OpenStreetMap's are whole numbers."""
    word = text or ""
    return int(word) if word.lstrip("-").isdecimal() else word


def _sheet(
    where: str, places: Mapping[Hashable, tuple[Any, Any]], edges: Iterable[_Edge], crs: Any, *,
    directed: bool,
) -> Sheet:  # fmt: skip
    """The table of a graph's edges; a row is one direction where the graph is directed."""
    import shapely

    rows = list(edges)
    if not rows:
        raise MapError(
            f"{where}: it has no edges; a graph of a road network was expected; check that it is "
            "one, such as OSMnx makes"
        )
    shapes = _objects([edge.tags.get("geometry") for edge in rows])
    words = np.array([isinstance(shape, str) for shape in shapes], dtype=bool)
    shapes[words] = from_texts(shapes[words])
    bad = int(sum(shape is None for shape in shapes[words]))
    straight = [k for k, edge in enumerate(rows) if edge.tags.get("geometry") in (None, "")]
    for k in straight:
        ends = [_place(places, node, where) for node in (rows[k].origin, rows[k].target)]
        shapes[k] = shapely.LineString(ends)
    names = dict.fromkeys(str(name) for edge in rows for name in edge.tags)
    columns = {
        name.lower(): _objects([edge.tags.get(name) for edge in rows])
        for name in names if name not in ("geometry", "")
    }  # fmt: skip
    columns["u"] = _objects([edge.origin for edge in rows])
    columns["v"] = _objects([edge.target for edge in rows])
    return Sheet(where, columns, shapes, crs or None, bad, directed or None)


def _place(places: Mapping[Hashable, tuple[Any, Any]], node: Any, where: str) -> tuple[float, ...]:
    """Coordinates of a node.

    Raises:
        MapError: It has none.
    """
    try:
        x, y = (float(value) for value in places[node])
    except (KeyError, TypeError, ValueError):
        raise MapError(
            f"{where}: node {node!r} has no position; coordinates x and y of each node, or a "
            "geometry of each edge, were expected; add them"
        ) from None
    return x, y


def _objects(values: list[Any]) -> NDArray[Any]:
    """A column of anything."""
    column = np.full(len(values), None, dtype=object)
    column[:] = values
    return column
