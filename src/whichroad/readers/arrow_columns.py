"""Columns of an Arrow table as NumPy arrays: numbers, times, labels."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ReadError
from ..observations import Array
from .checks import Ints, Skipped, keep
from .names import Column

if TYPE_CHECKING:
    import pyarrow as pa

_NUMBER = "unparsable number"
_TIME = "unparsable time"
_NAMED = ("UTC", "GMT", "]")
# UTC by name, or the name of a zone behind an offset: 12:00:00+02:00[Europe/Berlin]
_ZONE = re.compile(r"(?<=\d)\s*(?:UTC|GMT)$|(?:(?<=[+-]\d\d:\d\d)|(?<=Z))\[[^\[\]]*\]$")
_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
# A bare number of seconds since 1970 stays below 1e11 until the year 5138.
LARGEST = ((1e11, 1.0), (1e14, 1e-3), (1e17, 1e-6), (np.inf, 1e-9))


def numbers(column: "pa.ChunkedArray", name: str, skipped: Skipped) -> Array:
    """A column as floats, NaN where a cell is empty or no number (those are counted)."""
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = column.type
    if pa.types.is_dictionary(kind):
        column, kind = column.cast(kind.value_type), kind.value_type
    if pa.types.is_null(kind):
        return np.full(len(column), np.nan)
    if pa.types.is_boolean(kind):
        column = column.cast(pa.uint8())
    if _is_text(kind):
        return _parsed(column, name, skipped)
    try:
        return _floats(
            column if pa.types.is_float64(kind) else pc.cast(column, pa.float64(), safe=False)
        )
    except pa.ArrowException:
        skipped[f"{_NUMBER} in {name}"] += len(column) - column.null_count
        return np.full(len(column), np.nan)


def _is_text(kind: "pa.DataType") -> bool:
    import pyarrow as pa

    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind)) or str(kind) in (
        "string_view",
        "binary",
        "large_binary",
    )


def _floats(column: "pa.ChunkedArray") -> Array:
    """Floats of a float column, NaN for null, as an array of our own."""
    return np.array(column.to_numpy(zero_copy_only=False), np.float64)


def _parsed(column: "pa.ChunkedArray", name: str, skipped: Skipped) -> Array:
    """Numbers out of text."""
    import pandas as pd

    cells = pd.Series(column.to_pandas(), dtype=object)
    cells = cells.map(lambda cell: cell.decode("utf-8", "replace") if type(cell) is bytes else cell)
    empty = cells.map(lambda cell: not isinstance(cell, str) or not cell.strip()).to_numpy(bool)
    values = pd.to_numeric(cells, errors="coerce").to_numpy(np.float64)
    keep(~np.isnan(values) | empty, f"{_NUMBER} in {name}", skipped)
    return np.array(values)


def times(column: "pa.ChunkedArray", meaning: Column, where: str, skipped: Skipped) -> Array:
    """A column as seconds since 1970 UTC, NaN where a cell is empty or no time.

    Times without a zone are UTC.  The unit of bare numbers follows from their size.

    Args:
        column: ISO 8601 text, Arrow timestamps, or numbers.
        meaning: Gives the unit of numbers, where the column's name does.
        where: The source, for errors.
        skipped: Counts cells that are no time.

    Raises:
        ReadError: The column holds times of day, dates or something else.
    """
    import pyarrow as pa

    kind = column.type
    if pa.types.is_dictionary(kind):
        column, kind = column.cast(kind.value_type), kind.value_type
    if pa.types.is_timestamp(kind):
        ticks = _nullable(column.cast(pa.int64()))
        return ticks / _PER_SECOND[kind.unit]
    if _is_text(kind):
        seconds = _iso(column)
        if seconds is not None:
            empty = np.array([not cell for cell in column.to_pylist()], bool)
            keep(np.isfinite(seconds) | empty, _TIME, skipped)
            return seconds
    elif not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
        raise ReadError(
            f"{where}: column {meaning.name!r} holds {kind}; date and time (ISO 8601) or seconds "
            "since 1970 were expected"
        )
    values = numbers(column, meaning.name, skipped)
    values[~np.isfinite(values)] = np.nan
    if meaning.factor:
        return values * meaning.factor
    sizes = np.abs(values[np.isfinite(values)])
    if not len(sizes):
        return values
    middle = (len(sizes) - 1) // 2
    size = float(np.partition(sizes, middle)[middle])
    return values * next(factor for largest, factor in LARGEST if size < largest)


def _nullable(column: "pa.ChunkedArray") -> Array:
    import pyarrow as pa

    return _floats(column.cast(pa.float64(), safe=False))


def _iso(column: "pa.ChunkedArray") -> Array | None:
    """Seconds of ISO 8601 text, or None where no cell is a date."""
    cells = [
        cell.decode("utf-8", "replace") if type(cell) is bytes else cell
        for cell in column.to_pylist()
    ]
    if not any(cell and "-" in cell[1:].replace("/", "-") for cell in cells):
        return None
    return iso_seconds(cells)


def iso_seconds(cells: Sequence[str | None]) -> Array:
    """Seconds since 1970 UTC of ISO 8601 texts, NaN where one is not; no zone: UTC."""
    import pandas as pd

    if any(cell and cell.endswith(_NAMED) for cell in cells):
        cells = [_ZONE.sub("", cell) if cell else None for cell in cells]
    texts = pd.Series([cell.replace("/", "-") if cell else None for cell in cells], dtype=object)
    stamps = pd.to_datetime(texts, utc=True, errors="coerce", format="ISO8601")
    micros: NDArray[Any] = stamps.dt.as_unit("us").astype("int64").to_numpy()
    return np.where(stamps.notna().to_numpy(), micros / 1e6, np.nan)


def texts(column: "pa.ChunkedArray") -> tuple[list[str], Ints]:
    """Labels of a column and the label of each row, in order of first appearance."""
    import pyarrow as pa

    if not pa.types.is_dictionary(column.type):
        column = column.dictionary_encode()
    combined = column.combine_chunks()
    if isinstance(combined, pa.ChunkedArray):  # more than one chunk when it cannot be one
        combined = combined.chunk(0) if combined.num_chunks else pa.array([]).dictionary_encode()
    labels = ["" if v is None else str(v) for v in combined.dictionary.to_pylist()]
    codes = combined.indices.fill_null(len(labels)).to_numpy(zero_copy_only=False)
    return [*labels, ""], np.asarray(codes, np.int64)
