"""Anyone's own table of roads: columns found by their usual names, rows to streets."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geodesy.units import mps_of_kmh
from ..graph.network import AGAINST_ONE_WAY, NO_ACCESS
from ..observations import Array
from . import one_ways
from . import tags as meaning
from .lines import Lines, read_lines
from .link import Links, link, middle_plane
from .sheet import Sheet, plain
from .streets import Column, Streets, Texts, attributes, take
from .tag_column import NAMES as TAGS
from .tag_column import Tags, tags_in
from .values import T, as_number, as_word, best, each, first, parts_of

_UNSAID = ("maxspeed", "speed_limit")  # columns of limits whose names say no unit
# south, north, west and east of where signs are in mph: Britain, the United States
_IN_MPH = ((49.8, 61.0, -8.7, 1.8), (24.4, 49.4, -125.0, -66.9), (51.0, 71.5, -170.0, -130.0),
           (18.8, 22.3, -160.3, -154.7))  # fmt: skip
# accepted column names by meaning; the first that is there wins; case does not matter
NAMES = {
    "source_id": ("id", "edge_id", "link_id", "osmid", "osm_id", "way_id", "fid", "gid", "ogc_fid"),
    "from": ("from", "from_node", "u", "source", "from_id", "from_node_id", "node_from"),
    "to": ("to", "to_node", "v", "target", "to_id", "to_node_id", "node_to"),
    "oneway": one_ways.NAMES,
    "cost": ("cost",),
    "reverse_cost": ("reverse_cost", "reverse_co"),
    "name": ("name", "street", "street_name", "road_name", "osm_name", "link_label"),
    "highway": ("highway", "fclass", "class", "road_class", "clazz"),
    "speed_limit_kmh": ("speed_limit_kmh", *_UNSAID),
    "lanes": ("lanes",),
    "width": ("width",),
    "layer": ("layer",),
    "bridge": ("bridge",),
    "tunnel": ("tunnel",),
    "level_from": ("f_zlev", "from_zlev", "zlev_from", "f_elev"),
    "level_to": ("t_zlev", "to_zlev", "zlev_to", "t_elev"),
    "junction": ("junction", "roundabout"),
    "access": ("access",),
}
_TAGGED = ("oneway", "access", "speed_limit_kmh", "name", "highway", "lanes", "width", "layer",
           "bridge", "tunnel", "junction")  # what a column of tags may hold  # fmt: skip
_DIRECTED_SHARE = 0.1  # share of rows with an opposite row, from which on rows are directions
_LEVELS = 9  # the highest and, below 0, the lowest level of an end
# osm2po's numbers for the classes of OpenStreetMap
_NUMBERED = {
    "11": "motorway", "12": "motorway_link", "13": "trunk", "14": "trunk_link",
    "15": "primary", "16": "primary_link", "21": "secondary", "22": "secondary_link",
    "31": "tertiary", "32": "tertiary_link", "41": "residential", "42": "road",
    "43": "unclassified", "51": "service", "63": "living_street",
}  # fmt: skip
_NOT_FOR_CARS = frozenset(
    {"footway", "path", "cycleway", "steps", "pedestrian", "bridleway", "corridor", "track",
     "track_grade1", "track_grade2", "track_grade3", "track_grade4", "track_grade5", "platform",
     "elevator", "proposed", "construction"}
)  # fmt: skip


# a cell's meaning, of the list in it or of its one value
_word = first(as_word, "")
_limit = first(lambda v: meaning.speed_limit_kmh(as_word(v)), 0.0)
_size = first(lambda v: meaning.number(as_word(v)), 0.0)
_any_true = best(meaning.truth, max, False)
_access = best(lambda v: meaning.access({"access": as_word(v)}), max, meaning.OPEN)
_is_ring = best(lambda v: _one_ring(as_word(v).lower()), max, False)


def _one_ring(name: str) -> bool:
    return meaning.roundabout({"junction": name}) or name in {"true", "1", "yes", "t"}


def read_edges(
    sheet: Sheet, crs: Any, directed: bool | None, gap: float | None = None
) -> tuple[Streets, str]:
    """Streets of a table of roads.

    Args:
        sheet: The open table.
        crs: Coordinate system where the table does not name it.
        directed: Whether a row is one direction only; None: found out.
        gap: How far ends may miss each other, m; None: it is learnt.

    Returns:
        The streets, and what to call the table.

    Raises:
        MapError: No geometry was found, or its coordinate system is unknown.
    """
    streets, skipped = streets_of(sheet, crs, directed, gap)
    return replace(streets, skipped=dict(skipped)), sheet.where


def streets_of(
    sheet: Sheet, crs: Any, directed: bool | None, gap: float | None = None
) -> tuple[Streets, Counter[str]]:
    """`read_edges` of an open table; gives the streets, and what was left out."""
    skipped: Counter[str] = Counter()
    likely = one_ways.likely_column(sheet)
    sheet = _with_closed(_known(_with_tags(one_ways.with_one(sheet), skipped)), skipped)
    directed = sheet.directed if directed is None else directed
    lines = read_lines(sheet, crs, skipped)
    lines = _for_cars(sheet, lines, skipped)
    origin, target = _find(sheet, "from"), _find(sheet, "to")
    level = _layers(sheet, lines)
    # words of one-way roads are about the drawing; costs and rows of one direction are not
    by_name = bool(directed) or (directed is None and _find(sheet, "oneway") is None)
    ends = _end_levels(sheet, lines, skipped)
    links = link(lines, origin, target, level, sheet.where, ends=ends, turn=by_name, gap=gap)
    rows = links.row
    along = _one_way(sheet, rows, skipped)
    if along is None:
        twins = (links.leader != np.arange(len(rows))).sum()
        if directed is None:
            directed = bool(2 * twins >= _DIRECTED_SHARE * len(rows)) and len(rows) > 1
            if not directed:
                links = link(lines, origin, target, level, sheet.where, ends=ends, gap=gap)
                why = one_ways.why_none(likely)
                skipped[why] += len(np.unique(rows))
        along = np.full(len(rows), int(directed), dtype=np.int8)
    elif directed:
        along = np.where(along == 0, 1, along).astype(np.int8)
    skipped.update(links.skipped)
    _say_unit(sheet, links, skipped)
    return _streets(sheet, links, along, skipped), skipped


def _with_tags(sheet: Sheet, skipped: Counter[str]) -> Sheet:
    """The table with columns for what it has in one of tags; columns of its own stay."""
    column = next((sheet.columns[name] for name in TAGS if name in sheet.columns), None)
    if column is None or not any(rows := tags_in(column, skipped)):
        return sheet
    classes = _find(sheet, "highway")
    if classes is not None:  # motorways are one-way by their class
        rows = [{"highway": _class(own)} | tags for own, tags in zip(classes, rows, strict=True)]
    absent = [what for what in _TAGGED if _find(sheet, what) is None]
    if "oneway" in absent and _find(sheet, "reverse_cost") is not None:
        absent.remove("oneway")
    found = {
        what: np.array([_tagged(what, tags) for tags in rows], dtype=object) for what in absent
    }
    return replace(sheet, columns=sheet.columns | found)


def _tagged(what: str, tags: Tags) -> object:
    """The cell that a column of its own would have."""
    if what == "oneway":
        return meaning.oneway(tags)
    if what == "access":
        return meaning.access_word(tags)
    return tags.get("maxspeed" if what == "speed_limit_kmh" else what)


def _with_closed(sheet: Sheet, skipped: Counter[str]) -> Sheet:
    """The table whose roads that are closed both ways by their one-way word have no access."""
    column = _find(sheet, "oneway")
    shut = None if column is None else one_ways.closed(column)
    if shut is None or not shut.any():
        return sheet
    skipped["roads closed both ways, N beside FT and TF (kept, without access)"] += int(shut.sum())
    access = _find(sheet, "access")
    cells = np.full(sheet.rows, None, dtype=object) if access is None else access.astype(object)
    cells[shut] = "no"
    return replace(sheet, columns=sheet.columns | {"access": cells})


def _known(sheet: Sheet) -> Sheet:
    """The table with the columns that are understood here only."""
    used = {name for names in NAMES.values() for name in names}
    columns = {name: plain(column) for name, column in sheet.columns.items() if name in used}
    return replace(sheet, columns=columns)


def _find(sheet: Sheet, what: str) -> NDArray[Any] | None:
    """The column that has one of a thing's usual names."""
    return next((sheet.columns[n] for n in NAMES[what] if n in sheet.columns), None)


