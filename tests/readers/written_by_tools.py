"""Drives in the forms that the makers of loggers and services document."""

import json
import warnings

import numpy as np

from .written import (
    KMH,
    KNOT,
    N,
    csv,
    frame_of,
    installed,
    kind,
    lines,
    text,
)  # fmt: skip


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
