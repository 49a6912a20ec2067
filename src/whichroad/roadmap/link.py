"""Which lines of a table meet where, and which draw the same road twice."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError
from ..geodesy.angles import degrees, radians
from ..geodesy.plane import Plane
from ..observations import Array
from . import gaps, topology
from .line_ends import EXACT, drawing
from .lines import Lines
from .named_nodes import drawn_back, homes
from .sheet import is_absent, plain
from .streets import Bytes, Column, Ints, Texts

SNAP = 0.5  # m within which ends meet, and vertices are the same
_SAME = 0.1  # m within which ends of named nodes are one place: digits are cut
_FARTHEST = 100.0  # m, distance of an end from its node that counts as wrong
_BEYOND = 20.0  # m, more than a junction is wide: an end that far from its node may be wrong
_TURNED = (" (nodes exchanged)", " (lines turned)")


@dataclass(frozen=True, slots=True)
class Links:
    """Lines over shared nodes.  n lines, N nodes."""

    row: Ints  # (n,) the table's row
    first: Ints  # (n+1,)
    node: Ints  # (L,) nodes of each line
    lat_deg: Array  # (N,)
    lon_deg: Array
    node_id: Column  # (N,)
    leader: Ints  # (n,) the first line that draws the same road
    back: Bytes  # (n,) 1 where it runs against its leader
    skipped: dict[str, int] = field(default_factory=dict)

    def of(self, kept: Ints) -> tuple[Ints, Ints]:
        """`first` and `node` of some lines, in their order."""
        count = np.diff(self.first)
        inside = np.zeros(len(count), bool)
        inside[kept] = True
        return (
            np.concatenate([[0], np.cumsum(count[kept])]),
            self.node[np.repeat(inside, count)],
        )


def link(
    lines: Lines, origin: NDArray[Any] | None, target: NDArray[Any] | None, level: Ints,
    where: str, *, ends: Ints | None = None, turn: bool = False, gap: float | None = None,
) -> Links:  # fmt: skip
    """Find the nodes of lines.

    Args:
        lines: The lines.
        origin: (rows,) names of the nodes at which rows begin; None: ends that lie together
            meet, and ends that lie on other lines meet those.
        target: (rows,) names of those at which rows end.
        level: (n,) lines of different levels meet at their ends only.
        where: Name of the table, for errors.
        ends: (n, 2) levels at which lines begin and end; those of different levels do not meet,
            unless their nodes have names.  None: all meet.
        turn: Whether lines that are drawn from their target to their origin are turned, as the
            names tell the direction; else their names are exchanged, as the drawing does.
        gap: How far ends may miss each other that have no names, m; None: it is learnt.

    Returns:
        The linked lines.

    Raises:
        MapError: The named nodes cannot be nodes: their ends lie far apart.  The gap is none.
    """
    gaps.check(gap)
    plane = middle_plane(lines.lat_deg, lines.lon_deg)
    x, y = plane.from_geodetic(lines.lat_deg, lines.lon_deg)
    if origin is not None and target is not None:
        return _named(lines, x, y, origin[lines.row], target[lines.row], where, turn)
    lines, x, y, skipped = _mended(lines, plane, x, y, level, ends, gap)
    return _inferred(lines, plane, x, y, level, ends, skipped)


def middle_plane(lat_deg: Array, lon_deg: Array) -> Plane:
    """The plane about the middle of some points; no meridian is special."""
    lat, lon = radians(lat_deg), radians(lon_deg)
    towards = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    middle = (towards.min(axis=1) + towards.max(axis=1)) / 2.0
    lat0 = float(degrees(np.arctan2(middle[2], np.hypot(middle[0], middle[1]))))
    return Plane(round(lat0, 6), round(float(degrees(np.arctan2(middle[1], middle[0]))), 6))


def _named(
    lines: Lines, x: Array, y: Array, origin: NDArray[Any], target: NDArray[Any], where: str,
    turn: bool,
) -> Links:  # fmt: skip
    """Lines whose end nodes have names.

    A node lies where most of its lines have it.  A line that ends beside it keeps its own last
    vertex and is drawn on to the node; one that ends far from it stays without.
    """
    known, skipped = _with_nodes(lines, origin, target)
    inside = np.repeat(known, np.diff(lines.first))
    lines, x, y = lines.take(known), x[inside], y[inside]
    # row by row: its beginning, its end
    code, node_id = _codes(np.stack([origin[known], target[known]], axis=1).ravel())
    ends = np.stack([lines.first[:-1], lines.first[1:] - 1], axis=1).ravel()
    place = _joined(x[ends], y[ends], _SAME)[2]
    back = drawn_back(code, place)
    if back.any():
        skipped[f"lines drawn from their second node to their first{_TURNED[turn]}"] = int(
            back.sum()
        )
        pairs = (place if turn else code).reshape(-1, 2)
        pairs[back] = pairs[back, ::-1]
        if turn:
            at = _turned(lines, back)
            lines = replace(lines, lat_deg=lines.lat_deg[at], lon_deg=lines.lon_deg[at])
            x, y = x[at], y[at]
    home = ends[homes(code, place)]
    distance = np.hypot(x[ends] - x[home[code]], y[ends] - y[home[code]])
    away = distance > _FARTHEST
    if len(ends) == 0 or np.mean(away) > 0.5:
        raise MapError(
            f"{where}: more than half of the lines end over {_FARTHEST:g} m from the node that "
            "from and to name; ids of nodes were expected there; rename these columns to have the "
            "nodes found from the geometry"
        )
    if away.any():
        skipped[f"ends over {_FARTHEST:g} m from their node (not joined to it)"] = int(away.sum())
    far = (distance > SNAP) & ~away
    beyond = far & (distance > _BEYOND)
    if beyond.any():
        skipped[f"ends drawn on to their node by over {_BEYOND:g} m"] = int(beyond.sum())
    if (far & ~beyond).any():
        skipped["ends drawn on to their node"] = int((far & ~beyond).sum())
    own = np.ones(len(x), bool)
    near = ~(far | away)
    own[ends[near]] = False
    node = np.empty(len(x), np.int64)
    node[own] = len(home) + np.arange(own.sum())
    node[ends[near]] = code[near]
    after = np.arange(len(ends)) % 2 == 1
    count = np.diff(lines.first) + far[0::2] + far[1::2]
    node = np.insert(node, np.where(after, ends + 1, ends)[far], code[far])
    at = np.concatenate([home, np.flatnonzero(own)])
    if isinstance(node_id, Texts):
        code_ = np.concatenate([node_id.code, np.zeros(own.sum(), np.int32)])
        node_id = Texts(code_, node_id.offset, node_id.utf8)
    else:
        node_id = np.concatenate([node_id, np.full(own.sum(), -1)])
    first = np.concatenate([[0], np.cumsum(count)])
    return _links(lines, first, node, at, node_id, skipped, lines.first, x, y)


def _turned(lines: Lines, which: NDArray[np.bool_]) -> Ints:
    """The vertices in the order in which some of the lines run backwards."""
    line = np.repeat(np.arange(len(which)), np.diff(lines.first))
    at = np.arange(len(line))
    mirrored = lines.first[line] + lines.first[line + 1] - 1 - at
    return np.where(which[line], mirrored, at)


def _with_nodes(
    lines: Lines, origin: NDArray[Any], target: NDArray[Any]
) -> tuple[NDArray[np.bool_], dict[str, int]]:
    """Which lines have an origin and a target of their own, and why the others have not."""
    nameless = _absent(origin) | _absent(target)
    several = ~nameless & (np.bincount(lines.row)[lines.row] > 1)
    reasons = {
        "rows without from or to": nameless,
        "rows of several separate lines, with from and to": several,
    }
    skipped = {why: len(np.unique(lines.row[which])) for why, which in reasons.items()}
    return ~(nameless | several), {why: count for why, count in skipped.items() if count}


def _absent(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Which cells are empty."""
    if values.dtype.kind in "iub":
        return np.zeros(len(values), bool)
    return np.array([is_absent(v) for v in values.tolist()], dtype=bool)


