"""`whichroad replay` and `whichroad report`: replay of a recorded drive."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from urllib.parse import quote

import typer

from .arguments import (
    Force,
    MapOption,
    Token,
    check_token,
    extra_live,
    read_start,
    read_window,
)
from .console import progress_line

if TYPE_CHECKING:
    from ..replay.player import Player

DriveId = Annotated[
    str | None, typer.Option(help="Which drive, where there are several in the input.")
]

PathFile = Annotated[
    Path | None,
    typer.Option("--path", help="The path of `match --path-out`: the route between distant fixes."),
]


def replay(
    drive: Annotated[
        list[Path],
        typer.Argument(metavar="DRIVE|RESULT", help="Logs of a drive, or points of `match -o`."),
    ],
    roads: MapOption,
    can: Annotated[Path | None, typer.Option(help="CAN log with the wheels.")] = None,
    dbc: Annotated[Path | None, typer.Option(help="What the CAN log's signals mean.")] = None,
    vehicle: Annotated[Path | None, typer.Option(help="The car, a vehicle.toml.")] = None,
    start: Annotated[
        str | None,
        typer.Option(metavar="LAT,LON,BEARING", help="A known pose, as `match` takes it."),
    ] = None,
    mask: Annotated[
        list[str] | None,
        typer.Option(metavar="START:END", help="Withhold GNSS from the start, as `match` does."),
    ] = None,
    path: PathFile = None,
    drive_id: DriveId = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: any that is free.")] = 8080,
    host: Annotated[
        str, typer.Option(help="Where to listen; 0.0.0.0 lets other machines in, with a --token.")
    ] = "127.0.0.1",
    token: Token = None,
    tiles: Annotated[
        str | None,
        typer.Option(metavar="URL", help="Map tiles below the roads: https://.../{z}/{x}/{y}.png"),
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page.")] = True,
) -> None:
    """Show a recorded drive, or an answer, on the page: play it, turn its clock, mask GNSS."""
    pose, windows = read_start(start), [read_window(text) for text in mask or ()]
    with extra_live("replay"):
        check_token(host, token)
    from ..readers import read_drive, read_vehicle
    from ..replay.open_replay import Remaking, is_points, one_of, play_drive, play_result
    from ..roadmap import open_map

    with extra_live("replay"):
        import uvicorn  # noqa: F401  # now, not when the drive has been answered
        import websockets  # noqa: F401  # uvicorn would do without, and the page would be mute

        from ..replay.replay_server import listen, replay_app, serve

    with progress_line() as progress:
        progress("reading the map", 0, 0)
        network = open_map(roads)
        player: Player
        if len(drive) == 1 and can is None and is_points(drive[0]):
            player = play_result(drive[0], network, drive_id, path)
        else:
            if path is not None:
                raise typer.BadParameter("--path belongs to points of `match -o`, not to a drive")
            car = None if vehicle is None else read_vehicle(vehicle)
            progress("reading the drive", 0, 0)
            one = one_of(read_drive(drive, vehicle=car, dbc=dbc, can=can), drive_id)
            progress("answering it", 0, 0)
            player = play_drive(Remaking(one, network, car, pose), windows)
        app = replay_app(player, network, tiles_url=tiles, host=host, token=token)
        listener = listen(host, port)
    name = f"[{host}]" if ":" in host else host
    url = f"http://{name}:{listener.getsockname()[1]}/"
    typer.echo(f"{url} shows it; Ctrl-C ends")
    page = url if token is None else f"{url}?token={quote(token)}"
    serve(app, listener, page if browser else None)


def report(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Points of `match -o`.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="The page, one .html file.")],
    roads: Annotated[
        Path | None, typer.Option("--map", help="The map, to draw the roads near the track.")
    ] = None,
    path: PathFile = None,
    drive_id: DriveId = None,
    force: Force = False,
) -> None:
    """Write one HTML file that shows an answer, to open anywhere and to mail."""
    from ..replay.drive_report import check_report, write_report
    from ..replay.points import check_map, read_points
    from ..replay.recorded_messages import RecordedMessages
    from ..roadmap import open_map
    from ..writers import check_apart

    check_apart({"-o": out}, [result, roads, path])
    check_report(out, force=force)
    if path is not None and roads is None:
        raise typer.BadParameter("--path is drawn along the roads; --map was expected with it")
    with progress_line() as progress:
        progress("reading the answer", 0, 0)
        points = read_points(result, drive_id, path)
        progress("reading the map", 0, 0)
        network = None if roads is None else open_map(roads)
        if network is not None:
            check_map(points, network, result)
        progress("writing", 0, 0)
        write_report(RecordedMessages(points, network), out, network, force=force)
    typer.echo(f"{out}: {out.stat().st_size / 1e6:.1f} MB")
