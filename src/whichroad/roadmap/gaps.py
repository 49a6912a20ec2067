"""Ends of lines that miss each other by a metre or some: how far, and where they should meet.

In tables that were drawn with snapping, ends meet exactly, or they are dead ends, few of which lie
near another road.  Ends drawn by eye miss each other by 0.3 to 3 m.  Many more miss by so much than
by 4 to 8 m, and so the table itself tells how far its ends may be joined.
"""

from collections import defaultdict
from dataclasses import dataclass
from math import hypot
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError
from ..observations import Array
from .line_ends import EXACT, Drawing, Mask
from .streets import Ints

MOST = 20.0  # m, the widest gap that may be given
_FAR = 8.0  # m, how far roads are looked for
_WIDEST, _DEAD = 3.0, 4.0  # m, the widest gap that is learnt, and from where on ends are dead
_SLOPPY = 0.3  # share of ends that miss, from which on gaps may be wider
_WIDEST_SLOPPY, _DEAD_SLOPPY = 6.0, 6.0  # m, the same of such tables
_FEW = 20  # of such ends, up to which nothing is said
_BIN = 0.25  # m, of distances that are counted
_TIMES, _MORE = 4.0, 5.0  # so many times the dead ends, and more, are ends that miss
_SHARE = 0.01  # of all ends that miss: fewer are dead ends at one distance, as of cul-de-sacs
_BEYOND = 0.1  # share of ends that miss by more than the gap, from which on none is learnt
_MANY = 0.05  # share of ends that miss, from which on it is said that none were joined
_SPREAD = 2.0  # gaps between the middles of places that become one
_RING = 8.0  # gaps: a shorter road between two places keeps them apart
_FACING = 0.9  # cosine: two ends point at each other, or the same way
_BESIDE = 0.7  # cosine, up to which what lies near an end is beside it
_AHEAD = 0.5  # cosine: an end points at what lies within 60 degrees of its direction
_ON = 0.7  # cosine of the turn of a road that goes on, as from a bridge to the ground
_ROUND = -0.3  # the same where nothing else goes on


def check(gap: float | None) -> None:
    """Refuse a gap that is none."""
    if gap is not None and not 0.0 <= gap <= MOST:
        raise MapError(
            f"gap_m: {gap!r}; metres from 0 (ends that miss by more than 0.5 m stay apart) to "
            f"{MOST:g} were expected, or None to learn it from the table; give one of these"
        )


