"""A pause of all sensors, while the car was driven or carried elsewhere: found again, or wrong?

Each drive of a world is cut: three minutes of it are not seen, and take a minute to ten hours by
the clock.  Driven, the wheels' counters have gone on meanwhile.  Carried, they have not.  Beside
them stands the same drive begun after the pause: no filter can find the road sooner.
"""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

import whichroad

from .. import Figure, Options, seeds_text
from ..exact_bounds import clopper_pearson
from . import scoring
from .drives import CAR, World, make_world, said_of, sense, table_of
from .nets import sumo_tool

SEEDS = range(3)
UNSEEN = 180.0  # s of the drive that are not seen
BEFORE, AFTER = 120.0, 150.0  # s of it that are, at least
FOUND = (25.0, 35.0)  # s after the pause
FIRST = 60.0  # s after it, in which declarations and levels are counted
PAUSES = (60.0, 600.0, 36_000.0)  # s by the clock
DECLARED = 0.999
WAYS = ("driven", "carried", "begun after it")


@dataclass
class Count:
    """Of one kind of pause: drives, and epochs of their first minute afterwards."""

    drives: int = 0
    found: int = 0
    declared: int = 0
    wrong: int = 0
    exceeded: int = 0
    epochs: int = 0


def run(options: Options) -> list[Figure]:
    """Every drive that is long enough, paused in each way."""
    sumo_tool("sumo")
    seeds = options.seeds or SEEDS
    folder = Path(options.more.get("cache") or options.more.get("out") or "worlds")
    counts: dict[tuple[str, str, float], Count] = {}
    for seed in seeds:
        world = make_world(seed, [], folder, options.data)
        for number in range(len(world.truths)):
            for way in WAYS:
                for pause in PAUSES if way != WAYS[2] else PAUSES[:1]:
                    _add(counts, world, number, way, pause, options)
        options.say(f"world {seed} ({world.place}): {len(world.truths)} drives")
    return [f for key in sorted(counts) for f in _figures(key, counts[key], seeds_text(seeds))]


def _add(
    counts: dict[tuple[str, str, float], Count], world: World, number: int, way: str,
    pause: float, options: Options,
) -> None:  # fmt: skip
    truth = world.truths[number]
    cut = 0.3 * float(truth.time[-1])
    end = cut + UNSEEN
    _, _, fixes, odometry = sense(world, number, [], options.data)
    if cut < BEFORE or truth.time[-1] < end + AFTER or not len(fixes.time):
        return
    seen = _seen(fixes.time, cut, end, way)
    moments = _later(fixes.time, cut, end, pause)
    columns = {f.name: getattr(fixes, f.name)[seen] for f in fields(fixes)}
    fixes = replace(fixes, **columns | {"time": moments[seen]})
    odometry = _paused(odometry, cut, end, pause, way)
    truth = replace(truth, time=_later(truth.time, cut, end, pause))
    table = table_of(fixes, odometry, world.chart)
    result = whichroad.match(table, world.chart.roads, vehicle=CAR, settings=options.settings())
    said, _ = said_of(result.to_arrow(), truth, world.chart)
    sensors = "with odometry" if odometry else "receiver alone"
    _count(counts.setdefault((sensors, way, pause), Count()), said, cut + pause)


def _seen(time: np.ndarray, cut: float, end: float, way: str) -> np.ndarray:
    return (time > end) | ((time < cut) & (way != WAYS[2]))


def _later(time: np.ndarray, cut: float, end: float, pause: float) -> np.ndarray:
    """Times by the clock, (n,): the unseen part lasts as long as the pause."""
    inside = cut + (time - cut) * (pause / UNSEEN)
    return np.where(time > end, time + pause - UNSEEN, np.where(time > cut, inside, time))


def _paused(
    odometry: dict[str, Any], cut: float, end: float, pause: float, way: str
) -> dict[str, Any]:
    """Odometry less its pause; counters of a car that is carried stand meanwhile."""
    if not odometry:
        return odometry
    time = odometry["time"]
    seen, after = _seen(time, cut, end, way), time > end
    out = {name: np.array(values, float) for name, values in odometry.items()}
    for name in {"left", "right"} & set(out):
        if way == WAYS[1]:
            count = out[name]
            count[after] -= count[after][0] - count[time < cut][-1]
    out["time"] = _later(time, cut, end, pause)
    return {name: values[seen] for name, values in out.items()}


def _count(count: Count, said: scoring.Said, begin: float) -> None:
    right = scoring.right_road(said)
    since = said.time - begin
    about = (since > FOUND[0]) & (since < FOUND[1])
    first = (since > 0.0) & (since < FIRST)
    sure = first & (said.p_top >= DECLARED)
    count.drives += 1
    count.found += int(about.any() and np.mean(right[about]) > 0.5)
    count.declared += int(sure.sum())
    count.wrong += int((sure & ~right).sum())
    count.exceeded += int((np.hypot(*said.error.T) > said.level)[first].sum())
    count.epochs += int(first.sum())


def _figures(key: tuple[str, str, float], count: Count, seeds: str) -> list[Figure]:
    sensors, way, pause = key
    what = f"{sensors}, {way}" + (f", pause of {pause:,.0f} s" if way != WAYS[2] else "")
    goals = ("", "", "") if way == WAYS[2] else (">= 99", "<= 1", "<= 1")
    rows = (
        ("right road 30 s after", count.found, count.drives, 100.0, "%"),
        ("wrong at P >= 0.999, first minute", count.wrong, count.declared, 1e3, "per mille"),
        ("level exceeded, first minute", count.exceeded, count.epochs, 1e3, "per mille"),
    )
    figures = []
    for (name, k, n, times, unit), goal in zip(rows, goals, strict=True):
        low, high = clopper_pearson(k, n) if name.startswith("right") and n else (0.0, 0.0)
        ci = (times * low, times * high) if name.startswith("right") and n else None
        value = times * k / n if n else None
        figures.append(Figure(f"{what}: {name}", value, goal, unit, n, ci, seeds))
    return figures
