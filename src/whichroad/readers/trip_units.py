"""Units that no column names, and the grid of places, told by the first trips of a stream."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, groupby, islice

from .drive_tables import units_in
from .many_trips import TripBatch, joined_rows
from .names import find
from .reading import Reading
from .table_units import MOST, MOST_ROWS, Units, open_columns

KnownUnits = Mapping[tuple[str, ...], Units]  # by the names of the columns that name no unit
_NONE: KnownUnits = {}


def with_units(
    batches: Iterable[TripBatch], reading: Reading, given: KnownUnits = _NONE
) -> Iterator[TripBatch]:
    """The batches, each with the units of its columns.

    Args:
        batches: Of whole trips; the first are held until they have the trips that tell.  Where
            all units are known the first batch alone tells the grid of the places.
        reading: What the caller says of the table.
        given: What is known before.
    """
    known = dict(given)

    def names(batch: TripBatch) -> tuple[str, ...]:
        return open_columns(find(batch.table.column_names, reading.columns))

    for key, alike in groupby(batches, names):
        yield from _of_one_table(alike, key, known, reading)


def _of_one_table(
    batches: Iterator[TripBatch],
    key: tuple[str, ...],
    known: dict[tuple[str, ...], Units],
    reading: Reading,
) -> Iterator[TripBatch]:
    first = [] if key in known else _first(batches) if key else list(islice(batches, 1))
    if first:
        known[key] = _units(first, reading)
    for batch in chain(first, batches):
        yield batch._replace(units=known[key])


def first_units(batches: Iterable[TripBatch], reading: Reading) -> KnownUnits:
    """The units of a stream, of which only the first batches are taken."""
    for batch in with_units(batches, reading):
        key = open_columns(find(batch.table.column_names, reading.columns))
        return {key: batch.units or Units()}
    return {}


def _first(batches: Iterator[TripBatch]) -> list[TripBatch]:
    """Batches with the trips that `table_units.units_of` asks."""
    held: list[TripBatch] = []
    for batch in batches:
        held.append(batch)
        trips = sum(len(one.names) for one in held)
        if trips >= MOST or sum(one.first[-1] for one in held) > MOST_ROWS:
            break
    return held


def _units(batches: list[TripBatch], reading: Reading) -> Units:
    first, rows = [0], 0
    for batch in batches:
        first += [rows + end for end in batch.first[1:]]
        rows += batch.first[-1]
    return units_in(joined_rows([batch.table for batch in batches]), first, reading)
