"""Any table as columns of arrays: pandas, GeoPandas, Arrow, a dict of arrays, or a file."""

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ReadError, SettingError, comes_with
from ..observations import Array
from ..roadmap.open_table import read_csv

Bools = NDArray[np.bool_]


POINTS, TRUTH = ("points.arrow", "points.parquet"), ("truth.parquet",)
"""Names of points, and of a truth, in a folder."""


def _in_folder(folder: Path, names: Sequence[str]) -> Path:
    """The first of some files that is in a folder.

    Raises:
        ReadError: None is.
    """
    found = [folder / name for name in names if (folder / name).is_file()]
    if not found:
        raise ReadError(
            f"{folder}: a folder without {' or '.join(names)}; a table was expected; points come "
            "from `whichroad match DRIVE --map MAP -o points.parquet`"
        )
    return found[0]


def read_truth_table(path: Path) -> Any:
    """A truth from a file, or from the folder that `whichroad simulate` wrote."""
    return read_table(_in_folder(path, TRUTH) if path.is_dir() else path)


def renamed(tables: Mapping[str, Any], columns: Mapping[str, str]) -> list[dict[str, Any]]:
    """Tables under the names that are compared.

    Args:
        tables: By their names in messages.
        columns: Name -> own column, of at least one of the tables.

    Returns:
        Each as a dict of its columns.

    Raises:
        ReadError: No table has such a column, or a name is not known.
    """
    for name, column in columns.items():
        if name not in KNOWN:
            close = difflib.get_close_matches(name, KNOWN, 3, 0.5)
            hint = f"did you mean {' or '.join(close)}?" if close else "see docs/compare.md"
            raise ReadError(
                f"columns: {name!r} is no column that is compared; one of {', '.join(KNOWN)} was "
                f"expected; {hint}"
            )
        if not any(column in _columns(table) for table in tables.values()):
            seen = "; ".join(f"{n}: {', '.join(_columns(t))}" for n, t in tables.items())
            raise ReadError(
                f"columns: no column {column!r} for {name} ({seen}); a column of one of the tables "
                "was expected; check its spelling"
            )
    given = []
    for table in tables.values():
        mine = {name: column for name, column in columns.items() if column in _columns(table)}
        others = {n: table[n] for n in _columns(table) if n not in mine}
        given.append(others | {name: table[column] for name, column in mine.items()})
    return given


KNOWN = (
    "time", "lat", "lon", "drive_id", "bearing_deg", "cov_ee_m2", "cov_en_m2", "cov_nn_m2",
    "sigma_m", "sigma_bearing_deg", "edge_id", "source_id", "abscissa_m", "p_road", "p_off_road",
    "map_lat", "map_lon", "speed_mps", "on_road", "travelled_m", "outage",
)  # fmt: skip
"""Columns that are compared."""


def _columns(table: Any) -> list[str]:
    return list(getattr(table, "column_names", None) or table.keys())


def read_table(path: Path) -> Any:
    """A table from a file, the suffix chooses; the points of a recording, a folder."""
    path = _in_folder(path, POINTS) if path.is_dir() else path
    try:
        match path.suffix.lower():
            case ".parquet" | ".geoparquet":
                import pyarrow.parquet as pq

                return pq.read_table(path)
            case ".arrow" | ".feather":
                from ..tables.schema import read_arrow

                return read_arrow(path.read_bytes())[0]
            case ".csv":
                return read_csv(path)
            case ".geojson" | ".json":
                with comes_with("geo", f"{path}: this format"):
                    import geopandas

                return geopandas.read_file(path)
    except SettingError:
        raise
    except (OSError, ValueError, RuntimeError) as error:
        seen = error if path.is_file() else "the file does not exist"
        raise ReadError(
            f"{path}: {seen}; a table of points was expected; check that it is one"
        ) from error
    raise ReadError(
        f"{path}: the suffix {path.suffix!r} names no table; one of .parquet, .arrow, .feather, "
        ".csv, .geojson was expected; convert it"
    )


