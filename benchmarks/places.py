"""Point objects ahead of and near to a simulated car: is P true, is sigma, what does it cost?

Drives in Heidelberg with a random map error, half of them with 1.5 km without GNSS in every 4 km.
About each lie points at random, half of them in the map's frame and half where they truly are.
Every 100 m the places within 500 m ahead and within 50 m are asked for.  Of the answers a fifth is
kept, drawn whatever came of it: about one for each place that is approached.

The drivers of `priors` turn as the map's priors say; those of `others` avoid service roads,
streets where they have been, and dead ends.
"""

import time
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import whichroad
from whichroad.epochs import build_timeline
from whichroad.places import Places, RelativePlace
from whichroad.recorded import localize_recorded
from whichroad.simulate import SimulatedDrive, simulate_drive
from whichroad.simulate.map_error_field import draw_map_error
from whichroad.simulate.simulation_settings import PRESETS
from whichroad.tables.relative_places import stances_of

from . import Figure, Options, interval, seeds_text, town
from .processes import spread

SEEDS = range(9000, 9300)
LENGTH_M = 6000.0
AHEAD_M, NEAR_M = 500.0, 50.0
_KEPT = 0.2  # of the answers, so that there is about one for a place and a drive
_EVERY_M = 100.0  # driven, between two questions
_WARM_UP_S = 20.0
_PLACES = 2000  # about each drive
_ABOUT_M = 700.0  # from the route, on either axis
_MANY = 10_000  # places of which the time of a question is measured
_SHARPEST = 2.3  # rad, turns that the simulated car cannot take
_COLOURS = ("#1b6ca8", "#d1495b", "#5b8e7d", "#e8963c")
_SHARES = {1: 68.27, 2: 95.45, 3: 99.73}  # % of a Gaussian within so many sigmas

# p, came true, distance less m driven, sigma, distance
Rows = list[tuple[float, float, float, float, float]]


class Answer(NamedTuple):
    """What was asked of one drive: rows of each kind of question."""

    rows: dict[str, Rows]


class Drive(NamedTuple):
    """A simulated drive, and the edges that it would have driven on."""

    simulated: SimulatedDrive
    route: list[int]  # from its first edge, beyond its end


def route_by_priors(roads: Any, start: int, length_m: float, draw: Any) -> tuple[list[int], int]:
    """A way that turns as the priors say, and how many of its edges the simulated car can drive.

    It cannot turn round, nor break a rule, which the priors allow.
    """
    edges, route, driven, possible = roads.edges, [start], 0.0, 0
    while driven < length_m:
        row = edges[route[-1]]
        turns = roads.turns[row["first_turn"] : row["end_turn"]]
        if not len(turns):
            break
        p = turns.prior.astype(float)
        turn = turns[int(draw.choice(len(p), p=p / p.sum()))]
        steerable = turn.edge != row["opposite"] and abs(turn.angle) < _SHARPEST
        if not possible and not (steerable and turn.rule == 0 and edges.rule[turn.edge] == 0):
            possible, length_m = len(route), driven + 2.0 * AHEAD_M
        route.append(int(turn.edge))
        driven += float(edges.length[route[-1]])
        if not possible and driven > length_m - 2.0 * AHEAD_M:
            possible = len(route)
    return route, possible or len(route)


def simulated(seed: int, drivers: str) -> Drive:
    """The drive of a seed."""
    roads, allowed = town._world["roads"], town._world["allowed"]
    scenario = ("good", "outage")[seed % 2]
    draw = np.random.default_rng([seed, 91])
    field = draw_map_error(PRESETS[scenario], draw)
    route, possible = None, 0
    if drivers == "priors":
        starts = np.flatnonzero(allowed)
        length = roads.arrays.edges.length[starts]
        while route is None or possible < 4:
            start = int(draw.choice(starts, p=length / length.sum()))
            route, possible = route_by_priors(roads.arrays, start, LENGTH_M + 2.0 * AHEAD_M, draw)
    drive = simulate_drive(
        roads, seed=seed, length_m=LENGTH_M + AHEAD_M, scenario=scenario, allowed=allowed,
        route=None if route is None else route[:possible], error_field=field,
    )  # fmt: skip
    return Drive(drive, drive.route.tolist() if route is None else route)


