"""Columns of an Arrow table as NumPy arrays: numbers, times, labels."""

import math
import re
from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import UUID

import numpy as np

from ..errors import ReadError
from ..observations import Array
from .bare_times import are_clocks, of_numbers, with_numbers
from .checks import UNPARSABLE_TIME, Ints, Skipped, keep
from .dates import (
    UNSAID,
    Writing,
    is_clock,
    of_clocks,
    of_days,
    of_texts,
    plausible,
    to_utc,
)
from .digit_dates import Taken
from .names import Column
from .whole_trips import refuse_lists

if TYPE_CHECKING:
    import pyarrow as pa

_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
_DECIMAL = re.compile(r"\s*[-+]?\d+,\d+\s*$")
_GROUPED = re.compile(r"\s*[-+]?[1-9]\d{0,2},\d{3}\s*$")  # as thousands are, such as 12,345
_CLOCK = re.compile(r"\s*(?!0000\d\d\.)\d{5,6}(?:\.\d+)?\s*")  # and no days or seconds below 60
_ABSENT = ("", "-", "--", "null", "none", "nan", "na", "n/a")  # what stands in empty cells


class Times(NamedTuple):
    """A column of times."""

    seconds: Array  # (n,) since 1970 UTC, NaN where a cell is empty or no time
    zoneless: bool = False  # some name no zone; the caller's, else UTC, was taken
    counted: bool = False  # bare numbers that count from another start, their unit is open
    dateless: bool = False  # times of day, counted from the midnight before the first
    others: int = 0  # cells in another format than the one the column was read by
    ticks: bool = False  # numbers of 100 ns that count from the year 1 or 1601
    taken: Taken | None = None  # how dates of digits were read that do not show it


def unparsable(name: str) -> str:
    """As what cells of a column are counted that are no numbers."""
    return f"unparsable number in {name}"


def numbers(column: "pa.ChunkedArray", name: str, skipped: Skipped) -> Array:
    """A column as floats, NaN where a cell is empty or no number (those are counted)."""
    import pyarrow as pa
    import pyarrow.compute as pc

    column, kind = _plain(column)
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
        skipped[unparsable(name)] += len(column) - column.null_count
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
    cells = [c.decode("utf-8", "replace") if type(c) is bytes else c for c in column.to_pylist()]
    empty = np.array([_is_absent(cell) for cell in cells], bool)
    values = np.array([_number(cell) for cell in _with_points(cells)], np.float64)
    keep(~np.isnan(values) | empty, unparsable(name), skipped)
    return values


def _with_points(cells: list[Any]) -> list[Any]:
    """Cells whose commas are surely decimal ones, and not of thousands, with points."""
    texts = [cell for cell in cells if isinstance(cell, str)]
    with_comma = [cell for cell in texts if "," in cell and _DECIMAL.match(cell)]
    if all(map(_GROUPED.match, with_comma)) or any("." in cell for cell in texts):
        return cells
    commas = set(with_comma)
    return [cell.replace(",", ".") if cell in commas else cell for cell in cells]


def _number(cell: object) -> float:
    """The number that a cell holds, NaN where it is none."""
    try:
        return math.nan if isinstance(cell, str) and "_" in cell else float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _is_absent(cell: object) -> bool:
    return not isinstance(cell, str) or cell.strip().lower() in _ABSENT


