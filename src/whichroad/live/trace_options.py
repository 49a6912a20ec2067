"""What `POST /match` is asked besides the trace: `lag`, `mask` and `give` of its address."""

import math
from typing import Any, NamedTuple

from starlette.datastructures import QueryParams
from starlette.exceptions import HTTPException

from ..errors import SettingError
from ..lookback.smoothing import Lag
from ..moments import parse_window

GIVE = ("all", "points", "path")
_MOST_WINDOWS = 100
_KNOWN = ("lag", "mask", "give", "vehicle", "token")


class TraceOptions(NamedTuple):
    """How a trace is matched, and what of the answer is given.

    Attributes:
        lag: As `match` takes it.
        mask: Windows in seconds, as `match` takes them.
        give: `all`, or only `points` or `path`.
    """

    lag: str | None = None
    mask: tuple[tuple[float, float], ...] = ()
    give: str = "all"


def trace_options(query: QueryParams) -> TraceOptions:
    """The options of an address.

    Raises:
        HTTPException: One is unknown, or has no such value.
    """
    unknown = [name for name in query if name not in _KNOWN]
    if unknown:
        raise HTTPException(400, f"{unknown[0][:40]!r} is unknown; lag, mask or give was expected")
    give, lag, masks = query.get("give", "all"), query.get("lag"), query.getlist("mask")
    if give not in GIVE:
        raise HTTPException(400, f"give is {give[:40]!r}; one of {', '.join(GIVE)} was expected")
    if len(masks) > _MOST_WINDOWS:
        raise HTTPException(400, f"at most {_MOST_WINDOWS} masks were expected")
    try:
        Lag.of(lag)
        windows = [parse_window(text[:100]) for text in masks]
    except SettingError as error:
        raise HTTPException(400, str(error)[:200]) from None
    mask = tuple((_seconds(begin), _seconds(end)) for begin, end in windows)
    if not all(math.isfinite(moment) for window in mask for moment in window):
        raise HTTPException(400, "mask: finite moments were expected")
    return TraceOptions(lag, mask, give)


def _seconds(moment: Any) -> float:
    return float(moment) if isinstance(moment, float) else float(moment.timestamp())
