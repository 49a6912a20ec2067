"""A collector beside a main road, and a car parked beside a road: what P says, and what it could.

*Collector*: two one-way roads 8, 12 or 16 m apart with slips from each to the other every 300 m.
At a slip the driver changes with P = 0.5.  A decision is the last fix before the next slip; that
slip itself counts as the road that it leads from.  Two oracles know the place along the road, how
often drivers change, and that the vehicle is on one of the two, at first on either: exact filters
of road and slow error.  *declared* takes the errors to be as the settings say, with the declared
sigma; *all* as they were drawn.  We are asked twice: as we are, who do not believe a receiver
alone, and *believing* it, with `gnss_inflation` and `gnss_start` 1, as the oracles do.

*Parked*: a drive of 600 m in Heidelberg that ends 5 min on its road, or 10 to 40 m beside it and
at least 10 m from every road.
"""

import itertools
import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import shapely

import whichroad
from whichroad.settings import Settings
from whichroad.simulate import MapBuilder
from whichroad.simulate.map_builder import ORIGIN
from whichroad.simulate.route_choice import drivable

from .. import Figure, Options, interval
from ..sparse import harness
from . import matched, turning

GAPS, RATES = (8, 12, 16), (1, 5, 10)  # m; s
BLOCK, SLIP = 300.0, 40.0  # m, between slips of one kind, and their length
BLOCKS, DRIVES = 20, 12  # a drive; drives a seed
CHANGE = 0.5  # P of taking a slip, as the turns of the map have it
SPEED = 15.0  # m/s
SIGMA, SLOW, SLOW_S = 5.0, 0.9, 45.0  # m; share of it that is slow; s
LEAST = 1e-4  # P that a score counts at least
BELIEVES = Settings(gnss_inflation=1.0, gnss_start=1.0)

STOPS = 100  # a seed
STAND, EVERY = 300.0, 5  # s
ASIDE = (10.0, 40.0)  # m


class Errors(NamedTuple):
    """What an oracle takes the errors across the road to be."""

    slow: float  # sigma, m
    time: float  # its correlation time, s
    white: float  # sigma, m


def declared() -> Errors:
    """By the settings: the receiver's slow part, the map's error and the lane's as one."""
    own = Settings()
    slow = SIGMA**2 / (1.0 + own.gnss_white_ratio**2)
    off = own.map_sigma**2
    time = (slow * own.gnss_time + off * own.map_length / SPEED) / (slow + off)
    white = SIGMA**2 - slow + own.lane_sigma**2
    return Errors(float(np.sqrt(slow + off)), time, float(np.sqrt(white)))


ALL = Errors(SLOW * SIGMA, SLOW_S, float(np.sqrt(1.0 - SLOW**2)) * SIGMA)


def two_roads(gap: float) -> Any:
    """The map: the main road along y = 0, the collector to its right."""
    builder = MapBuilder()
    ends = BLOCKS * BLOCK + 200.0
    main, side = ["a"], ["c"]
    for name, x, y in (
        ("a", -300.0, 0.0),
        ("b", ends, 0.0),
        ("c", -300.0, -gap),
        ("d", ends, -gap),
    ):
        builder.node(name, x, y)
    for k in range(BLOCKS):
        for name, y, road in (("m", 0.0, main), ("s", -gap, side)):
            builder.node(f"{name}{k}o", k * BLOCK, y)
            builder.node(f"{name}{k}i", k * BLOCK + SLIP, y)
            road += [f"{name}{k}o", f"{name}{k}i"]
        builder.way([f"m{k}o", f"s{k}i"], "trunk_link", oneway="yes", name="out")
        builder.way([f"s{k}o", f"m{k}i"], "trunk_link", oneway="yes", name="in")
    main.append("b")
    builder.way(main, "trunk", oneway="yes", name="main", maxspeed="60")
    builder.way([*side, "d"], "trunk", oneway="yes", name="side", maxspeed="60")
    return builder.compiled()


def chosen(rng: Any) -> np.ndarray:
    """The road behind each block's slips: 0 the main one, 1 the collector."""
    changes = rng.random(BLOCKS) < CHANGE
    return np.cumsum(changes) % 2