def _codes(names: NDArray[Any]) -> tuple[Ints, Column]:
    """Numbers from 0 for names, and the names."""
    if names.dtype.kind == "f" and ((names == np.floor(names)) & (np.abs(names) < 2**53)).all():
        names = names.astype(np.int64)  # whole numbers that once stood beside empty cells
    names = plain(names)
    if names.dtype.kind in "iu":
        unique, code = np.unique(names, return_inverse=True)
        return code, unique.astype(np.int64)
    words, code = np.unique(np.array([str(n) for n in names.tolist()]), return_inverse=True)
    return code, Texts.of(words.tolist())


def _mended(
    lines: Lines, plane: Plane, x: Array, y: Array, level: Ints, ends: Ints | None,
    gap: float | None,
) -> tuple[Lines, Array, Array, dict[str, int]]:  # fmt: skip
    """Lines whose ends meet where they missed each other by more than `SNAP`, if that is usual."""
    height = np.zeros(2 * len(lines.row), np.int64) if ends is None else ends.ravel()
    at = np.stack([lines.first[:-1], lines.first[1:] - 1], axis=1).ravel()
    place = _first_alike(height, _joined(x[at], y[at], EXACT)[2])
    ends_at = drawing(lines, x, y, level, place, height)
    kept, skipped = gaps.mend(ends_at, gap, SNAP)
    moved = (ends_at.x != x) | (ends_at.y != y)
    if not moved.any():
        return lines, x, y, skipped
    lat, lon = lines.lat_deg.copy(), lines.lon_deg.copy()
    x, y = ends_at.x, ends_at.y
    lat[moved], lon[moved] = plane.to_geodetic(x[moved], y[moved])
    first = np.concatenate([[0], np.cumsum(kept)])[lines.first]
    return Lines(lines.row, first, lat[kept], lon[kept]), x[kept], y[kept], skipped


