"""Roads above each other: which of two is driven, by GNSS alone, by heights and by the sky.

    bridge    a road splits; one branch climbs to a bridge and runs 550 m right above the other
              (in three of a hundred drives the other one goes down instead)
    sunken    the same, and the other branch goes down instead
    tunnel    a road splits; one branch runs 550 m in a tunnel right below the other
    real      tunnels of Monaco and Andorra with a street above them, approached from 400 m away
    crossing  two roads cross at 2 degrees, one above the other; the drive begins near there

The ground rises and falls by a slope of 1.5 % that lasts for 400 m.  A receiver's height errs by
4 m for 100 s, a barometer's by 1.5 m for 300 s, both by 0.5 m anew.  A receiver has lost its
satellites in 97 % of the readings in the tunnel, and in 3 % of those outside, for 20 s.

Both roads of a map share its error, but for one case: lines that are drawn by hand, each for
itself, with points every 50 m that are 0.7 m off across (the filter's `relative_sigma`).
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from whichroad.epochs import build_timeline
from whichroad.evidence.sensed import Sensed
from whichroad.observations import SensorReading
from whichroad.recorded import localize_recorded
from whichroad.roadmap import RoadMap
from whichroad.sensors import Height, Sensor, Sky
from whichroad.settings import Settings
from whichroad.simulate import GOOD, MapBuilder, SimulatedDrive, simulate_drive

from .. import Figure, Options
from ..added_sensors import lasting
from ..places import by_chance, calibration_error
from .drives import Row, Table, each, eastward, named, world

SEEDS = range(12_000, 13_000)
LEVELS = (0.9, 0.999)  # P from which on a road is declared
SCENES = ("bridge", "sunken", "tunnel", "crossing", "real")
SETTINGS = replace(GOOD, stop_probability=0.1, lane_change_rate=0.0)
_APPROACH, _AFTER = 600.0, 500.0
_FROM, _TO = 150.0, 700.0  # m behind the fork, where one road is above the other
_ANGLE = np.radians(2.0)  # of roads that cross
_CLIMB = (5.5, 7.5)  # m from road to road
_SINKS = 0.03  # of the bridges, at which the other road goes down instead
_SLOPE, _SLOPE_M = 0.015, 400.0  # of the ground
_ABOVE, _BELOW = "Above", "Below"
_BY_HAND, _POINTS_M = (
    0.7,
    50.0,
)  # m, sigma of points that are drawn by hand, and from point to point

Told = tuple[Sensor, list[SensorReading]]


class Pair(NamedTuple):
    """A map of two roads that lie above each other."""

    roads: RoadMap
    approach: int  # edge
    road: dict[str, int]  # edge of each from there on


def _tags(scene: str, name: str) -> dict[str, str]:
    """Of the part that lies above, or below."""
    if scene == "tunnel":
        return {"tunnel": "yes", "layer": "-1"} if name == _BELOW else {}
    return {"bridge": "yes", "layer": "1"} if name == _ABOVE else {}


def draw(scene: str, by_hand: np.random.Generator | None = None) -> Pair:
    """The map of a fork, its lines exact or drawn by hand."""
    builder = MapBuilder()
    builder.node("begin", -_APPROACH, 0.0)
    builder.node("fork", 0.0, 0.0)
    builder.way(["begin", "fork"], "secondary", name="Approach", maxspeed="50")
    for name, side in ((_ABOVE, 1.0), (_BELOW, -1.0)):
        for what, x, y in (
            ("apart", 40.0, 0.4), ("from", _FROM, 0.0), ("to", _TO, 0.0),
            ("end", _TO + _AFTER, 90.0),
        ):  # fmt: skip
            off = 0.0 if by_hand is None else _BY_HAND * by_hand.standard_normal()
            builder.node(f"{name} {what}", x, side * y + off)
        between = []
        for x in np.arange(_FROM, _TO, _POINTS_M)[1:].tolist():
            off = 0.0 if by_hand is None else _BY_HAND * by_hand.standard_normal()
            between.append(f"{name} {x:g}")
            builder.node(between[-1], x, off)
        one = [f"{name} {what}" for what in ("apart", "from", "to", "end")]
        builder.way(["fork", *one[:2]], "secondary", name=name, maxspeed="50")
        builder.way(
            [one[1], *between, one[2]], "secondary", name=name, maxspeed="50", **_tags(scene, name)
        )
        builder.way(one[2:], "secondary", name=name, maxspeed="50")
    roads = builder.compiled()
    approach, above, below = (eastward(roads, name) for name in ("Approach", _ABOVE, _BELOW))
    return Pair(roads, approach, {_ABOVE: above, _BELOW: below})


def draw_crossing() -> Pair:
    """The map of two roads that cross without meeting."""
    builder = MapBuilder()
    for name, angle in ((_ABOVE, 0.5 * _ANGLE), (_BELOW, -0.5 * _ANGLE)):
        c, s = np.cos(angle), np.sin(angle)
        places = [(-1500.0, "begin"), (-60.0, "from"), (60.0, "to"), (1500.0, "end")]
        for k, (x, what) in enumerate(places):
            builder.node(f"{name} {what}", x * c, x * s)
            if k:
                tags = _tags("crossing", name) if k == 2 else {}
                ends = [f"{name} {places[k - 1][1]}", f"{name} {what}"]
                builder.way(ends, "secondary", name=name, maxspeed="50", **tags)
    roads = builder.compiled()
    above, below = (eastward(roads, name) for name in (_ABOVE, _BELOW))
    return Pair(roads, -1, {_ABOVE: above, _BELOW: below})


def prepare() -> None:
    """The maps of this process."""
    world["stacked"] = {scene: draw(scene) for scene in SCENES[:3]} | {"crossing": draw_crossing()}


def _drive(pair: Pair, scene: str, truth: str, seed: int) -> tuple[SimulatedDrive, np.ndarray]:
    """The drive, and m behind the fork (the crossing) at each truth."""
    if scene == "crossing":
        drive = simulate_drive(pair.roads, seed=seed, scenario=SETTINGS, route=[pair.road[truth]])
        begin = 1440.0 + float(np.random.default_rng([seed, 3]).uniform(-60.0, 20.0))
        return _from(drive, begin), drive.truth.along - 1500.0
    route = [pair.approach, pair.road[truth]]
    node = 0.8 * float(pair.roads.arrays.edges.length[pair.approach])
    dark = ((node + _FROM, node + _TO),) if scene == "tunnel" and truth == _BELOW else ()
    drive = simulate_drive(pair.roads, seed=seed, scenario=SETTINGS, route=route, outages_m=dark)
    on = drive.truth.edge == pair.road[truth]
    return drive, np.where(on, drive.truth.along, -1.0)


def _from(drive: SimulatedDrive, along: float) -> SimulatedDrive:
    """What was recorded from there on."""
    begin = float(drive.truth.time[np.searchsorted(drive.truth.along, along)])
    recording, keep = drive.drive, {}
    for name in ("fixes", "odometry"):
        log = getattr(recording, name)
        late = log.time >= begin
        columns = {k: getattr(log, k)[late] for k in log.__dataclass_fields__}
        keep[name] = replace(log, **columns)
    return replace(drive, drive=replace(recording, **keep))


def over_ground(scene: str, truth: str, at: np.ndarray, draw: np.random.Generator) -> np.ndarray:
    """Height of the road over the ground, m, (n,)."""
    climb, ramp = draw.uniform(*_CLIMB), draw.uniform(90.0, 140.0)
    begin, end = (_FROM, _TO) if scene != "crossing" else (-60.0, 60.0)
    up = np.clip((at - begin + ramp) / ramp, 0.0, 1.0) * np.clip((end + ramp - at) / ramp, 0.0, 1.0)
    smooth = 0.5 - 0.5 * np.cos(np.pi * up)
    lower = scene in ("sunken", "tunnel") or draw.random() < _SINKS
    moves = truth == (_BELOW if lower else _ABOVE)
    return (-climb if lower else climb) * smooth * moves


def heights(
    drive: SimulatedDrive, over: np.ndarray, sensor: Height, draw: np.random.Generator
) -> Told:
    """Readings once a second."""
    t = drive.truth
    slope = lasting(t.travelled, _SLOPE, _SLOPE_M, draw)
    ground = np.cumsum(slope * np.diff(t.travelled, prepend=t.travelled[0]))
    k = np.arange(0, len(t), 10)
    error = lasting(t.time[k], sensor.drift_m, sensor.drift_s, draw)
    error += 0.5 * draw.standard_normal(len(k)) + 40.0
    told = zip(t.time[k].tolist(), (ground[k] + over[k] + error).tolist(), strict=True)
    return sensor, [SensorReading(time, {"height_m": z}) for time, z in told]


def sky(drive: SimulatedDrive, covered: np.ndarray, draw: np.random.Generator) -> Told:
    """Numbers of satellites once a second."""
    t = drive.truth
    k = np.arange(0, len(t), 10)
    blocked, lost = False, []
    for under in covered[k]:
        blocked = draw.random() < (0.95 if blocked else 0.05 * 0.03 / 0.97)
        lost.append(draw.random() < 0.97 if under else blocked)
    seen = np.where(lost, draw.integers(0, 4, len(k)), draw.integers(5, 14, len(k)))
    told = zip(t.time[k].tolist(), seen.tolist(), strict=True)
    return Sky(), [SensorReading(time, {"satellites": float(n)}) for time, n in told]


def one(seed: int, *, settings: Settings, scenes: tuple[str, ...]) -> Row:
    """A drive through each scene, by each sensor."""
    row: Row = {}
    for scene in (one for one in scenes if one != "real"):
        pair: Pair = world["stacked"][scene]
        chance = np.random.default_rng([seed, SCENES.index(scene), 71])
        truth, other = chance.permutation([_ABOVE, _BELOW]).tolist()
        drive, at = _drive(pair, scene, truth, seed)
        over = over_ground(scene, truth, at, chance)
        told: dict[str, list[Told]] = {"GNSS alone": []}
        if scene == "tunnel":  # heights say nothing of tunnels
            under = (at >= _FROM) & (at < _TO) & (truth == _BELOW)
            told["sky"] = [sky(drive, under, chance)]
        else:
            told["height by satellites"] = [heights(drive, over, Height(), chance)]
            told["barometer"] = [heights(drive, over, BAROMETER, chance)]
        for name, given in told.items():
            for what, value in _said(pair, drive, given, at, truth, other, scene, settings):
                row[f"{scene}, {name}: {what}"] = value
        if scene != "crossing":
            drawn = draw(scene, np.random.default_rng([seed, 83]))
            for what, value in _said(drawn, drive, [], at, truth, other, scene, settings):
                row[f"{scene}, lines drawn by hand, GNSS alone: {what}"] = value
    return row


BAROMETER = Height(drift_m=1.5, drift_s=300.0)


def _said(
    pair: Pair, drive: SimulatedDrive, told: list[Told], at: np.ndarray, truth: str, other: str,
    scene: str, settings: Settings,
) -> Iterator[tuple[str, float]]:  # fmt: skip
    """P at the end of the stacked part, and the first road declared in it at each P."""
    rows, k = _located(pair.roads, drive, told, settings)
    low, high = (_FROM, _TO) if scene != "crossing" else (-1500.0, 150.0)
    inside = np.flatnonzero((at >= low) & (at < high) & (k >= 0) & (rows.live[k] > 0))
    found = rows[k[inside]]
    right, wrong = (_p_of(found, named(pair.roads, name)) for name in (truth, other))
    return _declared(right, wrong, -1 if scene != "crossing" else len(right) // 2)


def _located(
    roads: RoadMap, drive: SimulatedDrive, told: list[Told], settings: Settings
) -> tuple[Any, np.ndarray]:
    """The filter's rows, and which of them holds at each truth; -1: none."""
    readings = tuple(sorted((o for _, given in told for o in given), key=lambda o: o.time))
    sensed = Sensed([sensor for sensor, _ in told], roads) if told else None
    timeline = build_timeline(
        replace(drive.drive, sensed=readings), roads.plane, drive.vehicle, (), sensed
    )
    found = localize_recorded(roads, timeline, vehicle=drive.vehicle, settings=settings)
    k = np.searchsorted(timeline.epochs.time, drive.truth.time + 1e-3) - 1
    return found.output.rows, k


