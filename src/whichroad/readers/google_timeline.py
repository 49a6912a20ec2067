"""Google's timeline as phones export it.

That is `Timeline.json` of Android and `location-history.json` of iOS.  A phone keeps what it
measured (`rawSignals`) for about a month, and paths of a few places for years.  Both are read.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any

import numpy as np

from ..observations import Array, Drive
from .dates import iso_seconds
from .json_records import dicts
from .reading import Reading
from .source import Source
from .tracks import Track, drives_of_tracks

MEASURED = "place of a path within 15 minutes of a measured one (not used)"
UNMEASURED = "visit or activity of the timeline (no measured place)"
_NEAR = 900.0  # s from a measured place, within which paths tell nothing new
_DEGREES = re.compile(r"\s*(?:geo:)?(-?[\d.]+)\s*°?,\s*(-?[\d.]+)\s*°?\s*$")  # 49.4°, 8.7°
_OFFSET = "durationMinutesOffsetFromStartTime"
_MINUTES = "times of the path are told in whole minutes"


def is_timeline(content: Any) -> bool:
    """Whether the content of a JSON file is such a timeline."""
    if isinstance(content, dict):
        return not content.keys().isdisjoint(("semanticSegments", "rawSignals"))
    return any("timelinePath" in segment for segment in dicts(content))


def drives_of_timeline(content: Any, source: Source, reading: Reading) -> list[Drive]:
    """The measured places of a timeline, and those of its paths where it has no others.

    Args:
        content: Of the file.
        source: The file.
        reading: What the caller says of it.

    Returns:
        An empty list where it has no places.
    """
    segments = content.get("semanticSegments") if isinstance(content, dict) else content
    measured = list(_measured(content.get("rawSignals") if isinstance(content, dict) else []))
    paths, of_paths = list(_of_paths(segments)), 0
    if measured and paths:
        known, when = np.sort(_seconds(measured)), _seconds(paths)
        known = known[np.isfinite(known)]
        near = np.append(known, np.inf)[np.searchsorted(known, when - _NEAR)] <= when + _NEAR
        of_paths = int(near.sum())
        paths = [row for row, left_out in zip(paths, near.tolist(), strict=True) if not left_out]
    rows = measured + paths
    if not rows:
        return []
    rows = [rows[k] for k in np.argsort(_seconds(rows), kind="stable").tolist()]
    first, *others = drives_of_tracks([Track("", rows)], source, reading)
    told = [segment for segment in dicts(segments) if {"visit", "activity"} & segment.keys()]
    counts = {MEASURED: of_paths, UNMEASURED: len(told)}
    skipped = first.skipped | {reason: count for reason, count in counts.items() if count}
    coarse = (_MINUTES,) if any(_OFFSET in p for s in dicts(segments) for p in _path(s)) else ()
    return [replace(first, skipped=skipped, notes=(*first.notes, *coarse)), *others]


def _measured(signals: Any) -> Iterator[dict[str, Any]]:
    for signal in dicts(signals):
        for position in dicts([signal.get("position")]):
            place = _degrees(position.get("LatLng") or position.get("latLng"))
            if place:
                yield {
                    "time": position.get("timestamp"), "lat": place[0], "lon": place[1],
                    "accuracy": position.get("accuracyMeters"),
                    "speed_mps": position.get("speedMetersPerSecond"),
                }  # fmt: skip


def _of_paths(segments: Any) -> Iterator[dict[str, Any]]:
    for segment in dicts(segments):
        for point in _path(segment):
            place = _degrees(point.get("point"))
            if place:
                time = point.get("time") or _later(segment.get("startTime"), point.get(_OFFSET))
                yield {"time": time, "lat": place[0], "lon": place[1]}


def _path(segment: dict[str, Any]) -> Iterator[dict[str, Any]]:
    return dicts(segment.get("timelinePath"))


def _later(start: Any, minutes: Any) -> str | None:
    """A time so many minutes after another, as ISO 8601; None: they are not understood."""
    try:
        return (datetime.fromisoformat(start) + timedelta(minutes=float(minutes))).isoformat()
    except (TypeError, ValueError, OverflowError):
        return None


def _seconds(rows: list[dict[str, Any]]) -> Array:
    return iso_seconds([None if row["time"] is None else str(row["time"]) for row in rows])


def _degrees(text: Any) -> tuple[float, float] | None:
    match = _DEGREES.match(text) if isinstance(text, str) else None
    try:
        return (float(match[1]), float(match[2])) if match else None
    except ValueError:
        return None
