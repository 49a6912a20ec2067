"""`whichroad match`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import DriveError, SettingError
from ..wording import counted
from .arguments import (
    CanOption,
    ColumnsOption,
    CrsOption,
    DatesOption,
    DbcOption,
    Force,
    IdOption,
    MapOption,
    Model,
    SensorOption,
    VehicleOption,
    ZoneOption,
    read_columns,
    read_sensors,
    read_start,
    read_window,
)
from .console import print_skipped_roads, print_table, progress_line
from .match_table import match_trips

if TYPE_CHECKING:
    from ..tables.result import Result


_EACH = 4  # drives printed one by one; of more only their sums
_OF_ALL = ("drives", "epochs", "epochs_without_answer", "path_m")
_PRINTED_APART = ("skipped", "notes", "diagnosis", "fixes_outside_map")
_LABELS = {  # what people read; the way first, as its parts share its probability at junctions
    "mean_p_way": "mean P of the way",
    "mean_p_road": "mean P of the edge",
    "mean_p_off_road": "mean P off road",
}


def match(
    drive: Annotated[
        list[Path],
        typer.Argument(
            metavar="DRIVE",
            help="Drives: CSV, Parquet, Arrow, GPX, KML, GeoJSON, GeoPackage, Shapefile, NMEA, "
            "RTKLIB .pos, UBX, GnssLogger, JSON, CAN logs, ROS bags, MCAP. Files, folders, "
            "wildcards, or `-` (standard input).",
        ),
    ],
    roads: MapOption,
    can: CanOption = None,
    dbc: DbcOption = None,
    vehicle: VehicleOption = None,
    crs: CrsOption = None,
    id_: IdOption = None,
    columns: ColumnsOption = None,
    tz: ZoneOption = None,
    dates: DatesOption = None,
    start: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON,BEARING",
            help="Start pose, in degrees. `map` finds the start from wheel data alone; "
            "`map:LAT,LON,METRES` searches about a place.",
        ),
    ] = None,
    mask: Annotated[
        list[str] | None,
        typer.Option(
            metavar="START:END",
            help="Withhold GNSS: seconds since the start, or ISO times. May be repeated.",
        ),
    ] = None,
    model: Annotated[
        Model, typer.Option(help="`paper` is the published method, for comparison.")
    ] = Model.default,
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            help="File for the points: .parquet, .geoparquet, .geojson, .csv, .gpkg, .gpx, .arrow, "
            ".nmea, .mcap, .bag, .db3.",
        ),
    ] = None,
    path_out: Annotated[
        Path | None,
        typer.Option(
            help="File for the path, one row per edge: .parquet, .geoparquet, .geojson, .csv, "
            ".gpkg, .gpx, .arrow; .rou.xml with --by-source."
        ),
    ] = None,
    by_source: Annotated[
        bool,
        typer.Option(
            "--by-source",
            help="One row of the path for each OpenStreetMap way, or row of your table of roads, "
            "rather than for each edge.",
        ),
    ] = False,
    every: Annotated[
        float | None, typer.Option(min=0.0, metavar="S", help="Write one point every S seconds.")
    ] = None,
    attributes: Annotated[
        bool, typer.Option("--attributes", help="Add the road's name, class and speed limit.")
    ] = False,
    lag: Annotated[
        str | None,
        typer.Option(
            metavar="S|full",
            help="Smooth with a fixed lag of S seconds (or of `200m`), or over the full drive.",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="Also write one .html file that shows the result.")
    ] = None,
    lineage: Annotated[
        Path | None,
        typer.Option(
            help="Write the hypotheses, one row each: birth, parent, probability and end (.csv, "
            ".parquet, .arrow)."
        ),
    ] = None,
    places: Annotated[
        Path | None,
        typer.Option(
            help="Table of point objects, such as signs (CSV, GeoJSON, GeoParquet), for --ahead, "
            "--nearby and --report."
        ),
    ] = None,
    ahead: Annotated[
        Path | None,
        typer.Option(
            help="Write the places within 500 m ahead: distance, sigma and probability, one row "
            "for each epoch and place (.csv, .parquet, .arrow)."
        ),
    ] = None,
    nearby: Annotated[
        Path | None,
        typer.Option(help="Likewise the places within 50 m in a straight line."),
    ] = None,
    sensor: SensorOption = None,
    force: Force = False,
) -> None:
    """Match a recorded drive to the road network, with probabilities."""
    own, more = read_columns(columns), read_sensors(sensor)
    pose, windows = read_start(start), [read_window(text) for text in mask or ()]
    from .. import writers

    outputs = {"-o": out, "--path-out": path_out, "--report": report, "--lineage": lineage}
    outputs |= {"--ahead": ahead, "--nearby": nearby}
    writers.check_apart(outputs, [*drive, roads, can, dbc, vehicle, places])
    if places is None and not ahead is nearby is None:
        raise SettingError(
            "--ahead and --nearby go with --places; a table of point objects was expected"
        )
    if places is not None and ahead is nearby is report is None:
        raise SettingError(
            "--places goes with --ahead, --nearby or --report; where to write was expected"
        )
    for output in (out, path_out, lineage, ahead, nearby):
        if output is not None:
            writers.check(output, force=force)
    if report is not None:
        from ..replay.drive_report import check_report

        check_report(report, force=force)
    from .. import matching
    from ..evidence.sensed import columns_of
    from ..places import Places
    from ..readers import read_drive, read_vehicle, vehicle_beside
    from ..readers.many_trips import are_many
    from ..roadmap import left_out, open_map
    from ..tables.schema import thinned

    defaults = not (can or dbc or start or mask or report or lineage or places)
    defaults = defaults and model is Model.default
    if len(drive) == 1 and defaults and are_many(drive[0], id_, own):
        return match_trips(
            drive[0], roads, out=out, path_out=path_out, by_source=by_source, every=every,
            force=force, vehicle=vehicle, attributes=attributes, lag=lag, crs=crs,
            drive_id=id_ or "drive_id", columns=own, tz=tz, dates=dates, sensors=more,
        )  # fmt: skip
    with progress_line() as progress:
        car = vehicle_beside(drive) if vehicle is None else read_vehicle(vehicle)
        progress("reading the drive", 0, 0)
        drives = read_drive(
            drive,
            vehicle=car,
            dbc=dbc,
            can=can,
            crs=crs,
            id=id_,
            columns=own | columns_of(more),
            tz=tz,
            skip_unreadable=True,
            dates=dates,
        )
        if (report or lineage) is not None and len(drives) > 1:
            raise DriveError(
                f"{len(drives)} drives ({', '.join(d.drive_id for d in drives[:10])}) are in the "
                "input; one was expected by --report and --lineage; write all by -o points.parquet "
                "and show one by `whichroad report points.parquet --drive-id NAME`"
            )
        progress("reading the map", 0, 0)
        network = open_map(roads, crs=crs)
        about = None if places is None else Places(places, network)
        progress("localizing", 0, 0)
        result = matching.match(
            drives, network, vehicle=car, model=model.value, start=pose, mask=windows,
            attributes=attributes, hypotheses=report is not None, lag=lag, progress=progress,
            places=about, sensors=more,
        )  # fmt: skip
        progress("writing", 0, 0)
        _write(result, out, every, force)
        if path_out is not None:
            path = result.path_arrow()
            writers.write_table(
                network.by_source(path) if by_source else path, path_out, force=force
            )
        for file, ask in ((ahead, result.ahead), (nearby, result.nearby)):
            if file is not None:
                writers.write_table(thinned(ask(), every, whole=True), file, force=force)
        if lineage is not None:
            result.lineage.write(lineage, force=force)
        if report is not None:
            from ..replay.drive_report import write_report
            from ..replay.open_replay import Remaking, one_of

            shown = Remaking(one_of(drives, None), network, car, places=about, sensors=more)
            recorded = shown.recorded(result, shown.absolute(windows))
            write_report(recorded, report, network, force=force)
    for note in [] if about is None else about.notes():
        typer.echo(f"note: {note}", err=True)
    print_skipped_roads(left_out(roads, network))
    print_summary(result)
    if result.summary["epochs_without_answer"] == result.summary["epochs"]:
        epochs = counted(result.summary["epochs"], "epoch")
        raise DriveError(
            f"{drive[0]}: none of {epochs} could be matched; a drive on the roads of "
            f"{roads} was expected; is it the right map?"
        )
    if out is path_out is report is lineage is ahead is nearby is None:
        typer.echo("no output was asked for; add -o points.parquet --path-out path.parquet")


def _write(result: "Result", out: Path | None, every: float | None, force: bool) -> None:
    from ..tables.schema import thinned
    from ..writers import write_table

    if out is not None:
        write_table(thinned(result.to_arrow(), every), out, force=force)


def print_summary(result: "Result") -> None:
    """The summary; what was skipped or failed goes to the standard error."""
    from ..roadmap.extent import outside_note

    each = result.summary.get("each", [result.summary])
    for reason, count in result.summary.get("skipped", {}).items():
        typer.echo(f"skipped: {reason}: {count:,}", err=True)
    for note in dict.fromkeys(result.summary.get("notes", ())):
        typer.echo(f"note: {note}", err=True)
    for one in each:
        if outside := one.get("fixes_outside_map"):
            fixes = one["fixes"] + one["fixes_masked"]
            typer.echo(f"note: {one['drive_id']}: {outside_note(outside, fixes)}", err=True)
    for one in each:
        whose = f"{one['drive_id']}: " if len(each) > 1 else ""
        for finding in one.get("diagnosis", ()):
            typer.echo(f"{whose}{_finding_line(finding)}", err=True)
    if len(each) > _EACH:
        print_table("all", [(name, result.summary[name]) for name in _OF_ALL])
    for one in each if len(each) <= _EACH else ():
        figures = {name: value for name, value in one.items() if name not in _PRINTED_APART}
        title = str(figures.pop("drive_id", "drive"))
        shares = figures.get("status", {})
        figures["status"] = {word: f"{100 * share:.1f} %" for word, share in shares.items()}
        print_table(title, _in_words(figures))
    for failed in result.summary.get("failed", ()):
        typer.echo(f"skipped: {failed}", err=True)


def _in_words(figures: dict[str, Any]) -> list[tuple[str, Any]]:
    """The figures of a drive as they are printed."""
    way = figures.pop("mean_p_way", None)
    rows = []
    for name, value in figures.items():
        if name == "mean_p_road" and way is not None:
            rows.append((_LABELS["mean_p_way"], way))
        if value not in ((), [], {}):
            rows.append((_LABELS.get(name, name), value))
    return rows


def _finding_line(finding: dict[str, Any]) -> str:
    """One setting that does not fit, as a line."""
    from ..diagnosis.finding import Finding

    found = Finding(**finding)
    return f"{found.level}: {found}"
