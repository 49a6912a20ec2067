"""Observations and estimates, appended to files that are whole at every moment.

A recording is a folder: `fixes.arrow` and `odometry.arrow` are drive tables on our clock,
`points.arrow` is what `match` would have written.  Each is an Arrow stream of small batches;
a process that is killed leaves at most the end of one, which readers pass over and the next
start cuts off.
"""

import json
import math
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from .._compile import Records
from ..errors import WriteError
from ..filter.state import EPOCH
from ..filter.summary.estimate import ESTIMATE, Output
from ..observations import (
    Distance,
    GeoFix,
    Observation,
    SensorReading,
    SpeedYaw,
    WheelSpeed,
    WheelTicks,
    YawRate,
)
from ..online import Localizer
from ..readers.folders import ABOUT, READINGS, is_geared
from ..roadmap import RoadMap
from ..tables.export import points_table
from ..tables.schema import POINTS, RECORDING, TIME, times

_FIXES = ("time", "lat", "lon", "cov_ee_m2", "cov_en_m2", "cov_nn_m2", "speed_mps", "bearing_deg")
_ODOMETRY = {
    WheelTicks: ("time", "wheel_rl_ticks", "wheel_rr_ticks"),
    WheelSpeed: ("time", "wheel_rl_mps", "wheel_rr_mps"),
    Distance: ("time", "odometer_m"),
    SpeedYaw: ("time", "speed_mps", "yaw_rate_radps"),
    YawRate: ("time", "yaw_rate_radps"),
}
_COLUMNS = tuple(dict.fromkeys(name for names in _ODOMETRY.values() for name in names))
_PLACE = {kind: tuple(_COLUMNS.index(name) for name in names) for kind, names in _ODOMETRY.items()}


def _schema(names: tuple[str, ...]) -> pa.Schema:
    fields = [(name, TIME if name == "time" else pa.float64()) for name in names]
    return pa.schema(fields, metadata=RECORDING)


class Appended:
    """An Arrow stream that is only ever appended to.

    Args:
        path: A stream of the same schema goes on behind its last whole batch.
        schema: Of the batches.

    Attributes:
        last: The last whole batch that was there before; None: there was none.

    Raises:
        WriteError: The file cannot be written, or holds something else.
    """

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self.schema = schema
        self.last: pa.RecordBatch | None = None
        try:
            end, self.last = whole_until(path, schema) if path.exists() else (0, None)
            self._file = path.open("ab", buffering=0)
            self._file.truncate(end)
            self._end = end
            if end == 0:
                self._write(schema.serialize().to_pybytes())
        except OSError as error:
            raise WriteError(
                f"{path}: cannot be written ({error.strerror}); a place for a recording was "
                "expected; choose another with --record"
            ) from None

    def append(self, table: pa.Table) -> None:
        """Write a table as one batch or more.

        Raises:
            OSError: It cannot be written; the stream ends where it did, and may go on.
        """
        data = [b.serialize() for b in table.cast(self.schema).combine_chunks().to_batches()]
        self._write(b"".join(data))

    def close(self) -> None:
        """No more follows."""
        self._file.close()

    def _write(self, data: bytes) -> None:
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self._file.fileno(), view) :]
        except OSError:
            self._file.truncate(self._end)
            raise
        self._end += len(data)


def whole_until(path: Path, schema: pa.Schema) -> tuple[int, pa.RecordBatch | None]:
    """Where the last whole batch of a stream ends, bytes, and that batch.

    Zero and None are the answer for an empty or torn beginning.

    Raises:
        WriteError: The file is something else.
    """
    end, last = 0, None
    with path.open("rb") as file:
        try:
            first = pa.ipc.read_message(file)
            found = pa.ipc.read_schema(first)
            end = file.tell()
            while file.tell() < path.stat().st_size:
                message = pa.ipc.read_message(file)
                last = pa.ipc.read_record_batch(message, found)
                end = file.tell()
        except (pa.ArrowException, OSError, EOFError, ValueError):
            pass
        if end and not found.equals(schema):
            raise WriteError(
                f"{path}: holds another table; an earlier recording or an empty folder was "
                "expected; choose another with --record"
            )
    return end, last


