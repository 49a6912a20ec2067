"""`whichroad live`: the service that answers while the vehicle drives."""

import re
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import SettingError, comes_with
from .arguments import (
    MapOption,
    PlacesOption,
    SensorOption,
    TilesBy,
    Token,
    check_token,
    read_sensors,
    read_start,
)
from .console import progress_line, url_of
from .live_vehicles import Fittings, named, own_file

if TYPE_CHECKING:
    from ..live.addresses import Address
    from ..live.nmea_output import NmeaOutput
    from ..live.vehicle_run import Fitted
    from ..observations import Drive
    from ..roadmap import RoadMap
    from ..sensors import Sensor
    from ..settings import Settings, Vehicle

_OUT = re.compile(r"(tcp|udp)://(\[[^\]]*\]|[^:/]*):(\d{1,5})/?")


class Clock(StrEnum):
    """Whose times observations have."""

    sensor = "sensor"
    arrival = "arrival"


def live(
    roads: MapOption,
    nmea: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SOURCE",
            help="Fixes: /dev/ttyUSB0@9600, tcp://HOST:PORT, udp://HOST:PORT, listen://HOST:PORT, "
            "- (standard input), or a recorded file. May be repeated. NAME=SOURCE is of one "
            "vehicle of several.",
        ),
    ] = None,
    can: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SOURCE",
            help="Wheels: can0 (socketcan), INTERFACE:CHANNEL (python-can), or a recorded file. "
            "NAME=SOURCE is of one vehicle of several.",
        ),
    ] = None,
    dbc: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE", help="Signals of the CAN bus (.dbc), or NAME=FILE."),
    ] = None,
    vehicle: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE", help="Wheels, antenna, signals (.toml), or NAME=FILE."),
    ] = None,
    play: Annotated[
        list[Path] | None,
        typer.Option(metavar="DRIVE", help="Recorded files to play. May be repeated."),
    ] = None,
    speed: Annotated[
        str, typer.Option(metavar="X", help="Playback speed, a multiple of real time, or `max`.")
    ] = "1",
    laps: Annotated[
        int, typer.Option(min=1, help="Play the files this many times.", hidden=True)
    ] = 1,
    once: Annotated[
        bool, typer.Option("--once", help="Stop at the end of the recording or standard input.")
    ] = False,
    start: Annotated[
        str | None, typer.Option(metavar="LAT,LON,BEARING", help="Start pose, in degrees.")
    ] = None,
    window: Annotated[
        float,
        typer.Option(min=0.0, max=10.0, metavar="S", help="Sort in observations up to this late."),
    ] = 1.0,
    clock: Annotated[
        Clock, typer.Option(help="Use the sensor's times, or the times of arrival.")
    ] = Clock.sensor,
    lag: Annotated[
        float | None,
        typer.Option(min=0.0, max=600.0, metavar="S", help="Add the smoothed state S seconds ago."),
    ] = None,
    rate: Annotated[
        float,
        typer.Option(min=0.1, max=50.0, metavar="HZ", help="Rate of messages between fixes."),
    ] = 10.0,
    record: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for a recording of the service.")
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Store the state here, to resume after a crash."),
    ] = None,
    nmea_out: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SINK",
            help="Send the pose as NMEA: tcp://HOST:PORT (listens), udp://HOST:PORT. May be "
            "repeated. NAME=SINK is of one vehicle of several.",
        ),
    ] = None,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to listen on. 0: any free port.")
    ] = 8080,
    token: Token = None,
    tiles: Annotated[
        str | None, typer.Option(metavar="URL", help="Raster tiles to draw under the roads.")
    ] = None,
    tiles_by: TilesBy = None,
    page: Annotated[bool, typer.Option(help="Serve the web page at /.")] = True,
    sensor: SensorOption = None,
    readings: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SOURCE",
            help="Readings for each --sensor as lines of JSON: a source as of --nmea, but no file. "
            "May be repeated. NAME=SOURCE is of one vehicle of several.",
        ),
    ] = None,
    places: PlacesOption = None,
) -> None:
    """Localize a vehicle while it drives; serve a web page, WebSocket, HTTP and NMEA."""
    from ..writers import check_apart

    pose, factor, more = read_start(start), _speed(speed), read_sensors(sensor)
    recorded = record and record / "fixes.arrow"
    fittings = Fittings(
        named(nmea), named(can), named(dbc), named(vehicle), named(nmea_out), named(readings)
    )
    names = fittings.names
    read = [roads, *(play or ()), *([places] if places else [])]
    read += [v for given in (dbc, vehicle, can, nmea) for one in named(given).values() for v in one]
    check_apart({"--record": recorded, "--state": state}, read)
    if readings and (not more or play):
        raise typer.BadParameter(
            "--readings goes with --sensor, which says whose they are, and not with --play"
        )
    sinks = {name: [_sink(t) for t in fittings.nmea_out.get(name, ())] for name in names}
    if len(names) > 1 and (pose is not None or play):
        raise typer.BadParameter("--start and --play are of one vehicle; several were named")
    with comes_with("live", "live"):
        check_token(host, token)
        from ..live.server import Plan, serve
    from ..roadmap.store import is_compiled

    with progress_line() as progress:
        progress("reading the map", 0, 0)
        vehicles = _vehicles(fittings, roads, pose, lag, more, places)
        first = vehicles[0].localizer
        recording = _recorded(play, fittings, first.vehicle, more)
        if recording is not None:
            _check_on_map(recording, first.roads)
            for note in recording.notes:
                _report(f"note: {note}")
        for one in vehicles:
            if recording is None:
                one.nmea, one.can = _inputs(fittings, one.name)
                one.readings = _readings(fittings, one.name)
            one.nmea_outputs = _nmea_outputs(sinks[one.name])
            one.record = record if record is None or one.name is None else record / one.name
            one.state = own_file(state, one.name)
        pages = _pages(first.roads, tiles, tiles_by) if page else ()
    serve(
        Plan(
            vehicles, roads if is_compiled(roads) else None, recording, speed=factor, laps=laps,
            once=once, window=window, rate=rate, clock=clock.value, host=host, port=port,
            token=token, pages=pages, report=_report,
            ready=lambda bound: _print_addresses(host, bound, vehicles),
        )
    )  # fmt: skip


