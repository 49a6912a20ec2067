"""Streets that the map lacks: does the filter say so on them, and only on them?

Every drive goes through the full map of Heidelberg; the filter is given one from which a
few named streets of its route were taken, 3 to 8 % of it.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from whichroad.roadmap import RoadMap
from whichroad.roadmap.compile import compile_streets
from whichroad.roadmap.osm import read_osm
from whichroad.roadmap.streets import Streets, Texts, take
from whichroad.settings import Settings
from whichroad.simulate import SimulatedDrive, drivable, random_route, simulate_drive

from .. import Figure, Options
from .drives import SURE, Answer, Mask, Row, Table, answer, each, world

SEEDS = range(10_000, 10_200)
LENGTH_M = 10_000.0
SHARE = (0.03, 0.08)  # of the route
FIRST_M = 50.0  # not looked at on a missing street, nor behind its end
APART_M = 20.0  # from a mapped road that runs alike
ALIKE = np.radians(30.0)
WARM_UP_S = 20.0


def prepare(map_file: Path) -> None:
    """The full map of this process."""
    streets = read_osm(map_file)
    world["streets"] = streets
    world["roads"] = _compiled(streets)
    world["allowed"] = drivable(world["roads"].arrays, np.random.default_rng(0))


def _compiled(streets: Streets) -> RoadMap:
    network = compile_streets(streets, "map")
    ways = {**streets.columns, "highway": streets.highway}
    return RoadMap(
        network.roads, network.plane, network.pieces, network.way, network.node_id, ways, {}
    )


def without(streets: Streets, removed: Mask) -> Streets:
    """Streets less some of them, (W,) True; places keep their numbers, so the plane stays."""
    kept = np.flatnonzero(~removed)
    count = np.diff(streets.first)
    texts = streets.highway
    return replace(
        streets,
        first=np.concatenate([[0], np.cumsum(count[kept])]),
        node=streets.node[np.repeat(~removed, count)],
        **{
            name: getattr(streets, name)[kept]
            for name in ("rule_forward", "rule_backward", "speed", "lane", "lane_sigma", "service")
        },
        start=None if streets.start is None else streets.start[kept],
        whole=None if streets.whole is None else streets.whole[kept],
        highway=Texts(texts.code[kept], texts.offset, texts.utf8),
        columns={name: take(column, kept) for name, column in streets.columns.items()},
    )


def _removed(
    roads: RoadMap, names: NDArray[np.int32], route: NDArray[np.int64], random: np.random.Generator
) -> Mask:
    """Streets (W,) to take away: by whole names, a share of the route's length."""
    street = names[roads.way[route]]
    length = roads.arrays.edges.length[route]
    size = np.bincount(street, length, minlength=int(names.max()) + 1)
    wanted = random.uniform(*SHARE) * length.sum()
    inner = np.unique(street[3:-3])
    gone: list[int] = []
    for name in random.permutation(inner[(inner > 0) & (size[inner] > FIRST_M)]).tolist():
        if size[gone].sum() + size[name] <= SHARE[1] * length.sum():
            gone.append(name)
        if size[gone].sum() >= wanted:
            break
    return np.isin(names, gone)


def near_alike(roads: RoadMap, drive: SimulatedDrive, rows: NDArray[np.int64]) -> Mask:
    """Whether a mapped road runs alike within `APART_M` of the truth, at some of its rows."""
    truth = drive.truth
    found = np.zeros(len(rows), bool)
    for i, k in enumerate(rows.tolist()):
        near = roads.near(float(truth.map_x[k]), float(truth.map_y[k]), APART_M)
        places = zip(near.edge.tolist(), near.s.tolist(), strict=True)
        turn = np.array([roads.at(e, s)[2] for e, s in places]) - truth.heading[k]
        found[i] = bool((np.abs(np.angle(np.exp(2j * turn))) < 2.0 * ALIKE).any())
    return found


def since(flag: Mask, travelled: NDArray[np.float64]) -> NDArray[np.float64]:
    """Metres since a flag last was False, (n,)."""
    last = np.maximum.accumulate(np.where(flag, -np.inf, travelled))
    return np.where(np.isfinite(last), travelled - last, travelled - travelled[0])


