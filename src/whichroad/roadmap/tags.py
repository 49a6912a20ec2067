"""What the words of maps mean: road classes, speeds, one-ways, access, widths.

The words are OpenStreetMap's; tables of edges use the same ones.
"""

import math
import re

# km/h that traffic usually drives where no limit is known
CLASS_SPEED_KMH = {
    "motorway": 110.0,
    "motorway_link": 60.0,
    "trunk": 85.0,
    "trunk_link": 50.0,
    "primary": 60.0,
    "primary_link": 40.0,
    "secondary": 55.0,
    "secondary_link": 40.0,
    "tertiary": 45.0,
    "tertiary_link": 35.0,
    "unclassified": 40.0,
    "road": 40.0,
    "residential": 30.0,
    "living_street": 12.0,
    "service": 15.0,
}
DEFAULT_SPEED_KMH = 40.0
WIDE = frozenset({"", "motorway", "trunk"})  # two lanes in a direction, unless tagged
NARROW = frozenset({"residential", "living_street", "service"})

OPEN, LIMITED, CLOSED = 0, 1, 2
ACCESS_WORDS = ("yes", "limited", "no")
_CLOSED = frozenset(
    {"no", "private", "agricultural", "forestry", "emergency", "psv", "bus", "military"}
)
_LIMITED = frozenset({"delivery", "customers", "destination", "permit", "residents"})

_ZONES_KMH = {
    "walk": 7.0,
    "living_street": 10.0,
    "urban": 50.0,
    "rural": 90.0,
    "bicycle_road": 30.0,
    "school": 30.0,
}
_COUNTRY_ZONES_KMH = {"de:rural": 100.0, "at:rural": 100.0, "de:living_street": 7.0}
_NUMBER = re.compile(r"^\s*(\d+(?:\.\d+)?)\s*(km/h|kmh|kph|mph|knots|m|ft|'|lanes)?", re.IGNORECASE)
_ABSURD = 1e4  # bound of plausible speeds (km/h) and widths (m)
_FACTORS = {"mph": 1.609344, "knots": 1.852, "ft": 0.3048, "'": 0.3048}
_YES = frozenset({"yes", "true", "1", "t", "y", "1.0", "f", "forward", "ft"})
_REVERSE = frozenset({"-1", "reverse", "backward", "-1.0", "tf"})


def number(text: object) -> float:
    """The number at the start of a word, in km/h or m where a unit is given; 0: none, or absurd.

    Args:
        text: `50`, `30 mph`, `3.5 m`, `12 ft` or anything else.
    """
    if isinstance(text, (int, float)):
        return float(text) if 0 < text < _ABSURD else 0.0
    match = _NUMBER.match(str(text)) if text is not None else None
    if match is None:
        return 0.0
    value = float(match[1]) * _FACTORS.get((match[2] or "").lower(), 1.0)
    return value if value < _ABSURD else 0.0


def speed_limit_kmh(text: object) -> float:
    """Speed limit in km/h of a `maxspeed` value; 0 where it gives none (or no limit)."""
    value = number(text)
    if value or not isinstance(text, str):
        return value
    word = text.strip().lower()
    if word in _COUNTRY_ZONES_KMH:
        return _COUNTRY_ZONES_KMH[word]
    zone = word.rpartition(":")[2]
    if zone.startswith("zone"):  # DE:zone30, DE:zone:30
        return number(zone[4:])
    return _ZONES_KMH.get(zone, number(zone))


def whole(text: object) -> int:
    """A whole number such as a `layer`, at most 127; 0 where there is none."""
    try:
        return max(-127, min(127, int(float(str(text)))))
    except (ValueError, OverflowError):
        return 0


def truth(text: object) -> bool:
    """Whether a flag such as `bridge` is set: anything but no, false, 0 and nothing."""
    if text is None or (isinstance(text, float) and math.isnan(text)):
        return False
    return str(text).strip().lower() not in {"", "no", "false", "0", "0.0", "f", "n", "none", "nan"}


def oneway(tags: dict[str, str]) -> int:
    """1: along the way only, -1: against it only, 0: both."""
    word = (tags.get("oneway:motor_vehicle") or tags.get("oneway") or "").lower()
    if word in _REVERSE:
        return -1
    if word in {"yes", "true", "1"}:
        return 1
    if word in {"no", "false", "0", "reversible", "alternating"}:
        return 0
    return int(roundabout(tags) or tags.get("highway") == "motorway")


def roundabout(tags: dict[str, str]) -> bool:
    """Whether a way is part of a roundabout."""
    return tags.get("junction") in {"roundabout", "circular"}


def oneway_word(value: object) -> int | None:
    """The same for a table's column, whose words differ; None: not understood.

    FT or F is along, TF or T against, B both; a bool or 1 is along.  (A single T is
    "towards the start", as in the tables of GIS packages; `true` is spelled out.)
    """
    if isinstance(value, bool):
        return int(value)
    word = str(value).strip().lower()
    if word == "t" or word in _REVERSE:
        return -1
    if word in _YES:
        return 1
    if word in {"", "no", "false", "0", "0.0", "b", "both", "n", "none", "nan", "x"}:
        return 0
    return None


def access(tags: dict[str, str]) -> int:
    """OPEN, LIMITED or CLOSED for a car."""
    word = access_word(tags)
    return CLOSED if word in _CLOSED else LIMITED if word in _LIMITED else OPEN


def access_word(tags: dict[str, str]) -> str | None:
    """Of access for a car; the most particular tag decides."""
    keys = ("motorcar", "motor_vehicle", "vehicle", "access")
    return next((tags[key] for key in keys if key in tags), None)


def lane_offset(highway: str, both_ways: bool, lanes: float, width: float, ring: bool) -> float:
    """How far right of the centre line one usually drives on the right, m."""
    if both_ways:
        if width > 0.0:
            return width / 4.0
        return 1.2 if highway in NARROW else 1.75 * max(lanes / 2.0, 1.0)
    return 1.5 if lanes >= 2.0 and not ring else 0.0


def lane_sigma(highway: str, both_ways: bool, lanes: float) -> float:
    """Sigma of which lane is driven in, m: w sqrt((n² − 1) / 12) for n lanes of w = 3.3 m.

    Without a number of lanes, wide classes and unknown ones have two in a direction.
    """
    if lanes > 0.0:
        n = max(min(lanes, 12.0) / (2.0 if both_ways else 1.0), 1.0)
    else:
        n = 2.0 if highway in WIDE else 1.0
    return 3.3 * math.sqrt((n * n - 1.0) / 12.0)