def _inferred(
    drawn: Lines, plane: Plane, x: Array, y: Array, level: Ints, ends: Ints | None,
    skipped: dict[str, int],
) -> Links:  # fmt: skip
    """Lines that meet where they touch.

    Ends within `SNAP` meet; so does an end with another line, in a vertex or between two.
    Vertices inside of two lines meet where they are the same point on the same level.
    """
    lines, feet = _with_feet(drawn, plane, x, y)
    x_, y_ = plane.from_geodetic(lines.lat_deg, lines.lon_deg)
    at = _stand_ins(lines, x_, y_, feet, level, ends)
    places, node = np.unique(at, return_inverse=True)
    first, node = _without_repeats(lines.first, node, feet)
    number = np.arange(len(places))
    return _links(lines, first, node, places, number, skipped, drawn.first, x, y)


def _stand_ins(
    lines: Lines, x: Array, y: Array, feet: Ints, level: Ints, end_level: Ints | None
) -> Ints:
    """For each vertex the one that stands for all that meet there."""
    # feet first: of what meets, the first decides where, and a line that is met stays straight
    outer = np.unique(np.concatenate([lines.first[:-1], lines.first[1:] - 1]))
    ends = np.concatenate([feet, outer])
    end_x, end_y = x[ends], y[ends]
    key, order, label = _joined(end_x, end_y, SNAP)
    if end_level is not None:
        height = np.concatenate([np.zeros(len(feet), np.int64), end_level.ravel()])
        label = _first_alike(height, label)
    inside = np.ones(len(x), bool)
    inside[ends] = False
    inside_at = np.flatnonzero(inside)
    nearest = np.empty(len(inside_at), np.int64)
    topology.nearest_points(x[inside], y[inside], end_x, end_y, key, order, SNAP, nearest)
    at = np.empty(len(x), np.int64)  # the vertex that stands for each vertex
    at[ends] = ends[label]
    touch = nearest >= 0
    at[inside_at[touch]] = ends[label[nearest[touch]]]
    rest = inside_at[~touch]
    line = np.repeat(np.arange(len(lines.row)), np.diff(lines.first))
    at[rest] = rest[_first_alike(lines.lon_deg[rest], lines.lat_deg[rest], level[line[rest]])]
    return at


def _joined(x: Array, y: Array, within: float) -> tuple[Ints, Ints, Ints]:
    """Points within some metres joined: sorted keys of cells, their order, the first of each."""
    key = np.empty(len(x), np.int64)
    topology.point_cells(x, y, within, key)
    order = np.argsort(key, kind="stable")
    key = key[order]
    label = np.empty(len(x), np.int64)
    topology.join_close(x, y, key, order, within, label)
    return key, order, label


