"""Arguments in, exit codes out: 0 done, 1 nothing could be answered, 2 wrong usage.

Rooms are imported inside the commands, so that asking for help costs nothing.
Answers go to the standard output; progress, warnings and errors to the other.
"""

import math
import os
import sys
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from . import __version__
from .errors import DriveError, WhichroadError
from .terminal import progress_line, say_table

if TYPE_CHECKING:
    from .records import StartPose
    from .result import Result

app = typer.Typer(
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
map_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
app.add_typer(map_app, name="map", help="Compile a road map, or say what one holds.")

Moment = float | datetime


class Model(StrEnum):
    """The filters that can answer."""

    default = "default"
    paper = "paper"


class Scene(StrEnum):
    """The paper's experiments."""

    fork = "fork"
    outage = "outage"
    parallel = "parallel"
    junction = "junction"
    gst = "gst"


class Preset(StrEnum):
    """The worlds that can be simulated."""

    good = "good"
    urban = "urban"
    outage = "outage"


Force = Annotated[bool, typer.Option("--force", help="Replace outputs that exist.")]
MapOption = Annotated[
    Path,
    typer.Option(
        "--map",
        help="A compiled map, an OpenStreetMap extract (.osm.pbf, .osm, .osm.gz, .osm.bz2), "
        "or a table of edges (.geojson, .csv, .parquet).",
    ),
]


def main() -> NoReturn:
    """Run the command line; every way out is an exit code and no traceback."""
    try:
        app()
    except WhichroadError as error:
        _fail(f"error: {error}")
    except KeyboardInterrupt:
        _fail("interrupted", code=130)
    except Exception as error:
        if os.environ.get("WHICHROAD_TRACEBACK"):
            raise
        kind = type(error).__name__
        _fail(
            f"error: this should not happen ({kind}: {error}); please report it, with what "
            "WHICHROAD_TRACEBACK=1 adds"
        )
    sys.exit(0)


def _fail(message: str, code: int = 1) -> NoReturn:
    typer.echo(" ".join(message.split()), err=True)
    sys.exit(code)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"whichroad {__version__}")
        raise typer.Exit


@app.callback()
def whichroad(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Say the version."),
    ] = False,
) -> None:
    """Where exactly a vehicle is, on which road, and how sure that is."""


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for everything.")] = Path("whichroad-demo"),
    force: Force = False,
) -> None:
    """Localize the paper's drive from simulated files, and draw it."""
    from .demo import run_demo

    with progress_line() as progress:
        summary = run_demo(out, force=force, tell=progress)
    seconds = {"seconds": summary["seconds"]}
    say_table(
        "The paper's drive, answered from its files alone", (summary["said"] | seconds).items()
    )
    typer.echo(f"look at {summary['picture']}")


