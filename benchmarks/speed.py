"""How fast: recorded drives, one call on line, opening a map.  One thread, kernels warm.

A recorded drive is timed from records to filtered epochs (clocks aligned, fixes in the
plane, the filter); reading files and building tables are not the filter's and are said
apart.  Each rate is that of the least disturbed of several runs.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import whichroad
from whichroad.epochs import build_timeline
from whichroad.observations import Drive, GeoFix
from whichroad.online import Localizer
from whichroad.recorded import Recorded, localize_recorded
from whichroad.simulate import SimulatedDrive, drivable, simulate_drive

from . import Figure, Options, seeds_text
from .readings import observations

SEEDS = range(2000, 2008)
LENGTH_M = 15_000.0
REPEATS = 5
_LOOP_EVERY = 50  # calls between two empty loops


def timed(work: Callable[[], Any]) -> float:
    """Seconds that a call takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def _drives(options: Options) -> tuple[whichroad.RoadMap, list[SimulatedDrive]]:
    roads = whichroad.RoadMap.from_osm(options.need("maps", "heidelberg.osm.pbf"))
    allowed = drivable(roads.arrays, np.random.default_rng(0))
    seeds = options.seeds or SEEDS
    length = options.more.get("metres", LENGTH_M)
    drives = [simulate_drive(roads, seed=s, length_m=length, allowed=allowed) for s in seeds]
    return roads, drives


def _localize(roads: whichroad.RoadMap, drive: Drive, vehicle: whichroad.Vehicle) -> Recorded:
    return localize_recorded(roads, build_timeline(drive, roads.plane, vehicle), vehicle=vehicle)


def _rate(
    roads: whichroad.RoadMap, drives: list[tuple[Drive, whichroad.Vehicle]]
) -> tuple[float, float, int]:
    """Epochs a second over all drives (best run), mean live hypotheses, epochs."""
    first = [_localize(roads, d, v) for d, v in drives]  # warm
    epochs = sum(len(r.output.rows) for r in first)
    live = sum(int(r.output.rows.live.sum()) for r in first) / epochs
    runs = [timed(lambda: [_localize(roads, d, v) for d, v in drives]) for _ in range(REPEATS)]
    return epochs / min(runs), live, epochs


def run(options: Options) -> list[Figure]:
    """Recorded drives with and without odometry, and the tables."""
    roads, drives = _drives(options)
    seeds = seeds_text(options.seeds or SEEDS)
    wheels = [(d.drive, d.vehicle) for d in drives]
    alone = [(replace(d.drive, odometry=None), d.vehicle) for d in drives]
    rate, live, epochs = _rate(roads, wheels)
    gnss_rate, gnss_live, fixes = _rate(roads, alone)
    one = drives[0]
    whole = min(
        timed(lambda: whichroad.match(one.drive, roads, vehicle=one.vehicle))
        for _ in range(REPEATS)
    )
    rows = len(one.truth)
    return [
        Figure("recorded, 10 Hz wheels", rate, ">= 400000", "epochs/s", epochs, seeds=seeds),
        Figure("live hypotheses, wheels", live, "", "", epochs, seeds=seeds),
        Figure("recorded, GNSS alone 1 Hz", gnss_rate, ">= 120000", "fixes/s", fixes, seeds=seeds),
        Figure("live hypotheses, GNSS alone", gnss_live, "", "", fixes, seeds=seeds),
        Figure("match(), tables included", rows / whole, "", "epochs/s", rows),
    ]


def _empty_loop() -> None:
    for _ in range(1000):
        pass


def online(options: Options) -> list[Figure]:
    """Each `Localizer.update` of a drive, as a car would call it.

    Machines differ, and one machine from one minute to the next.  An empty Python loop of 1,000
    rounds is timed between the calls; the goals are multiples of its median.
    """
    roads, drives = _drives(replace(options, seeds=options.seeds or range(2000, 2002)))
    ticks: list[float] = []
    fixes: list[float] = []
    asked: list[float] = []
    loops: list[float] = []
    for warm in (True, False):
        for simulated in drives:
            localizer = Localizer(roads, vehicle=simulated.vehicle)
            for number, observation in enumerate(observations(simulated.drive)):
                seconds = timed(partial(localizer.update, observation))
                if number % _LOOP_EVERY == 0:
                    loops.append(timed(_empty_loop))
                    asked.append(timed(partial(_ask, localizer)))
                if not warm:
                    (fixes if isinstance(observation, GeoFix) else ticks).append(seconds)
    seeds = seeds_text(options.seeds or range(2000, 2002))
    micro, loop = 1e6 * np.array(ticks + fixes), 1e6 * float(np.median(loops))

    def quantile(name: str, q: float, values: np.ndarray, goal: str = "", of: str = "µs") -> Figure:
        return Figure(name, float(np.quantile(values, q)), goal, of, len(values), seeds=seeds)

    return [
        quantile("update, median", 0.5, micro),
        quantile("update, p99", 0.99, micro, "<= 100"),
        quantile("update, p99.9", 0.999, micro),
        quantile("update with a fix, p99", 0.99, 1e6 * np.array(fixes)),
        quantile("update, slowest", 1.0, micro),
        quantile("pose, covariance, road and status of an estimate", 0.5, 1e6 * np.array(asked)),
        quantile("an empty loop of 1,000 rounds", 0.5, 1e6 * np.array(loops)),
        quantile("update, median, as empty loops", 0.5, micro / loop, "<= 1.7", ""),
        quantile("update, p99, as empty loops", 0.99, micro / loop, "<= 3", ""),
    ]


def _ask(localizer: Localizer) -> None:
    """What most users ask of an estimate, which is worked out then."""
    estimate = localizer.estimate()
    _ = estimate.pose, estimate.cov, estimate.edge, estimate.p_road, estimate.status


def map_files(options: Options) -> list[Figure]:
    """Compile an extract, write it, open it."""
    source = options.need("maps", "heidelberg.osm.pbf")
    whichroad.RoadMap.from_osm(source)  # warm
    compiling = [timed(lambda: whichroad.RoadMap.from_osm(source)) for _ in range(REPEATS)]
    roads = whichroad.RoadMap.from_osm(source)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "heidelberg.map"
        saving = timed(lambda: roads.save(file))
        whichroad.RoadMap.open(file)
        opening = [timed(lambda: whichroad.RoadMap.open(file)) for _ in range(4 * REPEATS)]
        size = file.stat().st_size / 1e6
    edges = len(roads.arrays.edges.length)
    return [
        Figure("compile heidelberg.osm.pbf", median(compiling), "<= 3", "s", REPEATS),
        Figure("open it, compiled", 1e3 * median(opening), "<= 50", "ms", 4 * REPEATS),
        Figure("write it", 1e3 * saving, "", "ms"),
        Figure("compiled size", size, "", "MB"),
        Figure("directed edges", float(edges), "", ""),
    ]