def times(
    column: "pa.ChunkedArray",
    meaning: Column,
    where: str,
    skipped: Skipped,
    *,
    written: Writing = UNSAID,
    date: "tuple[str, pa.ChunkedArray] | None" = None,
) -> Times:
    """A column of times, or a column of times of day and one of dates.

    Args:
        column: Text (see `dates`), Arrow timestamps, or numbers.
        meaning: Gives the unit of numbers, where the column's name does.
        where: The source, for errors.
        skipped: Counts cells that are no time.
        written: How they are written, where they do not show it.
        date: The name and the column of the dates, where this one may hold times of day.

    Raises:
        ReadError: The column holds something else, or day and month cannot be told apart.
    """
    import pyarrow as pa

    column, kind = _plain(column)
    said = f"{where}: column {meaning.name!r}"
    if pa.types.is_timestamp(kind):
        ticks = _floats(column.cast(pa.int64()).cast(pa.float64(), safe=False))
        seconds, zoneless = plausible(ticks / _PER_SECOND[kind.unit]), kind.tz is None
        return Times(to_utc(seconds, written.zone) if zoneless else seconds, zoneless)
    clocks = pa.types.is_time(kind) or pa.types.is_date(kind)
    if not (clocks or _is_text(kind) or _is_number(kind)):
        raise ReadError(
            f"{said} holds {kind}; date and time (ISO 8601) or seconds since 1970 were expected"
        )
    if clocks or _is_text(kind) or (date is not None and not meaning.factor):
        cells = strings(column) if clocks or _is_text(kind) else _clock_digits(column)
        moments = None
        if date is not None and (clocks or any(map(_may_be_clock, cells))):
            whole = clocks or _is_text(kind) or _are_clocks(cells)  # else the numbers are no clock
            if whole:
                day = f"{where}: column {date[0]!r}"
                moments = of_days(strings(date[1]), cells, written, day)
        if moments is None and (clocks or _is_text(kind)):
            moments = of_texts(cells, written, said)
        if moments is not None:
            left = np.array([bool(cell) for cell in cells], bool) & ~np.isfinite(moments.seconds)
            if left.any():
                bare = [_number(c) if at else math.nan for c, at in zip(cells, left, strict=True)]
                moments = with_numbers(moments, np.array(bare), written.zone)
            keep(np.isfinite(moments.seconds) | ~left, UNPARSABLE_TIME, skipped)
            return Times(
                moments.seconds, moments.zoneless, others=moments.others, taken=moments.taken
            )
        since_midnight = of_clocks(cells) if clocks or _is_text(kind) else None
        if since_midnight is not None:
            return Times(since_midnight, dateless=True)
    if clocks:
        return Times(np.full(len(column), np.nan))
    values = numbers(column, meaning.name, skipped)
    values[~np.isfinite(values)] = np.nan
    if meaning.factor:
        return Times(values * meaning.factor)
    moments = of_numbers(values, written.zone)
    if moments is None and are_clocks(values):
        since_midnight = of_clocks(_clock_digits(column))
        if since_midnight is not None:
            return Times(since_midnight, dateless=True)
    if moments is None:
        return Times(values, counted=True)
    return Times(moments.seconds, moments.zoneless, False, False, moments.others, moments.ticks)


def is_zoneless(cell: "pa.Array", meaning: Column) -> bool:
    """Whether a time, an array of one, names no zone; of numbers by their size alone.

    Of numbers and timestamps no array of NumPy is made: with its first one Arrow brings pandas.
    """
    import pyarrow as pa

    if pa.types.is_timestamp(cell.type):
        return cell.type.tz is None
    if _is_number(cell.type):
        value = cell[0].as_py()
        read = (
            None if meaning.factor or value is None else of_numbers(np.array([float(value)]), None)
        )
        return read is not None and read.zoneless
    either = Writing(order="mdy")  # one time need not show which number is its month
    return times(pa.chunked_array([cell]), meaning, "table", Counter(), written=either).zoneless