def _declared(right: np.ndarray, wrong: np.ndarray, last: int) -> Iterator[tuple[str, float]]:
    """P at one epoch, and the first road that was declared at each P."""
    yield "p right", float(right[last])
    yield "p wrong", float(wrong[last])
    for p in LEVELS:
        first = np.flatnonzero(np.maximum(right, wrong) >= p)
        yield f"declared at {p}", float(len(first) > 0)
        yield f"right at {p}", float(len(first) > 0 and right[first[0]] >= p)
        yield f"wrong at {p}", float(len(first) > 0 and wrong[first[0]] >= p)


def _p_of(rows: Any, road: np.ndarray) -> np.ndarray:
    on = (rows.alt_edge >= 0) & road[np.maximum(rows.alt_edge, 0)]
    return np.asarray(np.where(on, rows.alt_p, 0.0).sum(axis=1, dtype=float))


def run(options: Options) -> list[Figure]:
    """All seeds; `--classes` names some of the scenes."""
    seeds = options.seeds or SEEDS
    scenes = tuple(options.more.get("classes", ",".join(SCENES)).split(","))
    work: Callable[[int], Row] = partial(one, settings=options.settings(), scenes=scenes)
    rows: list[Row] = []
    if scenes != ("real",):
        rows += each(work, seeds, options, prepare)
    if "real" in scenes:
        files = [str(options.need("maps", f"{town}.osm.pbf")) for town in _TOWNS]
        rows += each(partial(real, settings=options.settings()), seeds, options, _open_towns, files)
    return list(_figures(rows, Table(rows, seeds)))