def make_folder(folder: Path) -> None:
    """Make the folder of a recording, if it is not there.

    Raises:
        WriteError: It cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _no_folder(folder, error) from None


def folder_of(folder: Path, *, resumed: bool) -> Path:
    """Where to record: DIR, or DIR.2, DIR.3, ... where that holds an earlier drive.

    Args:
        folder: DIR; it is there.
        resumed: Whether the last drive goes on, in its own folder.
    """
    numbers = [one.name.removeprefix(f"{folder.name}.") for one in folder.parent.iterdir()]
    last = max((int(n) for n in numbers if n.isdecimal()), default=1)
    if last == 1 and (resumed or not (folder / ABOUT).exists()):
        return folder
    return folder.with_name(f"{folder.name}.{last if resumed else last + 1}")


def _no_folder(folder: Path, error: OSError) -> WriteError:
    return WriteError(
        f"{folder}: cannot be written to ({error.strerror}); a folder was expected; "
        "choose another with --record"
    )


class Recorder:
    """Collects what is to be recorded, and writes it now and then.

    Args:
        folder: Made if it is not there; an earlier recording is gone on with.
        roads: The map of the estimates.
        about: Written to `recording.json`, with `geared`: whether odometry came whose sign is a
            gear's.
        columns: Those that further sensors read; their readings are recorded, too.

    Attributes:
        lost: Rows that could not be written.

    Raises:
        WriteError: The folder cannot be written to, or holds something else.
    """

    def __init__(
        self, folder: Path, roads: RoadMap, about: dict[str, Any], columns: Sequence[str] = ()
    ) -> None:
        make_folder(folder)
        self._folder, self._about = folder, about | {"geared": is_geared(folder)}
        try:
            self._write_about()
        except OSError as error:
            raise _no_folder(folder, error) from None
        self._roads, self._name = roads, folder.name
        self._fixes = Appended(folder / "fixes.arrow", _schema(_FIXES))
        self._odometry = Appended(folder / "odometry.arrow", _schema(_COLUMNS))
        self._points = Appended(folder / "points.arrow", POINTS.with_metadata(RECORDING))
        self._columns = ("time", *dict.fromkeys(columns))
        self._readings = (
            Appended(folder / READINGS, _schema(self._columns)) if columns else None
        )  # fmt: skip
        self.lost = 0
        self._seen: list[Observation] = []
        self._estimates: list[tuple[bytes, bytes]] = []  # an epoch, its estimate

    def observe(self, observation: Observation) -> None:
        """Record an observation, whether it is used or not."""
        self._seen.append(observation)

    def record_estimate(self, localizer: Localizer) -> None:
        """Record a localizer's estimate after the last observation."""
        self._estimates.append(localizer.last_rows())

    @property
    def until(self) -> float:
        """Time of the last estimate that was recorded before this start, s; -inf: none was."""
        last = self._points.last
        if last is None or not last.num_rows:
            return -math.inf
        return float(last["time"].cast(pa.int64())[-1].as_py()) / 1e6

    @property
    def waiting(self) -> int:
        """Rows that are not written yet."""
        return len(self._seen) + len(self._estimates)

    def taken(self) -> Callable[[], None]:
        """What waits, as a call that writes it: from any thread, one at a time, in order.

        The call raises OSError where some of it cannot be written.  These rows are `lost`.
        """
        seen, self._seen = self._seen, []
        estimates, self._estimates = self._estimates, []
        return lambda: self._write(seen, estimates)

    def flush(self) -> None:
        """Write what waits."""
        self.taken()()

    def close(self) -> None:
        """No more follows; what waits is written."""
        try:
            self.flush()
        finally:
            for stream in (self._fixes, self._odometry, self._points, self._readings):
                if stream is not None:
                    stream.close()

    def _write(self, seen: list[Observation], estimates: list[tuple[bytes, bytes]]) -> None:
        failed = None
        if not self._about["geared"] and any(getattr(one, "geared", False) for one in seen):
            self._about["geared"] = True
            try:
                self._write_about()
            except OSError as error:
                self._about["geared"], failed = False, error  # the next batch tries again
        for stream, table in self._tables(seen, estimates):
            try:
                stream.append(table)
            except OSError as error:
                failed, self.lost = error, self.lost + table.num_rows
        if failed is not None:
            raise failed

    def _write_about(self) -> None:
        """Replace `recording.json`, so that it is whole at every moment."""
        part = self._folder / f"{ABOUT}.part"
        part.write_text(json.dumps(self._about, indent=2) + "\n", encoding="utf-8")
        part.replace(self._folder / ABOUT)

    def _tables(
        self, seen: list[Observation], estimates: list[tuple[bytes, bytes]]
    ) -> Iterator[tuple[Appended, pa.Table]]:
        """What goes to which stream."""
        fixes = [one for one in seen if isinstance(one, GeoFix)]
        if fixes:
            yield self._fixes, _fix_table(fixes)
        readings = [one for one in seen if isinstance(one, SensorReading)]
        if readings and self._readings is not None:
            yield self._readings, _reading_table(readings, self._columns)
        odometry = [one for one in seen if not isinstance(one, GeoFix | SensorReading)]
        if odometry:
            yield self._odometry, _odometry_table(odometry)
        if estimates:
            epochs, output = _stacked(estimates)
            yield self._points, points_table(self._name, epochs, output, self._roads)


def _fix_table(fixes: list[GeoFix]) -> pa.Table:
    def known(value: float, sigma: float) -> float | None:
        return value if math.isfinite(sigma) else None

    rows = [
        (
            f.time, f.lat_deg, f.lon_deg, known(f.cov_ee, f.cov_ee), known(f.cov_en, f.cov_ee),
            known(f.cov_nn, f.cov_nn), known(f.speed, f.sigma_speed),
            known(f.bearing_deg, f.sigma_bearing_deg),
        )
        for f in fixes
    ]  # fmt: skip
    return _table(_FIXES, list(zip(*rows, strict=True)))


def _odometry_table(readings: list[Any]) -> pa.Table:
    columns: list[list[float | None]] = [[None] * len(readings) for _ in _COLUMNS]
    for row, one in enumerate(readings):
        for place, name in zip(_PLACE[type(one)], one.__slots__, strict=False):  # but `geared`
            columns[place][row] = getattr(one, name)
    return _table(_COLUMNS, columns)


def _reading_table(readings: list[SensorReading], names: tuple[str, ...]) -> pa.Table:
    columns: list[list[Any]] = [[one.time for one in readings]]
    columns += [[one.values.get(name) for one in readings] for name in names[1:]]
    return _table(names, columns)


def _table(names: tuple[str, ...], columns: list[Any]) -> pa.Table:
    arrays = [times(np.array(columns[0]))]
    arrays += [pa.array(list(column), pa.float64()) for column in columns[1:]]
    return pa.table(arrays, names=list(names))


def _stacked(estimates: list[tuple[bytes, bytes]]) -> tuple[Records, Output]:
    """Epochs and estimates recorded one by one, as tables."""
    epochs, rows = (
        np.frombuffer(b"".join(parts), dtype).view(np.recarray)
        for parts, dtype in zip(zip(*estimates, strict=True), (EPOCH, ESTIMATE), strict=True)
    )
    return epochs, Output(rows, np.zeros((0, 0, 0)))
