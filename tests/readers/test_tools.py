"""Files as many tools write them: read as their owners mean, or refused with what to do.

Python packages write their own; the others' files are in the form that their makers document.
Each kind is written for two drives, one of them in the south-west.  Nothing may be wrong
without a word.
"""

import gzip
import io
import json
import sys
import warnings
import zipfile
from datetime import UTC, datetime
from types import SimpleNamespace

import geopandas as gpd
import gpxpy
import gpxpy.gpx
import numpy as np
import pandas as pd
import pytest

from whichroad.errors import ReadError
from whichroad.readers import drive_from_table, read_drive

from .driving import town

N = 90
PLACES = {"north-east": (49.4, 8.7), "south-west": (-33.45, -70.66)}
PLANES = {"north-east": 32632, "south-west": 32719}
KNOT, KMH, MPH = 1852 / 3600, 1 / 3.6, 0.44704
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:movingpandas")


@pytest.fixture(params=PLACES)
def drive(request):
    """One drive: its table, its times in several forms, its plane."""
    lat, lon = PLACES[request.param]
    seed = list(PLACES).index(request.param)
    frame = town(seed, n=N, lat=lat, lon=lon).drop(columns="true_yaw")
    frame = frame.rename(columns={"true_speed": "v"}).round({"lat": 7, "lon": 7, "v": 3})
    moments = pd.to_datetime(np.round(frame.time), unit="s", utc=True)
    return SimpleNamespace(
        frame=frame, time=frame.time.to_numpy(), lat=frame.lat.to_numpy(), lon=frame.lon.to_numpy(),
        v=frame.v.to_numpy(), at=moments, iso=moments.dt.strftime("%Y-%m-%dT%H:%M:%SZ"),
        epsg=PLANES[request.param], east=request.param == "north-east",
        rows=list(frame.itertuples(index=False)),
    )  # fmt: skip


def frame_of(d, at=True):
    """A GeoDataFrame of the drive's points."""
    more = {"time": d.iso} if at else {}
    return gpd.GeoDataFrame(more, geometry=gpd.points_from_xy(d.lon, d.lat), crs=4326)


def line_of(d):
    from shapely import LineString

    return gpd.GeoDataFrame(
        {"name": ["a"]}, geometry=[LineString(np.column_stack([d.lon, d.lat]))], crs=4326
    )


def gpx_of(d, timed=True):
    """The drive as gpxpy's object."""
    points = [
        gpxpy.gpx.GPXTrackPoint(
            lat, lon, time=datetime.fromtimestamp(round(t), UTC) if timed else None
        )
        for t, lat, lon in zip(d.time, d.lat, d.lon, strict=True)
    ]
    gpx, track = gpxpy.gpx.GPX(), gpxpy.gpx.GPXTrack(name="a")
    gpx.tracks.append(track)
    track.segments.append(gpxpy.gpx.GPXTrackSegment(points))
    return gpx


def trajectory(d):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mpd = pytest.importorskip("movingpandas", reason="movingpandas is not installed")
        frame = frame_of(d).assign(t=d.at.dt.tz_localize(None), who=1).drop(columns="time")
        return mpd.Trajectory(frame, traj_id="who", t="t")


def installed(name):
    return pytest.importorskip(name, reason=f"{name} is not installed")


def csv(path, columns, **options):
    pd.DataFrame(columns).to_csv(path, index=False, **options)
    return path


def text(path, content):
    path.write_text(content, encoding="utf-8")
    return path


def lines(rows, head=""):
    return head + "".join(f"{row}\n" for row in rows)


def degrees(d, letters=False):
    return {"lat": d.lat, "lon": d.lon}


# Kinds that must be read: each writes the drive and gives what is to be read, and with which
# options where the file alone does not say it.

READ = {}


def kind(name, **about):
    def keep(write):
        READ[name] = write, about
        return write

    return keep


@kind("pandas, by default")
def _(d, p):
    pd.DataFrame({"time": d.iso, "lat": d.lat, "lon": d.lon}).to_csv(p / "a.csv")
    return p / "a.csv"


@kind("pandas, by default, another suffix")
def _(d, p):
    pd.DataFrame({"time": d.iso, "lat": d.lat, "lon": d.lon}).to_csv(p / "a.txt")
    return p / "a.txt"


