"""One unit of work: its trips matched, and one file for each table, written beside and renamed."""

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from ..batch.batches import MAPS_SCHEMAS, SCHEMAS, is_folder, job_of, match_tables, slim
from ..errors import WriteError
from ..evidence.sensed import columns_of
from ..places import Places
from ..readers.trip_units import KnownUnits
from ..roadmap import shared_map
from ..sensors import Sensor
from ..settings import Settings, Vehicle
from ..tables.provenance import with_map
from ..tables.relative_places import relative_schema
from ..writers.parquet import repeating, schema_of, spatial
from .work_units import Unit, batches_of

SCHEMA_KEY, SCHEMA_VERSION = b"whichroad_schema", b"1"
_GROUP = 1 << 16  # rows of a row group of points
_LEVEL = 1  # of zstd


class Task(NamedTuple):
    """What all units share; it travels to processes."""

    map: str
    out: str
    trip_id: str
    points: str  # none, slim, all
    vehicle: Vehicle | None
    settings: Settings | None
    lag: Any
    crs: Any
    split: float | None
    sensors: tuple[Sensor, ...] = ()
    places: str | None = None  # path of a table of point objects
    columns: Mapping[str, str | int] = {}  # own names
    tz: str | None = None  # of times that name no zone
    dates: str | None = None  # mdy, dmy or ymd, of dates such as 06/01/2026
    units: KnownUnits = {}  # noqa: RUF012 - of columns that name none

    def folder(self, table: str) -> Path:
        """Where the files of a table go."""
        return Path(self.out) / table

    def own_columns(self) -> dict[str, str | int]:
        """Own names of columns, and the columns that the sensors read, as `Job.own_columns`."""
        return {**self.columns, **columns_of(self.sensors)}

    @property
    def tables(self) -> dict[str, str]:
        """Folders that are written, and the schema of each; that of drives is the last."""
        points = {} if self.points == "none" else {"points": self.points}
        kinds = {"slim": "slim", "all": "points"}
        about = {} if self.places is None else {"ahead": "ahead", "nearby": "nearby"}
        return {**{k: kinds[v] for k, v in points.items()}, **about, "path": "path",
                "drives": "drives"}  # fmt: skip

    def is_done(self, unit: Unit) -> bool:
        """Whether all files of a unit are there: drives are renamed after the others."""
        return (self.folder("drives") / f"{unit.name}.parquet").exists()


class Done(NamedTuple):
    """What became of the trips of a unit."""

    unit: str
    rows: int
    trips: int
    answered: int
    fixes: int
    epochs: int
    path_m: float
    reasons: Counter[str]  # of trips without an answer
    skipped: Counter[str]  # rows
    noted: Counter[str]  # trips

    def plus(self, other: "Done") -> "Done":
        """Both together."""
        return Done(
            "", self.rows + other.rows, self.trips + other.trips, self.answered + other.answered,
            self.fixes + other.fixes, self.epochs + other.epochs, self.path_m + other.path_m,
            self.reasons + other.reasons, self.skipped + other.skipped, self.noted + other.noted,
        )  # fmt: skip


NOTHING = Done("", 0, 0, 0, 0, 0, 0.0, Counter(), Counter(), Counter())


def run_unit(task: Task, unit: Unit) -> Done:
    """Match the trips of a unit and write their tables.

    Raises:
        ReadError: Its rows cannot be read.
        WriteError: A file cannot be written.
    """
    give = frozenset(task.tables) | {"drives"}
    job = job_of(
        task.map, task.vehicle, task.settings, task.lag, False, task.crs, give,
        split=task.split is not None, columns=task.columns, tz=task.tz, dates=task.dates,
    )  # fmt: skip
    about = None if task.places is None else _places(task.places, task.map)
    job = job.with_more(task.sensors, about)
    identity = job.identity
    rows = batches_of(unit, task.trip_id, task.own_columns())
    last = [name for name in task.tables if name != "points"]  # drives say that the unit is done
    parts: dict[str, list[pa.Table]] = {name: [] for name in last}
    with ExitStack() as files:
        points = None
        if "points" in task.tables:
            points = files.enter_context(_growing(task, "points", unit.name, identity))
        for tables in match_tables(
            rows, job, task.trip_id, task.split, ordered=True, units=task.units
        ):
            if points is not None:
                points(slim(tables.points) if task.points == "slim" else tables.points)
            for name in last:
                parts[name].append(getattr(tables, name))
    for name in last:
        with ExitStack() as files:
            write = files.enter_context(_growing(task, name, unit.name, identity, about))
            for part in [pa.concat_tables(parts[name])] if parts[name] else []:
                write(part)
    return told(unit.name, unit.rows, pa.concat_tables(parts["drives"]))