def _figures(rows: list[Row], table: Table) -> Iterator[Figure]:
    """Of each scene and sensor."""
    for case in dict.fromkeys(key.partition(":")[0] for row in rows for key in row if ":" in key):
        alone = case.endswith("alone")
        p = [(r[f"{case}: p {what}"], what == "right") for r in rows if f"{case}: p right" in r
             for what in ("right", "wrong")]  # fmt: skip
        yield from [
            Figure(f"{case}: calibration error", calibration_error(np.array(p, float)),
                   "<= 0.02" if alone else "", "", len(p), None, table.seeds),
            Figure(f"{case}: by chance below", by_chance(np.array(p, float)), "", "", len(p)),
            table.share(f"{case}: P >= 0.9 reached", f"{case}: declared at 0.9", None,
                        "" if alone else ">= 80"),
            table.share(f"{case}: right at P >= 0.9", f"{case}: right at 0.9",
                        f"{case}: declared at 0.9", "" if alone else ">= 98"),
            table.share(f"{case}: P >= 0.999 reached", f"{case}: declared at 0.999"),
            table.share(f"{case}: wrong at P >= 0.999", f"{case}: wrong at 0.999",
                        f"{case}: declared at 0.999", "" if alone else "<= 0.1"),
        ]  # fmt: skip