def _vehicles(
    fittings: Fittings, roads: Path, start: Any, lag: float | None, sensors: "list[Sensor]",
    places: Any,
) -> "list[Fitted]":  # fmt: skip
    """The filter of each vehicle, all on one map; nothing else is fitted yet."""
    from ..live.vehicle_run import Fitted
    from ..online import Localizer
    from ..roadmap import open_map

    cars = [(name, *_car(_path(fittings.one("vehicle", name)))) for name in fittings.names]
    network = open_map(roads, check=True)
    vehicles: list[Fitted] = []
    for name, car, settings in cars:
        localizer = Localizer(
            network, vehicle=car, settings=settings, start=start, lag=lag, sensors=sensors,
            places=places,
        )  # fmt: skip
        places = localizer.places
        vehicles.append(Fitted(localizer, name))
    for note in [] if places is None else places.notes():
        typer.echo(f"note: {note}", err=True)
    return vehicles


def _report(line: str) -> None:
    with suppress(OSError, ValueError):  # a log on a full disk, a closed terminal
        typer.echo(line, err=True)


def _speed(text: str) -> float | None:
    if text == "max":
        return None
    try:
        speed = float(text.removesuffix("x"))
    except ValueError:
        speed = 0.0
    if not 0.01 <= speed <= 1000.0:
        raise typer.BadParameter(f"--speed is {text!r}; a number, such as 5, or max was expected")
    return speed


def _sink(text: str) -> tuple[str, str, int]:
    found = _OUT.fullmatch(text)
    if found is None or int(found[3]) > 65_535:
        raise typer.BadParameter(
            f"--nmea-out is {text!r}; tcp://HOST:PORT or udp://HOST:PORT was expected"
        )
    return found[1], found[2].strip("[]") or "127.0.0.1", int(found[3])


def _nmea_outputs(sinks: list[tuple[str, str, int]]) -> "list[NmeaOutput]":
    from ..live.nmea_output import NmeaOutput

    return [NmeaOutput(*sink) for sink in sinks]


