"""What attributes of roads are called, and what is said of a name or an edge that is not one."""

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingError

_NAMES = {"maxspeed": "speed_limit_kmh"}  # as OpenStreetMap calls it
HIDDEN = ("back_id", "paired")  # columns that are no attributes
LEVEL = "level"  # made of `LEVELS`: how many roads it is above the ground
LEVELS = ("layer", "bridge", "tunnel")


def known_name(columns: Iterable[str], name: Any) -> str:
    """The map's name of an attribute, which may be given as OpenStreetMap has it.

    Args:
        columns: Of the map's table of streets.
        name: As the caller wrote it.

    Raises:
        SettingError: The map has no such attribute.
    """
    known = [*sorted(n for n in columns if n not in HIDDEN), *_NAMES]
    known += [LEVEL] if set(LEVELS) <= set(known) else []
    if name not in known:
        close = difflib.get_close_matches(str(name), known, 2, 0.6)
        hint = f"; did you mean {' or '.join(close)}?" if close else ""
        raise SettingError(
            f"attribute: {name!r} is none of this map; one of {', '.join(known)} was expected{hint}"
        )
    return _NAMES.get(name, str(name))


def levels_of(columns: Mapping[str, Any], way: NDArray[Any]) -> list[int]:
    """How many roads each of some streets is above the ground: by `layer`, else by what it is.

    Args:
        columns: Of the map's table of streets.
        way: (n,) their numbers.
    """
    layer, bridge, tunnel = (np.asarray(columns[one])[way] for one in LEVELS)
    tagged = np.where(tunnel > 0, -1, np.where(bridge > 0, 1, 0))
    levels: list[int] = np.where(layer == 0, tagged, layer).tolist()
    return levels


def refusal(columns: Iterable[str], edges: int, name: Any, edge: Any) -> SettingError:
    """Why an attribute of an edge could not be given.

    Args:
        columns: Of the map's table of streets.
        edges: How many the map has.
        name: As the caller wrote it.
        edge: Likewise.
    """
    if isinstance(edge, str) and not isinstance(name, str):
        return SettingError(
            f"attribute: the name is {name!r} and the edge {edge!r}; the name was expected first; "
            f"write attribute({edge!r}, {name!r})"
        )
    try:
        known_name(columns, name)
    except SettingError as error:
        return error
    seen = "None, which is off the roads" if edge is None else repr(edge)
    return SettingError(
        f"attribute: the edge is {seen}; the number of an edge, from 0 to {edges - 1}, was "
        "expected, as `edge_id` of the points and of the path gives it"
    )
