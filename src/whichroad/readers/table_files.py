"""Files of tables to the columns that are used: text, Parquet, Arrow."""

import io

import numpy as np

from ..errors import ReadError, first_line
from .arrow_columns import decoded_columns
from .checks import Skipped, keep
from .csv_text import read_csv
from .names import Seen, find
from .reading import Reading
from .source import Source
from .tables_in_memory import flattened

PARQUET = (".parquet", ".geoparquet", ".pq")
ARROW = (".arrow", ".feather", ".ipc")


def table_of(source: Source, skipped: Skipped, reading: Reading) -> Seen:
    """The used columns of a file, and the names of all.

    Raises:
        ReadError: It is no readable table.
    """
    if source.suffix in PARQUET or source.data.startswith(b"PAR1"):
        return _parquet(source, reading)
    if source.suffix in ARROW or source.data.startswith((b"ARROW1", b"FEA1")):
        return _arrow(source, skipped, reading)
    return read_csv(source.data, source.name, skipped, reading)


def _parquet(source: Source, reading: Reading) -> Seen:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(io.BytesIO(source.data))
        names = file.schema_arrow.names
        flat = flattened(file.schema_arrow.empty_table(), reading.columns).column_names
        found = find(flat, reading.columns)
        table = file.read(columns=[column.name for column in found.values()] or names[:1])
        table = flattened(table, reading.columns)
        table.validate(full=True)
        seen = Seen.of(table, names, found)
        return seen._replace(table=decoded_columns(table, seen.found, source.name))
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise _unreadable(source, "Parquet", error) from None


def _arrow(source: Source, skipped: Skipped, reading: Reading) -> Seen:
    import pyarrow as pa

    from ..tables.schema import read_arrow

    try:
        table, whole = read_arrow(source.data)
        keep(np.array([whole]), "incomplete end of a recording", skipped)
        table.validate(full=True)
        table = flattened(table, reading.columns)
        found = find(table.column_names, reading.columns)
        return Seen(decoded_columns(table, found, source.name), table.column_names, found)
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise _unreadable(source, "Arrow file", error) from None


def _unreadable(source: Source, kind: str, error: Exception) -> ReadError:
    first = first_line(error)
    return ReadError(f"{source.name}: no readable {kind} ({first}); was the file cut short?")