_TOWNS = ("monaco", "andorra")
_BESIDE_M, _ALIKE, _LONG_M = 15.0, 0.87, 60.0  # of a street above a tunnel: away, cosine, length
_BEFORE_M, _BEHIND_M = 400.0, 250.0  # driven before and behind


class Real(NamedTuple):
    """A tunnel of a real map, and a street above a part of it."""

    roads: RoadMap
    tunnel: int  # edge
    street: int


def _tunnels(roads: RoadMap) -> Iterator[Real]:
    """Tunnels with a street above them that runs the same way for a while."""
    edges, tunnel = roads.arrays.edges, np.array(roads.column("tunnel"), bool)
    open_ = np.flatnonzero(~tunnel & (edges.rule == 0)).tolist()
    at = [(e, s) for e in open_ for s in np.arange(0.0, edges.length[e], 10.0).tolist()]
    places, own = np.array([roads.at(*one)[:3] for one in at]), np.array([e for e, _ in at])
    for edge in np.flatnonzero(tunnel & (edges.rule == 0) & (edges.length > 120.0)).tolist():
        above: dict[int, float] = {}
        for s in np.arange(15.0, edges.length[edge] - 15.0, 15.0).tolist():
            x, y, heading = roads.at(edge, s)[:3]
            near = np.hypot(places[:, 0] - x, places[:, 1] - y) < _BESIDE_M
            near &= np.cos(places[:, 2] - heading) > _ALIKE
            for street in set(own[near].tolist()):
                above[street] = above.get(street, 0.0) + 15.0
        if above and max(above.values()) >= _LONG_M:
            yield Real(roads, edge, max(above, key=lambda street: above[street]))


