"""Commands that need no drive of one's own: the demo, simulated drives, the experiments."""

from pathlib import Path
from typing import Annotated

import typer

from .arguments import (
    Force,
    MapOption,
    Preset,
    Scene,
    read_columns,
    read_window,
)
from .console import print_table, progress_line


def demo(
    out: Annotated[Path, typer.Option(help="Folder for all files.")] = Path("whichroad-demo"),
    force: Force = False,
) -> None:
    """Simulate the drive of the paper into files, match it and draw it."""
    from ..demo import run_demo

    with progress_line() as progress:
        summary = run_demo(out, force=force, progress=progress)
    seconds = {"seconds": summary["seconds"]}
    print_table(
        "The paper's drive, matched from its files alone", (summary["said"] | seconds).items()
    )
    typer.echo(f"see {summary['picture']}; to replay the drive in a browser:")
    typer.echo(
        f"  whichroad replay {out / 'drive.nmea'} --can {out / 'can.log'} --dbc "
        f"{out / 'vehicle.dbc'} --vehicle {out / 'vehicle.toml'} --map {out / 'map.osm'}"
    )
    typer.echo("to write it as one HTML file:")
    typer.echo(
        f"  whichroad report {out / 'points.parquet'} --map {out / 'map.osm'} "
        f"-o {out / 'report.html'}"
    )


def simulate(
    roads: MapOption,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the files of the drive.")],
    seed: Annotated[
        int, typer.Option(min=0, help="Random seed; the same seed gives the same drive.")
    ] = 1,
    length: Annotated[
        float, typer.Option(min=0.1, metavar="KM", help="Length of the drive.")
    ] = 12.0,
    preset: Annotated[Preset, typer.Option(help="Conditions to simulate.")] = Preset.good,
    force: Force = False,
) -> None:
    """Simulate a drive with known truth, in the formats of a real one."""
    from ..roadmap import open_map
    from ..simulate import FILES, simulate_drive, write_drive
    from ..writers import check_apart

    check_apart({f"{name} of -o": out / name for name in FILES}, [roads])
    with progress_line() as progress:
        progress("reading the map", 0, 0)
        network = open_map(roads)
        progress("driving", 0, 0)
        drive = simulate_drive(network, seed=seed, length_m=1000.0 * length, scenario=preset.value)
        written = write_drive(drive, network, out, force=force)
    for path in written:
        typer.echo(str(path))


def evaluate(
    result: Annotated[
        Path,
        typer.Argument(
            metavar="RESULT",
            help="Points from `match` or another program: time, lat, lon, and more if known.",
        ),
    ],
    truth: Annotated[
        Path,
        typer.Option(
            help="True points: time, lat, lon, and more. Or the folder that `simulate` wrote."
        ),
    ],
    mask: Annotated[
        list[str] | None,
        typer.Option(
            metavar="START:END",
            help="Also give the figures of this outage, as in `match`. May be repeated.",
        ),
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=COLUMN",
            help="Own column names of either table: time=ts,lat=Latitude. May be repeated.",
        ),
    ] = None,
) -> None:
    """Score a result against the known truth."""
    from ..evaluate import score_files
    from ..evaluate.score import MEANINGS

    own = {name: str(column) for name, column in read_columns(columns).items()}
    windows = [read_window(text) for text in mask or ()]
    with progress_line() as progress:
        progress("comparing", 0, 0)
        scored = score_files(result, truth, mask=windows, columns=own)
    print_table(f"{result} against {truth}", scored.figures.items(), MEANINGS)
    for note in scored.notes:
        typer.echo(f"note: {note}", err=True)
    if scored.further:
        more = "; ".join(f"{column} ({adds})" for column, adds in scored.further.items())
        typer.echo(f"more columns would add figures: {more}", err=True)


def experiments(
    out: Annotated[Path, typer.Option(help="Folder for all files.")] = Path(
        "whichroad-experiments"
    ),
    scene: Annotated[
        list[Scene] | None, typer.Option(help="Run only this scene. May be repeated.")
    ] = None,
    seeds: Annotated[
        str, typer.Option(metavar="A:B", help="Seeds A to B - 1, one drive each.")
    ] = "0:200",
    keep: Annotated[
        bool,
        typer.Option("--keep", help="Also write each drive, its map and its truth as tables."),
    ] = False,
    answers: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=DIR",
            help="Compare results of another program, DIR/SCENE/SEED.parquet. May be repeated.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Repeat the experiments of the paper over many drives, and compare methods."""
    first, _, last = seeds.partition(":")
    if not (first.isdecimal() and last.isdecimal() and int(first) < int(last)):
        raise typer.BadParameter(f"--seeds is {seeds!r}; A:B with A < B was expected")
    others = dict(text.partition("=")[::2] for text in answers or ())
    if not all(others.values()):
        raise typer.BadParameter(f"--answers is {answers}; NAME=DIR was expected")
    from ..experiments import run_experiments

    drives, names = range(int(first), int(last)), [one.value for one in scene or ()]
    with progress_line() as progress:
        done = run_experiments(
            out, scenes=names, seeds=drives, force=force, keep=keep, answers=others,
            progress=progress,
        )  # fmt: skip
    for name, about in done["scenes"].items():
        typer.echo(f"{name}: {about['title']} ({about['figure']})")
        typer.echo("".join(f"  {sentence}\n" for sentence in about["seen"]))
    typer.echo(f"seeds {seeds}; see {done['report']}")


def warmup() -> None:
    """Compile the kernels now, if this installation has not done so yet."""
    from ..native import library

    if (ready := library.ready()) is not None:
        typer.echo(f"nothing to do; the kernels are compiled: {ready}")
    else:
        typer.echo(f"compiled: {library.found()}")
