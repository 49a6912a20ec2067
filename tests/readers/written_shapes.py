"""Drives as geometries, as GPX, KML and NMEA, and in memory."""

import io
import json
import zipfile

import numpy as np
import pandas as pd

from .written import (
    KNOT,
    READ,
    N,
    csv,
    degrees,
    frame_of,
    gpx_of,
    kind,
    line_of,
    lines,
    text,
    trajectory,
)  # fmt: skip


@kind("pandas, Feather")
def _(d, p):
    pd.DataFrame({"time": d.at, **degrees(d)}).to_feather(p / "a.feather")
    return p / "a.feather"


@kind("geopandas, GeoParquet")
def _(d, p):
    frame_of(d).to_parquet(p / "a.parquet")
    return p / "a.parquet"


@kind("geopandas, GeoParquet in a plane")
def _(d, p):
    frame_of(d).to_crs(d.epsg).to_parquet(p / "a.parquet")
    return p / "a.parquet"


@kind("geopandas, GeoParquet on another datum")
def _(d, p):
    frame_of(d).to_crs(4230 if d.east else 4248).to_parquet(p / "a.geoparquet")
    return p / "a.geoparquet"


@kind("geopandas, GeoParquet as GeoArrow")
def _(d, p):
    frame_of(d).to_crs(d.epsg).to_parquet(p / "a.parquet", geometry_encoding="geoarrow")
    return p / "a.parquet"


@kind("geopandas, Feather in a plane")
def _(d, p):
    frame_of(d).to_crs(d.epsg).to_feather(p / "a.feather")
    return p / "a.feather"


@kind("geopandas, in memory, in a plane")
def _(d, p):
    return frame_of(d).to_crs(d.epsg)


@kind("geopandas, GeoJSON")
def _(d, p):
    frame_of(d).to_file(p / "a.geojson", COORDINATE_PRECISION=9)
    return p / "a.geojson"


@kind("geopandas, GeoPackage in a plane")
def _(d, p):
    frame_of(d).to_crs(d.epsg).to_file(p / "a.gpkg")
    return p / "a.gpkg"


@kind("geopandas, Shapefile")
def _(d, p):
    frame_of(d).to_file(p / "a.shp")
    return p / "a.shp"


@kind("geopandas, Shapefile in a zip")
def _(d, p):
    frame_of(d).to_file(p / "a.shp")
    with zipfile.ZipFile(p / "a.zip", "w") as archive:
        for suffix in ("shp", "shx", "dbf", "prj"):
            archive.write(p / f"a.{suffix}", f"a.{suffix}")
    return p / "a.zip"


@kind("geopandas, FlatGeobuf", ordered=False)
def _(d, p):
    frame_of(d).to_file(p / "a.fgb")
    return p / "a.fgb"


@kind("GeoJSON of togeojson")
def _(d, p):
    places = [[o, a, 100.0] for a, o in zip(d.lat, d.lon, strict=True)]
    line = {"type": "LineString", "coordinates": places}
    about = {"name": "a", "coordTimes": list(d.iso)}
    feature = {"type": "Feature", "properties": about, "geometry": line}
    content = {"type": "FeatureCollection", "features": [feature]}
    return text(p / "a.geojson", json.dumps(content))


@kind("GeoJSON of one feature of points")
def _(d, p):
    places = [[o, a] for a, o in zip(d.lat, d.lon, strict=True)]
    feature = {"type": "Feature", "properties": {"times": list(d.iso)},
               "geometry": {"type": "MultiPoint", "coordinates": places}}  # fmt: skip
    return text(p / "a.geojson", json.dumps(feature))


@kind("GeoJSON line", timed=False)
def _(d, p):
    line_of(d).to_file(p / "a.geojson", COORDINATE_PRECISION=9)
    return p / "a.geojson"


@kind("GeoPackage line", timed=False)
def _(d, p):
    line_of(d).to_crs(d.epsg).to_file(p / "a.gpkg")
    return p / "a.gpkg"


@kind("Shapefile line", timed=False)
def _(d, p):
    line_of(d).to_file(p / "a.shp")
    return p / "a.shp"


@kind("places alone", timed=False)
def _(d, p):
    return csv(p / "a.csv", degrees(d))


