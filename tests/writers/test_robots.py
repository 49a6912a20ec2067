"""What receivers, robots and SUMO take: read back by other libraries, and by our own readers."""

import json
import math
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pynmeagps
import pyproj
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from whichroad.errors import WriteError
from whichroad.readers import read_drive
from whichroad.tables import schema
from whichroad.writers import OF_POINTS, check, write_table

START = 1_780_315_200
N = 30


@pytest.fixture
def drive():
    """Points on a bend, an epoch without a position, and an outage."""
    k = np.arange(N)
    rows = {
        "drive_id": ["a"] * N,
        "time": (START + 0.5 * k) * 1_000_000,
        "lat": 49.4 + 1e-5 * k,
        "lon": 8.7 + 2e-5 * k,
        "bearing_deg": (350.0 + 2.0 * k) % 360.0,
        "speed_mps": 10.0 + 0.1 * k,
        "cov_ee_m2": 4.0 + 0.01 * k,
        "cov_en_m2": np.full(N, -1.0),
        "cov_nn_m2": np.full(N, 3.0),
        "sigma_bearing_deg": np.full(N, 2.0),
        "status": ["on_road"] * 20 + ["outage"] * 10,
    }
    table = pa.table({name: pa.array(values) for name, values in rows.items()})
    micros = pa.array(np.asarray(rows["time"]).astype(np.int64)).cast(schema.TIME)
    table = table.set_column(1, "time", micros)
    lost = pa.Table.from_pylist(
        [{"drive_id": "a", "time": (START + 99) * 1_000_000, "status": "lost"}], table.schema
    )
    return pa.concat_tables([table, lost])


@pytest.mark.parametrize("suffix", OF_POINTS)
def test_our_own_reader_reads_what_was_written(drive, tmp_path, suffix):
    path = tmp_path / f"out{suffix}"
    write_table(drive, path)
    fixes = read_drive(path)[0].fixes
    assert len(fixes) == N
    rounded = suffix == ".nmea"
    assert fixes.time == pytest.approx(START + 0.5 * np.arange(N), abs=1e-3)
    for name in ("lat", "lon"):
        assert getattr(fixes, f"{name}_deg") == pytest.approx(drive[name].to_numpy()[:N], abs=2e-8)
    for ours, column in (("cov_ee", "cov_ee_m2"), ("cov_en", "cov_en_m2"), ("cov_nn", "cov_nn_m2")):
        tolerance = 0.01 if rounded else 1e-9
        assert getattr(fixes, ours) == pytest.approx(drive[column].to_numpy()[:N], abs=tolerance)


def test_sentences_are_valid_and_say_where_there_was_no_gnss(drive, tmp_path):
    path = tmp_path / "out.nmea"
    write_table(drive, path)
    with path.open("rb") as stream:
        parsed = [m for _, m in pynmeagps.NMEAReader(stream, validate=1, quitonerror=2)]
    assert [m.msgID for m in parsed] == ["GGA", "RMC", "GST"] * N
    assert [m.quality for m in parsed[::3]] == [1] * 20 + [6] * 10
    speed = [m.spd * 1852 / 3600 for m in parsed[1::3]]
    assert speed == pytest.approx(drive["speed_mps"].to_numpy()[:N], abs=1e-3)
    assert [m.cog for m in parsed[1::3]] == pytest.approx(drive["bearing_deg"].to_numpy()[:N])


