"""Files of geometries that GDAL reads: GeoPackage, Shapefile, FlatGeobuf."""

import io
import warnings
from pathlib import Path
from typing import Any

from ..errors import ReadError, comes_with, first_line
from ..observations import Drive
from .checks import listed
from .reading import Reading
from .source import Source
from .tracks import Track, drives_of_tracks

_PREFERRED = "track_points"  # GDAL's layer of a GPX file's points
_POINTS, _LINES = ("Point", "MultiPoint"), ("LineString", "MultiLineString")


def read_geo(source: Source, reading: Reading) -> list[Drive]:
    """Read the points of a layer as a table, or its lines as tracks without times.

    Raises:
        ReadError: GDAL cannot read it, or it holds no points or lines, or several layers of them.
    """
    frame = _frame(source)
    import pandas as pd

    if frame.crs is None and reading.crs is not None:
        frame = frame.set_crs(reading.crs)
    if frame.crs is not None:
        frame = frame.to_crs(4326)
    blank = frame.geometry.isna() | frame.geometry.is_empty
    kinds = set(frame[~blank].geom_type)
    about = [column for column in frame.columns if column != frame.geometry.name]
    if kinds and kinds <= set(_POINTS):
        points = frame[~blank].explode(index_parts=False)
        plain = points[about].assign(lon=points.geometry.x, lat=points.geometry.y)
        if blank.any():  # rows without a place, where they stood
            plain = pd.concat([plain, frame.loc[blank, about]]).sort_index(kind="stable")
        tracks = [Track("", plain.to_dict("records"))]
    elif kinds and kinds <= set(_LINES):
        frame = frame[~blank]
        names = _names(frame, about)
        tracks = [
            Track(name if len(frame) > 1 else "", _along(line))
            for name, line in zip(names, frame.geometry, strict=True)
        ]
    else:
        raise ReadError(
            f"{source.name}: geometries of kind {', '.join(sorted(kinds)) or 'none'}; points or "
            "lines of a drive were expected"
        )
    return drives_of_tracks(tracks, source, reading)


def _frame(source: Source) -> Any:
    with comes_with("geo", f"{source.name}: this format"):
        import geopandas as gpd
        import pyogrio

    path = Path(source.path)
    place = path if path.is_file() and path.stat().st_size else None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # GDAL's, about what it mended
            layers = pyogrio.list_layers(place or io.BytesIO(source.data))
            names = [str(n) for n, kind in layers if kind and "Polygon" not in kind]
            if _PREFERRED in names:
                names = [_PREFERRED]
            if len(names) != 1:
                raise ReadError(
                    f"{source.name}: layers of geometries: {listed(names)}; one of points or lines "
                    "was expected; write it to a file of its own"
                )
            frame = gpd.read_file(place or io.BytesIO(source.data), layer=names[0])
    except (RuntimeError, ValueError, OSError, KeyError, TypeError) as error:
        first = first_line(error)
        raise ReadError(
            f"{source.name}: cannot be read by GDAL ({first}); a GeoPackage, Shapefile or "
            "FlatGeobuf was expected; was the file cut short?"
        ) from None
    if not hasattr(frame, "geom_type"):
        raise ReadError(f"{source.name}: no geometries; points or lines of a drive were expected")
    return frame


def _names(frame: Any, about: list[str]) -> list[str]:
    """What lines are called: their `name` or `id`, else their number."""
    for column in about:
        if column.lower() in ("name", "id", "trip_id", "track_id"):
            return [str(value) for value in frame[column]]
    return [str(number) for number in range(len(frame))]


def _along(line: Any) -> list[dict[str, Any]]:
    parts = getattr(line, "geoms", [line])
    return [{"lat": c[1], "lon": c[0]} for part in parts for c in part.coords]
