"""Requests in the words of OSRM and Valhalla, checked, matched and answered."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import parse_qsl, unquote

import numpy as np

from ..errors import MapError, WhichroadError
from ..geodesy.angles import wrap_degrees
from ..observations import Array
from ..roadmap import RoadMap
from ..roadmap.extent import are_swapped
from ..settings import Settings, Vehicle, tuned_by
from .matched_trace import Matched, Trace, match_trace
from .osrm_answer import ANNOTATIONS, Options, osrm_answer
from .polylines import decoded
from .refusal import AnswerError, osrm_error, valhalla_error
from .valhalla_answer import UNITS, Wish, attributes_answer, route_answer

MOST_POINTS = 16_000  # of one trace, as Valhalla's own limit
_ONE_TIME = 1e-3  # s, within which all points have one time, which tells nothing
_LAST = 1e11  # s since 1970, beyond all times
_UNITS = {3: "milliseconds", 6: "microseconds", 9: "nanoseconds"}
_COSTINGS = {"auto", "taxi", "bus", "truck", "hov"}
_MATCHES = ("map_snap", "walk_or_snap", "edge_walk")
_TAKEN = {  # options of OSRM that are understood and change nothing here
    "gaps": r"split|ignore", "tidy": r"true|false", "bearings": r".*", "hints": r".*",
    "approaches": r".*", "exclude": r".+", "snapping": r"any|default", "format": r"json",
}  # fmt: skip
_WORDS = {
    "geometries": ("polyline", "polyline6", "geojson"),
    "overview": ("simplified", "full", "false"),
    "steps": ("true", "false"), "generate_hints": ("true", "false"),
    "skip_waypoints": ("true", "false"),
}  # fmt: skip


def osrm_match(
    roads: RoadMap, coordinates: str | Sequence[Sequence[float]],
    options: str | Mapping[str, Any] = "", *, vehicle: Vehicle | None = None,
    settings: Settings | None = None, most: int = MOST_POINTS,
) -> dict[str, Any]:  # fmt: skip
    """Match a trace and answer as OSRM's `/match/v1` does.

    `bearings`, `gaps`, `tidy` and the options of snapping are taken and change nothing.

    Args:
        roads: The map.
        coordinates: `lon,lat;lon,lat` or `polyline(...)` as in the address, or pairs [lon, lat].
        options: The query of the address, or its options by name: `timestamps`, `radiuses`,
            `waypoints`, `annotations` may be lists.
        vehicle: The car.
        settings: The model's numbers.
        most: Points that are taken, at most.

    Returns:
        `code`, `matchings`, `tracepoints`; and under `whichroad` what each point's estimate is.

    Raises:
        AnswerError: The request is refused; its `answer` has OSRM's `code` and `message`.
    """
    if isinstance(options, str):
        given = _query(options)
    else:
        given = {name: _text(value) for name, value in options.items()}
    lat, lon = _coordinates(coordinates)
    n = len(lat)
    if n > most:
        raise osrm_error("TooBig", "Too many trace coordinates")
    if n < 2:
        raise osrm_error("InvalidOptions", "Number of coordinates needs to be at least two.")
    wanted, time, radius = _osrm_options(given, n)
    if not (
        np.isfinite(lat).all() and (np.abs(lat) <= 90.0).all() and (np.abs(lon) <= 180.0).all()
    ):
        raise osrm_error("InvalidValue", "Invalid coordinate value.")
    trace = Trace(lat, lon, time, radius)
    return osrm_answer(_matched(trace, roads, vehicle, settings, osrm=True), wanted)


def trace_attributes(
    roads: RoadMap, request: str | bytes | Mapping[str, Any], *, vehicle: Vehicle | None = None,
    settings: Settings | None = None, most: int = MOST_POINTS,
) -> dict[str, Any]:  # fmt: skip
    """Match a trace and answer as Valhalla's `trace_attributes` does.

    Args:
        roads: The map.
        request: The body, as JSON or taken apart: `shape` or `encoded_polyline`, `costing`,
            `filters`, `units`, `use_timestamps` and `trace_options` are read.
        vehicle: The car.
        settings: The model's numbers.
        most: Points that are taken, at most.

    Returns:
        `edges`, `matched_points`, `shape` and more; under `whichroad` each point's estimate.

    Raises:
        AnswerError: The request is refused; its `answer` has Valhalla's `error_code` and `error`.
    """
    trace, wish = _valhalla(request, most)
    return attributes_answer(_matched(trace, roads, vehicle, settings), wish)


def trace_route(
    roads: RoadMap, request: str | bytes | Mapping[str, Any], *, vehicle: Vehicle | None = None,
    settings: Settings | None = None, most: int = MOST_POINTS,
) -> dict[str, Any]:  # fmt: skip
    """Match a trace and answer as Valhalla's `trace_route` does.

    Args:
        roads: The map.
        request: As of `trace_attributes`; `format` "osrm" gives OSRM's form.
        vehicle: The car.
        settings: The model's numbers.
        most: Points that are taken, at most.

    Returns:
        The `trip` with its legs; under `whichroad` each point's estimate.

    Raises:
        AnswerError: The request is refused; its `answer` has Valhalla's `error_code` and `error`.
    """
    trace, wish = _valhalla(request, most)
    return route_answer(_matched(trace, roads, vehicle, settings), wish)


def _matched(
    trace: Trace, roads: RoadMap, vehicle: Vehicle | None, settings: Settings | None,
    osrm: bool = False,
) -> Matched:  # fmt: skip
    try:
        return match_trace(trace, roads, vehicle or Vehicle(), tuned_by(settings, vehicle))
    except WhichroadError as error:
        away = isinstance(error, MapError)
        if osrm and away:
            text = "Could not find a matching segment for any coordinate."
            if are_swapped(trace.lat, trace.lon, roads):
                text += " Latitude and longitude seem swapped: longitude,latitude was expected."
            raise osrm_error("NoSegment", text) from None
        if osrm:
            raise osrm_error("NoMatch", "Could not match the trace.") from None
        raise valhalla_error(171 if away else 444) from None


# OSRM's words


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        separator = "," if value and isinstance(value[0], str) else ";"
        return separator.join("" if one is None else str(one) for one in value)
    return str(value)


def _query(text: str) -> dict[str, str]:
    """Options by name.

    Raises:
        AnswerError: It is no list of them.
    """
    parts = text.split("&") if text else []
    for part in parts:
        if "=" not in part:
            raise _malformed(text.index(part) if part else len(text))
    return dict(parse_qsl(text, keep_blank_values=True))


def _malformed(position: int) -> AnswerError:
    return osrm_error("InvalidQuery", f"Query string malformed close to position {position}")


def _coordinates(given: str | Sequence[Sequence[float]]) -> tuple[Array, Array]:
    """Latitudes and longitudes.

    Raises:
        AnswerError: They are no coordinates.
    """
    try:
        if isinstance(given, str):
            text = unquote(given).removesuffix(".json")
            line = re.fullmatch(r"polyline(6?)\((.*)\)", text, re.DOTALL)
            if line is not None:
                return decoded(line[2], 6 if line[1] else 5)
            values = np.array([part.split(",") for part in text.split(";")], dtype="U40")
            places = values.astype(np.float64)
        else:
            places = np.array(given, dtype=np.float64)
    except (ValueError, TypeError):
        raise _malformed(0) from None
    if places.ndim != 2 or places.shape[1] != 2:
        raise _malformed(0)
    return np.ascontiguousarray(places[:, 1]), np.ascontiguousarray(places[:, 0])


def _osrm_options(given: dict[str, str], n: int) -> tuple[Options, Array | None, Array]:
    """Options, times (None: none) and radiuses (NaN: none) of n coordinates."""
    known: dict[str, Any] = {}
    time, radius = None, np.full(n, np.nan)
    for name, value in given.items():
        if name in _WORDS:
            if value not in _WORDS[name]:
                raise _malformed(len(name))
            known[name] = value == "true" if _WORDS[name] == ("true", "false") else value
        elif name == "annotations":
            known[name] = _annotations(value)
        elif name == "waypoints":
            known[name] = _waypoints(value, n)
        elif name == "timestamps":
            time = _numbers(value, n, name)
            _check_times(time)
        elif name == "radiuses":
            radius = _numbers(value, n, name)
            if (radius < 0.0).any():
                text = "Could not find a matching segment for any coordinate."
                raise osrm_error("NoSegment", text)
            radius[(radius == 0.0) | np.isinf(radius)] = np.nan
        elif name == "token":
            continue
        elif name not in _TAKEN or not re.fullmatch(_TAKEN[name], value, re.DOTALL):
            raise _malformed(len(name))
    return Options(**known), time, radius


def _annotations(value: str) -> tuple[str, ...]:
    if value in ("true", "false"):
        return ANNOTATIONS if value == "true" else ()
    names = tuple(value.split(","))
    if not set(names) <= set(ANNOTATIONS):
        raise _malformed(len("annotations"))
    return names


def _waypoints(value: str, n: int) -> tuple[int, ...]:
    parts = value.split(";")
    if not all(part.isdecimal() and len(part) < 9 for part in parts):
        raise _malformed(len("waypoints"))
    found = tuple(int(part) for part in parts)
    if any(k >= n for k in found) or list(found) != sorted(set(found)):
        raise osrm_error("InvalidOptions", "waypoints: indices of coordinates were expected")
    if found[0] != 0 or found[-1] != n - 1:
        text = "First and last coordinates must be specified as waypoints."
        raise osrm_error("InvalidValue", text)
    return found


def _numbers(value: str, n: int, name: str) -> Array:
    """One number for each coordinate, NaN where it is left out."""
    parts = value.split(";")
    if len(parts) != n:
        text = f"Number of elements in {name} size {len(parts)} does not match coordinate size {n}"
        raise osrm_error("InvalidOptions", text)
    try:
        numbers = np.array([float(part) if part else math.nan for part in parts])
    except ValueError:
        raise _malformed(len(name)) from None
    return numbers


def _check_times(time: Array) -> None:
    """Refuse times that are no seconds since 1970 in order.

    Raises:
        AnswerError: They are that.
    """
    far = ~(np.abs(time) < _LAST)
    back = np.diff(time, prepend=time[:1]) < 0.0
    if not (far | back).any():
        return
    k = int(np.argmax(far | back))
    rule, seen = "monotonically increasing", f"number {k + 1} is {time[k]:.19g}"
    if far[k]:
        rule = "seconds since 1970, one for each coordinate"
        power = next((n for n in (3, 6, 9) if _LAST <= abs(time[k]) < _LAST * 10.0**n), None)
        if power:
            seen += f", as of {_UNITS[power]}; divide all by {10**power:,}"
    else:
        seen += f", after {time[k - 1]:.19g}"
    raise osrm_error("InvalidValue", f"Timestamps need to be {rule}: {seen}.")


# Valhalla's words


def _valhalla(request: str | bytes | Mapping[str, Any], most: int) -> tuple[Trace, Wish]:
    """The trace, and what of the answer is wanted.

    Raises:
        AnswerError: The request is refused.
    """
    given: Any = request
    if isinstance(request, str | bytes):
        try:
            given = json.loads(request)
        except (ValueError, RecursionError):
            raise valhalla_error(100) from None
    if not isinstance(given, Mapping):
        raise valhalla_error(100)
    try:
        return _valhalla_trace(given, most), _wish(given)
    except (TypeError, ValueError, AttributeError, OverflowError, KeyError):
        raise valhalla_error(100) from None


def _valhalla_trace(given: Mapping[str, Any], most: int) -> Trace:
    costing = given.get("costing")
    if not costing:
        raise valhalla_error(124)
    if costing not in _COSTINGS:
        raise valhalla_error(125, str(costing)[:40])
    if given.get("shape_match", "walk_or_snap") not in _MATCHES:
        raise valhalla_error(445)
    options = given.get("trace_options") or {}
    sigma = options.get("gps_accuracy", given.get("gps_accuracy"))
    if sigma is not None and not float(sigma) >= 0.0:
        raise valhalla_error(158, sigma, "gps_accuracy")
    shape, line = given.get("shape"), given.get("encoded_polyline")
    time: Array | None = None
    untimed = ""
    if isinstance(shape, list) and shape:
        if len(shape) > most:
            raise valhalla_error(153, len(shape), most)
        lat, lon = (np.array([float(p[name]) for p in shape]) for name in ("lat", "lon"))
        own = [p.get("accuracy", sigma) for p in shape]
        times = [p.get("time") for p in shape]
        if all(one is not None for one in times):
            time = np.array([float(one) for one in times])
        elif missing := times.count(None) % len(times):
            untimed = f"{missing:,} of {len(times):,} points have none"
    elif isinstance(line, str) and line:
        lat, lon = decoded(line, 5 if given.get("shape_format") == "polyline5" else 6)
        if len(lat) > most:
            raise valhalla_error(153, len(lat), most)
        own = [sigma] * len(lat)
    else:
        raise valhalla_error(114)
    if len(lat) < 2:
        raise valhalla_error(123)
    durations = _durations(given, len(lat))
    time = durations if time is None else time
    accuracy = np.array([math.nan if one is None else float(one) for one in own])
    accuracy[~(accuracy > 0.0) | np.isinf(accuracy)] = np.nan
    lon = wrap_degrees(lon)
    if not (np.isfinite(lat).all() and np.isfinite(lon).all() and (np.abs(lat) <= 90.0).all()):
        raise ValueError("a place that is none")
    if time is not None and not (np.isfinite(time).all() and (np.abs(time) < _LAST).all()):
        raise ValueError("a time that is none")
    if time is not None and np.ptp(time) <= _ONE_TIME:
        time = None
    elif time is not None and (back := np.diff(time, prepend=time[:1]) < 0.0).any():
        k = int(np.argmax(back))
        untimed = f"that of point {k + 1} is {time[k]:.15g}, after {time[k - 1]:.15g}"
        time = None  # Valhalla takes points in their order, whatever their times are
    return Trace(lat, lon, time, accuracy, untimed)


def _durations(given: Mapping[str, Any], n: int) -> Array | None:
    """Times from `begin_time` and `durations`, as they go with an encoded line."""
    steps = given.get("durations")
    if steps is None:
        return None
    if not isinstance(steps, list):
        raise ValueError("durations that are none")
    if len(steps) not in (n, n - 1):
        raise valhalla_error(136)
    steps = [float(step) for step in steps]
    return float(given.get("begin_time") or 0.0) + np.cumsum([0.0, *steps][-n:])


def _wish(given: Mapping[str, Any]) -> Wish:
    filters = given.get("filters") or {}
    names = frozenset(str(name) for name in filters.get("attributes") or ())
    include = filters.get("action", given.get("action")) == "include" and bool(names)
    options = given.get("directions_options") or {}
    units = str(given.get("units", options.get("units", "kilometers")))
    shape = given.get("shape")
    kinds = [p.get("type") for p in shape] if isinstance(shape, list) else []
    breaks = tuple(k for k, kind in enumerate(kinds) if kind in ("break", "break_through"))
    ends = {0, len(kinds) - 1} if kinds else set()
    return Wish(
        units={"mi": "miles", "km": "kilometers"}.get(units, units if units in UNITS else
                                                      "kilometers"),
        use_timestamps=bool(given.get("use_timestamps")),
        included=names if include else None,
        excluded=frozenset() if include else names,
        breaks=tuple(sorted(ends | set(breaks))) if len(breaks) > 0 else None,
        form="osrm" if given.get("format") == "osrm" else "json",
        instructions=given.get("directions_type", "instructions") == "instructions",
        id=None if given.get("id") is None else str(given["id"])[:200],
    )  # fmt: skip
