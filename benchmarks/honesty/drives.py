"""Simulate, localize and score drives by number, over all cores, and remember them."""

import hashlib
import sqlite3
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import whichroad
from whichroad import Settings, Vehicle
from whichroad._compile import Records
from whichroad.epochs import Timeline
from whichroad.filter.state import CLOCK, WHEELS
from whichroad.recorded import Recorded, localize_recorded
from whichroad.simulate import SimulationSettings
from whichroad.simulate.scenes import SCENES, Route, Scene, draw_scene
from whichroad.simulate.vectorised import DriveBuffers, Numbers, Truth, new_buffers, simulate_short

from .classes import CLASSES, NOISES, VARIANTS
from .oracle import declares, log_ratio
from .score import Row, new_scratch, score_drive

CHUNK = 250  # drives of one piece of work
_TELLING = {"figures.py", "report.py", "plots.py", "look.py", "__init__.py"}  # change no result


class Task(NamedTuple):
    """Drives `first` to `last` - 1 of one class and noise."""

    name: str
    noise: str
    first: int
    last: int
    settings: tuple[tuple[str, float], ...]  # of the model, other than the defaults

    @property
    def key(self) -> str:
        """What a remembered result is found by."""
        changed = ",".join(f"{k}={v:g}" for k, v in sorted(self.settings))
        return f"{version()} {self.name} {self.noise} {self.first}:{self.last} {changed}"


@cache
def version() -> str:
    """Digest of all code that results depend on: what another version did is not remembered."""
    home = Path(whichroad.__file__).parent
    files = [
        *home.glob("filter/**/*.py"),
        *home.glob("graph/*.py"),
        *home.glob("simulate/**/*.py"),
        *home.glob("roadmap/*.py"),
    ]
    files += [home / "recorded.py", home / "settings.py", *Path(__file__).parent.glob("*.py")]
    parts = [f.name.encode() + f.read_bytes() for f in sorted(files) if f.name not in _TELLING]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


@cache
def scene_of(kind: str, variant: int) -> Scene:
    """One scene of this process."""
    return draw_scene(kind, variant)


@cache
def _buffers() -> DriveBuffers:
    return new_buffers()


class Drive(NamedTuple):
    """One simulated drive; views that the next one overwrites."""

    scene: Scene
    route: Route
    epochs: Records
    truth: Truth
    driven: int  # which of the scene's routes
    mode: int
    buffers: DriveBuffers


def drive(name: str, noise: str, number: int) -> Drive:
    """Simulate drive `number` of a class and noise."""
    kind = CLASSES[name]
    code = list(SCENES).index(kind.scene), list(NOISES).index(noise)
    seed, draw = np.random.SeedSequence([*code, kind.odometry, number]).generate_state(2)
    scene = scene_of(kind.scene, number % VARIANTS)
    driven = int(draw) % len(scene.routes)
    route = scene.routes[driven]
    buffers = _buffers()
    n = simulate_short(route.line, buffers, _numbers(noise), kind.odometry, int(seed))
    epochs = buffers.epochs[:n]
    truth = Truth(*(a[:n] for a in buffers.truth))
    if not kind.doppler:
        epochs.speed_sigma = epochs.course_sigma = np.inf
    mode = WHEELS if kind.odometry else CLOCK
    return Drive(scene, route, epochs, truth, driven, mode, buffers)


@cache
def _numbers(noise: str) -> Numbers:
    return Numbers.of(NOISES[noise])


def localize(one: Drive, settings: Settings, noise: str, poses: bool = False) -> Recorded:
    """The filter's answer."""
    how = NOISES[noise]
    car = Vehicle(
        track_width=how.track_width, metres_per_tick_left=how.metres_per_tick,
        metres_per_tick_right=how.metres_per_tick, antenna_forward=how.antenna_forward,
        antenna_left=how.antenna_left,
    )  # fmt: skip
    timeline = Timeline(one.epochs, one.mode, 0)
    return localize_recorded(one.scene.roads, timeline, vehicle=car, settings=settings, poses=poses)