def places_about(drive: SimulatedDrive) -> tuple[Places, list[tuple[int, float]], np.ndarray]:
    """Random points about a drive, their edges and abscissae, and where they are in the world."""
    roads = town._world["roads"]
    edges, truth = roads.arrays.edges, drive.truth
    near = np.abs(edges.end_x - truth.x.mean()) < np.ptp(truth.x) / 2 + _ABOUT_M
    near &= np.abs(edges.end_y - truth.y.mean()) < np.ptp(truth.y) / 2 + _ABOUT_M
    candidates = np.flatnonzero(near & (edges.rule == 0))
    draw = np.random.default_rng([drive.seed, 92])
    length = edges.length[candidates]
    edge = draw.choice(candidates, _PLACES, p=length / length.sum())
    s = draw.uniform(0.0, 1.0, _PLACES) * edges.length[edge]
    xy = np.array([roads.at(int(e), float(m))[:2] for e, m in zip(edge, s, strict=True)])
    world = xy + roads.plane.scale(xy[:, 0], xy[:, 1])[:, None] * drive.error_field.at(*xy.T)
    on_map = np.arange(_PLACES) % 2 == 0
    given = np.where(on_map[:, None], xy, world)
    lat, lon = roads.plane.to_geodetic(given[:, 0].copy(), given[:, 1].copy())
    table = {"id": np.arange(_PLACES), "lat": lat, "lon": lon, "on_map": on_map}
    return Places(table, roads), list(zip(edge.tolist(), s.tolist(), strict=True)), world


def passages(drive: Drive, where: list[tuple[int, float]]) -> tuple[np.ndarray, Any]:
    """Map metres along the route at each truth, and those at which each place is passed."""
    edges, truth = town._world["roads"].arrays.edges, drive.simulated.truth
    length = edges.length[drive.route]
    begin = np.concatenate([[0.0], np.cumsum(length)[:-1]])
    at, row = np.empty(len(truth)), 0
    for k, edge in enumerate(truth.edge.tolist()):
        while drive.route[row] != edge:  # an edge may be shorter than a step of the truth
            row += 1
        at[k] = begin[row] + truth.along[k]
    on: dict[int, list[tuple[int, float]]] = defaultdict(list)
    for place, (edge, s) in enumerate(where):
        on[edge].append((place, s))
        back = int(edges.opposite[edge])
        if back >= 0:
            on[back].append((place, float(edges.length[back]) - s))
    passed: dict[int, list[float]] = defaultdict(list)
    for edge, first in zip(drive.route, begin.tolist(), strict=True):
        for place, s in on[edge]:
            passed[place].append(first + s)
    return at, {place: np.array(found) for place, found in passed.items()}


def one(seed: int, drivers: str = "priors") -> Answer:
    """Ask about one drive."""
    roads = town._world["roads"]
    whole = simulated(seed, drivers)
    drive = whole.simulated
    places, where, world = places_about(drive)
    at, passed = passages(whole, where)
    timeline = build_timeline(drive.drive, roads.plane, drive.vehicle)
    recorded = localize_recorded(roads, timeline, vehicle=drive.vehicle, poses=True)
    stances = stances_of(recorded.output, places)
    truth = drive.truth
    epoch = np.searchsorted(timeline.epochs.time, truth.time - 1e-3)
    last = at[-1] - (AHEAD_M if drivers == "others" else 0.0)  # as far as the way on is known
    asked = np.searchsorted(at, np.arange(0.0, last, _EVERY_M) + 1e-6)
    asked = asked[(asked < len(at)) & (recorded.output.rows.live[epoch[asked % len(at)]] > 0)]
    asked = asked[truth.time[asked] > truth.time[0] + _WARM_UP_S]
    draw = np.random.default_rng([seed, 93])
    found: dict[str, Rows] = {
        f"{what}, {frame}": []
        for what in ("ahead", "near") for frame in ("on the map", "in the world")
    }  # fmt: skip

    def note(what: str, answers: list[RelativePlace], came: dict[int, float]) -> None:
        listed = {int(a.id): a for a in answers}
        for place in sorted(listed.keys() | came.keys()):
            if draw.random() > _KEPT:
                continue
            answer = listed.get(place, RelativePlace(place, np.nan, np.nan, 0.0))
            error = answer.distance_m - came[place] if place in came else np.nan
            frame = "on the map" if place % 2 == 0 else "in the world"
            row = (answer.p, float(place in came), error, answer.sigma_m, answer.distance_m)
            found[f"{what}, {frame}"].append(row)

    for k in asked.tolist():
        stance = stances[epoch[k]].tobytes()
        come = {}
        for place, metres in passed.items():
            to_come = metres[(metres > at[k]) & (metres <= at[k] + AHEAD_M)]
            if len(to_come):
                driven = np.interp(to_come[0], at, truth.travelled, right=np.nan)
                come[place] = float(driven - truth.travelled[k])
        note("ahead", places.ahead(stance, AHEAD_M), come)
        scale = float(roads.plane.scale(truth.x[k], truth.y[k]))
        away = np.hypot(*(world - [truth.x[k], truth.y[k]]).T) / scale
        near = np.flatnonzero(away <= NEAR_M)
        note("near", places.nearby(stance, NEAR_M), {int(i): float(away[i]) for i in near})
    return Answer(found)


