"""Speeds of edges or roads by hour of the week, out of the paths of many drives.

The mean is the harmonic one, distance over time.  Each passage counts by its probability and by
how much of it was seen: `length / (length + REACH * interval)`, where the interval is that of
the drive's fixes.  The share depends on no speed, so that slow passages count no more than fast
ones.  The 95 % interval is that of a ratio estimator, in seconds a metre, and of what was not
seen: that is the mean over a longer stretch, and a shorter one differs the more from it.
"""

import math
from collections.abc import Iterable, Iterator
from hashlib import blake2b
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
from numpy.typing import NDArray

from ..errors import ReadError, SettingError
from ..readers.splitting import seconds_of
from ..readers.tables_in_memory import refuse_without_rows

REACH = 10.0  # m/s: what is guessed about both ends of a passage, over the interval of fixes
EVEN = 10.0  # m over which seconds a metre are alike: stops.  Real tracks at 1 Hz: 10 to 20
CREEPING = 1.0  # m/s: who takes longer for an edge has stopped for the rest of the time
_HOURS = 168  # of a week
_BITS = 24  # of a vehicle's hash
_MERGE = 1 << 20  # rows of parts after which they are joined
_LEAST = 3  # passages of which an interval is given
_Z = 1.959964  # two-sided 95 % quantile of the normal distribution
_MAP = "map"
_RULES = "broken_rule"
_COLUMNS = ("drive_id", "forward", "enter_time", "enter_m", "exit_m", "duration_s", "p")

SPEEDS = pa.schema(
    [
        ("forward", pa.bool_()),
        ("hour", pa.int64()),  # of the week: 0 is Monday 0 to 1 h; null: all hours
        ("speed_mps", pa.float64()),  # harmonic mean; null where all passages are left out
        ("low_mps", pa.float64()),  # its 95 % interval, null where passages are too few
        ("high_mps", pa.float64()),
        ("passages", pa.int64()),
        ("vehicles", pa.int64()),
        ("weight", pa.float64()),  # sum of the weights of the passages
        ("left_out", pa.int64()),  # further passages, with a stop that was too long
    ]
)
"""Columns of `speeds`, behind the edge's or the road's id."""

Ints = NDArray[np.int64]


def speeds(
    path: Any,
    *,
    by: str = "edge_id",
    hours: bool = True,
    tz: str = "UTC",
    drives: Any = None,
    longest_stop: str | float | None = "5min",
) -> pa.Table:
    """Speed of each edge or road, by direction and hour of the week.

    Args:
        path: The folder of a fleet, a Parquet file or a folder of them, a table of a path, or an
            iterable of tables: only a part of them is in memory.
        by: "edge_id", or "source_id" for the roads of the map's source: with the path of
            `RoadMap.by_source`, as that of `match` names only the road in the middle of an edge.
        hours: Whether hours are told apart.
        tz: The zone of the hours, such as "Europe/Berlin".
        drives: The table, file or folder of drives, which gives the interval of fixes; None:
            that of the fleet's folder, else passages count by their probability alone.
        longest_stop: A passage is left out, and counted, that takes longer by more than this than
            at 1 m/s on one of its edges: `5min`, `300s` or s; None: all passages count.

    Returns:
        A row for each id, direction and hour that was passed, see `SPEEDS`.  Rows of a drive that
        follow each other on a road are one passage of it.  A vehicle is what stands before the
        last "/" of a drive's name, or the whole name.  Edges of a folder of maps are told by the
        column `map` too.

    Raises:
        ReadError: It is no path.
        SettingError: An argument is unknown.
    """
    if by not in ("edge_id", "source_id"):
        raise SettingError(f"by is {by!r}; edge_id or source_id was expected")
    intervals = _Intervals.of(drives if drives is not None else _beside(path))
    use = "or None; passages with a longer stop are left out"
    sums = _Sums(by, seconds_of(longest_stop, "longest_stop", use))
    try:
        for rows, first in _passages(_tables(path, (by, *_COLUMNS)), by):
            sums.add(rows, first, intervals, tz if hours else None)
    except pa.ArrowInvalid as error:
        reason = str(error).splitlines()[0]
        raise SettingError(f"tz is {tz!r}; such as Europe/Berlin was expected ({reason})") from None
    return sums.table(hours)


def _beside(path: Any) -> Any:
    """The drives in the folder of a fleet."""
    if isinstance(path, str | PathLike) and (Path(path) / "drives").is_dir():
        return Path(path) / "drives"
    return None


