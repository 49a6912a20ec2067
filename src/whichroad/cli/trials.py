"""Commands that need no drive of one's own: the demo, simulated drives, the experiments."""

from pathlib import Path
from typing import Annotated

import typer

from .arguments import Force, MapOption, Preset, Scene
from .console import print_table, progress_line


def demo(
    out: Annotated[Path, typer.Option(help="Folder for everything.")] = Path("whichroad-demo"),
    force: Force = False,
) -> None:
    """Localize the paper's drive from simulated files, and draw it."""
    from ..demo import run_demo

    with progress_line() as progress:
        summary = run_demo(out, force=force, progress=progress)
    seconds = {"seconds": summary["seconds"]}
    print_table(
        "The paper's drive, answered from its files alone", (summary["said"] | seconds).items()
    )
    typer.echo(f"see {summary['picture']}, or replay the drive and mask GNSS meanwhile:")
    typer.echo(
        f"  whichroad replay {out / 'drive.nmea'} --can {out / 'can.log'} --dbc "
        f"{out / 'vehicle.dbc'} --vehicle {out / 'vehicle.toml'} --map {out / 'map.osm'}"
    )
    typer.echo("to mail it as one page:")
    typer.echo(
        f"  whichroad report {out / 'points.parquet'} --map {out / 'map.osm'} "
        f"-o {out / 'report.html'}"
    )


def simulate(
    roads: MapOption,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the drive's files.")],
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same drive.")] = 1,
    length: Annotated[float, typer.Option(min=0.1, metavar="KM", help="How far to drive.")] = 12.0,
    preset: Annotated[Preset, typer.Option(help="The world to drive in.")] = Preset.good,
    force: Force = False,
) -> None:
    """Make a drive whose truth is known, in the formats of a real one."""
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
            help="Points that `match` or any other program wrote: time, lat, lon, or more.",
        ),
    ],
    truth: Annotated[
        Path, typer.Option(help="The truth: time, lat, lon, or more, as simulate has it.")
    ],
) -> None:
    """Score an answer against a known truth."""
    from ..evaluate import evaluate_files, further_columns

    with progress_line() as progress:
        progress("comparing", 0, 0)
        figures = evaluate_files(result, truth)
    print_table(f"{result} against {truth}", figures.items())
    further = further_columns(figures)
    if further:
        more = "; ".join(f"{column} ({adds})" for column, adds in further.items())
        typer.echo(f"columns of the answer that would add figures: {more}", err=True)
        typer.echo("of these edge_id and abscissa_m are needed in the truth, too", err=True)


def experiments(
    out: Annotated[Path, typer.Option(help="Folder for everything.")] = Path(
        "whichroad-experiments"
    ),
    scene: Annotated[list[Scene] | None, typer.Option(help="Only this one; repeatable.")] = None,
    seeds: Annotated[str, typer.Option(metavar="A:B", help="Drives A to B - 1 of each.")] = "0:200",
    keep: Annotated[
        bool,
        typer.Option("--keep", help="Also write every drive, its map and its truth, as tables."),
    ] = False,
    answers: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=DIR",
            help="Answers of another program, DIR/SCENE/SEED.parquet, to be compared; repeatable.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Drive the paper's experiments many times, by its method and by ours, and report."""
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
    """Compile the kernels now rather than at the first drive, where that is still to be done."""
    from ..native import library

    if (ready := library.ready()) is not None:
        typer.echo(f"nothing is to be done: the kernels are compiled, {ready}")
    else:
        typer.echo(f"compiled: {library.found()}")
