"""KML: tracks with times, points with times, and lines without."""

import io
import xml.etree.ElementTree as ET
from typing import Any

from ..errors import ReadError
from ..observations import Drive
from .reading import Reading
from .source import Source
from .tracks import Track, drives_of_tracks

_ADVICE = "export GPX"


def read_kml(source: Source, reading: Reading) -> list[Drive]:
    """Read the tracks (`gx:Track`) of a KML file, else its points with times, else its lines.

    Raises:
        ReadError: It is no XML, or holds none of these.
    """
    try:
        root = ET.parse(io.BytesIO(source.data)).getroot()
    except (ET.ParseError, ValueError, LookupError) as error:
        raise ReadError(
            f"{source.name}: no readable KML ({error}); was the file cut short? {_ADVICE}"
        ) from None
    tracks, points, lines = [], list[dict[str, Any]](), []
    for number, mark in enumerate(_all(root, "Placemark")):
        name = _text(mark, "name") or str(number)
        rows = [row for track in _all(mark, "Track") for row in _of_track(track)]
        if rows:
            tracks.append(Track(name, rows))
        places = [p for line in _all(mark, "LineString") for p in _coordinates(line)]
        if places:
            lines.append(Track(name, places))
        when = _text(mark, "when")
        for point in _all(mark, "Point"):
            points += [row | ({"time": when} if when else {}) for row in _coordinates(point)]
    found = tracks or ([Track("", points)] if _timed(points) else lines)
    found = found or ([Track("", points)] if len(points) > 1 else [])
    if not found:
        raise ReadError(
            f"{source.name}: KML without a track, a line or points, and no GPX; a track of places "
            f"was expected; {_ADVICE}"
        )
    return drives_of_tracks([found[0]._replace(name="")] if len(found) == 1 else found,
                            source, reading)  # fmt: skip


def _timed(points: list[dict[str, Any]]) -> bool:
    return len([point for point in points if "time" in point]) > 1


def _tag(element: Any) -> str:
    return str(element.tag).rpartition("}")[2]


def _all(element: Any, tag: str) -> list[Any]:
    return [inner for inner in element.iter() if _tag(inner) == tag]


def _text(element: Any, tag: str) -> str:
    return next(((inner.text or "").strip() for inner in _all(element, tag)), "")


def _of_track(track: Any) -> list[dict[str, Any]]:
    """The places of a `gx:Track` with their times."""
    times = [(inner.text or "").strip() for inner in track if _tag(inner) == "when"]
    places = [_place((inner.text or "").split()) for inner in track if _tag(inner) == "coord"]
    rows = zip(times, places, strict=False)
    return [{"time": time, **place} for time, place in rows if place]


def _coordinates(element: Any) -> list[dict[str, Any]]:
    texts = _text(element, "coordinates").split()
    return [place for text in texts if (place := _place(text.split(",")))]


def _place(numbers: list[str]) -> dict[str, Any]:
    try:
        return {"lat": float(numbers[1]), "lon": float(numbers[0])}
    except (ValueError, IndexError):
        return {}
