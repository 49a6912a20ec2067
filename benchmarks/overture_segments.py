"""Segments after Overture's schema, written for the tests, also of an OpenStreetMap extract."""

import pyarrow as pa
import pyarrow.parquet
import shapely

_BETWEEN = ("between", pa.list_(pa.float64()))
_TEXT = pa.string()
_WHEN = pa.struct([
    ("during", _TEXT), ("heading", _TEXT), ("using", pa.list_(_TEXT)),
    ("recognized", pa.list_(_TEXT)), ("mode", pa.list_(_TEXT)),
    ("vehicle", pa.list_(pa.struct([("dimension", _TEXT), ("comparison", _TEXT),
                                    ("value", pa.float64()), ("unit", _TEXT)]))),
])  # fmt: skip
_SPEED = pa.struct([("value", pa.int32()), ("unit", _TEXT)])
_STEP = pa.struct([("connector_id", _TEXT), ("segment_id", _TEXT)])
SCHEMA = pa.schema([
    ("id", _TEXT), ("geometry", pa.binary()), ("version", pa.int32()), ("subtype", _TEXT),
    ("class", _TEXT), ("subclass", _TEXT),
    ("names", pa.struct([("primary", _TEXT), ("common", pa.map_(_TEXT, _TEXT)),
                         ("rules", pa.list_(pa.struct([("variant", _TEXT), ("language", _TEXT),
                                                       ("value", _TEXT), _BETWEEN,
                                                       ("side", _TEXT)])))])),
    ("connectors", pa.list_(pa.struct([("connector_id", _TEXT), ("at", pa.float64())]))),
    ("routes", pa.list_(pa.struct([("name", _TEXT), ("ref", _TEXT), _BETWEEN]))),
    ("road_flags", pa.list_(pa.struct([("values", pa.list_(_TEXT)), _BETWEEN]))),
    ("speed_limits", pa.list_(pa.struct([("min_speed", _SPEED), ("max_speed", _SPEED),
                                         ("is_max_speed_variable", pa.bool_()),
                                         ("when", _WHEN), _BETWEEN]))),
    ("access_restrictions", pa.list_(pa.struct([("access_type", _TEXT), ("when", _WHEN),
                                                _BETWEEN]))),
    ("level_rules", pa.list_(pa.struct([("value", pa.int32()), _BETWEEN]))),
    ("width_rules", pa.list_(pa.struct([("value", pa.float64()), _BETWEEN]))),
    ("subclass_rules", pa.list_(pa.struct([("value", _TEXT), _BETWEEN]))),
    ("prohibited_transitions", pa.list_(pa.struct([("sequence", pa.list_(_STEP)),
                                                   ("final_heading", _TEXT), ("when", _WHEN),
                                                   _BETWEEN]))),
])  # fmt: skip


def segment(identity, places, connectors, **rules):
    """One segment.

    Args:
        identity: Its GERS id.
        places: Longitudes and latitudes.
        connectors: Names and shares.
        rules: Further columns.
    """
    return {
        "id": identity, "geometry": shapely.to_wkb(shapely.LineString(places)), "version": 1,
        "subtype": "road", "class": "residential",
        "connectors": [{"connector_id": name, "at": at} for name, at in connectors], **rules,
    }  # fmt: skip


def table(rows):
    return pa.Table.from_pylist(rows, SCHEMA)


def write(rows, path):
    pyarrow.parquet.write_table(table(rows), path)
    return path


def of_osm(path):
    """Segments of the drivable ways of an extract; connectors where ways meet.

    Its own reading of tags: one-ways, access, limits in km/h, levels, bridges and tunnels.
    """
    import osmium
    from pyproj import Geod

    geod = Geod(ellps="WGS84")
    ways, times = [], {}
    classes = {
        *("motorway", "trunk", "primary", "secondary", "tertiary", "unclassified", "residential"),
        *("living_street", "service"),
    }
    for way in osmium.FileProcessor(str(path)).with_locations():
        if not way.is_way():
            continue
        tags = dict(way.tags)
        word = tags.get("highway", "").removesuffix("_link")
        if word not in classes or tags.get("area") == "yes":
            continue
        nodes = [(n.ref, n.lon, n.lat) for n in way.nodes if n.location.valid()]
        if len(nodes) < 2 or len(nodes) < len(way.nodes):
            continue
        ways.append((way.id, word, tags, nodes))
        for n in nodes:
            times[n[0]] = times.get(n[0], 0) + 1
    rows = []
    for number, word, tags, nodes in ways:
        lon, lat = [n[1] for n in nodes], [n[2] for n in nodes]
        steps = geod.inv(lon[:-1], lat[:-1], lon[1:], lat[1:])[2]
        total, at, connectors = sum(steps), 0.0, []
        for k, n in enumerate(nodes):
            if times[n[0]] > 1 or k in (0, len(nodes) - 1):
                connectors.append((f"c{n[0]}", min(at / total, 1.0) if total else 0.0))
            at += steps[k] if k < len(steps) else 0.0
        rows.append(segment(f"w{number}", list(zip(lon, lat, strict=True)), connectors,
                            **_rules(word, tags)))  # fmt: skip
    return rows


def _rules(word, tags):
    access = []
    oneway = tags.get("oneway:motor_vehicle", tags.get("oneway"))
    ring = tags.get("junction") in ("roundabout", "circular")
    motorway = tags["highway"] == "motorway"
    if oneway in ("yes", "1", "true") or (oneway is None and (ring or motorway)):
        access.append({"access_type": "denied", "when": {"heading": "backward"}})
    elif oneway in ("-1", "reverse"):
        access.append({"access_type": "denied", "when": {"heading": "forward"}})
    for key, modes in (("access", None), ("vehicle", ["vehicle"]),
                       ("motor_vehicle", ["motor_vehicle"]), ("motorcar", ["car"])):  # fmt: skip
        value = tags.get(key)
        when = {"mode": modes} if modes else None
        if value in ("no", "private", "agricultural", "forestry", "emergency", "psv", "bus",
                     "military"):  # fmt: skip
            access.append({"access_type": "denied", "when": when})
        elif value in ("destination", "customers", "delivery", "permit", "residents"):
            access.append({"access_type": "denied", "when": when})
            using = {**(when or {}), "using": ["at_destination"]}
            access.append({"access_type": "allowed", "when": using})
        elif value is not None:
            access.append({"access_type": "allowed", "when": when})
    flags = [w for w in ("bridge", "tunnel") if tags.get(w, "no") != "no"]
    if tags["highway"].endswith("_link"):
        flags.append("link")
    rules = {"class": word, "access_restrictions": access or None}
    if flags:
        rules["road_flags"] = [{"values": [f"is_{w}" for w in flags]}]
    if tags.get("maxspeed", "").isdecimal():
        limit = {"value": int(tags["maxspeed"]), "unit": "km/h"}
        rules["speed_limits"] = [{"max_speed": limit}]
    if tags.get("layer", "0") not in ("0", ""):
        rules["level_rules"] = [{"value": int(float(tags["layer"]))}]
    return rules
