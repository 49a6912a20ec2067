"""Tools that are known by the names of their columns, and the units that these names do not say.

The places decide where they show another unit.
"""

from collections.abc import Set
from typing import NamedTuple

from ..geodesy.units import KMH, KNOT


class Profile(NamedTuple):
    """What a tool's tables leave unsaid; names as `names.normal` makes them."""

    tool: str
    marks: frozenset[str]  # columns that together only this tool writes
    units: dict[str, float]  # column -> factor to SI


def _profile(tool: str, marks: str, **units: float) -> Profile:
    return Profile(tool, frozenset(marks.split()), units)


PROFILES = (
    _profile("Traccar", "deviceid fixtime devicetime", speed=KNOT),
    _profile("Geotab", "device datetime latitude longitude", speed=KMH),
    _profile("Wejo", "journeyid capturedtimestamp", speed=KMH),
    _profile("OwnTracks", "tst vel", vel=KMH),
    _profile("Google's location history", "latitudee7 longitudee7", velocity=1.0, speed=1.0),
    _profile("Movebank", "location_long location_lat ground_speed", ground_speed=1.0),
    _profile("GnssLogger", "latitudedegrees unixtimemillis", speed=1.0),
)


def units_of(names: Set[str]) -> dict[str, float]:
    """Factors to SI of columns whose tool is known.

    Args:
        names: Of all columns of a table.
    """
    return next((p.units for p in PROFILES if p.marks <= names), {})
