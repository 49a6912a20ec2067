"""A run: trips to files, by processes, unit by unit; what is there is done."""

import hashlib
import json
import multiprocessing
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any, NamedTuple

from ..batch.batches import cores, is_folder
from ..errors import DriveError, ReadError, SettingError, WriteError
from ..evidence.sensed import checked
from ..lookback.smoothing import Lag
from ..places.place_table import read_places
from ..readers import read_vehicle
from ..readers.dates import Writing
from ..readers.many_trips import own_names
from ..readers.names import find
from ..readers.ordered_trips import ordered_batches
from ..readers.reading import Reading
from ..readers.splitting import seconds_of
from ..readers.table_units import open_columns
from ..readers.trip_units import KnownUnits, first_units
from ..readers.zone_notes import zone_note_of
from ..roadmap import RoadMap, RoadMaps, left_out, open_map, shared_maps
from ..roadmap.store import is_compiled
from ..sensors import Sensor
from ..settings import Settings, Vehicle
from . import manifest
from .bad_trips import write_bad
from .inputs import Inputs, check_readable, inputs_of
from .sources import can_stay
from .staging import stage
from .work import NOTHING, Done, Task, done_before, run_unit, sweep
from .work_units import UNIT_ROWS, Unit, batches_of, plan, rows_of

_WORK = ".work"  # folder of what is needed until the end
_AHEAD = 4  # units that wait for each worker


class Progress(NamedTuple):
    """How far a run is."""

    done: Done  # of all units so far
    rows: int  # of all units
    rows_per_s: float  # of this run
    seconds_left: float


class Summary(NamedTuple):
    """What became of all trips."""

    out: Path
    done: Done
    units: int
    units_before: int  # that were there when the run began
    seconds: float
    note: str | None = None  # on times that name no zone
    bad: int = 0  # trips in the table of bad ones
    map_left_out: Mapping[str, int] = {}  # rows of a table of roads, by reason


def run_fleet(
    trips: str | Path | Sequence[str | Path],
    map: str | Path,
    out: str | Path,
    *,
    trip_id: str = "drive_id",
    split: str | float | None = None,
    order: str = "any",
    points: str = "none",
    vehicle: Vehicle | str | Path | None = None,
    settings: Settings | None = None,
    lag: Any = None,
    crs: Any = None,
    columns: Mapping[str, str] | None = None,
    tz: str | None = None,
    dates: str | None = None,
    sensors: Sequence[Sensor] = (),
    places: str | Path | None = None,
    workers: int | None = None,
    memory: str = "256MB",
    resume: bool = False,
    unit_rows: int = UNIT_ROWS,
    progress: Callable[[Progress], None] | None = None,
) -> Summary:
    """Match all trips of files into a folder: `path`, `drives`, perhaps `points`, `manifest.json`.

    Args:
        trips: Files, folders (also partitioned), patterns: Parquet, GeoParquet, Arrow, CSV; or
            a query of DuckDB that begins with SELECT, FROM or WITH.
        map: A compiled map, or a folder of them; another map is compiled first.
        out: The folder.
        trip_id: The column that names trips; the default finds its usual aliases.
        split: As in `match_many`.
        order: "any": rows are sorted by DuckDB.  "sorted": all rows of a trip lie together,
            which is checked.
        points: "none", "slim" (no poses) or "all".
        vehicle: Of all trips.
        settings: The model's numbers.
        lag: As in `match`.
        crs: Reference system of `x, y` columns.
        columns: Own names of columns, as in `match_many`.
        tz: Zone of times that name none, e.g. "Europe/Berlin"; None: UTC.
        dates: "mdy", "dmy" or "ymd": the order in dates such as 06/01/2026 and 010626.
        sensors: Further sensors (`whichroad.sensors`), whose columns are in the files.
        places: Path of a table of point objects: `ahead` and `nearby` have those within 500 m
            ahead and within 50 m, at each epoch.
        workers: Processes; None: one for each core this process may use.
        memory: Of the sort; what is beyond goes to the folder `out`.
        resume: Go on with the run that the folder holds.
        unit_rows: Rows of a unit of work, about.
        progress: Called after each unit.

    Raises:
        ReadError: The trips cannot be read, or are not in the order that was claimed.
        MapError: The map is not one.
        SettingError: An argument is out of bounds, or duckdb is missing.
        WriteError: The folder holds a run, or one that was asked for otherwise.
        DriveError: No trip could be answered.
    """
    began = time.monotonic()
    _check(order, points, workers)
    own, trip_id = own_names(columns, trip_id)
    Writing.of(tz, dates)
    if places is not None:
        if is_folder(map):
            raise SettingError(f"{map}: places are read for one map, and this is a folder of them")
        read_places(places)
    folder = Path(out)
    inputs = inputs_of([trips] if isinstance(trips, str | Path) else trips)
    if isinstance(vehicle, str | Path):
        vehicle = read_vehicle(vehicle)
    held = manifest.read(folder)
    if held is not None and not resume:
        raise WriteError(
            f"{folder}: it holds a run already; an empty folder was expected; choose another, or "
            "go on with it by --resume"
        )
    if held is None and any(folder.glob("drives/*.parquet")):
        raise WriteError(f"{folder}: it holds tables without a manifest; choose an empty folder")
    tables = ["points"] * (points != "none") + ["ahead", "nearby"] * (places is not None)
    if held is None:
        _make(folder, tables)
    compiled, roads = _compiled(map, folder, crs)
    Lag.of(lag)
    task = Task(
        str(compiled), str(folder.resolve()), trip_id, points, vehicle, settings, lag, crs,
        seconds_of(split), checked(sensors), None if places is None else str(places),
        own, tz, dates,
    )  # fmt: skip
    now = manifest.asked(task, inputs, order, roads.identity)
    if held is not None:
        manifest.check_same(folder, held[0], now)
        _make(folder, tables)
    if isinstance(roads, RoadMap) and compiled.parent == folder.resolve() / _WORK:
        roads.save(compiled)
    sweep(task)
    size = workers or cores()
    units = _units(folder, inputs, now, held and held[1], task, memory, size, unit_rows)
    waiting = [unit for unit in units if not task.is_done(unit)]
    note = _zone_note(task, waiting)
    task = task._replace(units=_column_units(task, units)) if waiting else task
    done = NOTHING
    for unit in units:
        if task.is_done(unit):
            done = done.plus(done_before(task, unit))
    done = _all(task, units, waiting, done, min(size, len(waiting)), progress)
    bad = write_bad(folder)
    shutil.rmtree(folder / _WORK, ignore_errors=True)
    if not done.answered:
        reason = next((reason for reason, _ in done.reasons.most_common(1)), "there is no trip")
        raise DriveError(
            f"{folder}: none of {done.trips:,} trips could be answered; trips on the roads of the "
            f"map were expected; the most usual reason: {reason}"
        )
    seconds = time.monotonic() - began
    before, rows = len(units) - len(waiting), {}
    if isinstance(roads, RoadMap):
        rows = left_out(map, roads)
    return Summary(folder, done, len(units), before, seconds, note, bad, rows)


