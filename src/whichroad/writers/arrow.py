"""Arrow IPC files, as Feather names them: the table as it is, nothing converted."""

from pathlib import Path

import pyarrow as pa


def write(table: pa.Table, path: Path) -> None:
    """Write the table."""
    with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table)