def _tables(source: Any, columns: Iterable[str]) -> Iterator[pa.Table]:
    """The columns of a source, some rows at a time.

    Raises:
        ReadError: It lacks one, or cannot be read.
    """
    if isinstance(source, str | PathLike):
        folder = Path(source)
        for name in ("path", "drives"):
            if (folder / name).is_dir() and name == ("path" if "p" in columns else "drives"):
                folder = folder / name
        try:
            data = ds.dataset(str(folder), format="parquet")
            columns = _used(data.schema.names, columns)
            options = {"batch_size": 1 << 16, "batch_readahead": 1, "fragment_readahead": 1}
            for batch in data.to_batches(columns=columns, **options):
                yield pa.Table.from_batches([batch])
        except (pa.ArrowException, OSError) as error:
            reason = str(error).splitlines()[0]
            raise ReadError(
                f"{source}: cannot be read ({reason}); Parquet of paths was expected"
            ) from None
        return
    if hasattr(source, "columns") or hasattr(source, "schema"):
        source = [source]
    for one in source:
        refuse_without_rows(one)
        if hasattr(one, "geometry") and hasattr(one, "to_crs"):
            one = one.drop(columns=one.geometry.name)
        table = one if isinstance(one, pa.Table) else pa.table(one)
        yield table.select(_used(table.column_names, columns))


def _used(names: list[str], columns: Iterable[str]) -> list[str]:
    """The columns that are read: those of a list, that of maps for edges, that of gaps for roads.

    Raises:
        ReadError: One is missing.
    """
    missing = [name for name in columns if name not in names]
    if missing:
        raise ReadError(
            f"path: no column {', '.join(missing)}; the path of match, match_many or fleet was "
            "expected, not its points"
        )
    more = {"edge_id": _MAP, "source_id": _RULES}
    return [*columns, *(name for id_, name in more.items() if id_ in columns and name in names)]


def _passages(tables: Iterable[pa.Table], by: str) -> Iterator[tuple[pa.Table, Ints]]:
    """The rows of a path, and the first ones of the passages among them; no passage is cut.

    A row is a passage of an edge, a run of rows of one drive one of a road.
    """
    held: pa.Table | None = None
    for part in tables:
        parts = [part] if held is None else [held, part]
        rows = pa.concat_tables(parts, promote_options="permissive")
        if by == "edge_id":
            yield rows, np.arange(rows.num_rows)
        elif rows.num_rows:
            first = np.flatnonzero(_begins(rows))
            yield rows.slice(0, first[-1]), first[:-1]
            held = rows.slice(first[-1])
    if held is not None:
        yield held, np.zeros(1, np.int64)


def _begins(rows: pa.Table) -> NDArray[np.bool_]:
    """Whether each row begins a run of one drive on a road in one direction."""
    begins = np.ones(rows.num_rows, bool)
    gap = np.zeros(rows.num_rows, bool)
    if _RULES in rows.column_names:
        gap = pc.match_substring(rows[_RULES], "gap").fill_null(False).to_numpy()
    codes = [_codes(rows[name])[1] for name in ("drive_id", "source_id")]
    told = np.column_stack([*codes, rows["forward"].to_numpy()])
    begins[1:] = gap[1:] | (told[1:] != told[:-1]).any(axis=1)
    return begins


def _codes(column: pa.ChunkedArray | pa.Array) -> tuple[list[Any], Ints]:
    """The words of a column, and which of them each row has; -1: none."""
    encoded = column.dictionary_encode()
    encoded = encoded.combine_chunks() if isinstance(encoded, pa.ChunkedArray) else encoded
    if isinstance(encoded, pa.ChunkedArray):
        encoded = pa.concat_arrays(encoded.chunks)
    codes = encoded.indices.fill_null(-1).to_numpy().astype(np.int64)
    return encoded.dictionary.to_pylist(), codes


def _hashes(column: pa.ChunkedArray | pa.Array) -> tuple[NDArray[np.uint64], Ints]:
    """Hashes of the texts of a column, and which of them each row has."""
    words, at = _codes(column)
    digests = (blake2b(str(word).encode(), digest_size=8).digest() for word in words)
    return np.array([int.from_bytes(one, "little") for one in digests], np.uint64), at


