"""`whichroad map`: compile a road map, or describe one."""

from pathlib import Path
from typing import Annotated

import typer

from .arguments import Force
from .console import print_table, progress_line

map_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)


@map_app.command("build")
def map_build(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="INPUT",
            help="An OpenStreetMap extract (.osm.pbf, .osm, .osm.xml, ...), Overture's segments "
            "(.parquet) or a network of SUMO (.net.xml). Or a table or graph of edges "
            "(.geojson, .csv, .parquet, .gpkg, .graphml, .shp, ...).",
        ),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="File for the compiled map.")],
    crs: Annotated[
        str | None,
        typer.Option(help="Reference system of an edge table or network, such as EPSG:3067."),
    ] = None,
    gap: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="How far ends of an edge table may miss each other and yet meet; 0: not at all. "
            "Else it is learnt.",
        ),
    ] = None,
    bbox: Annotated[
        str | None,
        typer.Option(
            metavar="WEST,SOUTH,EAST,NORTH",
            help="Keep only this part of an OSM extract, in degrees.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Compile a road map, so that other commands open it at once."""
    from ..roadmap import RoadMap, open_map
    from ..writers import check_apart, replacing

    of_edges = crs is not None or gap is not None
    if of_edges and bbox is not None:
        raise typer.BadParameter(
            "--crs and --gap are for edge tables, --bbox for OSM extracts; give one of them"
        )
    check_apart({"-o": out}, [source])
    with progress_line() as progress, replacing(out, force=force) as part:
        progress(f"reading {source}", 0, 0)
        if bbox is not None:
            roads = RoadMap.from_osm(source, bbox=tuple(bbox.split(",")))  # type: ignore[arg-type]
        else:
            roads = RoadMap.from_edges(source, crs=crs, gap_m=gap) if of_edges else open_map(source)
        roads.save(part)
        info = roads.info()
    for reason, count in info["skipped"].items():
        typer.echo(f"skipped: {reason}: {count:,}", err=True)
    size = f"{out.stat().st_size / 1e6:.1f} MB"
    typer.echo(f"{out}: {info['km']:,.1f} km of roads, {info['edges']:,} directed edges, {size}")


@map_app.command("info")
def map_info(
    roads: Annotated[Path, typer.Argument(metavar="MAP", help="A road map, compiled or not.")],
) -> None:
    """Print what a map holds."""
    from ..roadmap import open_map

    with progress_line() as progress:
        progress(f"reading {roads}", 0, 0)
        info = open_map(roads).info()
    print_table(str(roads), info.items())


@map_app.command("check")
def map_check(
    roads: Annotated[Path, typer.Argument(metavar="MAP", help="Any map.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="The defects as a table with places.")
    ] = None,
    path: Annotated[
        Path | None,
        typer.Option(
            help="Path from `match --path-out` (.parquet, .arrow): list the defects on it."
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Find defects: roads that do not meet, isolated parts, one-way dead ends, duplicates."""
    from ..evaluate.input_tables import read_table
    from ..roadmap import open_map
    from ..roadmap.defects import KINDS, defects
    from ..writers import check, check_apart, write_table

    check_apart({"-o": out}, [roads, path])
    if out is not None:
        check(out, force=force)
    with progress_line() as progress:
        progress(f"reading {roads}", 0, 0)
        network = open_map(roads)
        progress("looking for defects", 0, 0)
        found = defects(network, None if path is None else read_table(path))
    kinds = found["kind"].to_pylist()
    rows = [(kind, f"{kinds.count(kind):,} {what}") for kind, what in KINDS.items()]
    print_table(f"{roads}: {len(kinds):,} defects", rows)
    if path is not None:
        met = sum(count > 0 for count in found["stumbled"].to_pylist())
        typer.echo(f"{path}: drives broke a rule or a gap began at {met:,} of them")
    if out is not None:
        write_table(found, out, force=force)


@map_app.command("diff")
def map_diff(
    old: Annotated[Path, typer.Argument(metavar="OLD", help="The map of old results.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="A later one of the same region.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", help="A row for each old edge: .csv .parquet .arrow; else its counts."
        ),
    ] = None,
    force: Force = False,
) -> None:
    """List for each edge of an old map the same edge of a new map."""
    from ..roadmap import open_map
    from ..roadmap.differences import counts, differences
    from ..writers import check, check_apart, write_table

    if out is not None:
        check_apart({"-o": out}, [old, new])
        check(out, force=force)
    with progress_line() as progress:
        progress("reading the maps", 0, 0)
        before, after = open_map(old), open_map(new)
        progress("comparing", 0, 0)
        table = differences(before, after)
    if out is not None:
        write_table(table, out, force=force)
    title = f"{old}: {before.fingerprint}, {new}: {after.fingerprint}"
    print_table(title, [("edges", table.num_rows), *counts(table).most_common()])
