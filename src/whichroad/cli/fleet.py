"""`whichroad fleet`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..wording import counted
from .arguments import (
    ColumnsOption,
    CrsOption,
    DatesOption,
    SensorOption,
    VehicleOption,
    ZoneOption,
    read_columns,
    read_sensors,
)
from .console import print_skipped_roads, print_table, progress_line

if TYPE_CHECKING:
    from ..fleet import Summary
    from ..fleet.run import Progress

_MOST_PRINTED = 10  # reasons


def fleet(
    trips: Annotated[
        list[str],
        typer.Argument(
            metavar="TRIPS...",
            help="Parquet (also partitioned), GeoParquet, Arrow, CSV: files, folders, patterns; or "
            "a query of DuckDB that begins with SELECT, FROM or WITH.",
        ),
    ],
    roads: Annotated[
        Path,
        typer.Option(
            "--map",
            help="A map, as of `whichroad match`, or a folder of compiled maps. Each trip takes "
            "the map of a folder that holds it.",
        ),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the tables.")],
    trip_id: Annotated[
        str,
        typer.Option(
            "--trip-id",
            metavar="COLUMN",
            help="Column that names the trip of each row. By default also trip_id and the other "
            "usual names are found.",
        ),
    ] = "drive_id",
    split: Annotated[
        str | None,
        typer.Option(
            metavar="5min",
            help="Split each vehicle into trips at pauses and stops this long, and at jumps. They "
            "are called NAME/1, NAME/2, ...",
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of processes. Default: one for each core.")
    ] = None,
    order: Annotated[
        str,
        typer.Option(
            metavar="any|sorted",
            help="`sorted` if all rows of a trip lie together (checked).",
        ),
    ] = "any",
    points: Annotated[
        str,
        typer.Option(metavar="none|slim|all", help="Write points; `slim` leaves out poses."),
    ] = "none",
    vehicle: VehicleOption = None,
    lag: Annotated[
        str | None, typer.Option(metavar="S|full", help="Smoothing, as for `whichroad match`.")
    ] = None,
    crs: CrsOption = None,
    columns: ColumnsOption = None,
    tz: ZoneOption = None,
    dates: DatesOption = None,
    sensor: SensorOption = None,
    places: Annotated[
        Path | None,
        typer.Option(
            help="Table of point objects, such as signs: write those within 500 m ahead and "
            "within 50 m (folders `ahead`, `nearby`)."
        ),
    ] = None,
    memory: Annotated[
        str, typer.Option(help="Memory limit of the sort; the rest goes to disk.")
    ] = "256MB",
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the run in this folder.")
    ] = False,
) -> None:
    """Match millions of trips: files in, a folder of path, drives and points out."""
    own = {name: str(column) for name, column in read_columns(columns).items()}
    sensors = read_sensors(sensor)
    from ..fleet import run_fleet
    from ..fleet.manifest import said_of_end

    try:
        with progress_line() as show:
            show("reading the trips", 0, 0)

            def tell(so_far: "Progress") -> None:
                show(_line(so_far), so_far.done.rows, so_far.rows)

            summary = run_fleet(
                trips, roads, out, trip_id=trip_id, split=split, order=order, points=points,
                vehicle=vehicle, lag=lag, crs=crs, columns=own, tz=tz, dates=dates, sensors=sensors,
                places=places, workers=workers, memory=memory, resume=resume, progress=tell,
            )  # fmt: skip
    except KeyboardInterrupt:
        typer.echo(said_of_end(out), err=True)
        raise typer.Exit(130) from None
    print_fleet(summary)


def _line(so_far: "Progress") -> str:
    """Fixes a second, time left, share of trips without an answer."""
    done = so_far.done
    bad = 100.0 * (done.trips - done.answered) / max(done.trips, 1)
    minutes, seconds = divmod(round(so_far.seconds_left), 60)
    return (
        f"{done.rows:,} of {so_far.rows:,} rows, {so_far.rows_per_s:,.0f}/s, "
        f"{minutes}:{seconds:02} left, {bad:.1f} % of trips without an answer"
    )


def print_fleet(summary: "Summary") -> None:
    """What was done; what was skipped, by reason, goes to the standard error."""
    from ..fleet.bad_trips import NAME as BAD

    done = summary.done
    if summary.note:
        typer.echo(f"note: {summary.note}", err=True)
    print_skipped_roads(summary.map_left_out)
    for reason, count in done.skipped.most_common():
        typer.echo(f"skipped: {reason}: {count:,}", err=True)
    for note, count in done.noted.most_common(_MOST_PRINTED):
        typer.echo(f"note: {counted(count, 'trip')}: {note}", err=True)
    for reason, count in done.reasons.most_common(_MOST_PRINTED):
        typer.echo(f"no answer: {counted(count, 'trip')}: {reason}", err=True)
    if summary.bad:
        typer.echo(f"{counted(summary.bad, 'bad trip')} listed in {summary.out / BAD}", err=True)
    print_table(
        str(summary.out),
        [
            ("rows", done.rows),
            ("trips", done.trips),
            ("answered", done.answered),
            ("fixes", done.fixes),
            ("path_km", done.path_m / 1e3),
            ("units", summary.units),
            ("units_done_before", summary.units_before),
            ("seconds", summary.seconds),
        ],
    )
