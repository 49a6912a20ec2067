"""From a seed to scored drives: world, map, sensors, filter, score."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

import whichroad
from whichroad import Vehicle

from . import online, scoring
from .drivers import Truth, make_drives
from .faults import FAULTS, Event, draw_events, has, suite_of
from .maps import Chart, draw_map
from .nets import EXTRACTS, PLACES, Net, make_net
from .receivers import ANTENNA, Fixes, absent, receive
from .situations import situations
from .told import sound, withhold
from .wheels import PER_TICK, TRACK, count_wheels, measure_distance, measure_yaw

START = 1_780_300_800.0  # s since 1970 UTC
CAR = Vehicle(
    track_width=TRACK, metres_per_tick_left=PER_TICK, metres_per_tick_right=PER_TICK,
    antenna_forward=ANTENNA,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class World:
    """A place, its map, and the cars that drive there."""

    seed: int
    place: str
    net: Net
    chart: Chart
    map_faults: list[Event]
    truths: list[Truth]


@dataclass(frozen=True, slots=True)
class Scored:
    """One drive that was filtered and scored."""

    name: str  # world/drive
    place: str
    suite: str
    events: list[Event]
    decisions: list[scoring.Decision]
    situations: list[frozenset[str]]  # of each decision
    all: scoring.PoseSums
    under: dict[str, scoring.PoseSums]  # epochs under each kind of fault
    alert: float  # s
    at: np.ndarray  # (k, 2) error and level, every tenth second, for the Stanford diagram
    named: tuple[str, ...] = ()  # what `diagnosis` warns of


@dataclass(frozen=True, slots=True)
class Run:
    """A drive with all that pictures need."""

    world: World
    truth: Truth
    fixes: Fixes
    said: scoring.Said
    position: np.ndarray  # (n, 2) m, what the filter said
    scored: Scored


def places(data: Path) -> list[str]:
    """The places that can be driven here: without the real data, the drawn ones."""
    return [p for p in PLACES if p not in EXTRACTS or (data / "maps" / f"{p}.osm.pbf").exists()]


def make_world(seed: int, chosen: list[str] | None, folder: Path, data: Path) -> World:
    """The world of a seed.

    Args:
        seed: Of everything.
        chosen: Faults that it has; None: all, each with its share; empty: none.
        folder: Where nets and drives are kept between runs.
        data: The folder of real data.
    """
    able = places(data)
    place = able[seed % len(able)]
    net, truths = _driven(place, seed, folder, data)
    faults = draw_events(chosen, "map", "", np.inf, np.random.default_rng([seed, 1]))
    chart = draw_map(net, faults, np.random.default_rng([seed, 2]))
    return World(seed, place, net, chart, faults, truths)


@lru_cache(12)  # the classes of a run share their worlds
def _driven(place: str, seed: int, folder: Path, data: Path) -> tuple[Net, list[Truth]]:
    net = make_net(place, seed, folder, data)
    return net, make_drives(net, seed)


def table_of(fixes: Fixes, odometry: dict[str, Any], chart: Chart) -> Any:
    """A drive as the table that whichroad reads."""
    degrees = chart.plane.degrees(np.column_stack([fixes.x, fixes.y]))
    columns = {
        "time": fixes.time, "lat": degrees[:, 1], "lon": degrees[:, 0],
        "cov_ee_m2": fixes.cov[:, 0], "cov_en_m2": fixes.cov[:, 1], "cov_nn_m2": fixes.cov[:, 2],
    }  # fmt: skip
    if np.isfinite(fixes.speed).any():
        columns |= {"speed_mps": fixes.speed, "bearing_deg": fixes.bearing_deg}
    names = {"left": "wheel_rl_ticks", "right": "wheel_rr_ticks", "speed": "speed_mps",
             "yaw": "yaw_rate_radps", "odometer": "odometer_m", "time": "time"}  # fmt: skip
    motion = {names[n]: c for n, c in odometry.items()}
    whole = {}
    for name in {**columns, **motion}:
        no_fix = np.full(len(fixes.time), np.nan)
        no_motion = np.full(len(next(iter(motion.values()), [])), np.nan)
        whole[name] = np.concatenate([columns.get(name, no_fix), motion.get(name, no_motion)])
    order = np.argsort(whole["time"], kind="stable")
    whole["time"] += START
    return pa.table({n: pa.array(c[order], mask=np.isnan(c[order])) for n, c in whole.items()})


def sense(
    world: World,
    number: int,
    chosen: list[str] | None,
    data: Path,
    told: bool = False,
    sensors: str = "",
) -> tuple[str, list[Event], Fixes, dict[str, np.ndarray]]:
    """Sensors of a drive: suite, faults, fixes, odometry.

    Args:
        world: Where it is.
        number: Of the drive.
        chosen: Faults, as of `make_world`.
        data: The folder of real data.
        told: Less what fails, while it does.
        sensors: The suite; nothing: it is drawn.
    """
    truth = world.truths[number]
    wanted = [f for f in chosen or [] if FAULTS[f].part != "map"]
    suite = sensors or suite_of(wanted, np.random.default_rng([world.seed, number, 3]))
    random = np.random.default_rng([world.seed, number, 4])
    length = float(truth.time[-1])
    about = [draw_events(chosen, part, suite, length, random) for part in ("receiver", "odometry")]
    if chosen is None:  # what is drawn is what can be had here
        missing = absent(data)
        about = [[e for e in events if e.name not in missing] for events in about]
    fixes = receive(truth, about[0], suite, data, np.random.default_rng([world.seed, number, 5]))
    random = np.random.default_rng([world.seed, number, 6])
    odometry: dict[str, np.ndarray] = {}
    of_odometry = sound(about[1]) if told else about[1]
    if suite == "wheels":
        odometry = count_wheels(truth, of_odometry, random)
    elif suite == "yaw":
        odometry = measure_yaw(truth, of_odometry, random)
    elif suite == "odometer":
        odometry = measure_distance(truth, of_odometry, random)
    if not told and has(about[1], "zeros"):
        fixes.speed[:] = 0.0
    if told:
        fixes, odometry = withhold(fixes, odometry, [*about[0], *about[1]])
    return suite, [*about[0], *about[1], *world.map_faults], fixes, odometry


def run_drive(
    world: World,
    number: int,
    chosen: list[str] | None,
    data: Path,
    settings: Any = None,
    told: bool = False,
    sensors: str = "",
    lag: str | None = None,
) -> Run | None:
    """Simulate the sensors of a drive, filter and score it; None where nothing was answered."""
    truth = world.truths[number]
    suite, events, fixes, odometry = sense(world, number, chosen, data, told, sensors)
    if not len(fixes.time):
        return None
    table = table_of(fixes, odometry, world.chart)
    if lag == online.ON_LINE:
        result = online.answer(table, world.chart.roads, CAR, settings)
    else:
        result = whichroad.match(table, world.chart.roads, vehicle=CAR, settings=settings, lag=lag)
    said, position = said_of(result.to_arrow(), truth, world.chart)
    if len(said.time) < 100:
        return None
    passed, kinds = situations(world.net, world.chart, truth)
    decisions = scoring.decide(said, passed)
    first = len(passed) - len(decisions)
    counted = scoring.counted(said)
    under = {}
    for name in {e.name for e in events}:
        inside = np.zeros(len(said.time), bool)
        for e in events:
            if e.name == name:
                inside |= scoring.under(said.time, e.begin, e.end)
        under[name] = scoring.pose_sums(said, counted & inside)
    at = np.flatnonzero(counted)[::100]
    scored = Scored(
        f"{world.seed}/{number}", world.place, suite, events, decisions, kinds[first:],
        scoring.pose_sums(said, counted), under, scoring.time_to_alert(said),
        np.column_stack([np.hypot(*said.error[at].T), said.level[at]]),
        tuple(f.what for f in result.diagnosis if f.level == "warning"),
    )  # fmt: skip
    return Run(world, truth, fixes, said, position, scored)


def said_of(points: Any, truth: Truth, chart: Chart) -> tuple[scoring.Said, np.ndarray]:
    """The filter's answer beside the truth, and its positions, (n, 2) m."""
    points = points.filter(pc.is_valid(points["lat"]))
    time = points["time"].cast(pa.int64()).to_numpy() * 1e-6 - START
    n = len(time)
    alternatives = points["alternatives"].combine_chunks()
    flat = alternatives.flatten()
    epoch = np.repeat(np.arange(n), np.asarray(alternatives.value_lengths().fill_null(0)))
    top, p_top = scoring.top_roads(
        epoch, flat.field("edge_id").to_numpy(), flat.field("p").to_numpy(), chart.road_of_edge, n
    )
    position = chart.plane.metres(points["lon"].to_numpy(), points["lat"].to_numpy())
    true = np.column_stack([np.interp(time, truth.time, v) for v in (truth.x, truth.y)])
    row = np.searchsorted(truth.time, time).clip(0, len(truth) - 1)
    cov = np.column_stack([points[f"cov_{c}_m2"].to_numpy() for c in ("ee", "en", "nn")])
    level = points["protection_level_m"].fill_null(0.0).to_numpy()
    lost = np.array([s == "lost" for s in points["status"].to_pylist()])
    said = scoring.Said(
        time, np.interp(time, truth.time, truth.travel), np.interp(time, truth.time, truth.speed),
        chart.road_of_code[truth.code[row]], position - true, cov, level, top, p_top, lost,
    )  # fmt: skip
    return said, position


def run_worlds(
    seeds: range, drives: int | None, chosen: list[str] | None, folder: Path, data: Path,
    settings: Any, say: Callable[[str], None], told: bool = False, sensors: str = "",
    lag: str | None = None,
) -> Iterator[Run]:  # fmt: skip
    """All drives of some worlds, with progress."""
    done = declared = wrong = 0
    for seed in seeds:
        world = make_world(seed, chosen, folder, data)
        left = len(world.truths) if drives is None else drives - done
        for number in range(min(left, len(world.truths))):
            run = run_drive(world, number, chosen, data, settings, told, sensors, lag)
            done += 1
            if run is not None:
                declared += sum(d.declared for d in run.scored.decisions)
                wrong += sum(d.wrong for d in run.scored.decisions)
                yield run
        say(f"world {seed} ({world.place}): {done} drives, {declared:,} declared, {wrong} wrong")
        if done == drives:
            return
