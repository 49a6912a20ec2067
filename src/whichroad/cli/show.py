"""`whichroad replay` and `whichroad report`: replay of a recorded drive."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from urllib.parse import quote

import typer

from ..errors import comes_with
from .arguments import (
    CanOption,
    ColumnsOption,
    CrsOption,
    DbcOption,
    Force,
    MapOption,
    PlacesOption,
    SensorOption,
    TilesBy,
    Token,
    VehicleOption,
    check_token,
    read_columns,
    read_sensors,
    read_start,
    read_window,
)
from .console import progress_line, url_of

if TYPE_CHECKING:
    from ..replay.player import Player

DriveId = Annotated[str | None, typer.Option(help="Which drive to show, if the input has several.")]

PathFile = Annotated[
    Path | None,
    typer.Option("--path", help="Path from `match --path-out`, to draw between distant fixes."),
]


def replay(
    drive: Annotated[
        list[Path],
        typer.Argument(metavar="DRIVE|RESULT", help="Drive logs, or points from `match -o`."),
    ],
    roads: MapOption,
    can: CanOption = None,
    dbc: DbcOption = None,
    vehicle: VehicleOption = None,
    columns: ColumnsOption = None,
    start: Annotated[
        str | None,
        typer.Option(metavar="LAT,LON,BEARING", help="Start pose, as for `match`."),
    ] = None,
    mask: Annotated[
        list[str] | None,
        typer.Option(metavar="START:END", help="Withhold GNSS from the start, as for `match`."),
    ] = None,
    path: PathFile = None,
    places: PlacesOption = None,
    sensor: SensorOption = None,
    crs: CrsOption = None,
    drive_id: DriveId = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to listen on. 0: any free port.")
    ] = 8080,
    host: Annotated[
        str,
        typer.Option(
            help="Address to listen on. 0.0.0.0 lets other machines connect; give a --token."
        ),
    ] = "127.0.0.1",
    token: Token = None,
    tiles: Annotated[
        str | None,
        typer.Option(
            metavar="URL", help="Tiles to draw under the roads: https://.../{z}/{x}/{y}.png"
        ),
    ] = None,
    tiles_by: TilesBy = None,
    truth: Annotated[
        Path | None,
        typer.Option(help="True positions (time, lat, lon), to show the error beside the ellipse."),
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
) -> None:
    """Replay a drive or a result in the browser, and mask GNSS while it plays."""
    pose, windows = read_start(start), [read_window(text) for text in mask or ()]
    own, more = read_columns(columns), read_sensors(sensor)
    with comes_with("live", "replay"):
        check_token(host, token)
    from ..evidence.sensed import columns_of
    from ..places import Places
    from ..readers import read_drive, read_vehicle, vehicle_beside
    from ..replay.dropped import DroppedFile
    from ..replay.open_replay import Remaking, is_points, one_of, play_drive, play_result
    from ..replay.truth import read_truth
    from ..roadmap import open_map

    with comes_with("live", "replay"):
        import uvicorn  # noqa: F401  # now, not when the drive has been answered
        import websockets  # noqa: F401  # uvicorn would do without, and the page would be mute

        from ..live.web_server import listen
        from ..replay.replay_server import replay_app, serve

    with progress_line() as progress:
        progress("reading the map", 0, 0)
        network = open_map(roads, crs=crs)
        about = None if places is None else Places(places, network)
        known = None if truth is None else read_truth(truth)
        car = vehicle_beside(drive) if vehicle is None else read_vehicle(vehicle)
        player: Player
        if len(drive) == 1 and can is None and is_points(drive[0]):
            if more:
                raise typer.BadParameter(
                    "--sensor was given with a result, which has no readings; a drive was expected"
                )
            player = play_result(drive[0], network, drive_id, path, known, about)
        else:
            if path is not None:
                raise typer.BadParameter(
                    "--path was given with a drive; points from `match -o` were expected"
                )
            progress("reading the drive", 0, 0)
            drives = read_drive(
                drive,
                vehicle=car,
                dbc=dbc,
                can=can,
                crs=crs,
                columns=(own | columns_of(more)) or None,
            )
            one = one_of(drives, drive_id)
            progress("localizing", 0, 0)
            shown = Remaking(one, network, car, pose, places=about, sensors=more)
            player = play_drive(shown, windows, known)
        app = replay_app(
            player, network, tiles_url=tiles, tiles_by=tiles_by, host=host, token=token,
            opener=DroppedFile(network, car, dbc, about, more),
        )  # fmt: skip
        listener = listen(host, port)
    url = url_of(host, listener.getsockname()[1])
    typer.echo(f"{url} shows the drive; Ctrl-C stops the server")
    page = url if token is None else f"{url}?token={quote(token)}"
    serve(app, listener, page if browser else None)


def report(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Points from `match -o`.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="File for the page (.html).")],
    roads: Annotated[
        Path | None, typer.Option("--map", help="Road map, to draw the roads near the track.")
    ] = None,
    path: PathFile = None,
    places: PlacesOption = None,
    crs: CrsOption = None,
    drive_id: DriveId = None,
    force: Force = False,
) -> None:
    """Write one HTML file that shows a result, to open anywhere or to mail.

    Places ahead are those of the most probable road.  How sensors were heard is no part of a
    result: `match --report` shows it.
    """
    from ..places import Places
    from ..replay.drive_report import check_report, write_report
    from ..replay.points import check_map, read_points
    from ..replay.recorded_messages import RecordedMessages
    from ..roadmap import open_map
    from ..writers import check_apart

    check_apart({"-o": out}, [result, roads, path, places])
    check_report(out, force=force)
    for option, given in (("--path", path), ("--places", places)):
        if given is not None and roads is None:
            raise typer.BadParameter(
                f"{option} was given without --map; the roads are needed to draw it"
            )
    with progress_line() as progress:
        progress("reading the result", 0, 0)
        points = read_points(result, drive_id, path)
        progress("reading the map", 0, 0)
        network = None if roads is None else open_map(roads, crs=crs)
        if network is not None:
            check_map(points, network, result)
        progress("writing", 0, 0)
        about = None if places is None or network is None else Places(places, network)
        write_report(RecordedMessages(points, network, places=about), out, network, force=force)
    typer.echo(f"{out}: {out.stat().st_size / 1e6:.1f} MB")