def one(seed: int, *, length_m: float, scenario: str, settings: Settings) -> Row | None:
    """One drive, its own reduced map."""
    random = np.random.default_rng([seed, 78])
    roads: RoadMap = world["roads"]
    route = random_route(roads.arrays, length_m, random, world["allowed"])
    column = world["streets"].columns["name"]
    removed = _removed(roads, column.code, route, random)
    if not removed.any():
        return None
    reduced = _compiled(without(world["streets"], removed))
    drive = simulate_drive(roads, seed=seed, route=route.tolist(), scenario=scenario)
    said = answer(reduced, drive, settings)
    return _score(roads, reduced, removed, drive, said)


def _score(
    roads: RoadMap, reduced: RoadMap, removed: Mask, drive: SimulatedDrive, said: Answer
) -> Row:
    """P(off-road) where it should be one, and where it should be none."""
    truth = drive.truth
    missing = removed[roads.pieces.way[roads.piece(truth.edge, truth.along)]]
    counted = ~truth.stopped & (truth.time > truth.time[0] + WARM_UP_S)
    off = said.rows.p_off_road
    on = np.flatnonzero(counted & missing & (since(missing, truth.travelled) > FIRST_M))
    on = on[~near_alike(reduced, drive, on)]
    back = since(~missing, truth.travelled)
    begun = np.concatenate([[False], missing[1:] & ~missing[:-1]])
    mapped = counted & ~missing & (back > FIRST_M)
    left = np.flatnonzero(np.concatenate([[False], ~missing[1:] & missing[:-1]]))
    returned = [float(back[k:][(off[k:] < 0.5) & ~missing[k:]][:1].sum()) for k in left.tolist()]
    found = [_detected(truth.travelled[k:], off[k:], missing[k:]) for k in np.flatnonzero(begun)]
    return {
        "missing": float(len(on)),
        "off": float(off[on].sum()),
        "off_half": float((off[on] > 0.5).sum()),
        "mapped": float(mapped.sum()),
        "off_mapped": float(off[mapped].sum()),
        "mapped_half": float((off[mapped] > 0.5).sum()),
        "wrong_p": float((said.rows.p_edge[on] > SURE).sum()),
        "returns": float(len(returned)),
        "return_m": float(np.sum(returned)),
        "stretches": float(len(found)),
        "found": float(np.isfinite(found).sum()),
        "found_m": float(np.sum(np.array(found)[np.isfinite(found)])),
    }


def _detected(travelled: NDArray[np.float64], off: NDArray[np.float64], missing: Mask) -> float:
    """Metres into a missing stretch after which P(off-road) first passes 0.5; inf: never."""
    end = int(np.argmin(missing)) if not missing.all() else len(missing)
    at = np.flatnonzero(off[:end] > 0.5)
    return float(travelled[at[0]] - travelled[0]) if len(at) else np.inf


def run(options: Options) -> list[Figure]:
    """All seeds."""
    seeds = options.seeds or SEEDS
    work = partial(
        one,
        length_m=options.more.get("metres", LENGTH_M),
        scenario=options.more.get("preset", "good"),
        settings=options.settings(),
    )
    table = Table(
        each(work, seeds, options, prepare, [options.need("maps", "heidelberg.osm.pbf")]), seeds
    )
    return [
        table.share("P(off-road) on missing streets", "off", "missing", ">= 0.9", "", 1.0),
        table.share("P(off-road) on mapped roads", "off_mapped", "mapped", "<= 0.005", "", 1.0),
        table.share("P(off-road) > 0.5 on missing streets", "off_half", "missing"),
        table.share("P(off-road) > 0.5 on mapped roads", "mapped_half", "mapped"),
        table.share("P(edge) > 0.95 on missing streets", "wrong_p", "missing"),
        table.share("missing stretches found", "found", "stretches"),
        table.share("found after, mean", "found_m", "found", "", "m", 1.0),
        table.share("back on the road after, mean", "return_m", "returns", "", "m", 1.0),
    ]
