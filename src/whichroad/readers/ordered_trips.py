"""Batches of whole trips from a stream in which the rows of each trip follow each other.

Nothing is sorted or kept beyond the last trip of a batch, which takes a fifth of the time that
`many_trips` takes for rows in any order.
"""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ReadError
from .arrow_columns import texts
from .dates import UNSAID, Writing
from .many_trips import (
    Own,
    Trip,
    TripBatch,
    cut,
    joined_rows,
    of_vehicles,
    packed,
    parts_of,
    split_each,
    usual_rows,
)
from .trip_files import in_batches

if TYPE_CHECKING:
    import pyarrow as pa

_NONE: Own = {}


def ordered_batches(
    batches: Iterable[Any], drive_id: str, *, split: float | None = None, own: Own = _NONE,
    written: Writing = UNSAID,
) -> Iterator[TripBatch]:  # fmt: skip
    """Cut a stream into whole trips.

    Args:
        batches: Record batches or tables, which may end within trips, or one table.
        drive_id: The column that names the trip; "drive_id" also finds its usual aliases.
        split: As of `many_trips.trip_batches`.
        own: Likewise.
        written: Likewise.

    Raises:
        ReadError: A trip comes again after others, or there is no such column.
    """
    tables = (of_vehicles(table, own) for table in _whole_tables(batches, drive_id, own))
    if split:
        trips = (Trip(*trip) for table in tables for trip in cut(table))
        yield from packed(split_each(trips, split, own, written), True)
        return
    seen: set[int] = set()
    for table in tables:
        for batch in parts_of(table):
            marks = {hash(name) for name in batch.names if name}
            if not seen.isdisjoint(marks):
                again = next(name for name in batch.names if name and hash(name) in seen)
                raise ReadError(
                    f"table: trip {again!r} comes again after others; all rows of a trip were "
                    "expected one behind the other; sort them by trip and time"
                )
            seen |= marks
            yield batch


def _whole_tables(batches: Iterable[Any], drive_id: str, own: Own) -> "Iterator[pa.Table]":
    """Tables of some whole trips each."""
    held: list[Any] = []  # rows of one trip, whose end has not come
    name = None
    for batch in in_batches(batches):
        table = usual_rows(batch, drive_id, own)
        if not table.num_rows:
            continue
        labels, codes = texts(table["drive_id"])
        others = np.flatnonzero(codes != codes[-1])
        first = int(others[-1]) + 1 if len(others) else 0
        if first:
            yield joined_rows([*held, table.slice(0, first)])
            held = []
        elif held and labels[codes[0]] != name:
            yield joined_rows(held)
            held = []
        held.append(table.slice(first))
        name = labels[codes[-1]]
    if held:
        yield joined_rows(held)