@kind("KML track")
def _(d, p):
    track = lines(f"<when>{t}</when>" for t in d.iso)
    track += lines(f"<gx:coord>{o} {a} 0</gx:coord>" for a, o in zip(d.lat, d.lon, strict=True))
    return text(p / "a.kml", _kml(f"<Placemark><gx:Track>{track}</gx:Track></Placemark>"))


@kind("KML points with times")
def _(d, p):
    marks = (
        f"<Placemark><TimeStamp><when>{t}</when></TimeStamp><Point><coordinates>{o},{a},0"
        "</coordinates></Point></Placemark>"
        for t, a, o in zip(d.iso, d.lat, d.lon, strict=True)
    )
    return text(p / "a.kml", _kml(lines(marks)))


@kind("KML of GDAL, a line", timed=False)
def _(d, p):
    line_of(d).to_file(p / "a.kml", driver="LIBKML")
    return p / "a.kml"


@kind("KMZ")
def _(d, p):
    READ["KML track"][0](d, p)
    with zipfile.ZipFile(p / "a.kmz", "w") as archive:
        archive.write(p / "a.kml", "doc.kml")
        archive.writestr("files/icon.png", b"x")
    return p / "a.kmz"


def _kml(inner):
    head = (
        '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">'
    )
    return f'<?xml version="1.0" encoding="UTF-8"?>{head}<Document>{inner}</Document></kml>'


@kind("gpxpy")
def _(d, p):
    return text(p / "a.gpx", gpx_of(d).to_xml())


@kind("gpxpy, in memory")
def _(d, p):
    return gpx_of(d)


@kind("gpxpy, without times", timed=False)
def _(d, p):
    return text(p / "a.gpx", gpx_of(d, timed=False).to_xml())


@kind("GPX route", timed=False)
def _(d, p):
    points = "".join(f'<rtept lat="{a}" lon="{o}"/>' for a, o in zip(d.lat, d.lon, strict=True))
    return text(p / "a.gpx", f'<gpx version="1.1"><rte><name>r</name>{points}</rte></gpx>')


@kind("GPX cut short", fewest=N // 2 - 2)
def _(d, p):
    whole = gpx_of(d).to_xml()
    return text(p / "a.gpx", whole[: whole.index("<trkpt") + (len(whole) - 700) // 2])


@kind("movingpandas")
def _(d, p):
    return trajectory(d)


@kind("movingpandas, a collection, GeoParquet")
def _(d, p):
    trajectory(d).df.to_parquet(p / "a.parquet")
    return p / "a.parquet"


@kind("tuples")
def _(d, p):
    return [(t, a, o) for t, a, o in zip(d.time, d.lat, d.lon, strict=True)]


@kind("tuples with datetimes")
def _(d, p):
    rows = zip(d.at.dt.to_pydatetime() if hasattr(d.at.dt, "to_pydatetime") else d.at, d.lat, d.lon,
               strict=True)  # fmt: skip
    return list(rows)


@kind("tuples without times", timed=False)
def _(d, p):
    return [(a, o) for a, o in zip(d.lat, d.lon, strict=True)]


@kind("an array")
def _(d, p):
    return np.column_stack([d.time, d.lat, d.lon])


@kind("an open file")
def _(d, p):
    return csv(p / "a.csv", {"time": d.iso, **degrees(d)}).open("rb")


@kind("an open text")
def _(d, p):
    return io.StringIO(pd.DataFrame({"time": d.iso, **degrees(d)}).to_csv())


@kind("NMEA without checksums", abs_deg=2e-6, speed=True, abs_speed=0.1)
def _(d, p):
    return text(p / "a.nmea", "".join(_rmc(d, sealed=False)))


@kind("NMEA of pynmeagps", abs_deg=2e-6, speed=True, abs_speed=0.1)
def _(d, p):
    return text(p / "a.log", "".join(_rmc(d, sealed=True)))


def _rmc(d, sealed):
    from pynmeagps import GET, NMEAMessage

    for t, a, o, v in zip(d.at, d.lat, d.lon, d.v, strict=True):
        message = NMEAMessage(
            "GN", "RMC", GET, time=t.time(), status="A", lat=a, NS="NS"[int(a < 0)], lon=o,
            EW="EW"[int(o < 0)], spd=round(v / KNOT, 2), cog=90.0, date=t.date(), posMode="A",
        )  # fmt: skip
        line = message.serialize().decode()
        yield line if sealed else line.partition("*")[0] + "\r\n"
