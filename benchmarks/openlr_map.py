# ruff: noqa: D102 - the methods are those of the package
"""A road map as `openlr_dereferencer` wants it: its lines are the legal directed edges."""

from functools import cached_property

import numpy as np
from openlr import FOW, FRC, Coordinates
from openlr_dereferencer.maps import Line, MapReader, Node
from openlr_dereferencer.maps.wgs84 import distance
from shapely import STRtree
from shapely.geometry import LineString, Point

from whichroad.roadmap.openlr_lines import form_of_way, functional_class

METRES = 111_000.0  # in a degree of latitude


class OurLine(Line):
    """A directed edge."""

    def __init__(self, reader, edge):
        self.reader, self.edge = reader, edge
        edges = reader.roads.arrays.edges
        word = reader.classes[edge] or ""
        self._frc, self._fow = functional_class(word), form_of_way(word, reader.rings[edge])
        self._length = float(edges.length[edge])
        line = reader.roads.edge_line(edge)
        lat, lon = reader.roads.plane.to_geodetic(*line.T)
        self._geometry = LineString(np.column_stack([lon, lat]))

    line_id = property(lambda self: self.edge)
    frc = property(lambda self: FRC(self._frc))
    fow = property(lambda self: FOW(self._fow))
    length = property(lambda self: self._length)
    geometry = property(lambda self: self._geometry)
    start_node = property(lambda s: s.reader.get_node(int(s.reader.edges.from_node[s.edge])))
    end_node = property(lambda s: s.reader.get_node(int(s.reader.edges.to_node[s.edge])))

    def distance_to(self, coord):
        near = self._geometry.interpolate(self._geometry.project(Point(*coord)))
        return distance(coord, Coordinates(near.x, near.y))


class OurNode(Node):
    """A junction."""

    def __init__(self, reader, number):
        self.reader, self.number = reader, number

    node_id = property(lambda self: self.number)

    @cached_property
    def coordinates(self):
        lines = [*self.reader.out.get(self.number, ()), *self.reader.into.get(self.number, ())]
        edge = lines[0]
        begins = self.reader.edges.from_node[edge] == self.number
        return Coordinates(*self.reader.lines[edge].geometry.coords[0 if begins else -1])

    def outgoing_lines(self):
        return [self.reader.lines[e] for e in self.reader.out.get(self.number, ())]

    def incoming_lines(self):
        return [self.reader.lines[e] for e in self.reader.into.get(self.number, ())]

    def connected_lines(self):
        return [*self.outgoing_lines(), *self.incoming_lines()]


class OurMap(MapReader):
    """The legal edges of a map."""

    def __init__(self, roads):
        self.roads, self.edges = roads, roads.arrays.edges
        self.classes, self.rings = roads.column("highway"), roads.column("roundabout")
        legal = np.flatnonzero(self.edges.rule == 0).tolist()
        self.out, self.into, self.nodes = {}, {}, {}
        for e in legal:
            self.out.setdefault(int(self.edges.from_node[e]), []).append(e)
            self.into.setdefault(int(self.edges.to_node[e]), []).append(e)
        self.lines = {e: OurLine(self, e) for e in legal}
        self.order = legal
        self.tree = STRtree([self.lines[e].geometry for e in legal])

    def get_line(self, line_id):
        return self.lines[line_id]

    def get_lines(self):
        return self.lines.values()

    def get_linecount(self):
        return len(self.lines)

    def get_node(self, node_id):
        return self.nodes.setdefault(node_id, OurNode(self, node_id))

    def get_nodes(self):
        return [self.get_node(n) for n in {*self.out, *self.into}]

    def get_nodecount(self):
        return len({*self.out, *self.into})

    def find_nodes_close_to(self, coord, dist):
        lines = self.find_lines_close_to(coord, dist)
        nodes = {n.node_id: n for line in lines for n in (line.start_node, line.end_node)}
        return [n for n in nodes.values() if distance(coord, n.coordinates) <= dist]

    def find_lines_close_to(self, coord, dist):
        around = Point(*coord).buffer(2.0 * dist / METRES)
        near = (self.lines[self.order[k]] for k in self.tree.query(around))
        return [line for line in near if line.distance_to(coord) <= dist]
