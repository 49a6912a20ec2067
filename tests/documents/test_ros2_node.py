"""The example of a node: its messages are ROS 2's, built by rosbags; rclpy itself is not here."""

import importlib.util
import json
import math
from pathlib import Path

import numpy as np
import pyproj
import pytest
from rosbags.typesys import Stores, get_typestore

from whichroad import GeoFix, Localizer, simulate_drive

NODE = Path(__file__).parents[2] / "docs" / "ros2_node.py"
STORE = get_typestore(Stores.ROS2_HUMBLE)


def message(kind, **given):
    """A message of ROS 2, empty but for what is given."""
    made = STORE.types[f"{kind.split('/')[0]}/msg/{kind.split('/')[1]}"]
    values = {}
    for name, (_, what) in STORE.get_msgdef(made.__msgtype__).fields:
        values[name] = given[name] if name in given else empty(what, name)
    return made(**values)


def empty(what, name):
    if isinstance(what, str):  # the name of another message
        package, _, kind = what.split("/")
        return message(f"{package}/{kind}")
    if isinstance(what, tuple) and isinstance(what[0], str):
        return "" if what[0] == "string" else 0.0 if what[0].startswith("float") else 0
    return np.zeros(36 if name == "covariance" else 9)


@pytest.fixture(scope="module")
def roads(town):
    return town


@pytest.fixture(scope="module")
def fixes(roads):
    return simulate_drive(roads, seed=3, length_m=900.0).drive.fixes


def the_node():
    spec = importlib.util.spec_from_file_location("ros2_node", NODE)
    node = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(node)
    return node


def a_fix(fixes, k):
    cov = np.zeros(9)
    cov[[0, 1, 3, 4]] = fixes.cov_ee[k], fixes.cov_en[k], fixes.cov_en[k], fixes.cov_nn[k]
    fix = message(
        "sensor_msgs/NavSatFix", latitude=fixes.lat_deg[k], longitude=fixes.lon_deg[k],
        position_covariance=cov, position_covariance_type=3,
    )  # fmt: skip
    fix.header.stamp.sec = int(fixes.time[k])
    return fix, cov


def test_the_node_knows_the_car_and_where_its_frame_begins(roads, fixes, tmp_path):
    file = tmp_path / "vehicle.toml"
    file.write_text("[antenna]\nforward_m = 2.0\n", "utf-8")
    node = the_node()
    with_car = node.Matcher(roads, lambda: message("nav_msgs/Odometry"), str(file))
    without = node.Matcher(roads, lambda: message("nav_msgs/Odometry"))
    assert with_car.origin is None
    for k in range(40):
        _, road = with_car.fix(a_fix(fixes, k)[0])
        without.fix(a_fix(fixes, k)[0])
    mine, other = (one._localizer.estimate().pose for one in (with_car, without))
    assert math.hypot(mine.x - other.x, mine.y - other.y) == pytest.approx(2.0, abs=0.7)
    assert isinstance(json.loads(road)["source_id"], str)
    told = message("sensor_msgs/NavSatFix")
    told = node.origin_of(with_car.origin, told, told.header.stamp)
    STORE.serialize_cdr(told, told.__msgtype__)
    assert told.latitude == pytest.approx(fixes.lat_deg[0], abs=3e-4)
    assert told.longitude == pytest.approx(fixes.lon_deg[0], abs=3e-4)


def test_the_node_turns_fixes_into_odometry_of_east_and_north(roads, fixes):
    node = the_node()
    matcher = node.Matcher(roads, lambda: message("nav_msgs/Odometry"))
    beside, geod, first = Localizer(roads), pyproj.Geod(ellps="WGS84"), None
    for k in range(40):
        fix, cov = a_fix(fixes, k)
        odometry, road = matcher.fix(fix)
        STORE.serialize_cdr(odometry, odometry.__msgtype__)
        own = GeoFix(float(int(fixes.time[k])), fixes.lat_deg[k], fixes.lon_deg[k],
                     *cov[[0, 1, 4]])  # fmt: skip
        pose = beside.update(own).pose
        first = first or (pose.lon, pose.lat)
        azimuth, _, away = geod.inv(*first, pose.lon, pose.lat)
        east, north = away * math.sin(math.radians(azimuth)), away * math.cos(math.radians(azimuth))
        place, turned = odometry.pose.pose.position, odometry.pose.pose.orientation
        assert (place.x, place.y) == pytest.approx((east, north), abs=2e-2)
        off = 90.0 - math.degrees(2.0 * math.atan2(turned.z, turned.w)) - pose.bearing_deg
        assert math.cos(math.radians(off)) == pytest.approx(1.0, abs=1e-6)
        assert np.linalg.eigvalsh(odometry.pose.covariance.reshape(6, 6)).min() > 0.0
        assert 0.0 <= json.loads(road)["p_road"] <= 1.0
    assert json.loads(road)["source_id"] is not None
    lost = message("sensor_msgs/NavSatFix")
    lost.status.status = -1
    assert matcher.fix(lost) is None