@map_app.command("build")
def map_build(
    source: Annotated[Path, typer.Argument(metavar="INPUT", help="OSM extract or edge table.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="The compiled map.")],
    crs: Annotated[
        str | None, typer.Option(help="Reference system of an edge table, such as EPSG:3067.")
    ] = None,
    force: Force = False,
) -> None:
    """Compile a map once, to open it in an instant."""
    from .roadmap import RoadMap
    from .session import open_map
    from .writers import replacing

    with progress_line() as progress, replacing(out, force=force) as part:
        progress(f"reading {source}", 0, 0)
        (open_map(source) if crs is None else RoadMap.from_edges(source, crs=crs)).save(part)
    typer.echo(f"{out}: {out.stat().st_size / 1e6:.1f} MB")


@map_app.command("info")
def map_info(roads: Annotated[Path, typer.Argument(metavar="MAP", help="Any map.")]) -> None:
    """Say what a map holds."""
    from .session import open_map

    with progress_line() as progress:
        progress(f"reading {roads}", 0, 0)
        info = open_map(roads).info()
    say_table(str(roads), info.items())


@app.command()
def match(
    drive: Annotated[
        list[Path], typer.Argument(metavar="DRIVE", help="NMEA logs and drive tables.")
    ],
    roads: MapOption,
    can: Annotated[Path | None, typer.Option(help="CAN log with the wheels.")] = None,
    dbc: Annotated[Path | None, typer.Option(help="What the CAN log's signals mean.")] = None,
    vehicle: Annotated[Path | None, typer.Option(help="The car, a vehicle.toml.")] = None,
    start: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON,BEARING",
            help="A known pose, in degrees; or `map`: anywhere on it, found by the turns that both "
            "wheels tell; or `map:LAT,LON,METRES`: about so far from there.",
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
    every: Annotated[
        float | None, typer.Option(min=0.0, metavar="S", help="One point every S seconds.")
    ] = None,
    attributes: Annotated[
        bool, typer.Option("--attributes", help="Add name, class and limit of the road.")
    ] = False,
    force: Force = False,
) -> None:
    """Say where a vehicle was, on which road, and how sure that is."""
    pose, windows = _start(start), [_window(text) for text in mask or ()]
    from . import writers

    for output in (out, path_out):
        if output is not None:
            writers.check(output, force=force)
    from . import session
    from .readers import read_drive, read_vehicle

    with progress_line() as progress:
        car = None if vehicle is None else read_vehicle(vehicle)
        progress("reading the drive", 0, 0)
        drives = read_drive(drive, vehicle=car, dbc=dbc, can=can)
        progress("reading the map", 0, 0)
        network = session.open_map(roads)
        result = session.match(
            drives, network, vehicle=car, model=model.value, start=pose, mask=windows,
            attributes=attributes, progress=progress,
        )  # fmt: skip
        progress("writing", 0, 0)
        _write(result, out, path_out, every, force)
    _say(result)
    if result.summary["epochs_without_answer"] == result.summary["epochs"]:
        raise DriveError(
            f"{drive[0]}: none of {result.summary['epochs']:,} epochs could be answered; a drive "
            f"on the roads of {roads} was expected; is it the right map?"
        )
    if out is None and path_out is None:
        typer.echo("nothing was written; -o points.parquet --path-out path.parquet would")


def _write(
    result: "Result", out: Path | None, path_out: Path | None, every: float | None, force: bool
) -> None:
    from .tables import thinned
    from .writers import write_table

    if out is not None:
        points = result.to_arrow()
        write_table(thinned(points, every) if every else points, out, force=force)
    if path_out is not None:
        result.write_path(path_out, force=force)


def _say(result: "Result") -> None:
    """The summary; what was skipped or failed goes to the standard error."""
    for one in result.summary.get("each", [result.summary]):
        figures = dict(one)
        for reason, count in figures.pop("skipped", {}).items():
            typer.echo(f"skipped: {count} {reason}", err=True)
        for note in figures.pop("notes", ()):
            typer.echo(f"note: {note}", err=True)
        for finding in figures.pop("diagnosis", ()):
            typer.echo(_told(finding), err=True)
        title = str(figures.pop("drive_id", "drive"))
        shares = figures.get("status", {})
        figures["status"] = {word: f"{100 * share:.1f} %" for word, share in shares.items()}
        say_table(title, [row for row in figures.items() if row[1] not in ((), [], {})])
    for failed in result.summary.get("failed", ()):
        typer.echo(f"skipped: {failed}", err=True)


def _told(finding: dict[str, Any]) -> str:
    """One setting that does not fit, as a line."""
    from .diagnosis import Finding

    told = Finding(**finding)
    return f"{told.level}: {told}"


@app.command()
def simulate(
    roads: MapOption,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the drive's files.")],
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same drive.")] = 1,
    length: Annotated[float, typer.Option(min=0.1, metavar="KM", help="How far to drive.")] = 12.0,
    preset: Annotated[Preset, typer.Option(help="The world to drive in.")] = Preset.good,
    force: Force = False,
) -> None:
    """Make a drive whose truth is known, in the formats of a real one."""
    from .session import open_map
    from .simulate import simulate_drive, write_drive

    with progress_line() as progress:
        progress("reading the map", 0, 0)
        network = open_map(roads)
        progress("driving", 0, 0)
        drive = simulate_drive(network, seed=seed, length_m=1000.0 * length, scenario=preset.value)
        written = write_drive(drive, network, out, force=force)
    for path in written:
        typer.echo(str(path))


@app.command()
def evaluate(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Points that match wrote.")],
    truth: Annotated[Path, typer.Option(help="The truth, a table as simulate writes it.")],
) -> None:
    """Say what an answer is worth against a known truth."""
    from .evaluate import evaluate_files

    with progress_line() as progress:
        progress("comparing", 0, 0)
        figures = evaluate_files(result, truth)
    say_table(f"{result} against {truth}", figures.items())


@app.command()
def experiments(
    out: Annotated[Path, typer.Option(help="Folder for everything.")] = Path(
        "whichroad-experiments"
    ),
    scene: Annotated[list[Scene] | None, typer.Option(help="Only this one; repeatable.")] = None,
    seeds: Annotated[str, typer.Option(metavar="A:B", help="Drives A to B - 1 of each.")] = "0:200",
    force: Force = False,
) -> None:
    """Drive the paper's experiments many times, by its method and by ours, and report."""
    first, _, last = seeds.partition(":")
    if not (first.isdecimal() and last.isdecimal() and int(first) < int(last)):
        raise typer.BadParameter(f"--seeds is {seeds!r}; A:B with A < B was expected")
    from .experiments import run_experiments

    drives, names = range(int(first), int(last)), [one.value for one in scene or ()]
    with progress_line() as progress:
        done = run_experiments(out, scenes=names, seeds=drives, force=force, tell=progress)
    for name, about in done["scenes"].items():
        typer.echo(f"{name}: {about['title']} ({about['figure']})")
        typer.echo("".join(f"  {sentence}\n" for sentence in about["seen"]))
    typer.echo(f"seeds {seeds}; look at {done['report']}")


@app.command()
def warmup() -> None:
    """Compile the kernels now rather than at the first drive."""
    from .demo import warm_up

    with progress_line() as progress:
        warm_up(progress)
    typer.echo("ready")


def _start(text: str | None) -> "StartPose | tuple[float, float, float] | str | None":
    """`LAT,LON,BEARING` as three numbers, `map`, or `map:LAT,LON,METRES` as a vague pose."""
    if text is None or text == "map":
        return text
    vague = text.startswith("map:")
    third, most = ("METRES", 1e6) if vague else ("BEARING", 360.0)
    try:
        lat, lon, last = (float(part) for part in text.removeprefix("map:").split(","))
    except ValueError:
        raise typer.BadParameter(
            f"--start is {text!r}; map, or three numbers LAT,LON,{third} were expected, "
            "the place in degrees"
        ) from None
    if not (abs(lat) <= 90 and abs(lon) <= 180 and abs(last) <= most and (last > 0 or not vague)):
        raise typer.BadParameter(
            f"--start is {text!r}; a latitude within 90, a longitude within 180 degrees and "
            + ("some metres" if vague else "a bearing within 360 degrees")
            + " were expected"
        )
    if not vague:
        return lat, lon, last
    from .records import StartPose

    return StartPose(lat, lon, 0.0, last, math.inf)


def _window(text: str) -> tuple[Moment, Moment]:
    """`START:END` as two moments; ISO times hold colons themselves."""
    for index, letter in enumerate(text):
        if letter == ":":
            begin, end = _moment(text[:index]), _moment(text[index + 1 :])
            if begin is not None and end is not None and type(begin) is type(end):
                if begin < end:  # type: ignore[operator]
                    return begin, end
                raise typer.BadParameter(f"--mask {text!r} ends before it starts")
    raise typer.BadParameter(
        f"--mask is {text!r}; START:END in seconds from the drive's start (120:240) or in ISO "
        "times (2026-06-01T08:02:00Z:2026-06-01T08:04:00Z) was expected"
    )


def _moment(text: str) -> Moment | None:
    """Seconds, or a time (UTC unless it says otherwise), or None."""
    try:
        return float(text)
    except ValueError:
        pass
    if "T" not in text:
        return None
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return None
    return time if time.tzinfo else time.replace(tzinfo=UTC)
