"""What is said of many trips whose times name no zone."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from .arrow_columns import is_zoneless
from .dates import HAS_ZONE, taken_as_utc
from .names import find

if TYPE_CHECKING:
    import pyarrow as pa


def zone_note_of(batches: Iterable[Any], own: Mapping[str, str | int]) -> str | None:
    """What to say of record batches; None: nothing.

    Of numbers and timestamps the first time tells it, of text the first that names no zone.
    """
    for batch in batches:
        if batch.num_rows:
            meaning = find(batch.schema.names, own)["time"]
            first, is_text = _perhaps_zoneless(batch.column(meaning.place))
            if len(first) and is_zoneless(first, meaning):
                return taken_as_utc(meaning.name)
            if not is_text:
                return None
    return None


def _perhaps_zoneless(column: "pa.Array") -> "tuple[pa.Array, bool]":
    """The first time that may name no zone, an array of one or none; and whether it is text."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    if not (pa.types.is_string(column.type) or pa.types.is_large_string(column.type)):
        return column.slice(0, 1), False
    clock, zone = (pc.match_substring_regex(column, mark) for mark in (":", HAS_ZONE.pattern))
    return column.filter(pc.and_not(clock, zone)).slice(0, 1), True
