"""Bags of ROS 1 and 2, and MCAP, written by rosbags and mcap: records are what was written."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from whichroad.errors import ReadError
from whichroad.observations import ASSUMED, Odometer, SpeedYawRate
from whichroad.readers import read_drive
from whichroad.settings import Settings

START = 1_780_315_200.0
KINDS = ("bag", "db3", "folder", "mcap")


class Bag:
    """Collects messages, and writes them as a bag of any kind."""

    def __init__(self, folder):
        self.folder, self.messages = folder, []

    def add(self, topic, kind, time, **fields):
        """Keep a message of a kind at a time after the start."""
        self.messages.append((topic, kind, START + time, fields))

    def write(self, kind):
        """The path of the bag."""
        one = kind == "bag"
        store = get_typestore(Stores.ROS1_NOETIC if one else Stores.ROS2_HUMBLE)
        path = self.folder / ("drive.bag" if one else f"drive_{kind}")
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer1(path) if one else Writer2(path, version=9, storage_plugin=plugin)
        with writer:
            topics = {}
            for topic, name, time, fields in self.messages:
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, name, typestore=store)
                message = built(store, name, time, fields, one)
                stamp = round(time * 1e9)
                raw = (store.serialize_ros1 if one else store.serialize_cdr)(message, name)
                writer.write(topics[topic], stamp, bytes(raw))
        if kind in ("db3", "mcap"):
            return next(path.glob(f"*.{kind}"))
        return path


def built(store, name, time, fields, seq):
    """A message with a header and some fields; the rest is zero."""
    t = store.types
    stamp = t["builtin_interfaces/msg/Time"](int(time), round(time % 1 * 1e9))
    header = t["std_msgs/msg/Header"](*([0] if seq else []), stamp, "gps")
    vector = t["geometry_msgs/msg/Vector3"]
    still = vector(0.0, 0.0, 0.0)
    kind = name.rpartition("/")[2]
    if kind == "NavSatFix":
        status = t["sensor_msgs/msg/NavSatStatus"](fields.get("status", 0), 1)
        cov = np.array(fields.get("cov", [0.0] * 9), float)
        return t[name](header, status, fields["lat"], fields["lon"], 50.0, cov,
                       fields.get("cov_kind", 2))  # fmt: skip
    if kind == "Imu":
        none, turned = np.zeros(9), t["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        return t[name](header, turned, none, vector(0.0, 0.0, fields["turn"]), none, still, none)
    linear = vector(fields["x"], fields.get("y", 0.0), 0.0)
    twist = t["geometry_msgs/msg/Twist"](linear, vector(0.0, 0.0, fields.get("turn", 0.0)))
    if kind == "TwistStamped":
        return t[name](header, twist)
    full = t["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
    if kind == "TwistWithCovarianceStamped":
        return t[name](header, full)
    pose = t["geometry_msgs/msg/Pose"](
        t["geometry_msgs/msg/Point"](0.0, 0.0, 0.0),
        t["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
    )
    with_cov = t["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
    return t[name](header, "base_link", with_cov, full)


COV = [4.0, 0.5, 0.0, 0.5, 3.0, 0.0, 0.0, 0.0, 9.0]


@pytest.fixture
def bag(tmp_path):
    return Bag(tmp_path)


def with_fixes(bag, n=20):
    for k in range(n):
        bag.add("/gps/fix", "sensor_msgs/msg/NavSatFix", k, lat=49.4 + 1e-4 * k, lon=8.7, cov=COV)


@pytest.mark.parametrize("kind", KINDS)
def test_fixes_and_odometry_are_what_was_written(bag, kind, sound):
    with_fixes(bag)
    for k in range(200):
        bag.add("/odom", "nav_msgs/msg/Odometry", 0.1 * k, x=10.0 + 0.01 * k, turn=0.001 * k)
    (drive,) = read_drive(bag.write(kind))
    sound(drive)
    fixes, log = drive.fixes, drive.odometry
    assert fixes.time == pytest.approx(START + np.arange(20.0), abs=1e-6)
    assert fixes.lat_deg == pytest.approx(49.4 + 1e-4 * np.arange(20))
    assert fixes.lon_deg == pytest.approx(np.full(20, 8.7))
    for name, value in (("ee", 4.0), ("en", 0.5), ("nn", 3.0)):
        assert (getattr(fixes, f"cov_{name}") == value).all()
    assert isinstance(log, SpeedYawRate)
    assert log.speed == pytest.approx(10.0 + 0.01 * np.arange(200))
    assert log.yaw_rate == pytest.approx(0.001 * np.arange(200))
    assert not drive.skipped


def test_messages_without_a_fix_are_counted_and_unknown_covariances_assumed(bag):
    with_fixes(bag, 3)
    bag.add("/gps/fix", "sensor_msgs/msg/NavSatFix", 3, lat=0.0, lon=0.0, status=-1)
    bag.add("/gps/fix", "sensor_msgs/msg/NavSatFix", 4, lat=49.5, lon=8.7, cov_kind=0)
    (drive,) = read_drive(bag.write("bag"))
    assert len(drive.fixes) == 4
    assert drive.fixes.flags.tolist() == [0, 0, 0, ASSUMED]
    assert drive.skipped == {"message without a fix": 1}


def test_the_status_of_a_fix_decides_where_its_covariance_is_unknown(bag):
    for k, status in enumerate((0, 1, 2)):
        bag.add("/gps/fix", "sensor_msgs/msg/NavSatFix", k, lat=49.4, lon=8.7, cov_kind=0,
                status=status)  # fmt: skip
    (drive,) = read_drive(bag.write("bag"))
    usual = Settings().default_sigma_m
    assert np.sqrt(drive.fixes.cov_ee) == pytest.approx([usual, usual, 0.1 * usual])


def test_a_twist_of_the_vehicle_takes_its_turns_from_the_imu(bag):
    with_fixes(bag)
    for k in range(190):
        bag.add("/vehicle/twist", "geometry_msgs/msg/TwistStamped", 0.1 * k, x=8.0)
        bag.add("/imu", "sensor_msgs/msg/Imu", 0.1 * k + 0.02, turn=0.2)
    (drive,) = read_drive(bag.write("mcap"))
    assert isinstance(drive.odometry, SpeedYawRate)
    assert drive.odometry.yaw_rate == pytest.approx(np.full(190, 0.2))
    assert any("Imu" in note for note in drive.notes)


def test_a_twist_that_points_aside_is_the_receivers_velocity(bag):
    with_fixes(bag)
    for k in range(20):
        bag.add("/gps/vel", "geometry_msgs/msg/TwistWithCovarianceStamped", k, x=3.0, y=4.0)
    (drive,) = read_drive(bag.write("bag"))
    assert drive.odometry is None
    assert drive.fixes.speed == pytest.approx(np.full(20, 5.0))
    assert drive.fixes.bearing_deg == pytest.approx(np.full(20, np.degrees(np.arctan2(3, 4))))


def test_a_speed_without_turns_is_a_distance(bag):
    with_fixes(bag)
    for k in range(190):
        bag.add("/vehicle/twist", "geometry_msgs/msg/TwistStamped", 0.1 * k, x=8.0)
    (drive,) = read_drive(bag.write("bag"))
    assert isinstance(drive.odometry, Odometer)
    assert drive.odometry.distance[-1] == pytest.approx(8.0 * 18.9)


def test_of_two_receivers_the_one_with_most_fixes_is_used_and_the_other_named(bag):
    with_fixes(bag)
    for k in range(5):
        bag.add("/other", "sensor_msgs/msg/NavSatFix", k, lat=10.0, lon=10.0)
    (drive,) = read_drive(bag.write("db3"))
    assert len(drive.fixes) == 20
    assert any("/gps/fix used, /other left out" in note for note in drive.notes)


def test_locations_of_foxglove_are_read_from_mcap(tmp_path):
    path = tmp_path / "fox.mcap"
    with path.open("wb") as sink:
        writer = McapWriter(sink)
        writer.start()
        schema = writer.register_schema("foxglove.LocationFix", "jsonschema", b"{}")
        channel = writer.register_channel("/fix", "json", schema)
        for k in range(5):
            fix = {"timestamp": {"sec": int(START) + k, "nsec": 5 * 10**8}, "latitude": 49.4,
                   "longitude": 8.7 + 1e-4 * k, "position_covariance": COV,
                   "position_covariance_type": 3}  # fmt: skip
            writer.add_message(channel, 10**9 * k, json.dumps(fix).encode(), 10**9 * k)
        writer.finish()
    fixes = read_drive(path)[0].fixes
    assert fixes.time == pytest.approx(START + 0.5 + np.arange(5.0))
    assert fixes.lon_deg == pytest.approx(8.7 + 1e-4 * np.arange(5))
    assert (fixes.cov_en == 0.5).all()


def test_a_bag_of_other_topics_is_refused_with_what_it_holds(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    path = tmp_path / "x.bag"
    with Writer1(path) as writer:
        topic = writer.add_connection("/x", "geometry_msgs/msg/Vector3", typestore=store)
        vector = store.types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        raw = store.serialize_ros1(vector, "geometry_msgs/msg/Vector3")
        writer.write(topic, 1, bytes(raw))
    with pytest.raises(ReadError, match=r"no NavSatFix, .*geometry_msgs/msg/Vector3: 1"):
        read_drive(path)


@pytest.mark.parametrize("name", ["x.bag", "x.mcap", "x.db3"])
@pytest.mark.parametrize(
    "content", [b"", b"#ROSBAG V2.0\n", bytes(200), b"\x89MCAP0\r\n" + bytes(9)]
)
def test_what_is_no_bag_is_refused(put, name, content):
    with pytest.raises(ReadError):
        read_drive(put(name, content))


def test_without_rosbags_the_remedy_is_named(bag, monkeypatch):
    with_fixes(bag)
    path = bag.write("bag")
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    with pytest.raises(ReadError, match=r'pip install "whichroad\[ros\]"'):
        read_drive(path)


def test_damaged_bags_give_records_or_a_read_error(bag, tmp_path):
    with_fixes(bag)
    rng = np.random.default_rng(1)
    seen = SimpleNamespace(read=0, refused=0)
    for kind in ("bag", "mcap"):
        data = bag.write(kind).read_bytes()
        for _ in range(60):
            bad = np.frombuffer(data, np.uint8).copy()
            for at in rng.integers(0, len(bad), 4):
                bad[at] ^= 1 << int(rng.integers(0, 8))
            path = tmp_path / f"bad.{kind}"
            path.write_bytes(bad.tobytes()[: int(rng.integers(len(bad) // 2, len(bad) + 1))])
            try:
                read_drive(path)
                seen.read += 1
            except ReadError:
                seen.refused += 1
    assert seen.refused > 30
