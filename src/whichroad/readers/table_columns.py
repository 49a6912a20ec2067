"""The names of a table's columns, without reading it."""

import csv
import re
from pathlib import Path

from ..errors import ReadError

_HEAD = 1 << 16  # bytes in which the line of names ends


def column_names(path: Path) -> list[str]:
    """The names of all columns of a drive table, in their order.

    Raises:
        ReadError: It cannot be read.
    """
    import pyarrow as pa

    from ..tables.schema import read_arrow

    suffix = path.suffix.lower()
    try:
        if suffix in (".parquet", ".geoparquet", ".pq"):
            import pyarrow.parquet as pq

            return list(pq.read_schema(path).names)
        if suffix in (".arrow", ".feather", ".ipc"):
            return list(read_arrow(path.read_bytes())[0].column_names)
        with path.open("rb") as file:
            head = file.read(_HEAD).removeprefix(b"\xef\xbb\xbf").decode(errors="replace")
        line = re.search(r"[^\r\n]+", head)
        text = line[0] if line else ""
        return next(csv.reader([text], delimiter=max(",;\t", key=text.count)), [])
    except (pa.ArrowException, OSError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or str(error).splitlines()[0][:200]
        raise ReadError(
            f"{path}: its columns cannot be read ({reason}); a table was expected; check that it "
            "is one and complete"
        ) from None
