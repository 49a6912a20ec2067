"""`whichroad match`."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import DriveError
from .arguments import (
    ColumnsOption,
    CrsOption,
    Force,
    IdOption,
    MapOption,
    Model,
    ZoneOption,
    read_columns,
    read_start,
    read_window,
)  # fmt: skip
from .console import print_table, progress_line
from .many import match_trips

if TYPE_CHECKING:
    from ..tables.result import Result


_EACH = 4  # drives printed one by one; of more only their sums
_OF_ALL = ("drives", "epochs", "epochs_without_answer", "path_m")
_PRINTED_APART = ("skipped", "notes", "diagnosis")


def match(
    drive: Annotated[
        list[Path],
        typer.Argument(
            metavar="DRIVE",
            help="Logs and tables of drives: files, folders, patterns, or `-` for standard input.",
        ),
    ],
    roads: MapOption,
    can: Annotated[Path | None, typer.Option(help="CAN log with the wheels.")] = None,
    dbc: Annotated[Path | None, typer.Option(help="What the CAN log's signals mean.")] = None,
    vehicle: Annotated[Path | None, typer.Option(help="The car, a vehicle.toml.")] = None,
    crs: CrsOption = None,
    id_: IdOption = None,
    columns: ColumnsOption = None,
    tz: ZoneOption = None,
    start: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON,BEARING",
            help="A known pose, in degrees; or `map`: anywhere on it, found by the turns that both "
            "wheels measure; or `map:LAT,LON,METRES`: about so far from there.",
        ),
    ] = None,
    mask: Annotated[
        list[str] | None,
        typer.Option(
            metavar="START:END",
            help="Withhold GNSS, in seconds from the drive's start or in ISO times; repeatable.",
        ),
    ] = None,
    model: Annotated[
        Model, typer.Option(help="`paper` is the method as printed, to compare.")
    ] = Model.default,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="Points: .parquet .geojson .csv .gpx .arrow."),
    ] = None,
    path_out: Annotated[
        Path | None, typer.Option(help="The path driven, edge by edge, in the same formats.")
    ] = None,
    by_source: Annotated[
        bool,
        typer.Option(
            "--by-source",
            help="The path by the roads of the source (OpenStreetMap ways), of which an edge "
            "may have several.",
        ),
    ] = False,
    every: Annotated[
        float | None, typer.Option(min=0.0, metavar="S", help="One point every S seconds.")
    ] = None,
    attributes: Annotated[
        bool, typer.Option("--attributes", help="Add name, class and limit of the road.")
    ] = False,
    lag: Annotated[
        str | None,
        typer.Option(
            metavar="S|full",
            help="Answer by what was known S seconds (or `200m`) later, or at the drive's end.",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="One .html file that shows the answer, to open anywhere.")
    ] = None,
    lineage: Annotated[
        Path | None,
        typer.Option(
            help="The hypotheses of the drive, one row each: when and from which one it was born, "
            "P, when and why it ended; .csv .parquet .arrow."
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Estimate where a vehicle was, on which road, and how sure that is."""
    own = read_columns(columns)
    pose, windows = read_start(start), [read_window(text) for text in mask or ()]
    from .. import writers

    outputs = {"-o": out, "--path-out": path_out, "--report": report, "--lineage": lineage}
    writers.check_apart(outputs, [*drive, roads, can, dbc, vehicle])
    for output in (out, path_out, lineage):
        if output is not None:
            writers.check(output, force=force)
    if report is not None:
        from ..replay.drive_report import check_report

        check_report(report, force=force)
    from .. import matching
    from ..readers import read_drive, read_vehicle
    from ..readers.many_trips import are_many
    from ..roadmap import open_map

    defaults = not (can or dbc or start or mask or report or lineage or own or tz)
    defaults = defaults and model is Model.default
    if len(drive) == 1 and defaults and are_many(drive[0], id_):
        return match_trips(
            drive[0], roads, out=out, path_out=path_out, by_source=by_source, every=every,
            force=force, vehicle=vehicle, attributes=attributes, lag=lag, crs=crs,
            drive_id=id_ or "drive_id",
        )  # fmt: skip
    with progress_line() as progress:
        car = None if vehicle is None else read_vehicle(vehicle)
        progress("reading the drive", 0, 0)
        drives = read_drive(
            drive, vehicle=car, dbc=dbc, can=can, crs=crs, id=id_, columns=own, tz=tz
        )
        if (report or lineage) is not None and len(drives) > 1:
            raise DriveError(
                f"{len(drives)} drives ({', '.join(d.drive_id for d in drives[:10])}) are in the "
                "input; one was expected by --report and --lineage; write all by -o points.parquet "
                "and show one by `whichroad report points.parquet --drive-id NAME`"
            )
        progress("reading the map", 0, 0)
        network = open_map(roads)
        progress("localizing", 0, 0)
        result = matching.match(
            drives, network, vehicle=car, model=model.value, start=pose, mask=windows,
            attributes=attributes, hypotheses=report is not None, lag=lag, progress=progress,
        )  # fmt: skip
        progress("writing", 0, 0)
        _write(result, out, every, force)
        if path_out is not None:
            path = result.path_arrow()
            writers.write_table(
                network.by_source(path) if by_source else path, path_out, force=force
            )
        if lineage is not None:
            result.lineage.write(lineage, force=force)
        if report is not None:
            from ..replay.drive_report import write_report
            from ..replay.open_replay import Remaking, one_of

            shown = Remaking(one_of(drives, None), network, car)
            recorded = shown.recorded(result, shown.absolute(windows))
            write_report(recorded, report, network, force=force)
    print_summary(result)
    if result.summary["epochs_without_answer"] == result.summary["epochs"]:
        raise DriveError(
            f"{drive[0]}: none of {result.summary['epochs']:,} epochs could be answered; a drive "
            f"on the roads of {roads} was expected; is it the right map?"
        )
    if out is path_out is report is lineage is None:
        typer.echo("nothing was written; -o points.parquet --path-out path.parquet would")