class _Intervals(NamedTuple):
    """Seconds between the fixes of drives."""

    drive: NDArray[np.uint64]  # sorted hashes of names
    seconds: NDArray[np.float32]

    @classmethod
    def of(cls, drives: Any) -> "_Intervals":
        """Of a table of drives; none."""
        names, seconds = [], []
        columns = ("drive_id", "epochs", "duration_s")
        for table in _tables(drives, columns) if drives is not None else ():
            hashes, at = _hashes(table["drive_id"])
            epochs = table["epochs"].to_numpy()
            length = table["duration_s"].fill_null(0.0).to_numpy()
            names.append(hashes[at])
            seconds.append((length / np.maximum(epochs - 1, 1)).astype(np.float32))
        if not names:
            return cls(np.empty(0, np.uint64), np.empty(0, np.float32))
        whole = np.concatenate(names)
        order = np.argsort(whole)
        return cls(whole[order], np.concatenate(seconds)[order])

    def __call__(self, hashes: NDArray[np.uint64]) -> NDArray[np.float64]:
        """Of each drive; 0 where it is not known."""
        if not len(self.drive):
            return np.zeros(len(hashes))
        at = np.minimum(np.searchsorted(self.drive, hashes), len(self.drive) - 1)
        known = self.drive[at] == hashes
        return np.where(known, self.seconds[at].astype(np.float64), 0.0)