@kind("pandas, times as an index without a name")
def _(d, p):
    pd.DataFrame({"lat": d.lat, "lon": d.lon}, index=d.at).rename_axis(None).to_csv(p / "a.csv")
    return p / "a.csv"


@kind("comments before the names and between rows")
def _(d, p):
    rows = [f"{t},{lat},{lon}" for t, lat, lon in zip(d.iso, d.lat, d.lon, strict=True)]
    rows.insert(10, "# a pause")
    return text(p / "a.csv", lines(rows, "# logged by me\n# version, 3, of it\ntime,lat,lon\n"))


@kind("names in a comment")
def _(d, p):
    rows = [f"{t},{lat},{lon}" for t, lat, lon in zip(d.iso, d.lat, d.lon, strict=True)]
    return text(p / "a.csv", lines(rows, "# time,lat,lon\n"))


@kind("a preamble")
def _(d, p):
    rows = [f"{t};{lat};{lon}" for t, lat, lon in zip(d.iso, d.lat, d.lon, strict=True)]
    head = "Logger;X200\nSerial;4711\n\nNote;first drive, in rain\n\nTime;Latitude;Longitude\n"
    return text(p / "a.csv", lines(rows, head))


@kind("bars between cells")
def _(d, p):
    return csv(p / "a.txt", {"time": d.iso, **degrees(d)}, sep="|")


@kind("blanks between cells")
def _(d, p):
    rows = [f" {t:.1f}   {a:.7f}  {o:.7f}" for t, a, o in zip(d.time, d.lat, d.lon, strict=True)]
    return text(p / "a.txt", lines(rows, " time   lat  lon\n"))


@kind("packed by gzip")
def _(d, p):
    return csv(p / "a.csv.gz", {"time": d.iso, **degrees(d)})


@kind("packed by zip")
def _(d, p):
    return csv(p / "a.csv.zip", {"time": d.iso, **degrees(d)})


@kind("packed by xz")
def _(d, p):
    return csv(p / "a.csv.xz", {"time": d.iso, **degrees(d)})


@kind("a German spreadsheet", speed=True)
def _(d, p):
    table = {"Zeitpunkt": d.at.dt.strftime("%d.%m.%Y %H:%M:%S"), **degrees(d), "km/h": d.v / KMH}
    return csv(p / "a.csv", table, sep=";", decimal=","), {
        "columns": {"time": "Zeitpunkt", "speed_kmh": "km/h"}
    }


@kind("days of a spreadsheet", abs_time=1e-3)
def _(d, p):
    return csv(p / "a.csv", {"time": d.time / 86_400 + 25_569, **degrees(d)})


@kind("American dates in two columns")
def _(d, p):
    day, clock = d.at.dt.strftime("%m/%d/%Y"), d.at.dt.strftime("%I:%M:%S %p")
    if d.east:  # 06/01/2026 does not show which number is the month
        return csv(p / "a.csv", {"Date": d.at.dt.strftime("%Y-%m-%d"), "Time": clock, **degrees(d)})
    day = pd.Series(day).str.replace("06/01", "06/21")
    d.time = d.time + 20 * 86_400
    return csv(p / "a.csv", {"Date": day, "Time": clock, **degrees(d)})


@kind("dates of mails")
def _(d, p):
    return csv(
        p / "a.csv", {"timestamp": d.at.dt.strftime("%a, %d %b %Y %H:%M:%S GMT"), **degrees(d)}
    )


@kind("compact dates")
def _(d, p):
    return csv(p / "a.csv", {"time": d.at.dt.strftime("%Y%m%d%H%M%S"), **degrees(d)})


@kind("local times and a zone")
def _(d, p):
    zone = "Europe/Berlin" if d.east else "America/Santiago"
    local = d.at.dt.tz_convert(zone).dt.strftime("%Y-%m-%d %H:%M:%S")
    return csv(p / "a.csv", {"time": local, **degrees(d)}), {"tz": zone}


@kind("own names", speed=True)
def _(d, p):
    path = csv(p / "a.csv", {"ts_x": d.iso, "B": d.lat, "L": d.lon, "tempo": d.v / KMH})
    return path, {"columns": {"time": "ts_x", "lat": "B", "lon": "L", "speed_kmh": "tempo"}}


