"""GPX: each track is a drive."""

import io
import xml.etree.ElementTree as ET
from collections import Counter
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ReadError
from ..observations import Drive
from ..settings import Settings
from .arrow_columns import iso_seconds
from .checks import NO_TIME, Skipped, keep, read_bytes
from .reported_fixes import Reported, make_fixes

_LEAVES = ("time", "hdop", "speed", "course")
_BAD = "unparsable point"


def read_gpx(path: str | PathLike[str], settings: Settings | None = None) -> list[Drive]:
    """Read the tracks of a GPX file, segments of a track joined.

    Args:
        path: The file, GPX 1.0 or 1.1; speed and course may stand in extensions.
        settings: Gives the range error and the sigma of fixes that report none.

    Returns:
        One drive per track that has points, in the order of the file.

    Raises:
        ReadError: It is no XML, was cut short, or has no track with points.
    """
    where, data = Path(path).name, read_bytes(path)
    tracks: list[tuple[str, list[dict[str, str]]]] = []
    try:
        _collect(data, tracks)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise ReadError(f"{where}: no readable GPX ({error}); was the file cut short?") from None
    tracks = [(name, points) for name, points in tracks if points]
    if not tracks:
        raise ReadError(f"{where}: no track with points; <trk> with <trkpt> was expected")
    drives = []
    for number, (name, points) in enumerate(tracks):
        skipped: Skipped = Counter()
        reported = _reported(points, skipped)
        fixes = make_fixes(reported, settings or Settings(), skipped)
        stem = Path(path).stem
        drive_id = stem if len(tracks) == 1 else f"{stem}/{name or number}"
        drives.append(Drive(drive_id, fixes, sources=(str(path),), skipped=dict(skipped)))
    return _distinct(drives)


def _collect(data: bytes, tracks: list[tuple[str, list[dict[str, str]]]]) -> None:
    """Tracks as name and points, each point its attributes and leaves as text."""
    inside: list[Any] = []
    name, points = "", list[dict[str, str]]()
    leaves: dict[str, str] = {}
    for event, element in ET.iterparse(io.BytesIO(data), events=("start", "end")):
        tag = element.tag.rpartition("}")[2]
        if event == "start":
            inside.append(element)
            if tag == "trk":
                name, points = "", []
            elif tag == "trkpt":
                leaves = {}
            continue
        inside.pop()
        if tag in _LEAVES and element.text:
            leaves.setdefault(tag, element.text.strip())
        elif tag == "name" and inside and inside[-1].tag.rpartition("}")[2] == "trk":
            name = (element.text or "").strip()
        elif tag == "trkpt":
            points.append({**element.attrib, **leaves})
        elif tag == "trk":
            tracks.append((name, points))
        if inside and tag in ("trkpt", "wpt", "rtept", "trkseg", "trk"):
            inside[-1].remove(element)  # else the whole file stays in memory


def _number(text: str | None) -> float:
    try:
        return float(text) if text else np.nan
    except ValueError:
        return np.nan


def _reported(points: list[dict[str, str]], skipped: Skipped) -> Reported:
    columns = {
        key: np.array([_number(point.get(key)) for point in points])
        for key in ("lat", "lon", "hdop", "speed", "course")
    }
    time = iso_seconds([point.get("time") for point in points])
    placed = keep(~(np.isnan(columns["lat"]) | np.isnan(columns["lon"])), _BAD, skipped)
    timed = keep(~np.isnan(time) | ~placed, NO_TIME, skipped)
    return Reported(
        time=time,
        lat_deg=columns["lat"],
        lon_deg=columns["lon"],
        hdop=columns["hdop"],
        speed=columns["speed"],
        bearing_deg=columns["course"],
    ).rows(np.flatnonzero(placed & timed))


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