def driven(road: np.ndarray, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions along and across at 1 Hz, from 300 m before the first slip."""
    x = -250.0 + SPEED * np.arange(int((BLOCKS * BLOCK + 250.0) / SPEED))
    y = np.zeros(len(x))
    for n, at in enumerate(x.tolist()):
        k = min(int(at // BLOCK), BLOCKS - 1)
        if k >= 0:
            y[n] = across(at, k, gap)[road[k - 1] if k else 0, road[k]]
    return x, y


def oracle(errors: Errors, y: np.ndarray, x: np.ndarray, gap: float) -> np.ndarray:
    """P(collector) at each fix, given all fixes so far."""
    grid = np.linspace(-4.0, 4.0, 81) * errors.slow
    belief = np.zeros((2, 2, len(grid)))  # road before the block's slips, behind them, error
    belief[0, 0] = belief[1, 1] = np.exp(-0.5 * (grid / errors.slow) ** 2)
    found, block = np.zeros(len(y)), -1
    for n, (at, seen) in enumerate(zip(x, y, strict=True)):
        if n:
            keep = np.exp(-(at - x[n - 1]) / SPEED / errors.time)
            sigma = errors.slow * np.sqrt(1.0 - keep**2)
            kernel = np.exp(-0.5 * ((grid[:, None] - keep * grid[None, :]) / sigma) ** 2)
            belief = belief @ (kernel / kernel.sum(0)).T
        while block < min(int(at // BLOCK), BLOCKS - 1):
            block += 1
            now = belief.sum(0)
            belief = (
                now[:, None] * np.array([[1.0 - CHANGE, CHANGE], [CHANGE, 1.0 - CHANGE]])[..., None]
            )
        off = seen - across(at, block, gap)[..., None] - grid
        belief = belief * np.exp(-0.5 * (off / errors.white) ** 2) + 1e-300
        belief /= belief.sum()
        found[n] = belief[:, 1].sum()
    return found


def across(x: float, block: int, gap: float) -> np.ndarray:
    """Where a vehicle is across the main road, by its road before and behind the slips, (2, 2)."""
    before, now = np.arange(2.0)[:, None], np.arange(2.0)
    part = np.clip((x - block * BLOCK) / SLIP, 0.0, 1.0)
    return np.asarray(-gap * (before + (now - before) * part))


def score(roads: Any, gap: float, every: int, rng: Any) -> np.ndarray:
    """P(true road) at a drive's decisions: ours, believing, of the two oracles, (d, 4)."""
    road = chosen(rng)
    x, y = driven(road, gap)
    error = turning.noise(len(x), rng)[:, 1] / turning.SIGMA * SIGMA
    k = np.arange(0, len(x), every)
    x, y = x[k], y[k]
    lane = float(np.median(roads.arrays.edges.lane))  # right of the line
    seen = y + error[k]
    lon0 = ORIGIN[1]
    px, py = roads.plane.from_geodetic(np.array([ORIGIN[0]]), np.array([lon0]))
    across = roads.plane.from_geodetic(np.array([ORIGIN[0] + 1e-4]), np.array([lon0]))
    north = np.array([across[0][0] - px[0], across[1][0] - py[0]])
    north /= np.hypot(*north)
    east = np.array([north[1], -north[0]])
    place = np.column_stack([px, py]) + x[:, None] * east + (seen - lane)[:, None] * north
    lat, lon = roads.plane.to_geodetic(place[:, 0], place[:, 1])
    fixes = {"time": k.astype(float), "lat": lat, "lon": lon, "sigma_m": np.full(len(k), SIGMA)}
    ours = [p_side(fixes, roads, settings) for settings in (Settings(), BELIEVES)]
    told = [*ours, oracle(declared(), seen, x, gap), oracle(ALL, seen, x, gap)]
    rows = []
    for block in range(BLOCKS):
        inside = np.flatnonzero((x > block * BLOCK + SLIP) & (x < (block + 1) * BLOCK))
        if len(inside):
            p = [float(one[inside[-1]]) for one in told]
            rows.append([q if road[block] else 1.0 - q for q in p])
    return np.array(rows)


def p_side(fixes: dict[str, np.ndarray], roads: Any, settings: Settings) -> np.ndarray:
    """Our P(collector) at each fix; a slip from it counts as the collector."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        points = whichroad.match(fixes, roads, settings=settings).to_arrow()
    names = [roads.attributes(e).get("name") for e in range(len(roads))]
    side = np.array([name in ("side", "in") for name in names])
    return np.array([
        sum(a["p"] for a in row if side[a["edge_id"]]) / max(sum(a["p"] for a in row), 1e-9)
        for row in points["alternatives"].to_pylist()
    ])  # fmt: skip


def collector(options: Options) -> list[Figure]:
    """Mean log score per decision below the oracles."""
    figures = []
    for gap, every in itertools.product(GAPS, RATES):
        if every not in matched.intervals(options):
            continue
        roads = two_roads(gap)
        scores = []
        for seed in options.seeds or matched.SEEDS:
            rng = np.random.default_rng([4, seed, gap, every])
            for _ in range(options.more.get("drives", DRIVES)):
                scores.append(np.log(np.maximum(score(roads, gap, every, rng), LEAST)))
        means = np.array([np.append(s.sum(0), len(s)) for s in scores])

        def below(rows: np.ndarray, k: int, ours: int) -> float:
            return float((rows[:, k] - rows[:, ours]).sum() / rows[:, 4].sum())

        n = int(means[:, 4].sum())
        for ours, kind in enumerate(("", ", believing")):
            label = f"collector {gap} m, {every} s{kind}"
            figures.append(
                Figure(f"{label}: score", float(means[:, ours].sum() / n), "", "nats", n)
            )
            for k, name, goal in (
                (2, "of the declared sigma", 0.02),
                (3, "of all covariances", 0.05),
            ):
                ends = interval(lambda r, k=k, ours=ours: below(r, k, ours), means)
                figures.append(
                    Figure(
                        f"{label}: below the oracle {name}", below(means, k, ours), f"<= {goal}",
                        "nats", n, ends,
                    )
                )  # fmt: skip
    return figures


def stops(options: Options, roads: Any) -> Iterator[tuple[turning.Drive, np.ndarray, bool]]:
    """Drives that end standing, the noise of their fixes, and whether beside the road."""
    length = roads.arrays.edges.length
    lines = [roads.arrays.vertices[e.first_vertex : e.last_vertex + 1] for e in roads.arrays.edges]
    tree = shapely.STRtree([shapely.LineString(np.column_stack([v.x, v.y])) for v in lines])
    for seed in options.seeds or matched.SEEDS:
        rng = np.random.default_rng([7, seed])
        allowed = drivable(roads.arrays, rng)
        starts = np.flatnonzero(allowed & (roads.arrays.edges.service == 0))
        count = 0
        while count < options.more.get("drives", STOPS):
            edge = int(rng.choice(starts))
            way = [edge, *turning.walk(roads.arrays, edge, 600.0, allowed, rng)]
            s = float(rng.uniform(0.2, 0.9) * length[way[-1]])
            aside = float(rng.uniform(*ASIDE)) if count % 2 else 0.0
            x, y, heading = roads.at(way[-1], s)
            place = shapely.Point(x + aside * np.sin(heading), y - aside * np.cos(heading))
            if aside and len(tree.query(place, "dwithin", ASIDE[0])):
                continue
            parts = [turning.Piece(e, 0.0, float(length[e])) for e in way[:-1]]
            parts += [turning.Piece(way[-1], 0.0, s, STAND, aside)]
            parts += [turning.Piece(way[-1], s, min(s + 4.0, float(length[way[-1]])))]
            drive = turning.driven(roads, "stop", parts)
            count += 1
            yield drive, turning.noise(len(drive.time), rng), aside > 0.0


def parked(options: Options) -> list[Figure]:
    """P(off_road) at the end of the stop against how often the car stands beside the road."""
    roads = harness.our_adapter(options, options.need("maps", "heidelberg.osm.pbf")).maps[0][2]
    tables, off = [], []
    for number, (drive, error, beside) in enumerate(stops(options, roads)):
        k = np.arange(0, len(drive.time) - 3, EVERY)
        lat, lon = roads.plane.to_geodetic(drive.x[k] + error[k, 0], drive.y[k] + error[k, 1])
        columns = {"drive_id": np.full(len(k), number), "time": drive.time[k] + 1.6e9}
        columns |= {"lat": lat, "lon": lon, "sigma_m": np.full(len(k), turning.SIGMA)}
        tables.append(pa.table(columns))
        off.append(beside)
    table, beside = pa.concat_tables(tables), np.array(off)
    last = np.cumsum([t.num_rows for t in tables]) - 1
    figures = []
    for kind, settings in (("", Settings()), (", believing", BELIEVES)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            points = whichroad.match_many(table, roads, settings=settings).points
        figures += calibrated(options, f"parked{kind}", points.take(last), beside)
    return figures


def calibrated(options: Options, label: str, ends: Any, off: np.ndarray) -> list[Figure]:
    """P(off_road) of the ends of stops beside whether they were off the road."""
    p, p_road = ends["p_off_road"].to_numpy(), ends["p_road"].to_numpy()
    rows = np.column_stack([p, off.astype(float), p_road])
    bins = np.minimum((10.0 * p).astype(int), 9)
    gaps = [(bins == b).mean() * abs((rows[bins == b, 0] - rows[bins == b, 1]).mean())
            for b in range(10) if (bins == b).any()]  # fmt: skip
    beside = rows[:, 1] > 0.0
    sure = beside & (p_road >= 0.999)
    for b in range(10):
        some = rows[bins == b]
        if len(some):
            options.say(f"  P(off) {some[:, 0].mean():.3f}: {some[:, 1].mean():.3f} of {len(some)}")
    n, off_road = len(rows), int(beside.sum())
    on_it, wrong = float(p[~beside].mean()), 1e3 * float(sure.sum() / beside.sum())
    return [
        Figure(f"{label}: error of P(off_road)", float(sum(gaps)), "<= 0.02", "", n),
        Figure(f"{label}: P(off_road) beside", float(p[beside].mean()), "", "", off_road),
        Figure(f"{label}: P(off_road) on the road", on_it, "", "", n - off_road),
        Figure(f"{label}: a road at P >= .999 beside", wrong, "", "/1000", off_road),
    ]