@kind("no names, columns by number")
def _(d, p):
    path = csv(p / "a.csv", {"n": 7, "lat": d.lat, "lon": d.lon, "t": d.iso}, header=False)
    return path, {"columns": {"time": 4, "lat": 2, "lon": "3"}}


@kind("polars, CSV")
def _(d, p):
    installed("polars").DataFrame({"time": list(d.iso), **degrees(d)}).write_csv(p / "a.csv")
    return p / "a.csv"


@kind("polars, Parquet")
def _(d, p):
    pl = installed("polars")
    table = pl.DataFrame({"time": d.at.dt.tz_localize(None).to_numpy(), **degrees(d)})
    table.write_parquet(p / "a.parquet")
    return p / "a.parquet"


@kind("polars, in memory")
def _(d, p):
    return installed("polars").DataFrame({"time": d.time, **degrees(d)})


@kind("DuckDB, in memory")
def _(d, p):
    drive = pd.DataFrame({"time": d.time, **degrees(d)})  # noqa: F841
    return installed("duckdb").sql("select * from drive")


@kind("DuckDB, Parquet")
def _(d, p):
    drive = pd.DataFrame({"ts": d.at, **degrees(d)})  # noqa: F841
    installed("duckdb").sql(f"copy (select * from drive) to '{p / 'a.parquet'}'")
    return p / "a.parquet"


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


@kind("Torque", speed=True)
def _(d, p):
    stamps = d.at.dt.strftime("%a %b %d %H:%M:%S GMT+00:00 %Y")
    device = d.at.dt.strftime("%d-%b-%Y %H:%M:%S.000")
    table = {"GPS Time": stamps, " Device Time": device, " Longitude": d.lon, " Latitude": d.lat,
             "GPS Speed (Meters/second)": d.v, " Horizontal Dilution of Precision": 4.0,
             " Altitude": 100.0, " Bearing": 90.0, "Speed (OBD)(km/h)": "-"}  # fmt: skip
    return csv(p / "trackLog.csv", table)


@kind("Geotab, its API", speed=True)
def _(d, p):
    rows = [
        {"latitude": a, "longitude": o, "speed": v / KMH, "dateTime": t.replace("Z", ".000Z"),
         "device": {"id": "b1"}, "id": f"b{k}"}
        for k, (t, a, o, v) in enumerate(zip(d.iso, d.lat, d.lon, d.v, strict=True))
    ]  # fmt: skip
    return text(p / "LogRecord.json", json.dumps({"result": rows, "jsonrpc": "2.0"}))


@kind("Geotab, a table", speed=True)
def _(d, p):
    table = {"device": "b1", "dateTime": d.iso, "latitude": d.lat, "longitude": d.lon,
             "speed": d.v / KMH}  # fmt: skip
    return csv(p / "LogRecord.csv", table)


@kind("RaceChrono", speed=True)
def _(d, p):
    head = (
        "This file is created using RaceChrono v9.1.3 ( http://racechrono.com/ ).\nFormat,3\n"
        'Session title,"Home, sweet"\nSession type,Lap timing\nDriver name,\n'
        "Created,01/06/2026,12:00\nNote,\n\n"
        "timestamp,fragment_id,lap_number,elapsed_time,distance_traveled,accuracy,altitude,"
        "bearing,latitude,longitude,speed\n"
        "unix time,,,s,m,m,m,deg,deg,deg,m/s\n"
        ",,,,,100: gps,100: gps,100: gps,100: gps,100: gps,calc\n"
    )
    rows = (
        f"{t:.3f},0,,{t - d.time[0]:.3f},0,3.0,100,90.0,{a},{o},{v}"
        for t, a, o, v in zip(d.time, d.lat, d.lon, d.v, strict=True)
    )
    return text(p / "session.csv", lines(rows, head))


@kind("Wejo", speed=True)
def _(d, p):
    stamps = d.at.dt.tz_convert("America/Chicago").dt.strftime("%Y-%m-%d %H:%M:%S.000%z")
    table = {"dataPointId": [f"{k:x}-a" for k in range(N)], "journeyId": "j1",
             "capturedTimestamp": stamps, "latitude": d.lat, "longitude": d.lon, "heading": 90,
             "speed": d.v / KMH, "ignitionStatus": "MID_JOURNEY"}  # fmt: skip
    return csv(p / "wejo.csv", table)