def _one_class(value: object) -> str:
    """A road class in OpenStreetMap's word, or the table's own."""
    name = as_word(value).lower()
    return _NUMBERED.get(name, name)


def _class(cell: object) -> str:
    """The first class of a cell that is for cars, else the first."""
    found = [_one_class(value) for value in parts_of(cell)]
    return next((one for one in found if one not in _NOT_FOR_CARS), found[0] if found else "")


def _for_cars(sheet: Sheet, lines: Lines, skipped: Counter[str]) -> Lines:
    """Without rows whose class is known not to be for cars."""
    column = _find(sheet, "highway")
    if column is None:
        return lines
    foot = np.array(each(column[lines.row], lambda v: _class(v) in _NOT_FOR_CARS), dtype=bool)
    if foot.any():
        skipped["rows of classes not for cars"] += int(foot.sum())
        lines = lines.take(~foot)
    return lines


def _layers(sheet: Sheet, lines: Lines) -> NDArray[np.int64]:
    """Level of each line: lines of different levels may cross without meeting."""
    level = np.zeros(len(lines.row), dtype=np.int64)
    for i, what in enumerate(("layer", "bridge", "tunnel")):
        column = _find(sheet, what)
        if column is not None:
            read: Callable[[Any], int] = first(meaning.whole, 0) if i == 0 else _any_true
            level = level * 1000 + np.array(each(column[lines.row], read), dtype=np.int64)
    return level


