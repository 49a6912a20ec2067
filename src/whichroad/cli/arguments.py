"""What several commands ask for, and how its text is understood."""

import importlib
import math
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import SettingError
from ..moments import Moment, parse_window

if TYPE_CHECKING:
    from ..observations import StartPose
    from ..sensors import Sensor


class Model(StrEnum):
    """The filters that can answer."""

    default = "default"
    paper = "paper"


class Scene(StrEnum):
    """The paper's experiments."""

    fork = "fork"
    outage = "outage"
    parallel = "parallel"
    junction = "junction"
    gst = "gst"


class Preset(StrEnum):
    """The worlds that can be simulated."""

    good = "good"
    urban = "urban"
    outage = "outage"


Token = Annotated[
    str | None,
    typer.Option(envvar="WHICHROAD_TOKEN", help="Token that every client must send."),
]
TilesBy = Annotated[str | None, typer.Option(metavar="TEXT", help="Attribution of the --tiles.")]
Force = Annotated[bool, typer.Option("--force", help="Replace existing output files.")]
MapOption = Annotated[
    Path,
    typer.Option(
        "--map",
        help="A compiled map, or an OpenStreetMap extract (.osm.pbf, .osm, .osm.xml, .osm.gz, "
        ".osm.bz2). Or a table or graph of edges (.geojson, .csv, .parquet, .gpkg, .graphml, "
        ".shp). Overture's segments (.parquet) and SUMO's networks (.net.xml) are maps too.",
    ),
]

CanOption = Annotated[Path | None, typer.Option("--can", help="CAN log with wheel data.")]
DbcOption = Annotated[
    Path | None, typer.Option("--dbc", help="DBC file that describes the CAN signals.")
]
VehicleOption = Annotated[
    Path | None, typer.Option("--vehicle", help="Vehicle description (vehicle.toml).")
]
SensorOption = Annotated[
    list[str] | None,
    typer.Option(
        "--sensor",
        metavar="NAME",
        help="A further sensor: a class of whichroad.sensors, such as Height or Sky, or your own "
        "as module:Class. May be repeated.",
    ),
]
PlacesOption = Annotated[
    Path | None,
    typer.Option(
        "--places",
        help="Table of point objects, such as signs (CSV, GeoJSON, GeoParquet): those ahead and "
        "near are shown.",
    ),
]
CrsOption = Annotated[
    str | None,
    typer.Option(
        "--crs",
        help="Coordinate system of columns x and y, and of a table of roads that names none, such "
        "as EPSG:3067.",
    ),
]
IdOption = Annotated[
    str | None,
    typer.Option("--id", metavar="COLUMN", help="Column that names the drive of each row."),
]
ColumnsOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=COLUMN",
        help="Your own column names, such as time=ts,lat=Latitude,speed_kmh=v. Columns without "
        "names have numbers: time=1,lat=2. May be repeated.",
    ),
]
ZoneOption = Annotated[
    str | None,
    typer.Option(
        metavar="ZONE",
        help="Time zone of times that name none, such as Europe/Berlin. Default: UTC.",
    ),
]
DatesOption = Annotated[
    str | None,
    typer.Option(
        metavar="mdy|dmy|ymd",
        help="Order of day, month and year in dates such as 06/01/2026 or 010626. Default: as "
        "they show.",
    ),
]


def read_columns(texts: list[str] | None) -> dict[str, str | int]:
    """`NAME=COLUMN,NAME=COLUMN` as names and the columns that they stand for."""
    own: dict[str, str | int] = {}
    for part in (part for text in texts or () for part in text.split(",")):
        name, equals, column = part.partition("=")
        if not (name.strip() and equals and column.strip()):
            raise typer.BadParameter(
                f"--columns has {part!r}; NAME=COLUMN was expected, such as time=ts,lat=Latitude"
            )
        own[name.strip()] = column.strip()
    return own


def read_sensors(texts: list[str] | None) -> "list[Sensor]":
    """`--sensor` as sensors: classes of whichroad.sensors, or `module:Class`, without arguments.

    Raises:
        BadParameter: There is no such class, or it cannot be made so.
    """
    from .. import sensors

    found = []
    for text in texts or ():
        module, colon, name = text.rpartition(":")
        here = [
            n for n, one in vars(sensors).items() if isinstance(one, type) and "rows" in vars(one)
        ]
        if not colon and name not in here:
            raise typer.BadParameter(
                f"--sensor is {text!r}; one of {', '.join(sorted(set(here) - {'Sensor'}))}, or "
                "module:Class was expected"
            )
        try:
            sys.path.insert(0, "")
            made = getattr(importlib.import_module(module) if colon else sensors, name)()
        except (ImportError, AttributeError, TypeError, ValueError) as error:
            raise typer.BadParameter(
                f"--sensor is {text!r}: {error}; a class that is made without arguments was "
                "expected, as in docs/tutorials/add-a-sensor.md"
            ) from None
        finally:
            sys.path.remove("")
        found.append(made)
    return found


def read_start(text: str | None) -> "StartPose | tuple[float, float, float] | str | None":
    """`LAT,LON,BEARING` as three numbers, `map`, or `map:LAT,LON,METRES` as a vague pose."""
    if text is None or text == "map":
        return text
    vague = text.startswith("map:")
    third, most = ("METRES", 1e6) if vague else ("BEARING", 360.0)
    try:
        lat, lon, last = (float(part) for part in text.removeprefix("map:").split(","))
    except ValueError:
        raise typer.BadParameter(
            f"--start is {text!r}; map, or three numbers LAT,LON,{third} were expected, "
            "the place in degrees"
        ) from None
    if not (abs(lat) <= 90 and abs(lon) <= 180 and abs(last) <= most and (last > 0 or not vague)):
        raise typer.BadParameter(
            f"--start is {text!r}; a latitude within ±90°, a longitude within ±180° and "
            + ("a radius in metres" if vague else "a bearing within ±360°")
            + " were expected"
        )
    if not vague:
        return lat, lon, last
    from ..observations import StartPose

    return StartPose(lat, lon, 0.0, last, math.inf)


def read_window(text: str) -> tuple[Moment, Moment]:
    """`START:END` of `--mask` as two moments."""
    try:
        return parse_window(text)
    except SettingError as error:
        raise typer.BadParameter(f"--{error}") from None


def check_token(host: str, token: str | None) -> None:
    """See that who listens for other machines asks for a token.

    Raises:
        BadParameter: There is none.
    """
    from ..live.access import is_local

    if token is None and not is_local(host):
        raise typer.BadParameter(
            f"--host {host} lets other machines connect; a --token was expected"
        )
