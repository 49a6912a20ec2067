"""Any table as columns of arrays: pandas, GeoPandas, Arrow, a dict of arrays, or a file."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ReadError, SettingError, comes_with
from ..observations import Array

Bools = NDArray[np.bool_]


def read_table(path: Path) -> Any:
    """A table from a file, the suffix chooses; the points of a recording, a folder."""
    path = path / "points.arrow" if path.is_dir() else path
    try:
        match path.suffix.lower():
            case ".parquet":
                import pyarrow.parquet as pq

                return pq.read_table(path)
            case ".arrow" | ".feather":
                from ..tables.schema import read_arrow

                return read_arrow(path.read_bytes())[0]
            case ".csv":
                import pyarrow.csv as csv

                return csv.read_csv(path)
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
        self.names = set(getattr(table, "column_names", None) or table.keys())

    def rows(self, keep: Bools) -> "Table":
        """The same table with some of its rows."""
        chosen = Table(self.table, self.where)
        chosen.keep = keep
        return chosen

    def _raw(self, name: str) -> NDArray[Any]:
        if name not in self.names:
            raise ReadError(
                f"{self.where}: no column {name!r} among {', '.join(sorted(self.names))}; "
                "this column is needed; is it the right table?"
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