def calibration_error(table: np.ndarray) -> float:
    """Ten bins of equal width: mean distance of P from the share that came true, by their size."""
    p, true = table[:, 0], table[:, 1]
    which = np.minimum((10 * p).astype(int), 9)
    size = np.bincount(which, minlength=10)
    off = np.bincount(which, p, 10) - np.bincount(which, true, 10)
    return float(np.abs(off).sum() / size.sum())


def by_chance(table: np.ndarray) -> float:
    """The error that a calibrated answer with these P exceeds in one of twenty cases."""
    draw = np.random.default_rng(0)
    p = table[:, 0]
    errors = [
        calibration_error(np.column_stack([p, draw.uniform(size=len(p)) < p])) for _ in range(200)
    ]
    return float(np.quantile(errors, 0.95))


def run(options: Options) -> list[Figure]:
    """Both kinds of drivers, and the time of a question among 10,000 places."""
    return list(_figures(options))


def _figures(options: Options) -> Iterator[Figure]:
    map_file = options.need("maps", "heidelberg.osm.pbf")
    seeds = options.seeds or SEEDS
    for drivers in options.more.get("parts", "priors,others,time").split(","):
        if drivers == "time":
            yield from _times(map_file)
            continue
        answers: list[Answer] = []
        asked = spread(partial(one, drivers=drivers), seeds, options, town._open, [map_file])
        for seed, answer in zip(seeds, asked, strict=True):
            answers.append(answer)
            options.say(f"{drivers}, seed {seed}: {sum(map(len, answer.rows.values()))} places")
        if "out" in options.more:
            draw_picture(answers, Path(options.more["out"]) / f"places-{drivers}.png")
        for kind in answers[0].rows:
            yield from _of_kind(f"{drivers}: {kind}", [a.rows[kind] for a in answers], seeds)


def draw_picture(answers: list[Answer], file: Path) -> None:
    """P against what came true, and the errors of the distance in sigmas."""
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(8.2, 3.9), layout="constrained")
    left.plot([0, 1], [0, 1], color="#b0b0b0", lw=1)
    edges = np.linspace(-4.0, 4.0, 33)
    normal = np.exp(-0.5 * edges**2) / np.sqrt(2.0 * np.pi)
    right.plot(edges, normal, color="#b0b0b0", lw=1, label="Gaussian")
    for kind, colour in zip(answers[0].rows, _COLOURS, strict=True):
        table = np.array([row for answer in answers for row in answer.rows[kind]])
        which = np.minimum((10 * table[:, 0]).astype(int), 9)
        size = np.maximum(np.bincount(which, minlength=10), 1)
        p, true = (np.bincount(which, table[:, k], 10) / size for k in (0, 1))
        left.plot(p, true, "o-", ms=4, lw=1, color=colour, label=kind)
        known = table[np.isfinite(table[:, 2]) & (table[:, 0] > 0.5)]
        right.hist(known[:, 2] / known[:, 3], edges, density=True, histtype="step", color=colour)
    left.set(xlabel="P that was told", ylabel="share that came true", xlim=(0, 1), ylim=(0, 1))
    right.set(xlabel="error of the distance, sigmas", ylabel="density")
    left.legend(fontsize=8, frameon=False)
    right.legend(fontsize=8, frameon=False)
    for axis in (left, right):
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=8)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=80, metadata={"Software": None})
    plt.close(figure)


