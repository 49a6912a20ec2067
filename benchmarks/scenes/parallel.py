"""Two parallel roads and a receiver that is pulled towards the wrong one.

`pulled`: a clean approach, then the drive changes to the road beside, or does not, while
the fixes are pulled a full gap towards the other one all along.  `coldstart`: the drive
begins between the two, with a fair receiver or a pulled one.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from whichroad.roadmap import RoadMap
from whichroad.settings import Settings
from whichroad.simulate import GOOD, MapBuilder, Pull, SimulatedDrive, simulate_drive

from .. import Figure, Options
from .drives import SURE, Answer, Row, Table, answer, each, eastward, named, world
from .plain import Array

SEEDS = range(10_000, 11_000)
GAPS = (8, 12, 18, 25)  # m
# the pull comes at once behind the link, or grows along it: as if the other road were driven
CASES = list(product(GAPS, ("changed", "straight"), ("abrupt", "creeping")))
SETTINGS = replace(GOOD, stop_probability=0.0, lane_change_rate=0.0)
WITHIN_S = 60.0  # a cold start should be decided by then
PRIOR_DOF = 2  # of the map's variance before it is learnt: one length of its error, two axes
STRETCH_M = 800.0  # parallel, behind the link
_APPROACH = 900.0
_AFTER = 700.0  # m, the roads go on
_SLOPE = 5.0  # m of link per m of gap


class Pair(NamedTuple):
    """A map of two parallel roads; `side` begins with a link from where `main` begins."""

    roads: RoadMap
    right: float  # 1: the side road lies right of the main one, -1: left
    approach: int  # edges
    main: int
    side: int


def link_m(gap: float) -> float:
    """How far along the link reaches, m."""
    return max(40.0, _SLOPE * gap)


def draw(gap: float, right: float) -> Pair:
    """The map.

    Args:
        gap: Between the centre lines, m.
        right: 1: the side road lies to the right, -1: to the left.
    """
    builder, y, reach = MapBuilder(), -right * gap, link_m(gap)
    builder.node("begin", -_APPROACH, 0.0)
    builder.node("node", 0.0, 0.0)
    builder.node("main end", reach + STRETCH_M + _AFTER, 0.0)
    builder.node("merge", reach, y)
    builder.node("side end", reach + STRETCH_M + _AFTER, y)
    streets = {
        "Approach": ["begin", "node"],
        "Main": ["node", "main end"],
        "Side": ["node", "merge", "side end"],
    }
    for name, nodes in streets.items():
        builder.way(nodes, "tertiary", name=name, maxspeed="50")
    roads = builder.compiled()
    return Pair(roads, right, *(eastward(roads, name) for name in streets))


def prepare() -> None:
    """The maps of this process."""
    world["pairs"] = {(g, r): draw(g, r) for g in GAPS for r in (-1.0, 1.0)}


def one(seed: int, *, settings: Settings) -> Row:
    """Both truths and both ways to be pulled at every gap, on the same seed."""
    row: Row = {}
    for gap, truth, how in CASES:
        pair: Pair = world["pairs"][gap, float(1 - 2 * (seed % 2))]
        row |= {
            f"{gap} {truth} {how} {k}": v
            for k, v in _pulled(pair, gap, truth == "changed", how == "creeping", seed, settings)
        }
    return row


def _pulled(
    pair: Pair, gap: float, changed: bool, creeping: bool, seed: int, settings: Settings
) -> Iterator[tuple[str, float]]:
    """Epochs of the parallel stretch, of which right and confidently wrong."""
    roads, reach = pair.roads, link_m(gap)
    node_m = 0.8 * float(roads.arrays.edges.length[pair.approach])
    begin, rise = (node_m, reach) if creeping else (node_m + reach, 0.0)
    pull = Pull(begin, (-pair.right if changed else pair.right) * gap, 1.0, 0.0, np.inf, rise)
    drive = simulate_drive(
        roads, seed=seed, scenario=SETTINGS,
        route=[pair.approach, pair.side if changed else pair.main], pulls=(pull,),
    )  # fmt: skip
    said = answer(roads, drive, settings)
    gone = drive.truth.travelled - node_m - reach
    seen = (gone > 0.0) & (gone < STRETCH_M)
    main, side = (said.p_of(named(roads, name))[seen] for name in ("Main", "Side"))
    p_true, p_wrong = (side, main) if changed else (main, side)
    off = said.rows.p_off_road[seen]
    yield "epochs", float(seen.sum())
    yield "right", float(((p_true > p_wrong) & (p_true > off)).sum())
    yield "sure_wrong", float((p_wrong > SURE).sum())
    yield "ever", float((p_wrong > SURE).any())
    yield "sure_right", float((p_true > SURE).sum())
    yield "off", float(off.sum())


def pulled(options: Options) -> list[Figure]:
    """All seeds, the goals by gap."""
    seeds = options.seeds or SEEDS
    table = Table(each(partial(one, settings=options.settings()), seeds, options, prepare), seeds)
    figures = []
    for gap, truth, how in CASES:
        right, wrong = (">= 92", "<= 1") if gap == 8 else (">= 99.5", "")
        name, key = f"{gap} m, {truth}, {how}: ", f"{gap} {truth} {how} "
        figures += [
            table.share(name + "right", key + "right", key + "epochs", right),
            table.share(name + "surely wrong", key + "sure_wrong", key + "epochs", wrong),
            table.share(name + "drives ever so", key + "ever"),
            table.share(name + "surely right", key + "sure_right", key + "epochs"),
            table.share(name + "P(off-road)", key + "off", key + "epochs", "", "", 1.0),
        ]
    return figures


COLD = {  # receiver: s over which a pull of a full gap wears off
    "fair": None,
    "pull wears off": 60.0,
    "pulled for good": np.inf,
}


def cold(seed: int, *, settings: Settings) -> Row:
    """A start on either road, with every receiver, with and without wheels."""
    row: Row = {}
    for gap in GAPS:
        pair: Pair = world["pairs"][gap, float(1 - 2 * (seed % 2))]
        on_side = seed % 4 < 2
        for receiver, time in COLD.items():
            wrong_side = -pair.right if on_side else pair.right
            pulls = () if time is None else (Pull(-1.0, wrong_side * gap, time, 0.0),)
            drive = simulate_drive(
                pair.roads, seed=seed, scenario=SETTINGS,
                route=[pair.side if on_side else pair.main], pulls=pulls,
            )  # fmt: skip
            if time is None:
                row |= {
                    f"{gap} exact {k}": v for k, v in _exact(pair, gap, on_side, drive, settings)
                }
            for sensors, seen in (("wheels", drive), ("GNSS only", _without_wheels(drive))):
                said = answer(pair.roads, seen, settings)
                key = f"{gap} {receiver} {sensors} "
                row |= {key + k: v for k, v in _decision(pair, on_side, seen, said)}
    return row


def _without_wheels(drive: SimulatedDrive) -> SimulatedDrive:
    return replace(drive, drive=replace(drive.drive, odometry=None))


def _decision(
    pair: Pair, on_side: bool, drive: SimulatedDrive, said: Answer
) -> Iterator[tuple[str, float]]:
    """The first decision, and whether a wrong one was ever held."""
    main, side = (said.p_of(named(pair.roads, name)) for name in ("Main", "Side"))
    p_true, p_wrong = (side, main) if on_side else (main, side)
    since = drive.truth.time - drive.truth.time[0]
    sure = np.flatnonzero(said.started & (np.maximum(p_true, p_wrong) > SURE))
    within = len(sure) > 0 and since[sure[0]] <= WITHIN_S
    yield "decided", float(within)
    yield "decided_wrong", float(within and p_wrong[sure[0]] > SURE)
    yield "ever", float((p_wrong > SURE).any())
    yield "epochs", float(said.started.sum())
    yield "sure_wrong", float((said.started & (p_wrong > SURE)).sum())
    yield "after_s", float(since[sure[0]]) if within else 1e3


def _exact(
    pair: Pair, gap: float, on_side: bool, drive: SimulatedDrive, settings: Settings
) -> Iterator[tuple[str, float]]:
    """What the exact test of two roads decides that knows all variances: no filter can do more.

    Fixes of a receiver that is pulled a full gap for good are those of a fair one on the other
    road.  No rule tells them apart: whatever share of fair starts it decides rightly, it
    decides the same share of pulled ones wrongly.  `believing` takes the map's sigma to be
    `map_sigma`.  To `unsure` its variance is a scaled inverse chi-square about that, as if it
    came from one length of the error.
    """
    truth, known = drive.truth, drive.settings
    time = drive.fix_truth.time
    fixes = (time <= WITHIN_S) & drive.seen_fix
    at = np.searchsorted(truth.time - truth.time[0], time[fixes] - 1e-6)
    line = pair.roads.at(pair.side if on_side else pair.main, 400.0)[1]
    error = drive.fix_error[fixes, 1] + truth.y[at] - line + 1.75  # m north of the lane
    apart = (pair.right if on_side else -pair.right) * gap  # of the wrong road, m north
    moved = np.concatenate([[0.0], np.cumsum(np.diff(time[fixes]) * ~truth.stopped[at[1:]])])
    slow = known.gnss_bias_low**2 * np.exp(-np.abs(moved[:, None] - moved) / known.gnss_time)
    same = known.relative_sigma**2 + known.street_sigma**2 + known.lane_sigma**2
    cov = slow + same + known.gnss_white**2 * np.eye(len(moved))
    told = np.array([known.map_sigma**2])
    believed = np.array([settings.map_sigma**2])
    unsure = settings.map_sigma**2 * PRIOR_DOF / chi2.ppf((np.arange(20) + 0.5) / 20, PRIOR_DOF)
    enough = np.log(SURE / (1.0 - SURE))
    for name, maps in (("", told), ("believing ", believed), ("unsure ", unsure)):
        ratio = _log_odds(error, error - apart, cov, maps)
        sure = np.flatnonzero(np.abs(ratio) > enough)
        yield name + "decided", float(len(sure) > 0)
        yield name + "decided_wrong", float(len(sure) > 0 and ratio[sure[0]] < 0.0)
        yield name + "decided_right", float(len(sure) > 0 and ratio[sure[0]] > 0.0)
    pulled = _log_odds(error + apart, error, cov, told)
    sure = np.flatnonzero(np.abs(pulled) > enough)
    yield "pulled_wrong", float(len(sure) > 0 and pulled[sure[0]] < 0.0)


def _log_odds(one: Array, other: Array, cov: Array, maps: Array) -> Array:
    """Log-odds after each fix of one series of errors (n,) over another.

    Args:
        one: Errors on one road, m.
        other: The same on the other one.
        cov: Of the errors, without the map's, (n, n) m².
        maps: Variances that the map's may have, alike probable, (k,) m².
    """
    logs: list[list[Array]] = [[], []]
    for variance in maps:
        white = np.linalg.inv(np.linalg.cholesky(cov + variance))  # innovations, one by one
        for errors, found in zip((one, other), logs, strict=True):
            found.append(np.cumsum(np.log(np.diag(white)) - 0.5 * (white @ errors) ** 2))
    first, second = (np.logaddexp.reduce(found, axis=0) for found in logs)
    return np.asarray(first - second)


def coldstart(options: Options) -> list[Figure]:
    """All seeds: decisions of a fair receiver, wrong certainty of a pulled one."""
    seeds = options.seeds or SEEDS
    rows = each(partial(cold, settings=options.settings()), seeds, options, prepare)
    table, figures = Table(rows, seeds), []
    for sensors in ("wheels", "GNSS only"):
        for gap in GAPS:
            key = f"{gap} fair {sensors} "
            name = f"{gap} m, {sensors}, fair: "
            figures += [
                table.share(name + "decided within 60 s", key + "decided", None, ">= 80"),
                table.share(
                    name + "wrong of those", key + "decided_wrong", key + "decided", "<= 1"
                ),
            ]
            if sensors == "GNSS only":
                name, key = f"{gap} m, exact test, fair: ", f"{gap} exact "
                figures += [
                    table.share(name + "decided within 60 s", key + "decided"),
                    table.share(name + "wrong of those", key + "decided_wrong", key + "decided"),
                    table.share(name + "rightly decided", key + "decided_right"),
                    *(
                        table.share(f"{name}{how}, {what}", f"{key}{how} {said}", of)
                        for how in ("believing", "unsure")  # of the map's sigma
                        for what, said, of in (
                            ("rightly", "decided_right", None),
                            ("wrong of those", "decided_wrong", f"{key}{how} decided"),
                        )
                    ),
                    table.share(
                        f"{gap} m, exact test, pulled for good: wrongly decided",
                        key + "pulled_wrong",
                    ),
                ]
        for receiver in list(COLD)[1:]:
            for gap in GAPS:
                key = f"{gap} {receiver} {sensors} "
                name = f"{gap} m, {sensors}, {receiver}: "
                figures += [
                    table.share(name + "ever confidently wrong", key + "ever", None, "<= 1"),
                    table.share(name + "such epochs", key + "sure_wrong", key + "epochs"),
                ]
    return figures