@lru_cache(maxsize=2)
def _places(table: str, roads: str) -> Places:
    """The places of a run, read once in each process."""
    return Places(table, shared_map(roads))


@contextmanager
def _growing(
    task: Task, name: str, unit: str, identity: dict[str, Any], about: Places | None = None
) -> Iterator[Any]:
    """A function that writes parts of a table to the file of a unit, whole at the end."""
    path = task.folder(name) / f"{unit}.parquet"
    kind = task.tables[name]
    schemas = MAPS_SCHEMAS if is_folder(task.map) else SCHEMAS
    columns = schemas[kind] if kind in schemas else relative_schema(about)
    empty = with_map(columns.empty_table(), identity)
    schema = schema_of(empty, bounds=False)
    schema = schema.with_metadata({**schema.metadata, SCHEMA_KEY: SCHEMA_VERSION})
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with pq.ParquetWriter(
            beside, schema, compression="zstd", compression_level=_LEVEL,
            use_dictionary=repeating(schema),
        ) as file:  # fmt: skip
            yield lambda part: file.write_table(
                pa.Table.from_arrays(spatial(part).columns, schema=schema), _GROUP
            )
        os.replace(beside, path)
    except OSError as error:
        raise WriteError(
            f"{path}: cannot be written ({error.strerror or error}); a folder with space left was "
            "expected; run again with --resume"
        ) from error
    finally:
        beside.unlink(missing_ok=True)


def sweep(task: Task) -> None:
    """Remove the files that a run left half-written when it was killed."""
    for folder in (Path(task.out), *map(task.folder, task.tables)):
        for path in folder.glob(".*.[0-9]*"):
            path.unlink(missing_ok=True)


def told(unit: str, rows: int, drives: pa.Table) -> Done:
    """What a table of drives says of all of them."""
    reasons: Counter[str] = Counter()
    skipped: Counter[str] = Counter()
    noted: Counter[str] = Counter()
    answered = drives["answered"].to_pylist()
    for good, name, reason in zip(
        answered, drives["drive_id"].to_pylist(), drives["reason"].to_pylist(), strict=True
    ):
        if not good:
            reasons[kind_of(str(reason), str(name))] += 1
    for counts in drives["skipped"].to_pylist():
        for what, count in counts or ():
            skipped[what] += count
    for notes in drives["notes"].to_pylist():
        noted.update(notes or ())

    def total(name: str) -> Any:
        return sum(value for value in drives[name].to_pylist() if value)

    return Done(
        unit, rows, drives.num_rows, sum(answered), total("fixes"), total("epochs"),
        float(total("path_m")), reasons, skipped, noted,
    )  # fmt: skip


def done_before(task: Task, unit: Unit) -> Done:
    """What became of a unit that is there already."""
    drives = pq.read_table(task.folder("drives") / f"{unit.name}.parquet")
    return told(unit.name, unit.rows, drives)


def kind_of(reason: str, name: str) -> str:
    """A reason without the name and numbers of the trip, with the question that names a cause."""
    parts = reason.removeprefix(f"{name}: ").removeprefix("table: ").split(";")
    cause = parts[-1].strip()
    text = f"{parts[0]}; {cause}" if cause.endswith("?") and len(parts) > 1 else parts[0]
    words = ["N" if any(c.isdigit() for c in word) else word for word in text.split()]
    return " ".join(words)
