"""Logs of Android's GnssLogger: its lines `Fix`, of the provider that serves best."""

from collections import Counter
from dataclasses import replace

from ..errors import ReadError
from ..observations import Drive
from .csv_text import read_csv
from .drive_tables import drives_of
from .reading import Reading
from .source import Source

_HEAD = b"Fix,"


def read_gnss_logger(source: Source, reading: Reading) -> list[Drive]:
    """Read the fixes of a log; raw measurements are passed over.

    Of several providers the receiver (GPS) is taken, unless it gives less than half of the
    fixes of another.

    Raises:
        ReadError: There is no line `Fix`, or none that names their columns.
    """
    lines = [line.strip().lstrip(b"# ") for line in source.data.splitlines()]
    rows = [line.split(b",") for line in lines if line.startswith(_HEAD)]
    names = next((row for row in rows if b"Provider" in row), None)
    fixes = [row for row in rows if row is not names and b"Provider" not in row]
    if names is None or not fixes:
        raise ReadError(
            f"{source.name}: a log of GnssLogger without fixes; lines `Fix`, and `# Fix,Provider,"
            "...` with their columns, were expected; log locations too"
        )
    at = names.index(b"Provider")
    counts = Counter(row[at].upper() for row in fixes if len(row) > at)
    most = counts.most_common(1)[0][0] if counts else b""
    chosen = b"GPS" if 2 * counts[b"GPS"] >= counts[most] else most
    kept = [row for row in fixes if len(row) > at and row[at].upper() == chosen]
    text = b"\n".join(b",".join(row[: len(names)]) for row in [names, *kept])
    skipped: Counter[str] = Counter()
    seen = read_csv(text + b"\n", source.name, skipped, reading)
    drives = drives_of(seen, reading, skipped, source.name, source.stem, (source.path,))
    others = {name: n for name, n in counts.items() if name != chosen}
    if not others:
        return drives
    told = ", ".join(f"{n} of {name.decode(errors='replace')}" for name, n in others.items())
    note = f"fixes of provider {chosen.decode(errors='replace')} used; left out: {told}"
    return [replace(drive, notes=(note, *drive.notes)) for drive in drives]