def _with_feet(lines: Lines, plane: Plane, x: Array, y: Array) -> tuple[Lines, Ints]:
    """Lines with a vertex more where the end of another line lies on them between vertices.

    Returns:
        The lines, and the places of the new vertices.
    """
    import shapely

    first = lines.first
    shapes = shapely.linestrings(x, y, indices=np.repeat(np.arange(len(lines.row)), np.diff(first)))
    ends = np.stack([first[:-1], first[1:] - 1], axis=1).ravel()
    points = shapely.points(x[ends], y[ends])
    end, line = shapely.STRtree(shapes).query(points, predicate="dwithin", distance=SNAP)
    other = end // 2 != line
    end, line = end[other], line[other]
    step = np.hypot(np.diff(x), np.diff(y))
    step[first[1:-1] - 1] = 0.0  # from one line to the next
    total = np.concatenate([[0.0], np.cumsum(step)])
    foot = total[first[line]] + shapely.line_locate_point(shapes[line], points[end])
    v = np.searchsorted(total, foot, side="right") - 1
    v = np.clip(v, first[line], first[line + 1] - 2)
    ex, ey = x[ends[end]], y[ends[end]]
    away = np.minimum(np.hypot(ex - x[v], ey - y[v]), np.hypot(ex - x[v + 1], ey - y[v + 1])) > SNAP
    v, foot = v[away], foot[away]
    order = np.argsort(foot, kind="stable")
    v, foot = v[order], foot[order]
    t = (foot - total[v]) / step[v]
    lat, lon = plane.to_geodetic(x[v] + t * (x[v + 1] - x[v]), y[v] + t * (y[v + 1] - y[v]))
    with_feet = Lines(
        lines.row, first + np.searchsorted(v, first), np.insert(lines.lat_deg, v + 1, lat),
        np.insert(lines.lon_deg, v + 1, lon),
    )  # fmt: skip
    return with_feet, v + 1 + np.arange(len(v))


def _without_repeats(first: Ints, node: Ints, feet: Ints) -> tuple[Ints, Ints]:
    """`first` and `node` without feet that became one with the vertex before or behind them."""
    foot = np.zeros(len(node), bool)
    foot[feet] = True
    begins = np.zeros(len(node), bool)
    begins[first[:-1]] = True
    again = (node[1:] == node[:-1]) & ~begins[1:] & (foot[1:] | foot[:-1])
    kept = np.concatenate([[True], ~again])
    return np.concatenate([[0], np.cumsum(kept)])[first], node[kept]


def _first_alike(*columns: NDArray[Any]) -> Ints:
    """For each row the first row with the same values in all columns."""
    order = np.lexsort(columns)  # stable: the first of each group has the least number
    new = np.ones(len(order), bool)
    for column in columns:
        new[1:] &= column[order[1:]] == column[order[:-1]]
    new[1:] = ~new[1:]
    first = np.empty(len(order), np.int64)
    first[order] = order[new][np.cumsum(new) - 1]
    return first


def _links(
    lines: Lines, first: Ints, node: Ints, at: Ints, node_id: Column, skipped: dict[str, int],
    drawn: Ints, x: Array, y: Array,
) -> Links:  # fmt: skip
    """The links of lines whose nodes are known; rows that draw one road are found.

    Args:
        lines: The lines.
        first: (n+1,) first node of each.
        node: (L,) nodes.
        at: (N,) the vertex of `lines` at which each node lies.
        node_id: (N,) what the nodes are called.
        skipped: What was left out.
        drawn: (n+1,) first vertex of each line as it was drawn.
        x: Those vertices, m.
        y: m.
    """
    begin, end = node[first[:-1]], node[first[1:] - 1]
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    leader, back = np.empty(len(begin), np.int64), np.zeros(len(begin), np.uint8)
    order = np.lexsort((high, low))
    topology.find_twins(order, low, high, begin, drawn, x, y, SNAP, leader, back)
    return Links(
        lines.row, first, node, lines.lat_deg[at], lines.lon_deg[at], node_id, leader, back, skipped
    )