def decoded(column: "pa.ChunkedArray") -> "pa.ChunkedArray":
    """A column without runs, and of an extension type what it stores; of UUIDs their text.

    Most of Arrow's functions know neither.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_run_end_encoded(column.type):
        column = pc.run_end_decode(column)
    kind = column.type
    if not isinstance(kind, pa.BaseExtensionType):
        return column
    stored = column.cast(kind.storage_type)
    return _uuids(stored) if kind.extension_name == "arrow.uuid" else stored


def decoded_columns(
    table: "pa.Table", found: Mapping[str, Column], where: str = "table"
) -> "pa.Table":
    """The table with its columns `decoded`, but for the geometry, whose type says what it is.

    Raises:
        ReadError: Its rows are trips, with lists of places or times.
    """
    refuse_lists(table, found, where)
    own = [c.place for quantity, c in found.items() if quantity == "geometry"]
    for place, field in enumerate(table.schema):
        if place not in own and _is_encoded(field.type):
            table = table.set_column(place, field.name, decoded(table.column(place)))
    return table


def _is_encoded(kind: "pa.DataType") -> bool:
    import pyarrow as pa

    return pa.types.is_run_end_encoded(kind) or isinstance(kind, pa.BaseExtensionType)


def _uuids(stored: "pa.ChunkedArray") -> "pa.ChunkedArray":
    """The texts of UUIDs, such as `f81d4fae-7dec-11d0-a765-00a0c91e6bf6`, out of their bytes."""
    import pyarrow as pa

    chunks = []
    for chunk in stored.chunks:
        codes = chunk.dictionary_encode()
        names = pa.array([str(UUID(bytes=each)) for each in codes.dictionary.to_pylist()])
        chunks.append(names.cast(pa.string()).take(codes.indices))
    return pa.chunked_array(chunks, pa.string())


def _plain(column: "pa.ChunkedArray") -> tuple["pa.ChunkedArray", "pa.DataType"]:
    """A column without a dictionary, and its type."""
    import pyarrow as pa

    kind = column.type
    if pa.types.is_dictionary(kind):
        return column.cast(kind.value_type), kind.value_type
    return column, kind


def _is_number(kind: "pa.DataType") -> bool:
    import pyarrow as pa

    return bool(
        pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)
        or pa.types.is_null(kind)
    )  # fmt: skip


def _may_be_clock(cell: str | None) -> bool:
    return bool(cell) and (is_clock(cell or "") or bool(_CLOCK.fullmatch(cell or "")))


def _are_clocks(cells: list[str | None]) -> bool:
    """Whether nearly all cells that are filled are times of day, not all of the first minute."""
    seconds = of_clocks([cell for cell in cells if cell])
    if seconds is None or np.nanmax(seconds, initial=0.0) < 60.0:
        return False
    return bool(np.isfinite(seconds).mean() > 0.99)


def _clock_digits(column: "pa.ChunkedArray") -> list[str | None]:
    """Numbers with six digits before the point, as those of times of day have: 4640 is 004640."""
    parts = [(cell or "").partition(".") for cell in strings(column)]
    return [f"{whole.zfill(6)}{point}{rest}" if whole else None for whole, point, rest in parts]


def strings(column: "pa.ChunkedArray") -> list[str | None]:
    """A column of any type as text; None where a cell is empty."""
    return [
        None if cell is None
        else cell.decode("utf-8", "replace") if type(cell) is bytes else str(cell)
        for cell in _plain(column)[0].to_pylist()
    ]  # fmt: skip


def texts(column: "pa.ChunkedArray") -> tuple[list[str], Ints]:
    """Labels of a column and the label of each row, in order of first appearance."""
    import pyarrow as pa

    if not pa.types.is_dictionary(column.type):
        if pa.types.is_nested(column.type):  # such as lists, which Arrow has no dictionaries of
            column = pa.chunked_array([strings(column)], pa.string())
        column = column.dictionary_encode()
    combined = column.combine_chunks()
    if isinstance(combined, pa.ChunkedArray):  # more than one chunk when it cannot be one
        combined = combined.chunk(0) if combined.num_chunks else pa.array([]).dictionary_encode()
    labels = [_label(value) for value in _of_bytes(combined.dictionary)]
    codes = combined.indices.fill_null(len(labels)).to_numpy(zero_copy_only=False)
    return [*labels, ""], np.asarray(codes, np.int64)


def _label(value: object) -> str:
    """A label as text; whole numbers as such, also where a column with gaps made floats of them."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return "" if value is None else str(value)


def _of_bytes(values: "pa.Array") -> list[Any]:
    """Values; bytes among them as the text that they are, else as hexadecimal digits, each alone.

    So a name is the same in each batch of a stream.  Bytes of one length, such as those of UUIDs,
    are digits always: one of 10,000 is text by chance.
    """
    import pyarrow as pa

    fixed = pa.types.is_fixed_size_binary(values.type)
    return [
        _name_of(value, fixed) if isinstance(value, bytes) else value
        for value in values.to_pylist()
    ]


def _name_of(value: bytes, fixed: bool) -> str:
    """Bytes as text, or as digits."""
    try:
        text = value.decode()
    except UnicodeDecodeError:
        return value.hex()
    return text if text.isprintable() and not fixed else value.hex()