def _recorded(
    play: list[Path] | None, fittings: Fittings, car: "Vehicle", sensors: "list[Sensor]"
) -> "Drive | None":
    """The recorded drive, where files were given."""
    nmea = [one for given in fittings.nmea.values() for one in given]
    can = [one for given in fittings.can.values() for one in given]
    files = [*(play or ()), *(Path(one) for one in nmea if Path(one).is_file())]
    can_files = [Path(one) for one in can if Path(one).is_file()]
    if not files and not can_files:
        return None
    if len(fittings.names) > 1 or len(can_files) > 1:
        raise typer.BadParameter("recorded files are played for one vehicle; several were named")
    if len(files) < len(play or ()) + len(nmea) or (can and not can_files):
        raise typer.BadParameter(
            "recorded files and sensors cannot be combined; give one kind only"
        )
    from ..readers import read_drive

    dbc = _path(fittings.one("dbc", fittings.names[0]))
    from ..evidence.sensed import columns_of

    drives = read_drive(
        files, vehicle=car, can=can_files[0] if can_files else None, dbc=dbc,
        columns=columns_of(sensors),
    )  # fmt: skip
    if len(drives) > 1:
        raise typer.BadParameter(f"{len(drives)} drives are in the files; one was expected")
    return drives[0]


def _check_on_map(drive: "Drive", roads: "RoadMap") -> None:
    """As `match` does: a drive off the map is refused, a part of it told."""
    from ..roadmap.extent import fixes_outside, outside_note

    fixes = drive.fixes
    if fixes is None or not len(fixes):
        return
    outside = fixes_outside(drive.drive_id, fixes.lat_deg, fixes.lon_deg, roads)
    if outside:
        _report(f"note: {outside_note(outside, len(fixes))}")


def _inputs(
    fittings: Fittings, name: str | None
) -> "tuple[list[Address], list[tuple[Address, Path]]]":
    """The sensors of a vehicle."""
    from ..live.addresses import can_address, nmea_address

    nmea = [nmea_address(one) for one in fittings.nmea.get(name, ())]
    if any(address.kind == "serial" for address in nmea):
        with comes_with("live", "live"):
            import serial  # noqa: F401
    can = []
    source, dbc = fittings.can.get(name, []), _path(fittings.one("dbc", name))
    if len(source) > 1:
        raise typer.BadParameter("--can was given twice for one vehicle; once was expected")
    if source:
        if dbc is None:
            raise typer.BadParameter("--can was given without --dbc; both are needed")
        can = [(can_address(source[0]), dbc)]
    if not nmea and not can:
        raise typer.BadParameter("no input was given; --nmea, --can or --play was expected")
    return nmea, can


def _readings(fittings: Fittings, name: str | None) -> "list[Address]":
    """Where readings of further sensors come from, of a vehicle."""
    from ..live.addresses import nmea_address

    return [nmea_address(one, "--readings") for one in fittings.readings.get(name, ())]


def _car(path: Path | None) -> "tuple[Vehicle, Settings]":
    """A vehicle and the settings that fit its sensors."""
    from ..readers import read_vehicle
    from ..settings import Settings, Vehicle

    car = Vehicle() if path is None else read_vehicle(path)
    return car, Settings(**car.noise)


def _path(text: str | None) -> Path | None:
    return None if text is None else Path(text)


def _pages(roads: "RoadMap", tiles: str | None, tiles_by: str | None) -> Any:
    """The page's routes; without MapLibre the service runs without them, with a notice."""
    from ..page import page_routes

    try:
        return page_routes(roads, tiles_url=tiles, tiles_by=tiles_by)
    except SettingError as error:
        if tiles is not None:
            raise
        typer.echo(f"no page: {error}", err=True)
        return ()


def _print_addresses(host: str, port: int, vehicles: "list[Fitted]") -> None:
    typer.echo(url_of(host, port))
    typer.echo("Ctrl-C stops the service", err=True)
    for output in [output for one in vehicles for output in one.nmea_outputs]:
        typer.echo(f"NMEA: {output.scheme}://{output.host}:{output.port}")