def _word(value: Any) -> str:
    """A road's id as a word: 7, 7.0 and "7" are one; empty where there is none."""
    if value is None or value != value:
        return ""
    whole = isinstance(value, float) and value.is_integer()
    return str(int(value) if whole else value).strip().removesuffix(".0")


class Table:
    """Columns of any table as arrays."""

    def __init__(self, table: Any, where: str) -> None:
        self.where = where
        self.table = table
        self.keep: Any = slice(None)
        self.names = set(_columns(table))

    def rows(self, keep: Bools) -> "Table":
        """The same table with some of its rows."""
        chosen = Table(self.table, self.where)
        chosen.keep = keep
        return chosen

    def _raw(self, name: str) -> NDArray[Any]:
        if name not in self.names:
            raise ReadError(
                f"{self.where}: no column {name!r} among {', '.join(sorted(self.names))}; "
                f"this column is needed; name your own by columns= (--columns {name}=COLUMN)"
            )
        column = self.table[name]
        if hasattr(column, "to_numpy") and hasattr(column, "combine_chunks"):
            column = column.to_pandas()
        if getattr(getattr(column, "dtype", None), "tz", None) is not None:
            column = column.dt.tz_convert(None)
        values: NDArray[Any] = np.asarray(column)[self.keep]
        return values

    def numbers(self, name: str, absent: float | None = None) -> Array:
        """A column of numbers; `absent` stands for a missing column and for nulls."""
        if absent is not None and name not in self.names:
            return np.full(len(self._raw("time")), absent)
        try:
            values: Array = np.array(self._raw(name), dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ReadError(f"{self.where}: {name} holds text; numbers were expected") from error
        if absent is not None:
            values[np.isnan(values)] = absent
        return values

    def known(self, name: str) -> Array:
        """A column of numbers, NaN where it is missing."""
        return self.numbers(name) if name in self.names else np.full(len(self._raw("time")), np.nan)

    def flags(self, name: str, absent: bool) -> Bools:
        """A column of yes and no."""
        yes: Bools = self.numbers(name, float(absent)) != 0.0
        return yes

    def words(self, name: str) -> set[str]:
        """The different words of a column; none where it is missing."""
        return set(map(str, self._raw(name))) if name in self.names else set()

    def edges(self) -> NDArray[np.int64]:
        """Edges, -1 for none."""
        return self.numbers("edge_id", -1.0).astype(np.int64)

    def sources(self) -> list[str]:
        """The source's ids of roads as words, empty for none."""
        return [_word(value) for value in self._raw("source_id").tolist()]

    def times(self) -> Array:
        """Seconds since 1970 UTC from timestamps, ISO text or numbers."""
        values = self._raw("time")
        if values.dtype.kind in "OUT":
            text = [str(v).strip().removesuffix("Z").removesuffix("+00:00") for v in values]
            try:
                values = np.array(text, dtype="datetime64[us]")
            except ValueError as error:
                raise ReadError(
                    f"{self.where}: a time is not a date; ISO 8601, such as 2026-06-01T08:00:00Z, "
                    "was expected"
                ) from error
        if values.dtype.kind == "M":
            return values.astype("datetime64[us]").astype(np.int64) / 1e6
        return values.astype(np.float64)


def roads_of(p: Table, t: Table) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Roads of an answer and of its truth as numbers, -1 for none; None: not both name them.

    They are edges where both have `edge_id`, else the source's roads, such as OpenStreetMap's ways.
    """
    if {"edge_id"} <= p.names & t.names:
        return p.edges(), t.edges()
    if not {"source_id"} <= p.names & t.names:
        return None
    numbers: dict[str, int] = {"": -1}
    found = [
        np.array([numbers.setdefault(word, len(numbers) - 1) for word in table.sources()], np.int64)
        for table in (p, t)
    ]
    return found[0], found[1]