def _say_unit(sheet: Sheet, links: Links, skipped: Counter[str]) -> None:
    """Count limits that may be in mph: where signs are, and all are bare multiples of 5."""
    lat, lon = float(np.median(links.lat_deg)), float(np.median(links.lon_deg))
    there = any(s < lat < n and w < lon < e for s, n, w, e in _IN_MPH)
    column = next((sheet.columns[n] for n in _UNSAID if n in sheet.columns), None)
    if not there or column is None or NAMES["speed_limit_kmh"][0] in sheet.columns:
        return
    limits = np.array(each(column, as_number), dtype=np.float64)
    bare = limits > 0.0
    if bare.any() and not (limits[bare] % 5.0).any():
        why = "speed limits without a unit, in a country of mph (taken as km/h; write 30 mph)"
        skipped[why] += int(bare.sum())


def _end_levels(sheet: Sheet, lines: Lines, skipped: Counter[str]) -> NDArray[np.int64] | None:
    """(n, 2) levels at which lines begin and end: ends of different levels do not meet.

    None where the table has none, or heights in their place, which are no levels.
    """
    columns = [_find(sheet, what) for what in ("level_from", "level_to")]
    if any(column is None for column in columns):
        return None
    read = first(lambda v: meaning.number(as_word(v)), 0.0)
    levels = np.array([each(c[lines.row], read) for c in columns if c is not None]).T
    if ((levels != np.round(levels)) | (np.abs(levels) > _LEVELS)).any():
        why = f"levels of ends that are no whole numbers up to {_LEVELS} (none was read)"
        skipped[why] += len(np.unique(lines.row))
        return None
    several = np.bincount(lines.row)[lines.row] > 1
    levels[several] = 0.0  # which part has which end is not told
    return levels.astype(np.int64)


def _one_way(
    sheet: Sheet, rows: NDArray[np.int64], skipped: Counter[str]
) -> NDArray[np.int8] | None:
    """1 where a row may be driven as drawn only, -1 against it only, 0 both; None: unknown word."""
    name = one_ways.column_of(sheet)
    if name is not None:
        return one_ways.directions(name, sheet.columns[name][rows], skipped)
    back = _find(sheet, "reverse_cost")
    if back is None:
        return None
    forth = _find(sheet, "cost")
    there = np.ones(len(rows)) if forth is None else _costs(forth[rows], skipped)
    back = _costs(back[rows], skipped)
    # routers close a direction by a negative or an absurd cost
    closed_back = (back < 0) | (back >= 1e5) & (back > 100 * np.abs(there))
    closed = (there < 0) | (there >= 1e5) & (there > 100 * np.abs(back))
    return np.where(closed_back, 1, np.where(closed, -1, 0)).astype(np.int8)


def _costs(column: NDArray[Any], skipped: Counter[str]) -> NDArray[np.float64]:
    """Costs as numbers; NaN, which closes nothing, where there is none."""
    costs = np.array(each(column, as_number), dtype=np.float64)
    unknown = sum(c != c and v is not None for c, v in zip(costs, column.tolist(), strict=True))
    if unknown:
        skipped["costs that were not understood (taken as open)"] += int(unknown)
    return costs


def _streets(sheet: Sheet, links: Links, along: NDArray[np.int8], skipped: Counter[str]) -> Streets:
    """One street for each road; rows that draw it again only add a direction or an id."""
    number = np.arange(len(links.row))
    kept = np.flatnonzero(links.leader == number)
    forth, back = along >= 0, along <= 0
    turned = links.back > 0
    legal = np.zeros((len(number), 2), dtype=bool)
    np.logical_or.at(legal[:, 0], links.leader, np.where(turned, back, forth))
    np.logical_or.at(legal[:, 1], links.leader, np.where(turned, forth, back))
    if repeated := int(((links.leader != number) & ~turned).sum()):
        skipped["rows that repeat another"] += repeated
    opposite = np.full(len(number), -1)
    turned_rows = number[turned][::-1]  # the first of several wins
    opposite[links.leader[turned_rows]] = turned_rows
    tags = _Tags(sheet, links.row[kept])
    closed = np.where(tags.access == meaning.CLOSED, NO_ACCESS, 0)
    rules = np.where(legal[kept], 0, AGAINST_ONE_WAY) | closed[:, None]
    first, node = links.of(kept)
    ids = _ids(sheet)
    columns: dict[str, Column] = {"source_id": take(ids, links.row[kept])}
    if turned.any():
        other = np.where(opposite[kept] >= 0, opposite[kept], 0)
        columns["back_id"] = take(ids, links.row[other])
        columns["paired"] = (opposite[kept] >= 0).astype(np.uint8)
    start, whole = _along_rows(links, kept)
    oneway = legal[kept, 0].astype(np.int8) - legal[kept, 1].astype(np.int8)
    columns |= tags.columns(oneway)
    return Streets(
        links.lat_deg, links.lon_deg, links.node_id, first, node,
        rule_forward=rules[:, 0].astype(np.uint8), rule_backward=rules[:, 1].astype(np.uint8),
        speed=tags.speed, lane=tags.lane(oneway),
        lane_sigma=tags.lane_sigma(oneway), service=(tags.service).astype(np.uint8),
        highway=Texts.of(tags.highway), columns=columns, skipped=dict(skipped),
        start=start, whole=whole,
    )  # fmt: skip


