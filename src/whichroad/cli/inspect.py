"""`whichroad inspect`."""

from pathlib import Path
from typing import Annotated

import typer

from ..errors import ReadError
from .arguments import (
    CanOption,
    ColumnsOption,
    CrsOption,
    DatesOption,
    DbcOption,
    IdOption,
    VehicleOption,
    ZoneOption,
    read_columns,
)
from .console import print_table, progress_line


def inspect(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Drive logs and tables, their folders, maps, points from `match`, vehicle.toml, "
            ".dbc.",
        ),
    ],
    can: CanOption = None,
    dbc: DbcOption = None,
    vehicle: VehicleOption = None,
    crs: CrsOption = None,
    id_: IdOption = None,
    columns: ColumnsOption = None,
    tz: ZoneOption = None,
    dates: DatesOption = None,
) -> None:
    """Print what files hold, how they were read, and the command to match them."""
    from ..inspection import inspect_files

    with progress_line() as progress:
        progress("reading", 0, 0)
        found = inspect_files(
            files, can=can, dbc=dbc, vehicle=vehicle, crs=crs, id=id_,
            columns=read_columns(columns) or None, tz=tz, dates=dates,
        )  # fmt: skip
    for section in found.sections:
        print_table(section.title, section.rows)
        for line in section.said:
            typer.echo(f"  {line}")
    if not found.understood:
        raise ReadError(f"{files[0]}: none of the files could be read; see the reasons above")
    typer.echo(f"to match: {found.command}")
