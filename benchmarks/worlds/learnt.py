"""Errors of receivers and maps that nobody told the filter: are ellipse and level true?

The drives are those of `worlds`, their receivers and maps are drawn anew here.  Receivers alone
stand in canyons of three strengths and report sigmas one to three times too small.  Maps are off
as a whole by 0.5 to 30 m.  Phones report fixes seldom, with an accuracy of unknown worth.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

import whichroad

from .. import Figure, Options, seeds_text
from ..exact_bounds import clopper_pearson, upper_bound
from . import scoring
from .drivers import Truth
from .drives import CAR, World, make_world, said_of, table_of
from .maps import draw_map
from .nets import sumo_tool
from .receivers import ANTENNA, Fixes, receive
from .situations import situations
from .wheels import count_wheels

SEEDS = range(3)
FAR = 3000.0  # m of travel, beyond which something has been learnt
CANYONS = (4.0, 8.0, 12.0)  # m, slow error of each axis
OFFSETS = (0.5, 4.0, 15.0, 30.0)  # m, of a map as a whole
CANYON_TIME = 30.0  # s, for which the slow error lasts


@dataclass
class Sums:
    """Of the pose, over epochs."""

    epochs: int = 0
    inside: int = 0
    exceeded: int = 0
    right: int = 0
    nees: float = 0.0
    levels: list[float] = field(default_factory=list)

    def add(self, said: scoring.Said, which: np.ndarray) -> None:
        """Add some epochs of a drive, (n,) bool."""
        sums = scoring.pose_sums(said, which)
        if sums.epochs:
            self.epochs += sums.epochs
            self.inside += sums.inside
            self.exceeded += sums.exceeded
            self.right += sums.right
            self.nees += sums.nees
            self.levels.append(sums.level)


@dataclass
class Count:
    """Sums over epochs of drives: all that count, and those beyond 3 km."""

    drives: int = 0
    all: Sums = field(default_factory=Sums)
    far: Sums = field(default_factory=Sums)
    declared: int = 0
    wrong: int = 0
    decisions: int = 0


def gauss_markov(time: np.ndarray, lasts: float, random: np.random.Generator) -> np.ndarray:
    """A process of unit variance that is forgotten in `lasts` seconds, (n, 2)."""
    kept = np.exp(-np.diff(time, prepend=time[0] - 1e3 * lasts) / lasts)
    fresh = np.sqrt(1.0 - kept**2)[:, None] * random.normal(size=(len(time), 2))
    out = np.empty_like(fresh)
    last = np.zeros(2)
    for k in range(len(time)):
        last = kept[k] * last + fresh[k]
        out[k] = last
    return out


def in_canyon(truth: Truth, slow: float, random: np.random.Generator, data: Path) -> Fixes:
    """Fixes in a canyon, positions alone; the reported sigma is one to three times too small."""
    fixes = receive(truth, [], "fixes", data, random)
    at = _antenna(truth, fixes.time)
    white = 1.0 + 0.25 * slow
    error = slow * gauss_markov(fixes.time, CANYON_TIME, random)
    error += white * random.normal(size=error.shape)
    sigma = np.hypot(slow, white) / random.uniform(1.0, 3.0)
    return _with(fixes, at + error, sigma)


def by_phone(truth: Truth, random: np.random.Generator, data: Path) -> Fixes:
    """Fixes of a phone: 1 to 30 s apart, its accuracy 0.5 to 3 times right, and its habits.

    Speed and course lag and have holes; at times it says speed 0, and some fixes are those of
    the mobile network.  Some phones draw their fixes towards the road.
    """
    fixes = receive(truth, [], "gnss", data, random)
    slow = float(np.exp(random.uniform(np.log(3.0), np.log(12.0))))
    error = slow * gauss_markov(fixes.time, float(random.uniform(20.0, 90.0)), random)
    error += 0.3 * slow * random.normal(size=error.shape)
    at = _antenna(truth, fixes.time)
    snaps = random.random() < 0.15  # it draws its fixes some of the way to the road
    at = at + error * random.uniform(0.3, 0.7, (1, 2)) if snaps else at + error
    out = _with(fixes, at, 1.045 * slow / np.exp(random.uniform(np.log(0.5), np.log(3.0))))
    late = np.interp(fixes.time - random.uniform(0.5, 2.0), fixes.time, fixes.speed)
    speed = np.where(random.random(len(late)) < 0.1, np.nan, np.abs(late))
    zeros = random.random(len(late)) < random.choice([0.0, 0.05])
    speed = np.where(zeros, 0.0, speed)
    bearing = np.where(np.isnan(speed) | zeros, np.nan, np.roll(fixes.bearing_deg, 1))
    reports = random.random() < 0.7
    out = replace(out, speed=speed if reports else np.full(len(late), np.nan),
                  bearing_deg=bearing if reports else np.full(len(late), np.nan))  # fmt: skip
    every = np.exp(random.uniform(0.0, np.log(30.0)))
    due = np.floor((fixes.time - fixes.time[0]) / every)
    keep = np.concatenate([[True], np.diff(due) > 0])
    keep &= random.random(len(keep)) > 0.05
    out = replace(out, **{f.name: getattr(out, f.name)[keep] for f in fields(out)})
    cell = random.random(len(out.time)) < random.choice([0.0, 0.02])
    far = random.normal(0.0, 300.0, (len(out.time), 2))
    out.x[cell] += far[cell, 0]
    out.y[cell] += far[cell, 1]
    out.cov[cell] = np.array([500.0**2, 0.0, 500.0**2])
    return out


def _antenna(truth: Truth, time: np.ndarray) -> np.ndarray:
    heading = np.interp(time, truth.time, truth.heading)
    return np.column_stack(
        [
            np.interp(time, truth.time, v) + ANTENNA * f(heading)
            for v, f in ((truth.x, np.cos), (truth.y, np.sin))
        ]
    )


def _with(fixes: Fixes, at: np.ndarray, sigma: float) -> Fixes:
    cov = np.tile([sigma**2, 0.0, sigma**2], (len(at), 1))
    return replace(fixes, x=at[:, 0], y=at[:, 1], cov=cov)


Case = Callable[[World, int, np.random.Generator, Options], tuple[Any, Truth, Any]]


def _alone(make: Callable[..., Fixes], *args: float | str) -> Case:
    """A receiver alone on a sound map."""

    def case(world: World, number: int, random: np.random.Generator, options: Options) -> Any:
        truth = world.truths[number]
        fixes = make(truth, *args, random, options.data)
        return table_of(fixes, {}, world.chart), truth, world.chart

    return case


def _honest(truth: Truth, suite: str, random: np.random.Generator, data: Path) -> Fixes:
    return receive(truth, [], suite, data, random)


_charts: dict[tuple[int, float], Any] = {}


def _off(metres: float, too_small: float = 1.0, relative: float = 1.0) -> Case:
    """Wheels and a sound receiver on a map that is off as a whole."""

    def case(world: World, number: int, random: np.random.Generator, options: Options) -> Any:
        truth = world.truths[number]
        key = (world.seed, metres)
        if key not in _charts:
            if len(_charts) > 8:
                _charts.clear()
            drawn = np.random.default_rng([world.seed, 7, int(10 * metres)])
            _charts[key] = draw_map(world.net, [], drawn, offset=metres, relative=relative)
        fixes = receive(truth, [], "wheels", options.data, random)
        fixes = replace(fixes, cov=fixes.cov / too_small**2)
        chart = _charts[key]
        return (
            table_of(fixes, count_wheels(truth, [], random), chart),
            truth,
            chart,
        )

    return case


CASES: dict[str, tuple[Case, dict[str, str]]] = {
    "fixes alone, honest": (_alone(_honest, "fixes"), {}),
    "fixes with speed and course, honest": (_alone(_honest, "gnss"), {}),
    **{
        f"fixes alone, canyon of {s:.0f} m": (
            _alone(in_canyon, s),
            {"inside": ">= 90", "inside far": "90..99"},
        )
        for s in CANYONS
    },
    "phone": (_alone(by_phone), {"wrong": "<= 1"}),
    **{
        f"map {m:g} m off": (
            _off(m, relative=0.3 if m == 0.5 else 1.0),
            {"ANEES far": "0.65..1.4"}
            | ({"level far": "<= 6", "exceeded far": "<= 1"} if m == 0.5 else {}),
        )
        for m in OFFSETS
    },
    **{
        f"map {m:g} m off, sigma two times too small": (
            _off(m, 2.0, 0.3 if m == 0.5 else 1.0),
            {"ANEES far": "<= 1.6", "exceeded far": "<= 2"},
        )
        for m in OFFSETS
    },
}


def run(options: Options) -> list[Figure]:
    """Every drive of the worlds in every case; `parts` chooses those whose names begin so."""
    sumo_tool("sumo")
    seeds = options.seeds or SEEDS
    folder = Path(options.more.get("cache") or options.more.get("out") or "worlds")
    folder.mkdir(parents=True, exist_ok=True)
    parts = tuple(str(options.more.get("parts") or "").split(","))
    counts = {name: Count() for name in CASES if name.startswith(parts)}
    for seed in seeds:
        world = make_world(seed, [], folder, options.data)
        for number in range(len(world.truths)):
            for name in CASES:
                if name in counts:
                    random = np.random.default_rng([seed, number, 8, zlib.crc32(name.encode())])
                    _add(counts[name], world, number, CASES[name][0], random, options)
        options.say(f"world {seed} ({world.place}): {len(world.truths)} drives")
    pooled = [c for n, c in counts.items() if "canyon" in n]
    figures = [f for n, c in counts.items() for f in _figures(n, c, CASES[n][1], seeds)]
    return figures + (_pooled(pooled, seeds) if pooled else [])


def _add(
    count: Count, world: World, number: int, case: Case, random: np.random.Generator,
    options: Options,
) -> None:  # fmt: skip
    table, truth, chart = case(world, number, random, options)
    if len(table) < 10:
        return
    result = whichroad.match(table, chart.roads, vehicle=CAR, settings=options.settings())
    said, _ = said_of(result.to_arrow(), truth, chart)
    counted = scoring.counted(said)
    if not counted.any():
        return
    count.drives += 1
    count.all.add(said, counted)
    count.far.add(said, counted & (said.travel > FAR))
    passed, _ = situations(world.net, chart, truth)
    for decision in scoring.decide(said, passed):
        count.decisions += 1
        count.declared += decision.declared
        count.wrong += decision.wrong


def _figures(name: str, count: Count, goals: dict[str, str], seeds: range) -> list[Figure]:
    text = seeds_text(seeds)
    out = []
    for part, sums in (("", count.all), (" far", count.far)):
        if not sums.epochs:
            continue
        where = " beyond 3 km" if part else ""
        rows = (
            ("inside", "in the 95 % ellipse", 100.0 * sums.inside / sums.epochs, "%"),
            ("ANEES", "ANEES", sums.nees / sums.epochs / 2.0, ""),
            ("exceeded", "level exceeded", 1e3 * sums.exceeded / sums.epochs, "per mille"),
            ("level", "median level", float(np.median(sums.levels)), "m"),
            ("right", "right road", 100.0 * sums.right / sums.epochs, "%"),
        )
        for key, what, value, unit in rows:
            out.append(
                Figure(f"{name}: {what}{where}", value, goals.get(key + part, ""), unit,
                       sums.epochs, None, text)
            )  # fmt: skip
    return out + _declarations(name, count.declared, count.wrong, count.decisions, goals, text)


def _declarations(
    name: str, declared: int, wrong: int, decisions: int, goals: dict[str, str], text: str
) -> list[Figure]:
    low, high = clopper_pearson(wrong, max(declared, 1))
    return [
        Figure(f"{name}: declared", 100.0 * declared / max(decisions, 1), "", "%", decisions,
               None, text),
        Figure(f"{name}: wrong at P >= 0.999", 1e3 * wrong / max(declared, 1),
               goals.get("wrong", ""), "per mille", declared, (1e3 * low, 1e3 * high), text),
        Figure(f"{name}: upper bound of it", 1e3 * upper_bound(wrong, max(declared, 1)), "",
               "per mille", declared, None, text),
    ]  # fmt: skip


def _pooled(counts: list[Count], seeds: range) -> list[Figure]:
    text = seeds_text(seeds)
    epochs = max(sum(c.all.epochs for c in counts), 1)
    inside = sum(c.all.inside for c in counts)
    exceeded = sum(c.all.exceeded for c in counts)
    return [
        Figure("canyons together: in the 95 % ellipse", 100.0 * inside / epochs, "90..98", "%",
               epochs, None, text),
        Figure("canyons together: level exceeded", 1e3 * exceeded / epochs, "<= 3", "per mille",
               epochs, None, text),
        *_declarations(
            "canyons together", sum(c.declared for c in counts), sum(c.wrong for c in counts),
            sum(c.decisions for c in counts), {"wrong": "<= 2"}, text,
        ),
    ]  # fmt: skip
