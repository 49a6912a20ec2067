"""Good files of further formats, for `fuzz` to damage."""

import json
import struct
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
        "ubx": ubx(np.asarray(stamps), lat_deg, lon_deg),
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


def ubx_frame(kind: int, payload: bytes) -> bytes:
    """A UBX message with its checksum."""
    body = struct.pack(">H", kind) + struct.pack("<H", len(payload)) + payload
    values = np.frombuffer(body, np.uint8).astype(np.int64)
    sums = int(values.sum()), int(np.cumsum(values).sum())
    return b"\xb5\x62" + body + bytes(one & 255 for one in sums)


def ubx(stamps: Any, lat_deg: Any, lon_deg: Any) -> bytes:
    """NAV-PVT, NAV-COV and ESF-MEAS of each epoch: two wheel ticks and the gyro.

    Args:
        stamps: (n,) datetime64[us].
        lat_deg: (n,) latitudes.
        lon_deg: (n,) longitudes.
    """
    log = bytearray()
    for k, (s, a, o) in enumerate(zip(stamps, lat_deg, lon_deg, strict=True)):
        at, ms = s.item(), 1000 * k
        flags = struct.pack("<BIiBBBB", 3, 0, 1000 * at.microsecond, 3, 1, 0, 12)
        clock = struct.pack(
            "<IHBBBBB", ms, at.year, at.month, at.day, at.hour, at.minute, at.second
        )
        place = struct.pack("<iiiiII", round(1e7 * o), round(1e7 * a), 0, 0, 2000, 3000)
        speed = struct.pack("<iiiiiII", 0, 0, 0, 9000, 100_000 * (k % 360), 200, 100_000)
        log += ubx_frame(0x0107, clock + flags + place + speed + bytes(16))
        cov = struct.pack("<12f", 4.0, 0.5, 0.0, 3.0, *[0.0] * 8)
        log += ubx_frame(0x0136, struct.pack("<IBBB9x", ms, 0, 1, 1) + cov)
        words = (8 << 24 | 450 * k & 0x7FFFFF, 9 << 24 | 451 * k & 0x7FFFFF, 5 << 24 | 99)
        log += ubx_frame(0x1002, struct.pack("<IHH3I", ms, 3 << 11, 0, *words))
    return bytes(log)


def overture(roads: Any) -> bytes:
    """A map's streets as Overture's segments with rules on parts of them, in GeoParquet."""
    import io

    import pyarrow as pa
    import pyarrow.parquet

    table, rows = roads.edges_table(), []
    for row in table[table.forward].itertuples():
        ends = [(f"c{row.from_node}", 0.0), (f"c{row.to_node}", 1.0)]
        once = {"access_type": "denied", "when": {"heading": "backward"}, "between": [0.2, 0.7]}
        step = {"connector_id": ends[1][0], "segment_id": f"s{(row.edge_id + 2) % len(table)}"}
        rows.append({
            "id": f"s{row.edge_id}", "geometry": row.geometry.wkb, "subtype": "road",
            "class": row.highway, "names": {"primary": str(row.name)},
            "connectors": [{"connector_id": name, "at": at} for name, at in ends],
            "road_flags": [{"values": ["is_bridge"], "between": [0.3, 0.6]}],
            "speed_limits": [{"max_speed": {"value": 50, "unit": "km/h"}, "between": [0.0, 0.5]}],
            "access_restrictions": [once], "level_rules": [{"value": 1, "between": [0.3, 0.6]}],
            "prohibited_transitions": [{"sequence": [step], "final_heading": "forward"}],
        })  # fmt: skip
    file = io.BytesIO()
    pyarrow.parquet.write_table(pa.Table.from_pylist(rows), file, compression="none")
    return file.getvalue()


def sumo_net(roads: Any) -> bytes:
    """A map's legal edges as a network of SUMO, every other turn a connection."""
    table = roads.edges_table().to_crs("EPSG:32632")
    utm = "+proj=utm +zone=32 +datum=WGS84 +units=m"
    lines = [f'<net><location netOffset="0,0" projParameter="{utm}"/>']
    places = {}
    for row in table[~table.against_one_way].itertuples():
        shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in row.geometry.coords)
        places[row.from_node] = row.geometry.coords[0]
        places[row.to_node] = row.geometry.coords[-1]
        lines.append(
            f'<edge id="e{row.edge_id}" from="{row.from_node}" to="{row.to_node}" shape="{shape}" '
            f'type="highway.{row.highway}"><lane id="e{row.edge_id}_0" speed="13.9"/></edge>'
        )
    lines += [f'<junction id="{n}" x="{x:.2f}" y="{y:.2f}"/>' for n, (x, y) in places.items()]
    turns = roads.arrays.turns.edge[::2].tolist()
    lines += [f'<connection from="e{a}" to="e{b}"/>' for a, b in enumerate(turns)]
    return "\n".join([*lines, "</net>"]).encode()


def requests_of(drive: Any) -> tuple[bytes, bytes]:
    """The first 30 fixes as requests of OSRM (coordinates, line feed, options) and of Valhalla."""
    f = drive.drive.fixes
    rows = list(zip(*(c[:30].tolist() for c in (f.time, f.lat_deg, f.lon_deg)), strict=True))
    places = ";".join(f"{lon:.6f},{lat:.6f}" for _, lat, lon in rows)
    times = ";".join(f"{t:.0f}" for t, _, _ in rows)
    radiuses = ";".join(["5"] * len(rows))
    options = f"timestamps={times}&radiuses={radiuses}&waypoints=0;{len(rows) - 1}&steps=true"
    shape = [{"time": t, "lat": lat, "lon": lon, "accuracy": 5} for t, lat, lon in rows]
    asked = {"shape": shape, "costing": "auto", "units": "miles", "use_timestamps": True,
             "filters": {"attributes": ["edge.names"], "action": "exclude"}}  # fmt: skip
    osrm = f"{places}\n{options}&annotations=true&geometries=geojson&overview=full"
    return osrm.encode(), json.dumps(asked, indent=1).encode()


def for_robots(table: bytes, path: Path) -> bytes:
    """Points in Parquet as a bag or an MCAP, by our own writer.

    Args:
        table: With `time` as text.
        path: Where to; the suffix chooses.
    """
    import pyarrow as pa
    import pyarrow.parquet

    from whichroad.writers import write_table

    points = pyarrow.parquet.read_table(pa.BufferReader(table))
    times = points["time"].cast(pa.timestamp("us", tz="UTC"))
    write_table(points.set_column(0, "time", times).drop(["drive_id"]), path)
    return path.read_bytes()