def _along_rows(links: Links, kept: NDArray[np.int64]) -> tuple[Array | None, Array | None]:
    """Where streets begin along their rows, of several lines one behind the other; lengths, m."""
    several = np.bincount(links.row) > 1
    if not several[links.row].any():
        return None, None
    plane = middle_plane(links.lat_deg, links.lon_deg)
    x, y = plane.from_geodetic(links.lat_deg, links.lon_deg)
    node = links.node
    step = np.hypot(np.diff(x[node]), np.diff(y[node]))
    total = np.concatenate([[0.0], np.cumsum(step)])
    length = total[links.first[1:] - 1] - total[links.first[:-1]]
    order = np.argsort(links.row, kind="stable")
    before = np.concatenate([[0.0], np.cumsum(length[order])])[:-1]
    _, begin, at = np.unique(links.row[order], return_index=True, return_inverse=True)
    start = np.empty(len(order))
    start[order] = before - before[begin][at]
    whole = np.bincount(links.row, length)[links.row]
    alone = ~several[links.row]
    return start[kept], np.where(alone, np.nan, whole)[kept]


def _ids(sheet: Sheet) -> Column:
    """The rows' ids: their own, or their numbers from 0."""
    column = _find(sheet, "source_id")
    if column is None:
        return np.arange(sheet.rows)
    if column.dtype.kind in "iu":
        return column.astype(np.int64)
    return Texts.of([_word(value) for value in column.tolist()])


class _Tags:
    """The attributes of some rows."""

    def __init__(self, sheet: Sheet, rows: NDArray[np.int64]) -> None:
        self._sheet, self._rows = sheet, rows
        self.highway = self._read("highway", _class, "")
        self.limit = np.array(self._read("speed_limit_kmh", _limit, 0.0))
        self.lanes = np.array(self._read("lanes", _size, 0.0))
        self.width = np.array(self._read("width", _size, 0.0))
        self.ring = np.array(self._read("junction", _is_ring, False))
        words = self._read("access", _access, meaning.OPEN)
        self.access = np.array(words, dtype=np.uint8)
        self.service = np.array([name == "service" for name in self.highway], dtype=bool)
        usual = np.array(
            [meaning.CLASS_SPEED_KMH.get(h, meaning.DEFAULT_SPEED_KMH) for h in self.highway]
        )
        self.speed = mps_of_kmh(np.maximum(np.where(self.limit > 0, self.limit, usual), 5.0))

    def _read(self, what: str, function: Callable[[Any], T], absent: T) -> list[T]:
        column = _find(self._sheet, what)
        if column is None:
            return [absent] * len(self._rows)
        return each(column[self._rows], function)

    def lane(self, oneway: NDArray[np.int8]) -> NDArray[np.float64]:
        """Usual offset right of the centre line, m."""
        values = zip(self.highway, oneway == 0, self.lanes, self.width, self.ring, strict=True)
        return np.array([meaning.lane_offset(*v) for v in values], dtype=np.float64)

    def lane_sigma(self, oneway: NDArray[np.int8]) -> NDArray[np.float64]:
        """Sigma of the lane driven in, m."""
        values = zip(self.highway, oneway == 0, self.lanes, strict=True)
        return np.array([meaning.lane_sigma(*v) for v in values], dtype=np.float64)

    def columns(self, oneway: NDArray[np.int8]) -> dict[str, Column]:
        """The attributes that tables of edges show."""
        name = Texts.of(self._read("name", _word, ""))
        return {"name": name} | attributes(
            limit=self.limit, lanes=self.lanes, width=self.width,
            layer=self._read("layer", first(meaning.whole, 0), 0),
            bridge=self._read("bridge", _any_true, False),
            tunnel=self._read("tunnel", _any_true, False),
            oneway=oneway, roundabout=self.ring, access=self.access,
        )  # fmt: skip