def mend(d: Drawing, gap: float | None, least: float) -> tuple[Mask, dict[str, int]]:
    """Have ends meet that missed each other by little.

    Ends within the gap become one place: that where several lie already, else their middle.  Two
    that point at each other may both have missed, by a gap that is learnt.  Of lone ends that are
    left, those that run over a line end there, and those that point at one are drawn on to it.

    Args:
        d: The lines; their ends are moved.
        gap: How far ends miss each other at most, m; None: it is learnt.
        least: m, within which ends meet anyhow.

    Returns:
        (V,) the vertices that are left, and what was done, by reason.
    """
    kept = np.ones(len(d.x), bool)
    lone = d.lone()
    far = _FAR if gap is None else gap
    place, line, away = _near(d, d.shapes(), np.flatnonzero(lone), far)
    distance = np.full(len(lone), np.inf)
    np.minimum.at(distance, place, away)
    # an end on a line meets it, unless that line too ends there: both may have run too far
    overlap = np.where(away <= EXACT, _from_its_ends(d, place, line), 0.0)
    met = _which(place[overlap > 2.0 * _WIDEST], len(lone))
    loose = np.flatnonzero(lone & ~met)
    to_end = _to_others(d, loose)
    missed = np.where(to_end <= far, to_end, distance[loose])
    widest = learnt(missed, len(d.place)) if gap is None else gap
    if widest <= least:
        count = int(np.count_nonzero((missed > least) & (missed <= far)))
        if gap is not None or count <= max(_MANY * len(d.place), _FEW):
            return kept, {}
        return kept, {f"ends that miss roads by up to {far:g} m (not joined; gap_m joins)": count}
    met = _which(place[overlap > 2.0 * widest], len(lone))
    lone &= ~met
    # where most ends miss, two that lie in one place do so by chance
    sloppy = np.count_nonzero(missed <= far) > _SLOPPY * len(d.place)
    free = ~met if sloppy else lone.copy()
    before = d.xy()
    dead = (_DEAD_SLOPPY if sloppy else _DEAD) + EXACT
    joined = _clusters(d, free, widest, min(2.0 * widest, dead) if gap is None else gap)
    d.move(joined)
    lone[list(joined)] = False
    drawn, cut, left = _onto(d, np.flatnonzero(lone), widest)
    d.move(drawn)
    for end in np.flatnonzero(np.isin(d.place, list(cut))).tolist():
        for k in range(1, cut[int(d.place[end])] + 1):
            kept[d.vertex(np.array([end]), k)] = False
    shift = np.hypot(*(d.xy() - before).T)
    skipped = {}
    done = {
        "ends that missed others (joined)": list(joined),
        "ends that missed a line (drawn on to it)": [p for p in drawn if p not in cut],
        "ends that ran over a line (cut there)": list(cut),
    }
    for what, places in done.items():
        if places:
            by = f"up to {shift[places].max():.1f} m, median {np.median(shift[places]):.1f} m"
            skipped[what.replace(" (", f" by {by} (")] = len(places)
    if left:
        skipped[f"ends within {widest:g} m of a road that they do not point at (not joined)"] = left
    return kept, skipped


def _which(places: Ints, count: int) -> Mask:
    """Whether each place is one of some."""
    some = np.zeros(count, bool)
    some[places] = True
    return some


def learnt(missed: Array, ends: int) -> float:
    """How far ends miss each other, m; 0: they do not, or dead ends are not told from them.

    Args:
        missed: (k,) m, of each end that meets nothing from the nearest other end, else line.
        ends: Number of all ends.
    """
    sloppy = np.count_nonzero(missed <= _FAR) > _SLOPPY * ends
    widest, dead = (_WIDEST_SLOPPY, _DEAD_SLOPPY) if sloppy else (_WIDEST, _DEAD)
    edges = np.arange(0.5, widest + 0.5 * _BIN, _BIN)
    count, _ = np.histogram(missed, edges)
    dead_ends = np.count_nonzero((missed > dead) & (missed <= _FAR)) * _BIN / (_FAR - dead)
    many = np.flatnonzero(count >= _TIMES * dead_ends + _MORE)
    if not len(many):
        return 0.0
    gap = float(min(edges[many[-1] + 1] + _BIN, widest))
    within = np.count_nonzero(missed <= gap)
    if within < _SHARE * ends:
        return 0.0
    beyond = np.count_nonzero((missed > gap) & (missed <= _FAR))
    return 0.0 if sloppy and beyond > _BEYOND * within else gap