def _of_kind(title: str, drives: list[Rows], seeds: range) -> Iterator[Figure]:
    table = np.array([row for rows in drives for row in rows])
    text, n = seeds_text(seeds), len(table)
    goal = "<= 0.02" if title.startswith("priors") else ""
    yield Figure(f"{title}: calibration error", calibration_error(table), goal, "", n, None, text)
    yield Figure(f"{title}: by chance alone below", by_chance(table), "", "", n, None, text)
    for low, high in ((0.0, 0.1), (0.1, 0.5), (0.5, 0.9), (0.9, 1.1)):
        part = table[(table[:, 0] >= low) & (table[:, 0] < high)]
        if len(part):
            name = f"{title}: P {low:g} to {min(high, 1.0):g}, mean P {part[:, 0].mean():.3f}, true"
            yield Figure(name, float(part[:, 1].mean()), "", "", len(part), None, text)
    known = table[np.isfinite(table[:, 2]) & (table[:, 0] > 0.5)]
    off = np.abs(known[:, 2])
    for k, usual in _SHARES.items():
        name = f"{title}: distance within {k} sigma ({usual} % of a Gaussian)"
        each = [
            (sum(abs(r[2]) <= k * r[3] for r in sure), len(sure))
            for rows in drives if (sure := [r for r in rows if np.isfinite(r[2]) and r[0] > 0.5])
        ]  # fmt: skip

        def pooled(t: np.ndarray) -> float:
            return float(100.0 * t[:, 0].sum() / t[:, 1].sum())

        value = float(100.0 * np.mean(off <= k * known[:, 3]))
        yield Figure(name, value, "", "%", len(known), interval(pooled, each), text)
    for share in (0.5, 0.95):
        name = f"{title}: error of the distance, {100 * share:g} % below"
        yield Figure(name, float(np.quantile(off, share)), "", "m", len(known), None, text)


def _times(map_file: Path) -> Iterator[Figure]:
    """On line, 10,000 places on the map: a question, and an update with places and without."""
    town._open(map_file)
    roads = town._world["roads"]
    drive = simulated(9001, "others").simulated
    draw = np.random.default_rng(94)
    edges = roads.arrays.edges
    edge = draw.choice(len(roads), _MANY, p=edges.length / edges.length.sum())
    s = draw.uniform(0.0, 1.0, _MANY) * edges.length[edge]
    began = time.perf_counter()
    places = Places({"edge_id": edge, "abscissa_m": s}, roads)
    yield Figure("attaching 10,000 places by edge", time.perf_counter() - began, "", "s")
    fixes = drive.drive.fixes
    assert fixes is not None
    taken: dict[str, list[float]] = defaultdict(list)
    counts: list[int] = []
    for given in (places, None):
        localizer = whichroad.Localizer(roads, vehicle=drive.vehicle, places=given)
        for row in range(min(len(fixes.time), 600)):
            fix = whichroad.GeoFix(
                float(fixes.time[row]), float(fixes.lat_deg[row]), float(fixes.lon_deg[row])
            )
            began = time.perf_counter()
            estimate = localizer.update(fix)
            name = "an update without places" if given is None else "an update with places"
            taken[name].append(time.perf_counter() - began)
            if given is None or not estimate.answered:
                continue
            for name, ask, metres in (
                ("ahead, 500 m", estimate.ahead, AHEAD_M), ("nearby, 50 m", estimate.nearby, NEAR_M)
            ):  # fmt: skip
                least = 1.0
                for _ in range(3):
                    began = time.perf_counter()
                    answer = ask(metres)
                    least = min(least, time.perf_counter() - began)
                taken[name].append(least)
                if metres == AHEAD_M:
                    counts.append(len(answer))
    yield Figure("places that are found ahead, mean", float(np.mean(counts)), "", "", len(counts))
    for name, seconds in taken.items():
        goal = "<= 20" if name[:4] in ("ahea", "near") else ""
        for share in (0.5, 0.95):
            value = 1e6 * float(np.quantile(seconds, share))
            title = f"{name}, {100 * share:g} % below"
            yield Figure(title, value, goal if share == 0.5 else "", "us", len(seconds))