@kind("T-Drive")
def _(d, p):
    stamps = d.at.dt.strftime("%Y-%m-%d %H:%M:%S")
    rows = (f"366,{t},{o:.7f},{a:.7f}" for t, a, o in zip(stamps, d.lat, d.lon, strict=True))
    return text(p / "366.txt", lines(rows))


@kind("GeoLife", abs_time=1e-3)
def _(d, p):
    head = (
        "Geolife trajectory\nWGS 84\nAltitude is in Feet\nReserved 3\n"
        "0,2,255,My Track,0,0,2,8421376\n0\n"
    )
    rows = (
        f"{a:.7f},{o:.7f},0,492,{t.timestamp() / 86_400 + 25_569:.10f},{t:%Y-%m-%d},{t:%H:%M:%S}"
        for t, a, o in zip(d.at, d.lat, d.lon, strict=True)
    )
    return text(p / "20260601120000.plt", lines(rows, head))


@kind("Cabspotting")
def _(d, p):
    rows = (f"{a:.7f} {o:.7f} 0 {t:.0f}" for t, a, o in zip(d.time, d.lat, d.lon, strict=True))
    return text(p / "new_abboip.txt", lines(rows))


@kind("Traccar, its API", speed=True)
def _(d, p):
    rows = [
        {"id": k, "deviceId": 1, "protocol": "osmand", "serverTime": t, "deviceTime": t,
         "fixTime": t.replace("Z", ".000+00:00"), "outdated": False, "valid": True, "latitude": a,
         "longitude": o, "altitude": 0.0, "speed": v / KNOT, "course": 90.0, "accuracy": 0.0,
         "attributes": {"batteryLevel": 90.0, "distance": 10.1}}
        for k, (t, a, o, v) in enumerate(zip(d.iso, d.lat, d.lon, d.v, strict=True))
    ]  # fmt: skip
    return text(p / "positions.json", json.dumps(rows))


@kind("Traccar, its database", speed=True)
def _(d, p):
    stamps = d.at.dt.strftime("%Y-%m-%d %H:%M:%S")
    table = {"id": range(N), "protocol": "osmand", "deviceid": 1, "servertime": stamps,
             "devicetime": stamps, "fixtime": stamps, "valid": "t", "latitude": d.lat,
             "longitude": d.lon, "altitude": 0, "speed": d.v / KNOT, "course": 90}  # fmt: skip
    return csv(p / "tc_positions.csv", table)


@kind("Movebank", speed=True)
def _(d, p):
    table = {"event-id": range(N), "visible": "true",
             "timestamp": d.at.dt.strftime("%Y-%m-%d %H:%M:%S.000"), "location-long": d.lon,
             "location-lat": d.lat, "ground-speed": d.v, "heading": 90.0, "sensor-type": "gps",
             "tag-local-identifier": "1", "individual-local-identifier": "Ada"}  # fmt: skip
    return csv(p / "movebank.csv", table)


def _owntracks(d):
    for t, a, o, v in zip(d.time, d.lat, d.lon, d.v, strict=True):
        yield {"_type": "location", "tid": "ab", "lat": a, "lon": o, "tst": round(t), "acc": 5,
               "vel": round(v / KMH), "cog": 90, "t": "u"}  # fmt: skip


@kind("OwnTracks, its API", speed=True, abs_speed=0.2)
def _(d, p):
    return text(p / "a.json", json.dumps({"count": N, "data": list(_owntracks(d))}))


@kind("OwnTracks, its recorder", speed=True, abs_speed=0.2)
def _(d, p):
    rows = (
        f"{t}\t*                 \t{json.dumps(r)}"
        for t, r in zip(d.iso, _owntracks(d), strict=True)
    )
    return text(p / "2026-06.rec", lines(rows))


@kind("OwnTracks, a table", speed=True, abs_speed=0.2)
def _(d, p):
    return csv(p / "a.csv", list(_owntracks(d)))


@kind("Google's location history", abs_deg=1e-7)
def _(d, p):
    rows = [
        {"timestampMs": f"{1000 * t:.0f}", "latitudeE7": round(a * 1e7),
         "longitudeE7": round(o * 1e7), "accuracy": 12,
         "activity": [{"activity": [{"type": "STILL"}]}]}
        for t, a, o in zip(d.time, d.lat, d.lon, strict=True)
    ]  # fmt: skip
    return text(p / "Records.json", json.dumps({"locations": rows}))