@pytest.mark.parametrize("suffix", [".bag", ".db3"])
def test_a_bag_has_poses_in_east_and_north_and_twists_of_the_vehicle(drive, tmp_path, suffix):
    path = tmp_path / f"out{suffix}"
    write_table(drive, path)
    geod = pyproj.Geod(ellps="WGS84")
    lat, lon, bearing = (drive[c].to_numpy()[:N] for c in ("lat", "lon", "bearing_deg"))
    with AnyReader([path]) as bag:
        poses = [bag.deserialize(raw, c.msgtype) for c, _, raw in bag.messages()
                 if c.msgtype.endswith("Odometry")]  # fmt: skip
    assert len(poses) == N
    for k, pose in enumerate(poses):
        azimuth, _, distance = geod.inv(lon[0], lat[0], lon[k], lat[k])
        place = pose.pose.pose.position
        east, north = (distance * f(math.radians(azimuth)) for f in (math.sin, math.cos))
        assert (place.x, place.y) == pytest.approx((east, north), abs=1e-3)
        turned = pose.pose.pose.orientation
        yaw = 2.0 * math.atan2(turned.z, turned.w)
        off = math.degrees(yaw) - (90.0 - bearing[k])
        assert (off + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-3)
        cov = np.array(pose.pose.covariance).reshape(6, 6)
        assert cov[:2, :2].tolist() == [[pytest.approx(4.0 + 0.01 * k), -1.0], [-1.0, 3.0]]
        assert cov[5, 5] == pytest.approx(math.radians(2.0) ** 2)
        assert np.linalg.eigvalsh(cov).min() > 0.0
        assert (pose.header.frame_id, pose.child_frame_id) == ("map", "base_link")
        assert pose.twist.twist.linear.x == pytest.approx(10.0 + 0.1 * k)


def test_mcap_has_the_schemas_of_foxglove_by_name(drive, tmp_path):
    path = tmp_path / "out.mcap"
    write_table(drive, path)
    with path.open("rb") as file:
        found = [(s.name, c.topic, json.loads(m.data)) for s, c, m in
                 make_reader(file, validate_crcs=True).iter_messages()]  # fmt: skip
    names = {(name, topic) for name, topic, _ in found}
    assert names == {
        ("foxglove.LocationFix", "/whichroad/fix"),
        ("foxglove.PoseInFrame", "/whichroad/pose"),
    }
    fix = next(message for name, _, message in found if name == "foxglove.LocationFix")
    assert fix["timestamp"] == {"sec": START, "nsec": 0}
    assert fix["position_covariance_type"] == 3
    assert len(found) == 2 * N


@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
def test_several_drives_have_topics_of_their_own(drive, tmp_path, suffix):
    names = pa.array(["morning 1"] * 10 + ["b"] * 21)
    path = tmp_path / f"out{suffix}"
    write_table(drive.set_column(0, "drive_id", names), path)
    fixes = read_drive(path)[0]
    assert len(fixes.fixes) == 20  # of the drive with more epochs
    assert any("morning_1" in note for note in fixes.notes)


def by_source(*rows):
    names = ("drive_id", "source_id", "forward", "enter_time", "broken_rule")
    table = pa.Table.from_pylist([dict(zip(names, row, strict=True)) for row in rows])
    return table.set_column(3, "enter_time", table["enter_time"].cast(pa.int64()).cast(schema.TIME))


def test_routes_are_the_edges_driven_and_a_gap_begins_a_vehicle(tmp_path):
    path = tmp_path / "out.rou.xml"
    write_table(
        by_source(
            ("a", "e1", True, 5_000_000, None),
            ("a", "e1", True, 6_000_000, None),
            ("a", "e2", False, 7_000_000, None),
            ("a", "e9", True, 20_000_000, "gap"),
            ("b", "x<&>", True, 1_000_000, None),
        ),
        path,
    )
    root = ElementTree.parse(path).getroot()
    assert [(v.get("id"), v.get("depart"), v[0].get("edges")) for v in root] == [
        ("b", "0.00", "x<&>"),
        ("a", "4.00", "e1 -e2"),
        ("a.2", "19.00", "e9"),
    ]


def test_a_path_that_is_not_by_source_is_no_route_and_a_path_has_no_positions(path, tmp_path):
    with pytest.raises(WriteError, match=r"/out\.rou\.xml: .*--by-source"):
        write_table(path, tmp_path / "out.rou.xml")
    for suffix in OF_POINTS:
        with pytest.raises(WriteError, match="no positions with times"):
            write_table(path, tmp_path / f"out{suffix}")
    check(tmp_path / "later.rou.xml")
    with pytest.raises(WriteError, match="names no format"):
        check(tmp_path / "later.xml")
