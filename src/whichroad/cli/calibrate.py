"""`whichroad calibrate`."""

from pathlib import Path
from typing import Annotated

import typer

from ..errors import refused
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
    VehicleOption,
    ZoneOption,
    read_columns,
)
from .console import progress_line


def calibrate(
    drives: Annotated[
        list[Path],
        typer.Argument(
            metavar="DRIVES...",
            help="Drives of one car with fixes and odometry: files, or one folder for each drive.",
        ),
    ],
    roads: MapOption,
    out: Annotated[Path, typer.Option("-o", "--out", help="The vehicle.toml that is written.")],
    can: CanOption = None,
    dbc: DbcOption = None,
    vehicle: VehicleOption = None,
    crs: CrsOption = None,
    id_: IdOption = None,
    columns: ColumnsOption = None,
    tz: ZoneOption = None,
    dates: DatesOption = None,
    force: Force = False,
) -> None:
    """Learn a car's odometry, antenna, clock and noise from its own drives."""
    from .. import writers
    from ..calibration import calibrate as learn

    writers.check_apart({"-o": out}, [*drives, roads, can, dbc])
    writers.check_place(out, force=force)
    logs = [*drives, can] if can else drives
    with progress_line() as progress:
        found = learn(
            logs, roads, vehicle=vehicle, dbc=dbc, crs=crs, id=id_,
            columns=read_columns(columns) or None, tz=tz, dates=dates,
            progress=lambda what: progress(what, 0, 0),
        )  # fmt: skip
    try:
        out.write_text(found.to_toml(), encoding="utf-8")
    except OSError as error:
        raise refused(out, error, "choose another place") from error
    for one in found.quantities:
        typer.echo(str(one))
    typer.echo(
        f"held-out evidence of all: {found.gain:+.1f} ± {found.gain_sigma:.1f} nats a drive"
        if found.held_out
        else "held-out evidence: none, as no drive was held out"
    )
    for reason, count in found.left_out.items():
        typer.echo(f"left out: {counted(count, 'drive')}: {reason}", err=True)
    for note in found.notes:
        typer.echo(f"note: {note}", err=True)
    typer.echo(f"from {counted(found.drives, 'drive')}: {out}")
