"""Good files of further formats, for `fuzz` to damage."""

import json
from pathlib import Path
from typing import Any

import numpy as np


def formats(stamps: Any, lat_deg: Any, lon_deg: Any, folder: Path) -> dict[str, bytes]:
    """One drive as JSON, GeoJSON, KML, a GeoPackage and in texts of several tools.

    Args:
        stamps: (n,) datetime64[us].
        lat_deg: (n,) latitudes.
        lon_deg: (n,) longitudes.
        folder: For files that are needed in between.
    """
    places = [(f"{s}Z", s, a, o) for s, a, o in zip(stamps, lat_deg, lon_deg, strict=True)]
    rows = [
        {"timestamp": t, "latitudeE7": round(a * 1e7), "longitudeE7": round(o * 1e7)}
        for t, _, a, o in places
    ]
    features = [
        {
            "type": "Feature",
            "properties": {"time": t},
            "geometry": {"type": "Point", "coordinates": [o, a]},
        }
        for t, _, a, o in places
    ]
    geojson = json.dumps({"type": "FeatureCollection", "features": features}).encode()
    track = "".join(f"<when>{t}</when>\n<gx:coord>{o} {a} 0</gx:coord>\n" for t, _, a, o in places)
    kml = f'<kml xmlns:gx="x"><Placemark><gx:Track>\n{track}</gx:Track></Placemark></kml>'
    return {
        "json": json.dumps({"locations": rows}, indent=1).encode(),
        "geojson": geojson,
        "kml": kml.encode(),
        "gpkg": _geopackage(geojson, folder),
        "gnss logger": _gnss_logger(places),
        "own names": _german(places),
        "places": "\n".join(["lat lon", *(f"{a} {o}" for _, _, a, o in places)]).encode(),
    }


def _geopackage(geojson: bytes, folder: Path) -> bytes:
    import geopandas

    (folder / "points.geojson").write_bytes(geojson)
    geopandas.read_file(folder / "points.geojson").to_file(folder / "points.gpkg")
    return (folder / "points.gpkg").read_bytes()


def _gnss_logger(places: Any) -> bytes:
    names = "LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters"
    lines = [f"# Version\n# Fix,Provider,{names},UnixTimeMillis"]
    for _, s, a, o in places:
        ms = s.astype(np.int64) // 1000
        lines += [f"Fix,{who},{a},{o},90.0,{ms % 30},4.0,{ms}" for who in ("GPS", "FLP")]
    return "\n".join(lines).encode()


def _german(places: Any) -> bytes:
    lines = ["# of a logger\nLogger;X\n\nDatum_Zeit;lat;lon;speed"]
    for _, s, a, o in places:
        day, clock = str(s)[:10].split("-")[::-1], str(s)[11:19]
        number = f"{a:.7f};{o:.7f};{a % 1 * 40:.1f}".replace(".", ",")
        lines.append(f"{'.'.join(day)} {clock};{number}")
    return "\n".join(lines).encode()