def _write(result: "Result", out: Path | None, every: float | None, force: bool) -> None:
    from ..tables.schema import thinned
    from ..writers import write_table

    if out is not None:
        points = result.to_arrow()
        write_table(thinned(points, every) if every else points, out, force=force)


def print_summary(result: "Result") -> None:
    """The summary; what was skipped or failed goes to the standard error."""
    from ..roadmap.extent import outside_note

    each = result.summary.get("each", [result.summary])
    skipped: Counter[str] = Counter()
    for one in each:
        skipped.update(one.get("skipped", {}))
    for reason, count in skipped.items():
        typer.echo(f"skipped: {count} {reason}", err=True)
    for note in dict.fromkeys(note for one in each for note in one.get("notes", ())):
        typer.echo(f"note: {note}", err=True)
    for one in each:
        if outside := one.get("fixes_outside_map"):
            fixes = one["fixes"] + one["fixes_masked"]
            typer.echo(f"note: {one['drive_id']}: {outside_note(outside, fixes)}", err=True)
    for finding in (finding for one in each for finding in one.get("diagnosis", ())):
        typer.echo(_finding_line(finding), err=True)
    if len(each) > _EACH:
        print_table("all", [(name, result.summary[name]) for name in _OF_ALL])
    for one in each if len(each) <= _EACH else ():
        figures = {name: value for name, value in one.items() if name not in _PRINTED_APART}
        title = str(figures.pop("drive_id", "drive"))
        shares = figures.get("status", {})
        figures["status"] = {word: f"{100 * share:.1f} %" for word, share in shares.items()}
        print_table(title, [row for row in figures.items() if row[1] not in ((), [], {})])
    for failed in result.summary.get("failed", ()):
        typer.echo(f"skipped: {failed}", err=True)


def _finding_line(finding: dict[str, Any]) -> str:
    """One setting that does not fit, as a line."""
    from ..diagnosis.findings import Finding

    found = Finding(**finding)
    return f"{found.level}: {found}"
