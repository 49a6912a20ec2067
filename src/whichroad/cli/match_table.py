"""`whichroad match` on a table of many trips."""

from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ..errors import DriveError
from ..wording import counted
from .console import print_skipped_roads, print_table, progress_line

if TYPE_CHECKING:
    import pyarrow as pa

_MOST_PRINTED = 10  # reasons


def match_trips(
    table: Path,
    roads: Path,
    *,
    out: Path | None,
    path_out: Path | None,
    by_source: bool,
    every: float | None,
    force: bool,
    **options: Any,
) -> None:
    """Match every trip of a table and write the answers as they come.

    Args:
        table: A file or folder, see `batch.match_stream`.
        roads: The map.
        out: Where points go.
        path_out: Where paths go.
        by_source: Whether paths are given by the roads of the source.
        every: One point in so many seconds.
        force: Replace files that exist.
        options: For `batch.match_stream`.

    Raises:
        DriveError: No trip could be answered.
        ReadError: There is no such zone or order of dates.
    """
    from ..batch import match_stream
    from ..readers.dates import Writing
    from ..readers.many_trips import own_names, zone_note
    from ..readers.trip_files import dataset_of
    from ..roadmap import left_out, open_map
    from ..tables.schema import thinned
    from ..writers.stream import growing

    Writing.of(options["tz"], options.get("dates"))
    drive_id, columns = options["drive_id"], options["columns"]
    skipped: list[str] = []
    own, trip = own_names(columns, drive_id)
    data = dataset_of(table, skipped, own=own, trip=trip)
    for one in skipped:
        typer.echo(f"skipped: {one}", err=True)
    note = zone_note(data, drive_id, columns) if options["tz"] is None else None
    if note:
        typer.echo(f"note: {note}", err=True)
    trips: list[pa.Table] = []
    with progress_line() as progress, ExitStack() as files:
        points = out and files.enter_context(growing(out, force=force))
        path = path_out and files.enter_context(growing(path_out, force=force))
        progress("reading the map", 0, 0)
        network = open_map(roads, crs=options["crs"])
        progress("localizing", 0, 0)
        for part in match_stream(data, network, progress=progress, **options):
            if points:
                points(thinned(part.points, every))
            if path:
                path(network.by_source(part.path) if by_source else part.path)
            trips.append(part.drives)
        if not trips:
            raise DriveError(f"{table}: it holds no trips; rows with a drive_id were expected")
    print_skipped_roads(left_out(roads, network))
    _print_summary(table, trips)
    if out is None and path_out is None:
        typer.echo("no output was asked for; add -o points.parquet --path-out path.parquet")


def _print_summary(table: Path, parts: "list[pa.Table]") -> None:
    """How many trips were answered; why others were not goes to the standard error."""
    from ..roadmap.extent import outside_note

    rows = [row for part in parts for row in part.to_pylist()]
    skipped: Counter[str] = Counter()
    for row in rows:
        skipped.update(dict(row["skipped"] or ()))
    for reason, count in skipped.items():
        typer.echo(f"skipped: {reason}: {count:,}", err=True)
    noted = Counter(note for row in rows for note in row["notes"] or ())
    for note, count in noted.most_common(_MOST_PRINTED):
        typer.echo(f"note: {counted(count, 'trip')}: {note}", err=True)
    if outside := sum(row["fixes_outside_map"] for row in rows):
        typer.echo(f"note: {outside_note(outside, sum(row['fixes'] for row in rows))}", err=True)
    unanswered = [row for row in rows if not row["answered"]]
    for row in unanswered[:_MOST_PRINTED]:
        name = row["drive_id"] or "(no name)"
        typer.echo(f"no answer: {name}: {row['reason'].removeprefix(f'{name}: ')}", err=True)
    if len(unanswered) > _MOST_PRINTED:
        typer.echo(f"no answer: {len(unanswered) - _MOST_PRINTED:,} more", err=True)
    answered = [row for row in rows if row["answered"]]
    print_table(
        table.name,
        [
            ("trips", len(rows)),
            ("answered", len(answered)),
            ("epochs", sum(row["epochs"] for row in rows)),
            ("epochs_without_answer", sum(row["epochs_without_answer"] for row in rows)),
            ("path_m", sum((row["path_m"] for row in answered), 0.0)),
        ],
    )
    if not answered:
        raise DriveError(
            f"{table}: none of {counted(len(rows), 'trip')} could be matched; trips on the roads "
            f"of the map were expected; the reason of the first: {rows[0]['reason']}"
        )
