"""A table that grows: parts to one file, as Parquet without holding them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from . import replacing, write_table
from .parquet import repeating, schema_of, spatial

Write = Callable[[pa.Table], None]


@contextmanager
def growing(path: Path, *, force: bool = False) -> Iterator[Write]:
    """Give a function that writes the next part of a table; the file is whole at the end.

    Parquet is written as it comes; other formats when all is there.

    Args:
        path: Where to; one of `writers.SUFFIXES`.
        force: Replace a file that exists.

    Raises:
        WriteError: As `writers.write_table`.
    """
    if path.suffix.lower() not in (".parquet", ".geoparquet"):
        parts: list[pa.Table] = []
        yield parts.append
        if parts:
            write_table(pa.concat_tables(parts), path, force=force)
        return
    with replacing(path, force=force) as part:
        writer: pq.ParquetWriter | None = None

        def write(table: pa.Table) -> None:
            nonlocal writer
            if writer is None:
                schema = schema_of(table, bounds=False)
                writer = pq.ParquetWriter(
                    part, schema, compression="zstd", use_dictionary=repeating(schema)
                )
            writer.write_table(spatial(table).cast(writer.schema))

        try:
            yield write
        finally:
            if writer is not None:
                writer.close()