def _check(order: str, points: str, workers: int | None) -> None:
    """Refuse what an argument may not be.

    Raises:
        SettingError: It is that.
    """
    for name, value, known in (
        ("order", order, ("any", "sorted")),
        ("points", points, ("none", "slim", "all")),
    ):
        if value not in known:
            raise SettingError(f"{name} is {value!r}; one of {', '.join(known)} was expected")
    if workers is not None and workers < 1:
        raise SettingError(f"workers is {workers}; at least 1 was expected")


def _make(folder: Path, tables: Sequence[str]) -> None:
    """The folders of a run.

    Raises:
        WriteError: They cannot be made.
    """
    try:
        for name in (_WORK, "path", "drives", *tables):
            (folder / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError(
            f"{folder}: cannot be made ({error.strerror}); a folder that can be written to was "
            "expected; choose another"
        ) from None


def _compiled(map: str | Path, folder: Path, crs: Any) -> tuple[Path, RoadMap | RoadMaps]:
    """The path that a compiled map or a folder of them has or will have, and the map or maps."""
    if is_folder(map):
        return Path(map).resolve(), shared_maps(Path(map))
    path, roads = Path(map), open_map(map, crs=crs)
    if not is_compiled(path):
        path = folder / _WORK / "compiled.map"
    return path.resolve(), roads


def _units(
    folder: Path, inputs: Inputs, now: dict[str, Any], held: list[Unit] | None, task: Task,
    memory: str, threads: int, unit_rows: int,
) -> list[Unit]:  # fmt: skip
    """The units of a run: those of the manifest, else planned and written there."""
    missing = held and [unit for unit in held if not task.is_done(unit)]
    if held and not missing:
        return held
    own = task.own_columns()
    check_readable(inputs)
    if now["order"] == "sorted" and can_stay(inputs, task.trip_id, own):
        files = [path.resolve() for path in inputs.files["parquet"]]
    else:
        text = json.dumps([now["inputs"], now["trip_id"], now["order"], own, task.tz, now["crs"]])
        key = hashlib.sha256(text.encode()).hexdigest()[:16]
        staged = folder.resolve() / _WORK / f"rows-{key}.parquet"
        if not staged.exists():
            ordered = now["order"] == "sorted"
            stage(
                inputs, staged, task.trip_id, ordered=ordered, memory=memory, threads=threads,
                own=own, tz=task.tz, crs=task.crs,
            )  # fmt: skip
        files = [staged]
    if held:
        return held
    if threads > 1 and rows_of(files) > unit_rows:
        _start_processes()  # what they import takes as long as planning
    units = plan(files, task.trip_id, unit_rows, own)
    if not units:
        raise ReadError("trips: there is no row in them; rows with a drive_id were expected")
    manifest.write(folder, now, units)
    return units


def _zone_note(task: Task, waiting: list[Unit]) -> str | None:
    """What to say where times name no zone, and the caller has named none."""
    if task.tz is not None or not waiting:
        return None
    own = task.own_columns()
    rows = (batch for unit in waiting for batch in batches_of(unit, task.trip_id, own))
    return zone_note_of(rows, own)


def _column_units(task: Task, units: list[Unit]) -> KnownUnits:
    """The units of columns that name none, by the first trips of all."""
    own = task.own_columns()
    first = next(batches_of(units[0], task.trip_id, own), None)
    if first is None or not open_columns(find(first.schema.names, own)):
        return {}
    reading = Reading.of(
        task.vehicle, task.settings, crs=task.crs, columns=own, tz=task.tz, dates=task.dates
    )
    rows = (batch for unit in units for batch in batches_of(unit, task.trip_id, own))
    trips = ordered_batches(rows, task.trip_id, split=task.split, own=own, written=reading.written)
    return first_units(trips, reading)


def _all(
    task: Task, units: list[Unit], waiting: list[Unit], done: Done, workers: int,
    progress: Callable[[Progress], None] | None,
) -> Done:  # fmt: skip
    """Run the units that are not there, and sum what became of all."""
    rows, began, before = sum(unit.rows for unit in units), time.monotonic(), done.rows
    runs = _here(task, waiting) if workers < 2 else _by_processes(task, waiting, workers)
    with closing(runs):  # at once, whatever ends it
        for one in runs:
            done = done.plus(one)
            if progress:
                rate = (done.rows - before) / max(time.monotonic() - began, 1e-9)
                progress(Progress(done, rows, rate, (rows - done.rows) / rate))
    return done


def _here(task: Task, units: list[Unit]) -> Generator[Done, None, None]:
    return (run_unit(task, unit) for unit in units)


def _context() -> Any:
    """How processes are made: by one that has imported what they need, where there is that."""
    methods = multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
    if hasattr(context, "set_forkserver_preload"):
        # Arrow loads pandas, where there is one, with its first array: once for all workers
        context.set_forkserver_preload(["whichroad.fleet.work", "pandas"])
    return context


def _start_processes() -> None:
    """Let the process import that makes the others, beside this one."""
    if _context().get_start_method() == "forkserver":
        from multiprocessing import forkserver

        with _unheard():
            forkserver.ensure_running()


@contextmanager
def _unheard() -> Iterator[None]:
    """Processes that begin here never hear Ctrl-C, which a terminal sends to all of a run.

    This one hears it at the end, when it knows of all that it has begun.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    heard: list[int] = []
    usual = signal.getsignal(signal.SIGINT)
    late = callable(usual) and threading.current_thread() is threading.main_thread()
    if late:  # another thread may take the signal for this one
        signal.signal(signal.SIGINT, lambda number, frame: heard.append(number))
    resource_tracker.ensure_running()  # it would lift the block
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if late:
            signal.signal(signal.SIGINT, usual)
        if heard:
            signal.raise_signal(signal.SIGINT)


def _by_processes(task: Task, units: list[Unit], workers: int) -> Generator[Done, None, None]:
    """Units by processes, each with the map mapped; few of them wait."""
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, mp_context=_context(), initializer=_begin)
    running = set()
    try:
        left = iter(units)
        for unit in left:
            with _unheard():  # the first ones start the workers
                running.add(pool.submit(run_unit, task, unit))
            if len(running) >= _AHEAD * workers:
                first = next(as_completed(running))
                running.remove(first)
                yield first.result()
        for future in as_completed(running):
            yield future.result()
    except BrokenProcessPool:
        raise WriteError(
            f"{task.out}: a worker ended before its work (killed, or out of memory); all units "
            "that are there stay; go on by --resume, with fewer --workers where memory is short"
        ) from None
    except (KeyboardInterrupt, GeneratorExit):  # nobody waits for what was begun
        for worker in set(multiprocessing.active_children()) - others:
            worker.terminate()
            worker.join()
        sweep(task)
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _begin() -> None:
    """Of a worker: the parent alone hears Ctrl-C, and a worker ends when its parent has."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os.kill(os.getpid(), signal.SIGTERM)
