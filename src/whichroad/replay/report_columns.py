"""Columns of a report beside the track: levels, places ahead and near, sensors as heard."""

from collections.abc import Callable, Hashable, Iterable
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from ..live.messages import level_messages

if TYPE_CHECKING:
    from ..live.message_types import HeardMessage, PlaceMessage
    from .recorded_messages import RecordedMessages

_AHEAD, _NEARBY = 5, 3  # places of an epoch, at most, the nearest
_LEAST = 0.02  # P of these


def columns_beside(recorded: "RecordedMessages", at: NDArray[Any]) -> dict[str, Any]:
    """What the report's script shows of some epochs beside the track.

    Args:
        recorded: Of one drive.
        at: (n,) the epochs, rising.

    Returns:
        `levels`: distinct answers, and for each epoch the number of its own.  `points`: id, lat,
        lon of places; `ahead`, `nearby`: number in these, distance, sigma (m) and P; None without
        places.  `heard`: each sensor, for each epoch its rate (negative: s since it was heard,
        null: never) and the number of its state.
    """
    levels = [
        tuple((one["level"], one["kind"], one["p"]) for one in level_messages(recorded.levels(k)))
        for k in at.tolist()
    ]
    return {"levels": _told_once(levels), **_places(recorded, at), "heard": _heard(recorded, at)}


def _told_once(values: Iterable[Hashable]) -> dict[str, Any]:
    """Each value once, and which one it is in every row."""
    number: dict[Hashable, int] = {}
    row = [number.setdefault(value, len(number)) for value in values]
    return {"known": list(number), "row": row}


def _places(recorded: "RecordedMessages", at: NDArray[Any]) -> dict[str, Any]:
    about = recorded.places
    if about is None:
        return {"points": [], "ahead": None, "nearby": None}
    number: dict[tuple[Any, float, float], int] = {}

    def rows(ask: "Callable[[int], list[PlaceMessage]]", most: int) -> list[list[list[float]]]:
        return [
            [
                [
                    number.setdefault((one["id"], one["lat"], one["lon"]), len(number)),
                    round(one["distance_m"], 1), round(one["sigma_m"], 1), round(one["p"], 3),
                ]
                for one in [one for one in ask(k) if one["p"] >= _LEAST][:most]
            ]
            for k in at.tolist()
        ]  # fmt: skip

    ahead, nearby = rows(about.ahead, _AHEAD), rows(about.nearby, _NEARBY)
    return {"points": [list(one) for one in number], "ahead": ahead, "nearby": nearby}


def _heard(recorded: "RecordedMessages", at: NDArray[Any]) -> list[dict[str, Any]]:
    rows = [recorded.heard(k) for k in at.tolist()]
    return [
        {
            "name": first["name"],
            "further": first["further"],
            "said": [_said(row[place]) for row in rows],
            "states": _told_once(_state(row[place]) for row in rows),
        }
        for place, first in enumerate(rows[0] if rows else [])
    ]


def _said(one: "HeardMessage") -> float | None:
    if one["rate_hz"] > 0.0 or one["age_s"] is None:
        return round(one["rate_hz"], 1) if one["age_s"] is not None else None
    return -round(max(one["age_s"], 0.1), 1)


def _state(one: "HeardMessage") -> Hashable:
    doubted = None if one["doubted"] is None else tuple(one["doubted"])
    learnt = tuple(
        (n["what"], _four(n["value"]), None if n["sigma"] is None else _four(n["sigma"]), n["unit"])
        for n in one["learnt"]
    )
    return doubted, one["misfits"], one["withheld"], learnt


def _four(value: float) -> float:
    return float(f"{value:.4g}")
