"""`RoadMap`: a road network to drive on, and what its roads are called."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import MapError
from ..geodesy.plane import Plane
from ..graph.network import Roads
from . import edge_tables, store, topology
from .arrays import from_arrays, to_arrays
from .attribute_names import HIDDEN, LEVEL, known_name, levels_of, refusal
from .compile import Network, compile_streets
from .edge_geometry import EdgeGeometry
from .laid_out import Pieces
from .source_places import SourcePlace, on_source
from .streets import Column, Ints, Streets, Texts
from .tags import ACCESS_WORDS

if TYPE_CHECKING:
    import geopandas

_FLAGS = frozenset({"bridge", "tunnel", "roundabout"})


class RoadMap(EdgeGeometry):
    """A compiled road network.

    Edges are directed, numbered from 0, and run between junctions; where a street is legal
    in one direction only, the other one exists too and is marked in `arrays.edges.rule`.

    Attributes:
        arrays: The network as the kernels see it.
        plane: Its coordinates.
        ways: (W,) columns of the streets it was made of: `source_id`, `name`, `highway`, ...
        pieces: Which street lies where along each edge.
        way: (E,) street of each edge's longest piece.
        node_id: (J,) the source's ids of the junctions, see `node_ids`.
    """

    __slots__ = ("_about", "_fingerprint", "node_id", "pieces", "plane", "way", "ways")

    def __init__(
        self, arrays: Roads, plane: Plane, pieces: Pieces, way: NDArray[np.int32], node_id: Column,
        ways: Mapping[str, Column], about: Mapping[str, Any],
    ) -> None:  # fmt: skip
        self.arrays, self.plane = arrays, plane
        self.pieces, self.way = pieces, way
        self.node_id = node_id
        self.ways, self._about = dict(ways), dict(about)
        self._reach: float | None = None
        self._fingerprint: str | None = None

    @classmethod
    def from_osm(
        cls, path: str | Path, *, bbox: tuple[float, float, float, float] | None = None
    ) -> "RoadMap":
        """Compile an OpenStreetMap extract, or a part of one.

        Args:
            path: .osm.pbf, .osm, .osm.xml, .osm.gz or .osm.bz2.
            bbox: West, south, east and north of the part, degrees.  Streets are cut where
                their segments leave it.  None: all of it.

        Raises:
            MapError: The file cannot be read, or holds no drivable way in the box.
        """
        from .osm import date_of, read_osm

        return cls._compiled(read_osm(Path(path), bbox), str(path), date_of(Path(path)))

    @classmethod
    def from_edges(
        cls, table: Any, crs: Any = None, *, directed: bool | None = None,
        gap_m: float | None = None,
    ) -> "RoadMap":  # fmt: skip
        """Compile one's own table of roads, of which only `geometry` is required.

        Args:
            table: GeoDataFrame, Arrow table, graph of OSMnx (MultiDiGraph), or path to GeoParquet,
                CSV with WKT, GraphML, or whatever geopandas reads; columns as in docs/formats.md.
                Overture's segments and SUMO's `.net.xml` are read by their own schema.
            crs: Coordinate system where the table names none, as pyproj takes it ("EPSG:3067").
            directed: Whether a row is one direction of a road.  None: it is where the table
                has no column on one-way roads and rows come in opposite pairs.
            gap_m: How far apart ends may be at most and yet meet, m, where nodes have no names.
                None: it is learnt from the table; 0: only those within 0.5 m meet.

        Raises:
            MapError: No geometry was found, or its coordinate system is unknown.
        """
        from .read_roads import read_roads

        return cls._compiled(*read_roads(table, crs, directed, gap_m))

    @classmethod
    def _compiled(cls, streets: Streets, where: str, date: str | None = None) -> "RoadMap":
        network: Network = compile_streets(streets, where)
        ways = {**streets.columns, "highway": streets.highway}
        about: dict[str, Any] = {"source": where}
        about |= {"source_date": date} if date else {}
        about["skipped"] = {**streets.skipped, **network.dropped}
        return cls(
            network.roads, network.plane, network.pieces, network.way, network.node_id, ways, about
        )

    @classmethod
    def open(cls, path: str | Path, *, check: bool | None = None) -> "RoadMap":
        """Open a compiled map; its arrays stay in the file until they are used.

        Header, version and length are checked each time.

        Args:
            path: A file that `save` or `whichroad map build` made.
            check: Whether the arrays' checksums are compared, which reads the whole file.  None:
                once a path, size, time of change and inode, which the cache remembers.

        Raises:
            MapError: It is not one, is cut short, damaged or of another version.
        """
        about, arrays, fingerprint = store.read(Path(path), check=check)
        try:
            opened = cls(*from_arrays(about, arrays))
            opened._fingerprint = fingerprint
            return opened
        except (KeyError, OverflowError, TypeError, ValueError, MapError) as error:
            raise MapError(
                f"{path}: its contents do not form a map ({type(error).__name__}: {error}); "
                "a compiled map was expected; make it anew by `whichroad map build`"
            ) from error

    def save(self, path: str | Path) -> None:
        """Write the compiled map to a file, replacing one that is there.

        Raises:
            WriteError: The file cannot be written.
        """
        store.write(Path(path), *to_arrays(self))

    def __len__(self) -> int:
        return len(self.arrays.edges)

    def __repr__(self) -> str:
        return f"RoadMap({self.origin!r}, {len(self)} directed edges)"

    def _repr_html_(self) -> str:
        """What a notebook shows: the streets, as a picture that needs no connection."""
        from .drawing import map_html

        return map_html(self)

    @property
    def origin(self) -> str:
        """What the map was made of: the name of a file, or of a kind of table."""
        return str(self._about["source"])

    @property
    def fingerprint(self) -> str:
        """What tells maps apart: equal where their roads, ids and plane are."""
        if self._fingerprint is None:
            about, arrays = to_arrays(self)
            self._fingerprint = store.fingerprint_of(about, store.described(arrays)[0])
        return self._fingerprint

    @property
    def identity(self) -> dict[str, Any]:
        """Fingerprint, source and date of the source (None: unknown), as results name a map."""
        about = self._about
        return {"fingerprint": self.fingerprint, "source": about["source"],
                "source_date": about.get("source_date")}  # fmt: skip

    def piece(self, edge: ArrayLike, s: ArrayLike) -> Ints:
        """Row in `pieces` of the street at places along edges.

        Args:
            edge: (n,) edges, or one.
            s: (n,) true m from their starts, or one for all.
        """
        edges = np.ascontiguousarray(np.atleast_1d(np.asarray(edge, dtype=np.int64)))
        along = np.asarray(s, dtype=np.float64)
        if along.shape != edges.shape:
            along = np.broadcast_to(along, edges.shape)
        found, pieces = np.empty(len(edges), np.int64), self.pieces
        topology.find_pieces(pieces.first, pieces.start, edges, np.ascontiguousarray(along), found)
        return found

    def source(self, edge: int, s: float) -> tuple[int | str, bool]:
        """The source's id of the road at a place, and whether it is driven as drawn.

        Args:
            edge: The edge.
            s: True m from its start.
        """
        ids, forward = self.sources([edge], [s])
        return ids[0], bool(forward[0])

    def sources(self, edge: ArrayLike, s: ArrayLike) -> tuple[list[int | str], NDArray[np.bool_]]:
        """`source` of many places.

        Args:
            edge: (n,) edges.
            s: (n,) true m from their starts.
        """
        return self.drawn_as(self.piece(edge, s))

    def drawn_as(self, piece: Ints) -> tuple[list[int | str], NDArray[np.bool_]]:
        """`source` of (n,) of the `pieces`."""
        way, forward = self.pieces.way[piece], self.pieces.forward[piece] > 0
        ids = self._values("source_id", way)
        if "back_id" in self.ways:  # rows were directed: the opposite row has its own id
            paired = np.asarray(self.ways["paired"])[way] > 0
            back = self._values("back_id", way)
            swap = paired & ~forward
            ids = [b if w else a for a, b, w in zip(ids, back, swap, strict=True)]
            forward = forward | swap
        return ids, forward

    def on_source(self, edge: ArrayLike, s: ArrayLike) -> SourcePlace:
        """Where places along edges are on the roads of the source.

        Args:
            edge: (n,) edges.
            s: (n,) true m from their starts, or one for all.

        Returns:
            `m`, (n,) metres from the start of the road as it was drawn, and `share` of its length.
        """
        piece = self.piece(edge, s)
        along = np.broadcast_to(np.asarray(s, np.float64), piece.shape)
        return on_source(self, np.atleast_1d(np.asarray(edge)), piece, along)

    def node_ids(self, node: ArrayLike) -> list[int | str]:
        """The source's ids of (n,) junctions, which a path's `from_node` and `to_node` number.

        Raises:
            MapError: They are no such numbers.
        """
        return edge_tables.node_ids(self, node)

    def edge_id(self, edge: int) -> int:
        """The id of an edge in tables: its number, the same for every build of the same input."""
        return int(edge)

    def attributes(self, edge: int, s: float | None = None) -> dict[str, Any]:
        """What is known of the road at a place; absent values: None.

        Args:
            edge: Its number.
            s: True m from its start; None: the edge's longest piece.
        """
        way = self._way_at(edge, s)
        return {name: self._values(name, way)[0] for name in self.ways if name not in HIDDEN}

    def attribute(self, name: str, edge: int, s: float | None = None) -> Any:
        """One attribute of the road at a place; None where it is absent.

        Args:
            name: Of the attribute, as in `attributes`; "maxspeed" is `speed_limit_kmh`.
            edge: The edge.
            s: True m from its start; None: the edge's longest piece.

        Raises:
            SettingError: The map has no such attribute, or no such edge.
        """
        try:
            column = name if name in self.ways else known_name(self.ways, name)
            return self._values(column, self._way_at(edge if edge >= 0 else len(self), s))[0]
        except (LookupError, TypeError, ValueError):
            raise refusal(self.ways, len(self), name, edge) from None

    def _way_at(self, edge: int, s: float | None) -> NDArray[Any]:
        """The street of an edge at a place, (1,)."""
        return np.array([self.way[edge] if s is None else self.pieces.way[self.piece(edge, s)[0]]])

    def name(self, edge: int) -> str | None:
        """What the edge's longest piece is called."""
        return self._values("name", self.way[[edge]])[0]  # type: ignore[no-any-return]

    def names(self, edge: NDArray[Any]) -> list[str | None]:
        """`name` of (n,) edges."""
        return self._values("name", self.way[edge])

    def words(self, name: str, piece: Ints) -> list[str]:
        """An attribute that is text, of some of the `pieces`; empty where it is not known.

        Args:
            name: Of the attribute, such as `ref`; one that the map lacks is nowhere known.
            piece: (n,) rows of `pieces`.
        """
        if isinstance(column := self.ways.get(name), Texts):
            return column.words(self.pieces.way[piece])
        return [""] * len(piece)

    def column(self, name: str) -> list[Any]:
        """An attribute of every edge (of its longest piece), absent values None."""
        return self._values(name, self.way)

    def at_pieces(self, name: str) -> list[Any]:
        """An attribute of every row of `pieces`, absent values None."""
        return self._values(name, self.pieces.way)

    def _values(self, name: str, way: NDArray[Any]) -> list[Any]:
        """A column's values as plain Python, for some streets."""
        if name == LEVEL:
            return levels_of(self.ways, way)
        if isinstance(column := self.ways[name], Texts):
            return [word or None for word in column.words(way)]
        values = column[way].tolist()
        if name in _FLAGS or name == "access":
            return [bool(v) if name in _FLAGS else ACCESS_WORDS[v] for v in values]
        if name in ("speed_limit_kmh", "lanes", "width"):
            return [v or None for v in values]
        return cast(list[Any], values)

    def info(self) -> dict[str, Any]:
        """What the map holds, where it came from, and what was skipped and why."""
        return {**self._about, **edge_tables.info(self)}

    def edges_table(self) -> "geopandas.GeoDataFrame":
        """Every directed edge with its attributes, as a GeoDataFrame in EPSG:4326.

        A path joins it by `edge_id`.  Its `from_node` and `to_node` are ids of the source; what a
        path has under these names is `from_number` and `to_number` here.
        """
        return edge_tables.edges_table(self)

    def plot(self, ax: Any = None, **style: Any) -> Any:
        """Draw the streets with matplotlib.

        Args:
            ax: Axes to draw on; None: new ones.
            style: As `GeoDataFrame.plot` takes it, such as `color`, `linewidth`, `figsize`.

        Returns:
            The axes, longitude to the right and latitude up, degrees.
        """
        from .drawing import plot_map

        return plot_map(self, ax, style)

    def explore(self, **style: Any) -> Any:
        """The streets on a page that can be moved and enlarged, with their attributes.

        Args:
            style: As `GeoDataFrame.explore` takes it.

        Returns:
            A `folium.Map`, whose page loads scripts and tiles from the net.

        Raises:
            SettingError: A package of the extra `explore` is not installed.
        """
        from .drawing import explore_map

        return explore_map(self, style)

    def openlr(self, path: Any, by: str = "row") -> list[str | None]:
        """OpenLR line locations of a path, in Base64.

        Args:
            path: Of `match`, `match_many` or `by_source` on this map.
            by: "row": one for each row; "stretch": one for all rows that hang together.

        Returns:
            One for each row; None where it is driven against a rule, or over 14.9 km of one edge.

        Raises:
            MapError: It is no path, or the package openlr is missing.
        """
        from .openlr_lines import references

        return references(self, path, by)

    def by_source(self, path: Any) -> Any:
        """A path with one row for each road of the source (OpenStreetMap way, row of a table).

        An edge between junctions may be of several, of which `source_id` of the path names the
        middle one.  Within an edge a constant speed gives when each was entered.

        Args:
            path: Of `match` or `match_many` on this map, a GeoDataFrame or an Arrow table.

        Returns:
            The same kind of table, in driving order, without `from_node` and `to_node`; `seq` and
            `edge_id` are those of the edge, `enter_m` and `exit_m` along-track positions on it.

        Raises:
            MapError: It is no path, or of another map.
        """
        return edge_tables.by_source(self, path)
