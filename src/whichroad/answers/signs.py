"""What signs and lanes tell along a path: numbers of roads, destinations, lanes of turns."""

from typing import Any, NamedTuple

import numpy as np

from ..geodesy.angles import wrap_degrees
from .matched_trace import Matched, Piece

_INDICATIONS = {  # OpenStreetMap's words that OSRM has others for
    "through": "straight", "reverse": "uturn", "": "none", "merge_to_left": "slight left",
    "merge_to_right": "slight right", "slide_left": "slight left", "slide_right": "slight right",
}  # fmt: skip
_ANGLES = {  # degrees of a turn, clockwise
    "uturn": 180.0, "sharp right": 135.0, "right": 90.0, "slight right": 45.0, "straight": 0.0,
    "none": 0.0, "slight left": -45.0, "left": -90.0, "sharp left": -135.0,
}  # fmt: skip
_FITS = 60.0  # degrees by which a turn may differ from what its lane says
_INSIDE = 0.01  # m before the end of a piece


class Signs(NamedTuple):
    """Of (n,) pieces; empty: the map tells nothing."""

    ref: list[str]  # numbers of roads
    destinations: list[str]
    lanes: list[list[list[str]]]  # at the end of each, from the left: what each lane is for


def signs_of(matched: Matched, pieces: list[Piece]) -> Signs:
    """What the map tells of pieces, in the direction in which they are driven.

    Args:
        matched: The trace on the map.
        pieces: The path in order.
    """
    roads = matched.roads
    edge = np.array([piece.edge for piece in pieces], np.int64)
    start = np.array([piece.start for piece in pieces], np.float64)
    end = np.array([piece.end for piece in pieces], np.float64)
    middle, last = (
        roads.piece(edge, s) for s in (0.5 * (start + end), np.maximum(end - _INSIDE, start))
    )

    def driven(name: str, rows: Any) -> list[str]:
        _, forward = roads.drawn_as(rows)
        both = (roads.words(f"{name}_{way}", rows) for way in ("forward", "backward"))
        return [f if on else b for f, b, on in zip(*both, forward.tolist(), strict=True)]

    towards = [
        ", ".join(part.strip() for part in word.split(";") if part.strip())
        for word in driven("destination", middle)
    ]
    lanes = [lanes_of(word) for word in driven("turn_lanes", last)]
    return Signs(roads.words("ref", middle), towards, lanes)


def lanes_of(turn_lanes: str) -> list[list[str]]:
    """What each lane is for, in OSRM's words, from OpenStreetMap's `turn:lanes`."""
    if not turn_lanes.strip("| "):
        return []
    words = (lane.split(";") for lane in turn_lanes.split("|"))
    plain = ([word.strip().replace(" ", "_") for word in lane] for lane in words)
    named = ([_INDICATIONS.get(w, w.replace("_", " ")) for w in lane] for lane in plain)
    return [[word if word in _ANGLES else "none" for word in lane] for lane in named]


def lanes_for(lanes: list[list[str]], turn: float, *, by_valhalla: bool) -> list[dict[str, Any]]:
    """Lanes before a turn, and which of them lead into it, as OSRM's `lanes`.

    Args:
        lanes: As of `lanes_of`.
        turn: Degrees, clockwise.
        by_valhalla: With the keys that Valhalla adds.

    Returns:
        Empty: there are none, or none fits.
    """
    away = {w: abs(wrap_degrees(_ANGLES[w] - turn)) for lane in lanes for w in lane}
    best = min(away, key=away.__getitem__, default="")
    if not best or away[best] > _FITS:
        return []
    told = []
    for lane in lanes:
        one: dict[str, Any] = {"valid": best in lane, "indications": lane}
        if by_valhalla:
            one["active"] = best in lane
            one |= {"valid_indication": best} if best in lane else {}
        told.append(one)
    return told


def both_names(name: str | None, ref: str | None) -> list[str]:
    """The name of a street and its number, where they are known and two."""
    return list(dict.fromkeys(word for word in (name, ref) if word))