@kind("Google's location history, a table", abs_deg=1e-7)
def _(d, p):
    return csv(p / "a.csv", {"timestamp": d.iso, "latitudeE7": np.round(d.lat * 1e7).astype(int),
                             "longitudeE7": np.round(d.lon * 1e7).astype(int)})  # fmt: skip


@kind("Google's timeline", speed=True)
def _(d, p):
    raw = [
        {"position": {"LatLng": f"{a}°, {o}°", "accuracyMeters": 8, "timestamp": t,
                      "speedMetersPerSecond": v}}
        for t, a, o, v in zip(d.iso, d.lat, d.lon, d.v, strict=True)
    ]  # fmt: skip
    return text(p / "Timeline.json", json.dumps({"semanticSegments": [], "rawSignals": raw}))


@kind("trackintel, a table")
def _(d, p):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ti = installed("trackintel")
        frame = frame_of(d).rename_geometry("geom").assign(user_id=0, tracked_at=d.at)
        points = ti.Positionfixes(frame[["user_id", "tracked_at", "geom"]])
        ti.io.write_positionfixes_csv(points, p / "positionfixes.csv")
    return p / "positionfixes.csv"


@kind("trackintel, in memory")
def _(d, p):
    return (
        frame_of(d).rename_geometry("geom").assign(user_id=0, tracked_at=d.at).drop(columns="time")
    )


@kind("scikit-mobility")
def _(d, p):
    table = {"uid": 1, "lat": d.lat, "lng": d.lon, "datetime": d.at.dt.tz_localize(None), "tid": 3}
    return csv(p / "traj.csv", table)


@kind("GnssLogger", speed=True)
def _(d, p):
    head = (
        "# \n# Header Description:\n# \n# Version: v3.0.6.4 Platform: 14\n# \n"
        "# Raw,utcTimeMillis,TimeNanos\n"
        "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,"
        "BearingDegrees,UnixTimeMillis,SpeedAccuracyMps,BearingAccuracyDegrees\n# \n"
    )
    rows = []
    for t, a, o, v in zip(d.time, d.lat, d.lon, d.v, strict=True):
        rows.append(f"Raw,{1000 * t:.0f},1")
        rows.append(f"Fix,GPS,{a},{o},100.0,{v},4.0,90.0,{1000 * t:.0f},0.3,5.0")
        rows.append(f"Fix,FLP,{a + 1e-4},{o},100.0,{v},4.0,90.0,{1000 * t:.0f},,")
    return text(p / "gnss_log.txt", lines(rows, head))


@kind("GPSLogger", speed=True)
def _(d, p):
    table = {"time": d.iso, "lat": d.lat, "lon": d.lon, "elevation": 100.0, "accuracy": 4.0,
             "bearing": 90.0, "speed": d.v, "satellites": 9, "provider": "gps"}  # fmt: skip
    return csv(p / "20260601.txt", table)


@kind("Sensor Logger", speed=True)
def _(d, p):
    table = {"time": (d.time * 1e9).astype(np.int64), "seconds_elapsed": d.time - d.time[0],
             "bearingAccuracy": 5, "speedAccuracy": 0.3, "verticalAccuracy": 3,
             "horizontalAccuracy": 4, "speed": d.v, "bearing": 90, "altitude": 9,
             "longitude": d.lon, "latitude": d.lat}  # fmt: skip
    return csv(p / "Location.csv", table)


@kind("phyphox", speed=True, relative=True)
def _(d, p):
    table = {"Time (s)": d.time - d.time[0], "Latitude (°)": d.lat, "Longitude (°)": d.lon,
             "Altitude (m)": 9.0, "Velocity (m/s)": d.v, "Direction (°)": 90.0,
             "Horizontal Accuracy (m)": 4.0}  # fmt: skip
    return csv(p / "Raw Data.csv", table)


@kind("Columbus", speed=True)
def _(d, p):
    table = {"INDEX": range(N), "TAG": "T", "DATE": d.at.dt.strftime("%Y%m%d"),
             "TIME": d.at.dt.strftime("%H%M%S"), "LATITUDE": np.abs(d.lat),
             "N/S": np.where(d.lat < 0, "S", "N"), "LONGITUDE": np.abs(d.lon),
             "E/W": np.where(d.lon < 0, "W", "E"), "HEIGHT": 9, "SPEED": d.v / KMH,
             "HEADING": 90}  # fmt: skip
    return csv(p / "26060112.CSV", table)