def _through(roads: RoadMap, edge: int, draw: np.random.Generator) -> list[int]:
    """A way that leads through an edge, by turns that break no rule."""
    edges, turns = roads.arrays.edges, roads.arrays.turns
    origin = np.repeat(np.arange(len(edges)), edges.end_turn - edges.first_turn)
    usable = (turns.rule == 0) & (np.abs(turns.angle) < 2.0) & (edges.rule[turns.edge] == 0)
    usable &= edges.rule[origin] == 0
    way = [edge]
    for reach, behind in ((_BEFORE_M, False), (_BEHIND_M, True)):
        driven = 0.0
        while driven < reach:
            here = way[-1] if behind else way[0]
            found = (turns.edge if behind else origin)[
                usable & ((origin if behind else turns.edge) == here)
            ]
            found = np.setdiff1d(found, way)
            if not len(found):
                break
            other = int(draw.choice(found))
            driven += float(edges.length[other])
            way = [*way, other] if behind else [other, *way]
    return way


def _open_towns(*files: str) -> None:
    """The tunnels of this process."""
    world["tunnels"] = [one for file in files for one in _tunnels(RoadMap.from_osm(file))]


def real(seed: int, *, settings: Settings) -> Row | None:
    """A drive through a tunnel, or along the street above it, with the sky and without."""
    draw = np.random.default_rng([seed, 73])
    found: Real = world["tunnels"][seed % len(world["tunnels"])]
    roads = found.roads
    edge, other = draw.permutation([found.tunnel, found.street]).tolist()
    route = _through(roads, edge, draw)
    under = np.array(roads.column("tunnel"), bool)
    length = roads.arrays.edges.length[route]
    begin = np.cumsum(length) - length
    dark = tuple(
        (float(b), float(b + n)) for b, n, e in zip(begin, length, route, strict=True) if under[e]
    )
    try:
        drive = simulate_drive(roads, seed=seed, scenario=SETTINGS, route=route, outages_m=dark)
    except ValueError:
        return None
    covered = under[drive.truth.edge]
    row: Row = {}
    for name, told in (("GNSS alone", []), ("sky", [sky(drive, covered, draw)])):
        rows, k = _located(roads, drive, told, settings)
        on = np.flatnonzero((drive.truth.edge == edge) & (k >= 0) & (rows.live[k] > 0))
        if not len(on):
            return None
        said = rows[k[on]]
        both = {one: np.isin(np.arange(len(roads)), [one, roads.arrays.edges.opposite[one]])
                for one in (edge, other)}  # fmt: skip
        right, wrong = (_p_of(said, both[one]) for one in (edge, other))
        row |= {f"real, {name}: {what}": v for what, v in _declared(right, wrong, len(on) // 2)}
    return row
