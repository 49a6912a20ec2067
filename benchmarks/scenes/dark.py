"""Long ways without GNSS in Heidelberg: 1.5 km with turns, and 10 km.

`turns`: in every 500 m of the outage the road turns by 30 degrees or more, so that the
map can tell how far the car has come.  `long`: a random drive of 10 km.
"""

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from whichroad.roadmap import RoadMap
from whichroad.settings import Settings
from whichroad.simulate import SimulatedDrive, simulate_drive

from .. import Figure, Options
from ..town import right_edges
from .drives import SURE, Answer, Row, Table, answer, each, map_error, read_town, world

SEEDS = range(10_000, 12_000)
LONG_SEEDS = range(10_000, 10_200)
MASK_M = 1500.0
TURN_EVERY_M = 500.0
TURN = np.radians(30.0)
BEFORE_M = 1000.0  # with GNSS
LONG_M = 10_000.0
_ATTEMPTS = 8  # routes that are tried
_STRIDE = 10_000_000  # between their seeds
_LOOK_M = 25.0  # over which a turn must happen
_LAST_M = 300.0  # after the outage


def turning_window(drive: SimulatedDrive) -> tuple[float, float] | None:
    """The first 1.5 km (m driven, from, to) behind `BEFORE_M` without 500 m of no turn."""
    truth = drive.truth
    grid = np.arange(0.0, truth.travelled[-1], 5.0)
    heading = np.interp(grid, truth.travelled, np.unwrap(truth.heading))
    reach = int(_LOOK_M / 5.0)
    turned = np.abs(heading[reach:] - heading[:-reach]) >= TURN
    at = grid[reach:][turned]
    for begin in np.arange(BEFORE_M, truth.travelled[-1] - MASK_M - _LAST_M, 50.0).tolist():
        inside = at[(at > begin) & (at < begin + MASK_M)]
        if np.diff(inside, prepend=begin, append=begin + MASK_M).max() <= TURN_EVERY_M:
            return begin, begin + MASK_M
    return None


def turn(seed: int, *, settings: Settings) -> Row | None:
    """A drive of 4 km that turns often enough somewhere, where the outage is laid."""
    roads: RoadMap = world["roads"]
    for attempt in range(_ATTEMPTS):
        simulate = partial(
            simulate_drive, roads, seed=seed + attempt * _STRIDE, length_m=4000.0,
            allowed=world["allowed"],
        )  # fmt: skip
        window = turning_window(simulate())
        if window is not None:
            drive = simulate(outages_m=(window,))
            return _score(drive, answer(roads, drive, settings))
    return None


def straight(seed: int, *, length_m: float, settings: Settings) -> Row | None:
    """A drive with a long outage."""
    roads: RoadMap = world["roads"]
    whole = BEFORE_M + length_m
    drive = simulate_drive(
        roads, seed=seed, length_m=whole + _LAST_M, allowed=world["allowed"],
        outages_m=((BEFORE_M, whole),),
    )  # fmt: skip
    if drive.truth.travelled[-1] < whole:
        return None
    return _score(drive, answer(roads, drive, settings))


def _score(drive: SimulatedDrive, said: Answer) -> Row:
    """All epochs of the outage, and its last one."""
    truth, (begin, end) = drive.truth, drive.outages[0]
    error, right = map_error(world["roads"], drive, said), right_edges(drive, said.rows.edge)
    on = (truth.time > begin) & (truth.time < end)
    last = int(np.flatnonzero(on)[-1])
    moving = on & ~truth.stopped
    sure_wrong = moving & ~right & (said.rows.p_edge > SURE)
    return {
        "right_end": float(right[last]),
        "error_end": float(error[last]),
        "epochs": float(moving.sum()),
        "right": float((moving & right).sum()),
        "sure_wrong": float(sure_wrong.sum()),
        "error_95": float(np.quantile(error[moving], 0.95)),
        "within_2": float((moving & (error <= 2.0)).sum()),
        "within_5": float((moving & (error <= 5.0)).sum()),
        "within_10": float((moving & (error <= 10.0)).sum()),
        "lost_m": _lost(truth.travelled[moving], right[moving]),
        "p_end": float(said.rows.p_edge[last]),
    }


def _lost(travelled: NDArray[np.float64], right: NDArray[np.bool_]) -> float:
    """M into the outage after which the road was never right again; inf: right at its end."""
    at = np.flatnonzero(right)
    if len(at) == 0:
        return 0.0
    last = int(at[-1])
    return np.inf if last == len(right) - 1 else float(travelled[last] - travelled[0])


def turns(options: Options) -> list[Figure]:
    """1.5 km with a turn in every 500 m."""
    seeds = options.seeds or SEEDS
    work = partial(turn, settings=options.settings())
    table = Table(each(work, seeds, options, read_town, [_map(options)]), seeds)
    return [
        table.share("right road at the outage's end", "right_end", None, ">= 99"),
        table.quantile("map-frame error there, median", "error_end", 0.5, "<= 2"),
        table.quantile("map-frame error there, 95 %", "error_end", 0.95, "<= 5"),
        table.quantile("map-frame error there, 99 %", "error_end", 0.99),
        table.share("right road in the outage", "right", "epochs"),
        table.share("map-frame error <= 2 m in it", "within_2", "epochs"),
        table.share("map-frame error <= 5 m in it", "within_5", "epochs"),
        table.share("confidently wrong in it", "sure_wrong", "epochs"),
    ]


def long(options: Options) -> list[Figure]:
    """10 km."""
    seeds = options.seeds or LONG_SEEDS
    work = partial(
        straight, length_m=options.more.get("metres", LONG_M), settings=options.settings()
    )
    table = Table(each(work, seeds, options, read_town, [_map(options)]), seeds)
    return [
        table.share("right road in the outage", "right", "epochs", ">= 97"),
        table.share("map-frame error <= 10 m in it", "within_10", "epochs", ">= 95"),
        table.share("right road at its end", "right_end"),
        table.quantile("map-frame error there, median", "error_end", 0.5),
        table.quantile("map-frame error there, 95 %", "error_end", 0.95),
        table.share("confidently wrong in it", "sure_wrong", "epochs"),
    ]


def _map(options: Options) -> Path:
    return options.need("maps", "heidelberg.osm.pbf")
