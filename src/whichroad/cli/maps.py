"""`whichroad map`: compile a road map, or describe one."""

from pathlib import Path
from typing import Annotated

import typer

from .arguments import Force
from .console import print_table, progress_line

map_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)


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
    from ..roadmap import RoadMap, open_map
    from ..writers import check_apart, replacing

    check_apart({"-o": out}, [source])
    with progress_line() as progress, replacing(out, force=force) as part:
        progress(f"reading {source}", 0, 0)
        (open_map(source) if crs is None else RoadMap.from_edges(source, crs=crs)).save(part)
    typer.echo(f"{out}: {out.stat().st_size / 1e6:.1f} MB")


@map_app.command("info")
def map_info(roads: Annotated[Path, typer.Argument(metavar="MAP", help="Any map.")]) -> None:
    """Print what a map holds."""
    from ..roadmap import open_map

    with progress_line() as progress:
        progress(f"reading {roads}", 0, 0)
        info = open_map(roads).info()
    print_table(str(roads), info.items())
