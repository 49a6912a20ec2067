"""Map builder: points, streets through them and turn restrictions, as OSM XML."""

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from ..geodesy.plane import Plane

if TYPE_CHECKING:
    from ..roadmap import RoadMap

Point = tuple[float, float]

ORIGIN = (49.41, 2.82)  # lat, lon of the place (0, 0)

_VERTEX_SPACING = 28.0  # m, along curved roads

Tags = dict[str, str]


class MapBuilder:
    """Collects nodes, ways and restrictions; positions in metres about `ORIGIN`."""

    def __init__(self) -> None:
        self.places: list[Point] = []
        self.names: dict[str, int] = {}
        self.ways: list[tuple[list[int], Tags]] = []
        self.restrictions: list[tuple[str, int, int, int]] = []

    def node(self, name: str, x: float, y: float) -> None:
        """Name a place."""
        self.names[name] = self._add(x, y)

    def _add(self, x: float, y: float) -> int:
        self.places.append((x, y))
        return len(self.places)  # ids begin at 1

    def way(self, names: Sequence[str], highway: str, **tags: str) -> int:
        """Draw a street of straight lines through named places; returns its number."""
        return self._way([self.names[n] for n in names], highway, tags)

    def curve(self, names: Sequence[str], highway: str, **tags: str) -> int:
        """Draw a smooth street through named places; returns its number."""
        return self._way(self.bend([self.names[n] for n in names]), highway, tags)

    def _way(self, nodes: list[int], highway: str, tags: Tags) -> int:
        self.ways.append((nodes, {"highway": highway, **tags}))
        return len(self.ways)

    def bend(self, nodes: list[int]) -> list[int]:
        """Nodes on a smooth curve (Catmull-Rom) through the given ones."""
        p = np.array([self.places[n - 1] for n in nodes])
        p = np.vstack([2 * p[0] - p[1], p, 2 * p[-1] - p[-2]])
        bent = nodes[:1]
        for k, node in enumerate(nodes[1:], start=1):
            a, b, c, d = p[k - 1 : k + 3]
            pieces = max(1, round(math.dist(b, c) / _VERTEX_SPACING))
            for t in np.arange(1, pieces) / pieces:
                linear, square, cube = c - a, 2 * a - 5 * b + 4 * c - d, 3 * b - a - 3 * c + d
                x, y = b + 0.5 * (linear * t + square * t**2 + cube * t**3)
                bent.append(self._add(float(x), float(y)))
            bent.append(node)
        return bent

    def restrict(self, kind: str, origin: int, via: str, target: int) -> None:
        """Forbid or command a turn between two ways."""
        self.restrictions.append((kind, origin, self.names[via], target))

    def xml(self) -> str:
        """The map as OSM XML."""
        plane = Plane(*ORIGIN)
        lat, lon = plane.to_geodetic(*np.array(self.places).T)
        lines = [
            '<?xml version="1.0" encoding="UTF-8"?>',
            '<osm version="0.6" generator="whichroad">',
        ]
        for k, (a, b) in enumerate(zip(lat.tolist(), lon.tolist(), strict=True), start=1):
            lines.append(f'  <node id="{k}" version="1" lat="{a:.7f}" lon="{b:.7f}"/>')
        for k, (nodes, tags) in enumerate(self.ways, start=1):
            lines.append(f'  <way id="{k}" version="1">')
            lines += [f'    <nd ref="{n}"/>' for n in nodes]
            lines += _tag_lines(tags)
            lines.append("  </way>")
        for k, (kind, origin, via, target) in enumerate(self.restrictions, start=1):
            lines.append(f'  <relation id="{k}" version="1">')
            for role, sort, ref in (
                ("from", "way", origin),
                ("via", "node", via),
                ("to", "way", target),
            ):
                lines.append(f'    <member type="{sort}" ref="{ref}" role="{role}"/>')
            lines += [*_tag_lines({"type": "restriction", "restriction": kind}), "  </relation>"]
        return "\n".join([*lines, "</osm>", ""])

    def compiled(self) -> "RoadMap":
        """The compiled map."""
        from ..roadmap import RoadMap

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "sketch.osm"
            path.write_text(self.xml(), encoding="utf-8")
            return RoadMap.from_osm(path)


def _tag_lines(tags: Tags) -> list[str]:
    return [f"    <tag k={quoteattr(k)} v={quoteattr(v)}/>" for k, v in tags.items()]