class _Sums:
    """Sums over passages by id, direction and hour; each key is one number."""

    def __init__(self, by: str, longest_stop: float | None) -> None:
        self.by, self._longest_stop = by, longest_stop or math.inf
        self._words: dict[Any, int] = {}  # of sources, or of a map and an edge of it
        self._of_maps = False
        self._keys: list[Ints] = []
        self._sums: list[NDArray[np.float64]] = []  # (k, 9), see `_interval`; and passages left out
        self._pairs: list[Ints] = []  # key and hash of a vehicle
        self._rows = 0

    def add(self, rows: pa.Table, first: Ints, intervals: _Intervals, tz: str | None) -> None:
        """Count the passages of a part of a path, given their first rows."""
        if not len(first):
            return
        lengths = rows["exit_m"].to_numpy() - rows["enter_m"].to_numpy()
        p = np.add.reduceat(rows["p"].to_numpy() * lengths, first)
        length = np.add.reduceat(lengths, first)
        times = rows["duration_s"].to_numpy()
        stop = np.maximum.reduceat(times - lengths / CREEPING, first)
        time = np.add.reduceat(times, first)
        good = (length > 1.0) & (time > 0.0) & (p > 0.0)
        if not good.any():
            return
        length, time, p = length[good], time[good], p[good] / length[good]
        taken = np.where(stop[good] <= self._longest_stop, 1.0, 0.0)
        table = rows.take(pa.array(first[good]))
        hour = np.zeros(len(length), np.int64)
        if tz is not None:
            entered = table["enter_time"].cast(pa.timestamp("us", tz=tz))
            day, clock = pc.day_of_week(entered).to_numpy(), pc.hour(entered).to_numpy()
            hour = 24 * day + clock
        key = (self._ids(table) * 2 + table["forward"].to_numpy()) * _HOURS + hour
        drives, at = _hashes(table["drive_id"])
        interval = intervals(drives)[at]
        weight = taken * p * length / (length + REACH * interval)
        wd, wt = weight * length, weight * time
        sums = [taken, weight, wd, wt, wd**2, wd * wt, wt**2, weight * interval, 1.0 - taken]
        self._put(key, np.column_stack(sums))
        vehicle = pc.replace_substring_regex(table["drive_id"], r"/[0-9]+$", "")
        vehicles, at = _hashes(vehicle)
        hashed = (vehicles >> np.uint64(64 - _BITS)).astype(np.int64)
        self._pairs.append(np.unique(((key << _BITS) | hashed[at])[taken > 0.0]))
        self._rows += len(p)
        if self._rows > _MERGE:
            self._merge()

    def _ids(self, table: pa.Table) -> Ints:
        """A number for each row's id."""
        if self.by == "edge_id":
            edges = np.asarray(table["edge_id"].to_numpy(), np.int64)
            return self._of_map(edges, table[_MAP]) if _MAP in table.column_names else edges
        words, at = _codes(table["source_id"].fill_null(""))
        codes = np.array([self._words.setdefault(w, len(self._words)) for w in words], np.int64)
        return np.asarray(codes[at], np.int64)

    def _of_map(self, edges: Ints, maps: pa.ChunkedArray) -> Ints:
        """A number for each edge of one of several maps."""
        self._of_maps = True
        names, which = _codes(maps)
        one, at = np.unique(np.stack([which, edges]), axis=1, return_inverse=True)
        pairs = [(names[name], edge) for name, edge in one.T.tolist()]
        codes = [self._words.setdefault(pair, len(self._words)) for pair in pairs]
        return np.array(codes, np.int64)[at.reshape(-1)]

    def _put(self, keys: Ints, values: NDArray[np.float64]) -> None:
        """Sums of equal keys."""
        one, at = np.unique(keys, return_inverse=True)
        columns = [np.bincount(at, values[:, k], len(one)) for k in range(values.shape[1])]
        self._keys.append(one)
        self._sums.append(np.column_stack(columns))

    def _merge(self) -> None:
        keys, sums = np.concatenate(self._keys), np.concatenate(self._sums)
        self._keys, self._sums = [], []
        self._put(keys, sums)
        self._pairs = [np.unique(np.concatenate(self._pairs))]
        self._rows = 0

    def table(self, hours: bool) -> pa.Table:
        """What was found, by id, direction and hour."""
        if not self._keys:
            self._put(np.empty(0, np.int64), np.empty((0, 9)))
            self._pairs.append(np.empty(0, np.int64))
        self._merge()
        (keys,), (sums,), (pairs,) = self._keys, self._sums, self._pairs
        ids, hour = keys // (2 * _HOURS), keys % _HOURS
        n, weight, wd, wt = sums[:, :4].T
        some, (low, high) = n > 0, np.full((2, len(n)), np.nan)
        low[some], high[some] = _interval(sums[some, :8])
        begin, end = (np.searchsorted(pairs >> _BITS, keys, side) for side in ("left", "right"))
        few = n < _LEAST
        columns = [
            pa.array((keys // _HOURS) % 2 > 0),
            pa.array(hour, pa.int64(), mask=np.full(len(keys), not hours)),
            pa.array(np.divide(wd, wt, out=np.zeros(len(n)), where=some), mask=~some),
            pa.array(low, mask=few),
            pa.array(high, mask=few | ~np.isfinite(high)),
            pa.array(n.astype(np.int64)),
            pa.array((end - begin).astype(np.int64)),
            pa.array(weight),
            pa.array(sums[:, 8].astype(np.int64)),
        ]
        first = self._named(ids)
        return pa.Table.from_arrays(
            [*first.columns, *columns], schema=pa.schema([*first.schema, *SPEEDS])
        )

    def _named(self, ids: Ints) -> pa.Table:
        """The columns that say which road some ids are."""
        if self.by == "edge_id" and not self._of_maps:
            return pa.table({self.by: pa.array(ids)})
        words = list(self._words)
        if self.by == "source_id":
            return pa.table({self.by: pa.array([words[k] for k in ids.tolist()], pa.string())})
        maps, edges = ([words[k][place] for k in ids.tolist()] for place in (0, 1))
        return pa.table({_MAP: pa.array(maps, pa.string()), self.by: pa.array(edges, pa.int64())})


def _interval(sums: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """95 % interval of distance over time: Student's, of the ratio of time to distance.

    With r = Σ wt / Σ wd, the residuals wt - r wd have the variance Σ (wt - r wd)²; what is
    effective of the number of passages is (Σ wd)² / Σ (wd)².  What was not seen is guessed from
    the roads before and behind, as far as one drives between two fixes.  These differ from a
    road as one passage differs from another, however many passages there are.

    Passages tell how means over all of that differ, not those over the road alone.  Seconds a
    metre of places more than EVEN apart have little in common.  So the variance of their mean
    over a length is as 1 / (EVEN + length).  A road that is x times as slow as guessed is as
    likely as one x times as fast, since no time is below zero.

    Args:
        sums: (k, 8) of n, w, wd, wt, (wd)², wd wt, (wt)² and w times the interval of fixes.
    """
    n, w, wd, wt, dd, dt, tt, w_interval = sums.T
    ratio = wt / wd
    squares = np.maximum(tt - 2.0 * ratio * dt + ratio**2 * dd, 0.0)
    effective = np.minimum(wd**2 / dd, n)
    freedom = np.maximum(effective - 1.0, 1.0)
    one = _student(freedom) * np.sqrt(squares * (1.0 + 1.0 / freedom) / dd)  # of a passage
    mean = one * np.sqrt(dd) / wd
    length, between = wd / w, w_interval / w / ratio
    reach = length + between
    guess = one * between / reach * np.sqrt((EVEN + reach) / (EVEN + length))
    slower = np.hypot(mean, guess)
    faster = np.hypot(mean, guess * ratio / (ratio + guess))
    with np.errstate(divide="ignore"):
        high = np.where(ratio > faster, 1.0 / np.maximum(ratio - faster, 0.0), np.inf)
    return 1.0 / (ratio + slower), high


def _student(freedom: NDArray[np.float64]) -> NDArray[np.float64]:
    """97.5 % quantile of Student's distribution (Abramowitz and Stegun, 26.7.5)."""
    z, f = _Z, freedom
    return np.asarray(
        z + (z**3 + z) / (4 * f) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * f**2)
        + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * f**3)
    )  # fmt: skip
