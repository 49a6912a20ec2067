"""The trips of a run that are bad: without an answer, or with one to the smaller part of them."""

import os
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ..readers.checks import BACKWARDS
from ..readers.splitting import STANDING
from ..wording import counted

NAME = "bad_trips.parquet"
_USED = (BACKWARDS, STANDING)  # what is counted of rows without fault, or that were put right
_READ = ["drive_id", "answered", "reason", "fixes", "skipped"]


def write_bad(folder: Path) -> int:
    """Write the bad trips of a folder as a table: name, whether there is an answer, reason.

    A trip with an answer is bad where more of its rows were skipped for one reason than were used.

    Returns:
        How many there are.
    """
    files = [pq.ParquetFile(path) for path in sorted((folder / "drives").glob("*.parquet"))]
    own = files[0].schema_arrow
    schema = pa.schema([own.field(name) for name in _READ[:3]], own.metadata)
    beside, rows = folder / f".{NAME}.{os.getpid()}", 0
    with pq.ParquetWriter(beside, schema, compression="zstd") as table:
        for file in files:
            with file:
                bad = bad_of(file.read(_READ))
            rows += len(bad)
            if bad:
                table.write_table(pa.Table.from_pylist(bad, schema))
    os.replace(beside, folder / NAME)
    return rows


def bad_of(drives: pa.Table) -> list[dict[str, object]]:
    """The bad ones among rows of `tables.schema.DRIVES`, as rows of the table."""
    ends = drives["skipped"].combine_chunks().offsets
    some = pc.greater(ends.slice(1), ends.slice(0, len(drives)))
    found = []
    for row in drives.filter(pc.or_(some, pc.invert(drives["answered"]))).to_pylist():
        reason = row["reason"]
        if row["answered"]:
            reason = _mostly_skipped(dict(row["skipped"]), row["fixes"])
            if reason is None:
                continue
        found.append({"drive_id": row["drive_id"], "answered": row["answered"], "reason": reason})
    return found


def _mostly_skipped(skipped: dict[str, int], fixes: int) -> str | None:
    """Why most of a trip was not used; None: it was."""
    faults = {count: why for why, count in skipped.items() if why not in _USED}
    most = max(faults, default=0)
    if most <= fixes:
        return None
    used = counted(fixes, "fix", "fixes")
    return f"{counted(most, 'row')} skipped: {faults[most]}; the answer is of {used}"
