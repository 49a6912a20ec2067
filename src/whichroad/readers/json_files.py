"""JSON: records with places, GeoJSON, and Google's timeline, as tables.

Records are the objects of a list, wherever it lies in the file, or one on each line, as
OwnTracks writes them.
"""

import json
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from ..errors import ReadError
from ..observations import Drive
from .geometries import unproject
from .google_timeline import drives_of_timeline, is_timeline
from .json_records import dicts, drives_of_records, flat_record
from .reading import Reading
from .source import Source
from .tracks import Track, drives_of_tracks

_LINE = re.compile(rb"^[^{\n]*(\{.*\})\s*$", re.MULTILINE)  # a record behind a time, as OwnTracks
_WGS84 = ("CRS84", "4326")
_ADVICE = "write a CSV or Parquet with columns time, lat, lon"


class _Lines(NamedTuple):
    """A line of GeoJSON with the times of its points, where it has them."""

    coordinates: list[Any]
    times: list[Any] | None
    name: str


def read_json(source: Source, reading: Reading) -> list[Drive]:
    """Read the places of a JSON file.

    Raises:
        ReadError: It is no JSON, or holds no places.
    """
    content = _content(source)
    if isinstance(content, dict) and content.get("type") in _GEOMETRIES:
        tracks = _of_geojson(content, source)
        drives = drives_of_tracks(tracks, source, reading) if any(t.rows for t in tracks) else []
    elif is_timeline(content):
        drives = drives_of_timeline(content, source, reading)
    else:
        drives = drives_of_records(content, source, reading)
    if not drives:
        raise ReadError(
            f"{source.name}: JSON without records of places; NMEA 0183, a drive table (CSV, "
            f"Parquet, Arrow), GPX, GeoJSON or a CAN log was expected; {_ADVICE}"
        )
    return drives


def _content(source: Source) -> Any:
    data = source.data.removeprefix(b"\xef\xbb\xbf")
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        records = []
        for match in _LINE.finditer(data):
            try:
                records.append(json.loads(match[1]))
            except (ValueError, RecursionError):
                continue
        if records:
            return records
        first = str(error).splitlines()[0]
        raise ReadError(
            f"{source.name}: no readable JSON ({first}); was the file cut short? {_ADVICE}"
        ) from None


_GEOMETRIES = ("FeatureCollection", "Feature", "Point", "MultiPoint", "LineString",
               "MultiLineString")  # fmt: skip


def _of_geojson(content: dict[str, Any], source: Source) -> list[Track]:
    """Points as one table, each line as a track."""
    features = content.get("features") if content["type"] == "FeatureCollection" else [content]
    points: list[dict[str, Any]] = []
    lines: list[_Lines] = []
    for number, feature in enumerate(dicts(features)):
        geometry = feature.get("geometry") if feature.get("type") == "Feature" else feature
        about = feature.get("properties")
        about = about if isinstance(about, dict) else {}
        geometry = geometry if isinstance(geometry, dict) else {}
        places, kind = geometry.get("coordinates"), geometry.get("type")
        timed = kind == "MultiPoint" and isinstance(_times(about), list)
        if kind in ("Point", "MultiPoint", None) and not timed:
            # one without a place is a row without it
            there = _places(places if kind == "MultiPoint" else [places], flat_record(about))
            points += list(there) or [{**flat_record(about), "lat": None, "lon": None}]
        elif timed or kind in ("LineString", "MultiLineString"):
            lines += _lines(places, kind == "MultiLineString", about, str(number))
    tracks = [Track("", points)] if any(row["lat"] is not None for row in points) else []
    for line in lines:
        rows = list(_places(line.coordinates, {}))
        if line.times is not None and len(line.times) == len(line.coordinates) == len(rows):
            rows = [row | {"time": t} for row, t in zip(rows, line.times, strict=True)]
        tracks.append(Track(line.name if len(lines) > 1 else "", rows))
    return _on_wgs84(tracks, content, source)


def _lines(places: Any, many: bool, about: dict[str, Any], number: str) -> list[_Lines]:
    """The parts of a line joined, with times as togeojson and Mapbox write them."""
    parts = places if many and isinstance(places, list) else [places]
    coordinates = [p for part in parts if isinstance(part, list) for p in part]
    times = _times(about)
    if isinstance(times, list) and times and isinstance(times[0], list):
        times = [t for part in times for t in part]
    name = about.get("name") or about.get("id") or number
    return [_Lines(coordinates, times if isinstance(times, list) else None, str(name))]


def _times(about: dict[str, Any]) -> Any:
    """What the properties of a feature tell of the times of its points."""
    inner = about.get("coordinateProperties")
    times = about.get("coordTimes") or about.get("coordinate_times") or about.get("times")
    return times or (inner.get("times") if isinstance(inner, dict) else None)


def _places(places: Any, about: dict[str, Any]) -> Iterable[dict[str, Any]]:
    for place in places if isinstance(places, list) else ():
        if isinstance(place, list) and len(place) > 1:
            lon, lat = place[:2]
            if isinstance(lon, int | float) and isinstance(lat, int | float):
                named = {k: v for k, v in about.items() if k.lower() not in ("lat", "lon")}
                yield {**named, "lat": float(lat), "lon": float(lon)}


def _on_wgs84(tracks: list[Track], content: dict[str, Any], source: Source) -> list[Track]:
    """Tracks in the reference system that old GeoJSON names, on WGS 84."""
    crs = content.get("crs")
    name = crs.get("properties", {}).get("name") if isinstance(crs, dict) else None
    if not isinstance(name, str) or name.endswith(_WGS84):
        return tracks
    moved = []
    for track in tracks:
        x, y = (np.array([row[k] for row in track.rows], np.float64) for k in ("lon", "lat"))
        lon, lat = unproject(x, y, name, source.name)
        places = zip(track.rows, lat.tolist(), lon.tolist(), strict=True)
        moved.append(Track(track.name, [r | {"lat": a, "lon": o} for r, a, o in places]))
    return moved