def work(task: Task) -> np.ndarray:
    """Rows of a task's drives, (drives, columns of `Row`)."""
    settings = Settings(**dict(task.settings))
    row, roads, chances = new_scratch()
    rows = np.empty((task.last - task.first, len(Row._fields)), np.float32)
    for k, number in enumerate(range(task.first, task.last)):
        one = drive(task.name, task.noise, number)
        answer = localize(one, settings, task.noise)
        score_drive(
            row, answer.output.rows, one.truth, np.ascontiguousarray(one.epochs.time),
            one.route.line, one.scene.road_of, one.route.decision, one.route.evaluated_to,
            roads, chances,
        )  # fmt: skip
        rows[k] = row
        if CLASSES[task.name].tested:
            rows[k, -3:] = exact_test(one, NOISES[task.noise])
    return rows


def exact_test(one: Drive, how: SimulationSettings) -> tuple[float, float, float]:
    """The last columns of `Row`."""
    at = np.flatnonzero(one.epochs.has_fix)
    truth, epochs = one.truth, one.epochs
    h = truth.heading[at]
    x = epochs.fix[at, 0] - how.antenna_forward * np.cos(h) + how.antenna_left * np.sin(h)
    y = epochs.fix[at, 1] - how.antenna_forward * np.sin(h) - how.antenna_left * np.cos(h)
    went = np.diff(truth.travelled[at], prepend=truth.travelled[at[0]]) > 0.01
    moving = np.cumsum(np.diff(epochs.time[at], prepend=epochs.time[at[0]]) * went)
    ratio = log_ratio(one.scene, one.driven, x, y, moving, one.buffers.drawn, how)
    along = one.route.line.along[truth.place[at]]
    after = (along >= one.route.decision) & (along <= one.route.evaluated_to)
    declared, wrong, when = declares(ratio, after)
    seconds = epochs.time[at[when]] - epochs.time[at[np.argmax(after)]] if declared else 0.0
    return declared, wrong, seconds


@dataclass
class Memory:
    """Results of earlier runs, in one SQLite file (None: none are kept)."""

    path: Path | None

    def __post_init__(self) -> None:
        self.base = sqlite3.connect(self.path or ":memory:")
        self.base.execute("create table if not exists work (key text primary key, rows blob)")

    def get(self, task: Task) -> np.ndarray | None:
        """Rows of a task that was done."""
        found = self.base.execute("select rows from work where key = ?", (task.key,)).fetchone()
        if found is None:
            return None
        return np.frombuffer(found[0], np.float32).reshape(-1, len(Row._fields))

    def put(self, task: Task, rows: np.ndarray) -> None:
        """Remember them."""
        with self.base:
            self.base.execute(
                "insert or replace into work values (?, ?)", (task.key, rows.tobytes())
            )


def tasks(
    name: str, noise: str, seeds: range, settings: dict[str, float], chunk: int = CHUNK
) -> Iterator[Task]:
    """Cut the drives of a class into pieces."""
    for first in range(seeds.start, seeds.stop, chunk):
        last = min(first + chunk, seeds.stop)
        yield Task(name, noise, first, last, tuple(sorted(settings.items())))


def spread(
    todo: list[Task], memory: Memory, processes: int, say: Callable[[str], None]
) -> dict[Task, np.ndarray]:
    """Do all tasks that are not remembered, and tell how it goes."""
    done = {t: rows for t in todo if (rows := memory.get(t)) is not None}
    missing = [t for t in todo if t not in done]
    total = sum(t.last - t.first for t in missing)
    if done:
        say(f"{len(done)} of {len(todo)} pieces are known already")
    began, count, told = time.perf_counter(), 0, 0.0
    for task, rows in _results(missing, processes):
        memory.put(task, rows)
        done[task] = rows
        count += task.last - task.first
        passed = time.perf_counter() - began
        if passed > told + 5.0 or count == total:
            told = passed
            left = (total - count) * passed / count
            say(
                f"{count:,} of {total:,} drives, {count / passed:,.0f} a second, "
                f"{left:,.0f} s to go: {task.name} {task.noise}"
            )
    return done


def _results(missing: list[Task], processes: int) -> Iterator[tuple[Task, np.ndarray]]:
    if processes == 1 or len(missing) < 2:
        for task in missing:
            yield task, work(task)
        return
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        running: dict[Future[Any], Task] = {pool.submit(work, t): t for t in missing}
        left = set(running)
        while left:
            ready, left = wait(left, return_when="FIRST_COMPLETED")
            for future in ready:
                yield running[future], future.result()
