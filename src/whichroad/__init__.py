"""Match recorded or live drives to a road network, with probabilities.

    result = whichroad.match("drive.nmea", "city.osm.pbf")
    result.points, result.path

Names are loaded when first used, so that importing the package costs nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .batch import match_many
    from .diagnosis.findings import diagnose
    from .errors import (
        DriveError,
        MapError,
        ReadError,
        SettingError,
        WhichroadError,
        WriteError,
    )
    from .fleet.edge_speeds import speeds
    from .matching import match
    from .observations import (
        Distance,
        GeoFix,
        Pose,
        SpeedYaw,
        StartPose,
        WheelSpeed,
        WheelTicks,
        YawRate,
    )
    from .online import Estimate, Hypothesis, Localizer
    from .places import Places, RelativePlace
    from .readers import read_drive, read_vehicle
    from .roadmap import RoadMap
    from .settings import Settings, Vehicle
    from .simulate import simulate_drive
    from .tables.provenance import map_of
    from .tables.result import Result

_MODULES = {
    "batch": ("match_many",),
    "diagnosis.findings": ("diagnose",),
    "fleet.edge_speeds": ("speeds",),
    "errors": (
        "DriveError", "MapError", "ReadError", "SettingError", "WhichroadError", "WriteError",
    ),
    "online": ("Estimate", "Hypothesis", "Localizer"),
    "readers": ("read_drive", "read_vehicle"),
    "observations": (
        "Distance", "GeoFix", "Pose", "SpeedYaw", "StartPose",
        "WheelSpeed", "WheelTicks", "YawRate",
    ),
    "calibration": ("calibrate",),
    "tables.result": ("Result",),
    "tables.provenance": ("map_of",),
    "places": ("Places", "RelativePlace"),
    "roadmap": ("RoadMap",),
    "matching": ("match",),
    "settings": ("Settings", "Vehicle"),
    "simulate": ("simulate_drive",),
}  # fmt: skip
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__version__ = "0.1.0"
__all__ = [  # noqa: RUF022 - by module, in the order of use
    "match", "match_many", "map_of", "speeds", "RoadMap", "Localizer", "Result", "Estimate",
    "Hypothesis", "Pose", "Places", "RelativePlace", "GeoFix", "WheelTicks", "WheelSpeed",
    "Distance", "SpeedYaw", "YawRate", "StartPose", "Settings", "Vehicle", "read_drive",
    "read_vehicle", "simulate_drive", "diagnose", "calibrate",
    "WhichroadError", "ReadError", "MapError", "DriveError", "WriteError", "SettingError",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in ("fleet", "sensors", "spark"):
        return importlib.import_module(f".{name}", __name__)
    if name in _MODULE_OF:
        found = getattr(importlib.import_module(f".{_MODULE_OF[name]}", __name__), name)
        return globals().setdefault(name, found)  # the next use is an ordinary attribute
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