@kind("Background Geolocation", speed=True)
def _(d, p):
    rows = [
        {"uuid": f"{k}", "timestamp": t, "coords": {"latitude": a, "longitude": o, "accuracy": 5,
                                                      "speed": v, "heading": 90}}
        for k, (t, a, o, v) in enumerate(zip(d.iso, d.lat, d.lon, d.v, strict=True))
    ]  # fmt: skip
    return text(p / "locations.json", json.dumps({"location": rows}))


@kind("Valhalla's request", timed=True)
def _(d, p):
    shape = [{"lat": a, "lon": o, "time": t} for t, a, o in zip(d.time, d.lat, d.lon, strict=True)]
    return text(p / "trace.json", json.dumps({"shape": shape, "costing": "auto"}))


@kind("columns in JSON")
def _(d, p):
    return text(
        p / "a.json",
        json.dumps({"time": list(d.iso), "lat": d.lat.tolist(), "lon": d.lon.tolist()}),
    )


def read(thing, options):
    if hasattr(thing, "read"):
        with thing:
            return read_drive(thing, **options)
    if hasattr(thing, "suffix"):
        return read_drive(thing, **options)
    return drive_from_table(thing, **options)


@pytest.mark.parametrize("name", READ)
def test_what_a_tool_writes_is_read_as_its_owner_means_it(drive, tmp_path, name, sound):
    write, about = READ[name]
    made = write(drive, tmp_path)
    thing, options = made if isinstance(made, tuple) else (made, {})
    (got,) = read(thing, options)
    sound(got)
    n = len(got.fixes)
    assert n >= about.get("fewest", N)
    said = " ".join(got.notes)
    if about.get("ordered", True) or about.get("timed", True):
        assert got.fixes.lat_deg == pytest.approx(drive.lat[:n], abs=about.get("abs_deg", 1e-7))
        assert got.fixes.lon_deg == pytest.approx(drive.lon[:n], abs=about.get("abs_deg", 1e-7))
    if about.get("timed", True):
        start = drive.time[0] if about.get("relative") else 0.0
        tolerance = about.get("abs_time", 1e-3)
        assert got.fixes.time == pytest.approx(drive.time[:n] - start, abs=tolerance)
        assert "invented" not in said
    else:
        assert "no times: they were invented" in said
    known = np.isfinite(got.fixes.sigma_speed)
    if about.get("speed"):
        assert known.all()
        assert got.fixes.speed == pytest.approx(drive.v, abs=about.get("abs_speed", 2e-3))
    else:
        assert not known.any()
    if "fewest" in about:
        assert "cut short" in said


# Files of no kind that is read, or that do not say enough

REFUSED = {
    "a spreadsheet": ("a.xlsx", lambda d: _xlsx(), "spreadsheet.*save it as CSV"),
    "UTF-16": ("a.csv", lambda d: _table(d).encode("utf-16"), "UTF-16.*save it in UTF-8"),
    "TCX": ("a.tcx", lambda d: b"<?xml version='1.0'?><TrainingCenterDatabase/>", "export GPX"),
    "a page of the web": ("a.html", lambda d: b"<!doctype html><html></html>", "export GPX"),
    "a picture": ("a.jpg", lambda d: b"\xff\xd8\xff\xe0" + bytes(100), "unknown format"),
    "an empty file": ("a.csv", lambda d: b"", "the file is empty"),
    "places and an unknown column": (
        "a.csv", lambda d: _table(d, "Zeitpunkt"), "no time.*--columns time=",
    ),
    "unknown columns": ("a.csv", lambda d: b"a,b\n1,2\n", "no known column.*--columns"),
    "dates of which the month is unknown": (
        "a.csv",
        lambda d: pd.DataFrame({"time": "03/04/2026 10:00:00", **degrees(d)}).to_csv(index=False),
        "which number is the month; ISO 8601",
    ),
    "coordinates of a plane": (
        "a.csv",
        lambda d: pd.DataFrame({"time": d.iso, "x": 5e5, "y": 5.4e6}).to_csv(index=False),
        "without a reference system.*--crs",
    ),
    "a candump": ("a.log", lambda d: b"(1780315200.000000) can0 3A0#0A001E00\n", "--dbc"),
    "a cut JSON": ("a.json", lambda d: b'[{"lat": 49.4, "lon"', "cut short.*columns time"),
    "JSON without places": ("a.json", lambda d: b'{"a": [1, 2]}', "columns time, lat, lon"),
    "a damaged gzip": ("a.csv.gz", lambda d: gzip.compress(b"time,lat,lon\n")[:20], "unpack it"),
    "GeoJSON of areas": (
        "a.geojson",
        lambda d: b'{"type":"FeatureCollection","features":[{"type":"Feature","properties":{},'
        b'"geometry":{"type":"Polygon","coordinates":[[[8,49],[9,49],[9,50],[8,49]]]}}]}',
        "without records of places",
    ),
}  # fmt: skip


