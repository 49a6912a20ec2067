"""`whichroad serve`: answers of OSRM and Valhalla for many callers."""

from pathlib import Path
from typing import Annotated

import typer

from ..errors import comes_with
from .arguments import MapOption, Token, VehicleOption, check_token
from .console import progress_line, url_of


def serve(
    roads: MapOption,
    vehicle: VehicleOption = None,
    workers: Annotated[
        int, typer.Option(min=0, max=256, help="Processes. 0: one for each processor.")
    ] = 0,
    points: Annotated[
        int, typer.Option(min=2, max=200_000, help="Points of a trace, at most.")
    ] = 16_000,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to listen on. 0: any free port.")
    ] = 5000,
    token: Token = None,
) -> None:
    """Serve map matching over HTTP by the APIs of OSRM (/match/v1) and Valhalla."""
    with comes_with("live", "serve"):
        from ..serving.run_service import Plan
        from ..serving.run_service import serve as run

        check_token(host, token)
    from ..readers import read_vehicle
    from ..roadmap import open_map
    from ..roadmap.store import is_compiled
    from ..settings import Settings, Vehicle

    car = Vehicle() if vehicle is None else read_vehicle(vehicle)
    with progress_line() as progress:
        progress("reading the map", 0, 0)
        network = open_map(roads, check=True)
    compiled: Path | None = roads if is_compiled(roads) else None
    plan = Plan(network, compiled, car, Settings(**car.noise), workers, points, host, port, token)
    plan.ready = lambda bound: typer.echo(url_of(host, bound))
    run(plan)
