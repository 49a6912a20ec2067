"""GPX: each track is a drive, or each route where there are no tracks."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any
from xml.parsers.expat import ExpatError, ParserCreate

import numpy as np

from ..errors import ReadError
from ..observations import Array, Drive
from ..settings import Settings
from .checks import NO_TIME, Skipped, keep
from .dates import iso_seconds
from .reported_fixes import Reported, make_fixes
from .source import Source
from .without_times import invented_times

_TEXTS = frozenset(("time", "hdop", "speed", "course", "name"))  # tags whose text is read
_LINES = frozenset(("trk", "rte"))
_POINTS = {"trkpt": "trk", "rtept": "rte", "wpt": "wpt"}  # tag -> what it is a point of
_BAD = "unparsable point"


@dataclass(slots=True)
class _Track:
    """A track or a route: its points as attributes and leaves, all text."""

    kind: str
    name: str = ""
    points: list[dict[str, str]] = field(default_factory=list)


def read_gpx(file: Any, settings: Settings | None = None) -> list[Drive]:
    """Read the tracks of a GPX file, segments of a track joined.

    Without a track its routes are read, else its way points as one track.  Of a file that was
    cut short the points before the cut are read.  Points without any time are given times.

    Args:
        file: A path or source of GPX 1.0 or 1.1; speed and course may stand in extensions.
        settings: Gives the range error and the sigma of fixes that report none.

    Returns:
        One drive per track that has points, in the order of the file.

    Raises:
        ReadError: It is no XML, or has no points.
    """
    source = Source.of(file)
    where, notes = source.name, list[str]()
    tracks: list[_Track] = []
    try:
        _collect(source.data, tracks)
    except (ExpatError, ValueError, LookupError) as error:
        if not any(track.points for track in tracks) or b"<gpx" not in source.data[:4096]:
            raise ReadError(
                f"{where}: no readable GPX ({error}); was the file cut short?"
            ) from None
        notes.append(f"cut short or damaged ({error}): the points before that were read")
    for kind in ("trk", "rte", "wpt"):
        chosen = [track for track in tracks if track.kind == kind and track.points]
        if chosen:
            break
    else:
        raise ReadError(f"{where}: no track with points; <trk> with <trkpt> was expected")
    if kind != "trk":
        notes.append("no track: " + ("routes were read" if kind == "rte" else "way points were"))
    drives = []
    for number, track in enumerate(chosen):
        skipped: Skipped = Counter()
        told = list(notes)
        reported = _reported(track.points, skipped, told)
        fixes = make_fixes(reported, settings or Settings(), skipped)
        name = source.stem if len(chosen) == 1 else f"{source.stem}/{track.name or number}"
        drives.append(
            Drive(name, fixes, None, (source.path,), skipped=dict(skipped), notes=tuple(told))
        )
    return _distinct(drives)


def _collect(data: bytes, tracks: list[_Track]) -> None:
    """All tracks, routes and way points, each track filled as it is read.

    Raises:
        ExpatError: It is no XML from some byte on; what stands before is in `tracks`.
    """
    inside: list[str] = []
    ways = _Track("wpt")
    tracks.append(ways)
    local: dict[str, str] = {}  # names of tags without their prefix
    point: dict[str, str] = {}
    text: list[str] = []
    parser = ParserCreate()
    parser.buffer_text = True

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal point
        tag = local.get(name) or local.setdefault(name, name.rpartition(":")[2])
        inside.append(tag)
        if tag in _TEXTS:
            text.clear()
            parser.CharacterDataHandler = text.append
        elif tag in _POINTS:
            point = attributes
        elif tag in _LINES:
            tracks.append(_Track(tag))

    def end(name: str) -> None:
        nonlocal point
        tag = inside.pop()
        if tag in _TEXTS:
            parser.CharacterDataHandler = None
            said = text[0].strip() if len(text) == 1 else "".join(text).strip()
            if tag != "name":
                if said:
                    point.setdefault(tag, said)
            elif inside and inside[-1] in _LINES:
                tracks[-1].name = said
        elif tag in _POINTS:
            home = ways if tag == "wpt" else tracks[-1]
            if home.kind == _POINTS[tag]:
                home.points.append(point)
            point = {}

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(data, True)


def _number(text: str | None) -> float:
    try:
        return float(text) if text else np.nan
    except ValueError:
        return np.nan


def _numbers(texts: list[str | None]) -> Array:
    if not any(texts):
        return np.full(len(texts), np.nan)
    try:
        return np.array(list(map(float, texts)))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return np.array([_number(text) for text in texts])


def _reported(points: list[dict[str, str]], skipped: Skipped, notes: list[str]) -> Reported:
    columns = {
        key: _numbers([point.get(key) for point in points])
        for key in ("lat", "lon", "hdop", "speed", "course")
    }
    lat, lon = columns["lat"], columns["lon"]
    texts = [point.get("time") for point in points]
    time = iso_seconds(texts)
    if len(points) > 1 and len({text for text in texts if text}) < 2 and not _one_time(texts):
        time = invented_times(lat, lon, [np.arange(len(points))], notes)
    placed = keep(~(np.isnan(lat) | np.isnan(lon)), _BAD, skipped)
    timed = keep(~np.isnan(time) | ~placed, NO_TIME, skipped)
    return Reported(
        time=time,
        lat_deg=lat,
        lon_deg=lon,
        hdop=columns["hdop"],
        speed=columns["speed"],
        bearing_deg=columns["course"],
    ).rows(np.flatnonzero(placed & timed))


def _one_time(texts: list[str | None]) -> bool:
    """Whether a single point has a time: the others lack it then."""
    return sum(bool(text) for text in texts) == 1


def _distinct(drives: list[Drive]) -> list[Drive]:
    """Drives whose ids differ, tracks of one name being numbered."""
    from dataclasses import replace

    seen: Counter[str] = Counter()
    named = []
    for drive in drives:
        seen[drive.drive_id] += 1
        count = seen[drive.drive_id]
        named.append(drive if count == 1 else replace(drive, drive_id=f"{drive.drive_id}-{count}"))
    return named