def _to_others(d: Drawing, places: Ints) -> Array:
    """How far some places are from the nearest place of another road, m; infinite beyond `_FAR`."""
    import shapely

    points, road = shapely.points(d.xy()), d.road[d.some // 2]
    tree = shapely.STRtree(points)
    which, other = tree.query(points[places], predicate="dwithin", distance=_FAR)
    apart = road[places[which]] != road[other]
    which, other = which[apart], other[apart]
    distance = np.full(len(places), np.inf)
    np.minimum.at(distance, which, shapely.distance(points[places[which]], points[other]))
    return distance


def _from_its_ends(d: Drawing, place: Ints, line: Ints) -> Array:
    """How far places on lines are from the nearer end of these, m."""
    xy = d.xy()
    ends = xy[d.place.reshape(-1, 2)[line]]  # (k, 2, 2)
    return np.asarray(np.hypot(*(ends - xy[place][:, None]).T).min(axis=0))


def _near(
    d: Drawing, shapes: NDArray[Any], places: Ints, within: float
) -> tuple[Ints, Ints, Array]:
    """Places and other lines on their level that lie within some metres, and how far."""
    import shapely

    points = shapely.points(d.xy()[places])
    which, line = shapely.STRtree(shapes).query(points, predicate="dwithin", distance=within)
    own = d.some[places[which]] // 2
    other = (d.road[own] != d.road[line]) & (d.level[own] == d.level[line])
    which, line = which[other], line[other]
    return places[which], line, np.asarray(shapely.distance(points[which], shapes[line]))


@dataclass(slots=True)
class _Group:
    """Places that become one."""

    places: list[int]
    x: float
    y: float
    firm: bool  # several lines end there, or it lies on one: it stays
    roads: set[int]  # short ones, which are no rings

    def take(self, other: "_Group") -> None:
        """Join another one, at the firm one, else in the middle."""
        if not self.firm:
            n, m = len(self.places), len(other.places)
            share = 1.0 if other.firm else m / (n + m)
            self.x += share * (other.x - self.x)
            self.y += share * (other.y - self.y)
        self.places += other.places
        self.firm |= other.firm
        self.roads |= other.roads


def _clusters(
    d: Drawing, loose: Mask, widest: float, facing: float
) -> dict[int, tuple[float, float]]:
    """Where loose places move that lie close to others, the closest first.

    Two that point at each other may both have missed, and so lie farther apart.
    Two beside each other that point the same way stay two, as of the two carriageways of a road.
    Places between which a short road runs stay two, and so do two places that are firm.

    Args:
        d: The lines.
        loose: (G,) which places move.
        widest: m, how far ends may be apart.
        facing: m, the same of two that point at each other.
    """
    import shapely

    xy = d.xy()
    points, some = shapely.points(xy), np.flatnonzero(loose)
    tree = shapely.STRtree(points)
    which, b = tree.query(points[some], predicate="dwithin", distance=facing)
    a = some[which]
    once = ~loose[b] | (a < b)
    a, b = a[once], b[once]
    apart = np.hypot(*(xy[a] - xy[b]).T)
    between, ahead = xy[b] - xy[a], d.outwards(d.some)
    near = (apart <= widest) & ~(loose[b] & _beside(between, ahead, a, b))
    near |= loose[b] & _face(between, ahead, a, b)
    a, b, apart = a[near], b[near], apart[near]
    order = np.argsort(apart, kind="stable")
    involved = _which(np.concatenate([a, b]), len(xy))
    ends: dict[int, list[int]] = defaultdict(list)
    for end in np.flatnonzero(involved[d.place]).tolist():
        ends[int(d.place[end])].append(end)
    short, road = (d.length <= _RING * widest).tolist(), d.road.tolist()
    level, end_level = d.level.tolist(), d.end_level.tolist()
    group, levels = {}, {}
    for p, own in ends.items():
        levels[p] = {level[e // 2] for e in own}
        roads = {road[e // 2] for e in own if short[e // 2]}
        group[p] = _Group([p], float(xy[p, 0]), float(xy[p, 1]), not loose[p], roads)
    pairs = np.column_stack([a, b])[order].tolist()
    for turn in (_ON, _ROUND):
        for i, j in pairs:
            one, two = group[i], group[j]
            left = turn == _ON or 1 in (len(one.places), len(two.places))
            if one is two or not left or not _may_join(one, two, widest):
                continue
            if end_level[i] != end_level[j]:
                continue
            if not levels[i].isdisjoint(levels[j]) or _goes_on(d, ends[i], ends[j], turn):
                one.take(two)
                group |= dict.fromkeys(two.places, one)
    return {p: (g.x, g.y) for p, g in group.items() if len(g.places) > 1 and loose[p]}


def _face(between: Array, ahead: Array, a: Ints, b: Ints) -> Mask:
    """Whether ends point at each other, (k,), of vectors from a to b and the directions of all."""
    apart = np.maximum(np.hypot(*between.T), EXACT)
    one, two = (ahead[a] * between).sum(axis=1), -(ahead[b] * between).sum(axis=1)
    return np.asarray(np.minimum(one, two) >= _FACING * apart)


def _beside(between: Array, ahead: Array, a: Ints, b: Ints) -> Mask:
    """Whether ends point the same way and lie beside each other, (k,), of the same as `_face`."""
    apart = np.hypot(*between.T)
    alike = (ahead[a] * ahead[b]).sum(axis=1) > _FACING
    return np.asarray(alike & (abs((ahead[a] * between).sum(axis=1)) <= _BESIDE * apart))


def _may_join(one: _Group, two: _Group, widest: float) -> bool:
    """Whether two groups with places within the gap are one place."""
    if (one.firm and two.firm) or one.roads & two.roads:
        return False
    return hypot(one.x - two.x, one.y - two.y) <= _SPREAD * widest


def _goes_on(d: Drawing, one: list[int], two: list[int], turn: float) -> bool:
    """Whether a line that ends in a place goes on as one that ends in another.

    Args:
        d: The lines.
        one: Ends in a place.
        two: Ends in another one.
        turn: Least cosine of the turn.
    """
    ahead = d.outwards(np.array(one)) @ d.outwards(np.array(two)).T
    return bool(ahead.min() <= -turn)


def _onto(
    d: Drawing, places: Ints, widest: float
) -> tuple[dict[int, tuple[float, float]], dict[int, int], int]:
    """Where lone ends move that run over a line, or point at one.

    Returns:
        Where they move, of those cut how many vertices they lose, and how many are near a line and
        do not move.
    """
    import shapely

    shapes = d.shapes()
    place, line, distance = _near(d, shapes, places, widest)
    meets = np.isin(place, place[distance <= EXACT])
    place, line, distance = place[~meets], line[~meets], distance[~meets]
    xy, ahead = d.xy(), d.outwards(d.some)
    to: dict[int, tuple[float, float]] = {}
    cut: dict[int, int] = {}
    for k in np.lexsort((distance, place)).tolist():
        p, target = int(place[k]), shapes[line[k]]
        if p in cut or d.length[d.some[p] // 2] <= 2.0 * widest:
            continue
        crossed = _crossing(d, int(d.some[p]), target, widest)
        if crossed is not None:
            to[p], cut[p] = crossed
        elif p not in to:
            end = shapely.Point(xy[p])
            foot = shapely.line_interpolate_point(target, shapely.line_locate_point(target, end))
            vector = np.array([foot.x, foot.y]) - xy[p]
            if vector @ ahead[p] >= _AHEAD * distance[k]:
                to[p] = foot.x, foot.y
    return to, cut, len(set(place.tolist()) - set(to))


def _crossing(
    d: Drawing, end: int, target: Any, widest: float
) -> tuple[tuple[float, float], int] | None:
    """Where a line crosses another one close to its end, and how many inner vertices lie beyond."""
    import shapely

    v = d.vertex(np.full(d.first[end // 2 + 1] - d.first[end // 2], end), 0)
    v = v + (1 - 2 * (end % 2)) * np.arange(len(v))
    total = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(d.x[v]), np.diff(d.y[v])))])
    v = v[: np.searchsorted(total, widest) + 1]
    tail = shapely.linestrings(d.x[v], d.y[v])
    points = shapely.points(shapely.get_coordinates(shapely.intersection(tail, target)))
    along = shapely.line_locate_point(tail, points)
    along = along[(along > EXACT) & (along <= widest)]
    if not len(along):
        return None
    s = float(along.min())
    at = shapely.line_interpolate_point(tail, s)
    return (at.x, at.y), int(np.count_nonzero(total[1 : len(v)] < s))