def _table(d, time="time"):
    return pd.DataFrame({time: d.iso, **degrees(d)}).to_csv(index=False)


def _xlsx():
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")
        archive.writestr("xl/workbook.xml", "<workbook/>")
    return packed.getvalue()


@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_read_is_refused_with_what_to_do(drive, put, kind):
    name, content, said = REFUSED[kind]
    with pytest.raises(ReadError, match=f"(?s){said}") as caught:
        read_drive(put(name, content(drive)))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 900


def test_geoparquet_in_a_plane_without_its_system_is_refused_with_what_to_do(drive, tmp_path):
    frame = frame_of(drive).to_crs(drive.epsg).set_crs(None, allow_override=True)
    frame.to_parquet(tmp_path / "a.parquet")
    with pytest.raises(ReadError, match=r"without a reference system.*--crs"):
        read_drive(tmp_path / "a.parquet")
    (got,) = read_drive(tmp_path / "a.parquet", crs=drive.epsg)
    assert got.fixes.lat_deg == pytest.approx(drive.lat, abs=1e-7)


def test_many_trips_in_geoparquet_of_a_plane_are_where_they_were(drive, tmp_path):
    from whichroad.readers.many_trips import trip_batches

    frame = frame_of(drive).to_crs(drive.epsg).assign(trip_id=["a", "b"] * (N // 2))
    frame.to_parquet(tmp_path / "a.parquet")
    for batch in trip_batches(tmp_path / "a.parquet"):
        (got,) = drive_from_table(batch.table.slice(0, batch.first[1]))
        assert got.fixes.lat_deg == pytest.approx(drive.lat[::2], abs=1e-7)
        assert got.fixes.lon_deg == pytest.approx(drive.lon[::2], abs=1e-7)


def test_a_geopackage_of_several_layers_is_refused_with_what_to_do(drive, tmp_path):
    frame_of(drive).to_file(tmp_path / "a.gpkg", layer="one")
    frame_of(drive).to_file(tmp_path / "a.gpkg", layer="two")
    with pytest.raises(ReadError, match=r"one, two; .*a file of its own"):
        read_drive(tmp_path / "a.gpkg")


def test_standard_input_is_read(drive, monkeypatch):
    data = io.TextIOWrapper(io.BytesIO(_table(drive).encode()))
    monkeypatch.setattr(sys, "stdin", data)
    (got,) = read_drive("-")
    assert got.fixes.lat_deg == pytest.approx(drive.lat)


@pytest.mark.parametrize("by", ["folder", "pattern"])
def test_folders_and_patterns_are_all_their_files(drive, tmp_path, by):
    for k, rows in enumerate((slice(0, 40), slice(40, N))):
        part = pd.DataFrame({"time": drive.iso, **degrees(drive)})[rows]
        part.to_csv(tmp_path / f"{k}.csv", index=False)
    (tmp_path / "notes.md").write_text("my drives\n")
    (got,) = read_drive(tmp_path if by == "folder" else tmp_path / "*.csv")
    assert got.fixes.lat_deg == pytest.approx(drive.lat)
    assert any("0, 1: joined" in note for note in got.notes)
    assert any("not read: notes.md" in note for note in got.notes) == (by == "folder")
    with pytest.raises(ReadError, match="no file matches"):
        read_drive(tmp_path / "*.gpx")


def test_there_are_sixty_kinds_of_files():
    assert len(READ) + len(REFUSED) >= 60
