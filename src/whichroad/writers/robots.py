"""For robots: MCAP with Foxglove's schemas, and bags of ROS 1 and 2 with Odometry and NavSatFix.

Frames are those of REP-103 and REP-105: x east, y north, metres about the drive's first
position in `map`; the vehicle, x ahead, is `base_link`.
"""

import errno
import importlib
import json
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..errors import WriteError
from ..geodesy.angles import heading_of, radians
from ..geodesy.plane import Plane
from ..observations import Array
from .positions import Positions, positions

_UNKNOWN = 1e6  # variance of what is not estimated: height, roll, pitch
_FULL = 3  # covariance type of NavSatFix and LocationFix: all of it is known
_NUMBER, _WORD = {"type": "number"}, {"type": "string"}
_TIME = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}
_VECTOR = {"type": "object", "properties": dict.fromkeys("xyz", _NUMBER)}
_TURN = {"type": "object", "properties": dict.fromkeys("xyzw", _NUMBER)}
_SCHEMAS: dict[str, dict[str, Any]] = {
    "foxglove.LocationFix": {
        "timestamp": _TIME,
        "frame_id": _WORD,
        **dict.fromkeys(("latitude", "longitude", "altitude"), _NUMBER),
        "position_covariance": {"type": "array", "items": _NUMBER},
        "position_covariance_type": {"type": "integer"},
    },
    "foxglove.PoseInFrame": {
        "timestamp": _TIME,
        "frame_id": _WORD,
        "pose": {"type": "object", "properties": {"position": _VECTOR, "orientation": _TURN}},
    },
}


def write_mcap(table: pa.Table, path: Path) -> None:
    """Write points as foxglove.LocationFix and foxglove.PoseInFrame, in JSON.

    Raises:
        WriteError: The table has no positions, or the package mcap is missing.
    """
    drives, writing = list(positions(table, path)), _package("mcap.writer", path)
    with open(path, "wb") as sink:
        writer = writing.Writer(sink)
        writer.start()
        schemas = [
            writer.register_schema(name, "jsonschema", json.dumps(
                {"title": name, "type": "object", "properties": fields}
            ).encode())
            for name, fields in _SCHEMAS.items()
        ]  # fmt: skip
        for drive in drives:
            prefix = _prefix(drive, drives)
            fix, pose = (
                writer.register_channel(f"{prefix}/{name}", "json", schema)
                for name, schema in zip(("fix", "pose"), schemas, strict=True)
            )
            x, y, yaw = _in_map(drive)
            for k in range(len(drive.time)):
                stamp = _stamp(drive, k)
                clock = {"timestamp": {"sec": stamp // 10**9, "nsec": stamp % 10**9}}
                for channel, message in ((fix, _location(drive, k)), (pose, _pose(x, y, yaw, k))):
                    data = json.dumps(clock | message).encode()
                    writer.add_message(channel, stamp, data, stamp)
        writer.finish()


def write_bag(table: pa.Table, path: Path) -> None:
    """Write points as a bag of ROS 1: nav_msgs/Odometry and sensor_msgs/NavSatFix.

    Raises:
        WriteError: The table has no positions, or the package rosbags is missing.
    """
    drives = list(positions(table, path))
    bags, types = _package("rosbags.rosbag1", path), _package("rosbags.typesys", path)
    store = types.get_typestore(types.Stores.ROS1_NOETIC)
    path.unlink(missing_ok=True)  # the package makes new files alone
    with bags.Writer(path) as writer:
        _write_messages(writer, store, store.serialize_ros1, drives)


def write_ros2(table: pa.Table, path: Path) -> None:
    """Write points as the SQLite file of a bag of ROS 2, with the same messages.

    Raises:
        WriteError: The table has no positions, or the package rosbags is missing.
        OSError: The disk is full, or SQLite refuses.
    """
    import sqlite3

    drives = list(positions(table, path))
    bags, types = _package("rosbags.rosbag2", path), _package("rosbags.typesys", path)
    store = types.get_typestore(types.Stores.ROS2_HUMBLE)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        bag = Path(folder) / "bag"
        try:
            with bags.Writer(bag, version=8) as writer:
                _write_messages(writer, store, store.serialize_cdr, drives)
        except sqlite3.OperationalError as error:
            code = errno.ENOSPC if "full" in str(error) else errno.EIO
            raise OSError(code, str(error)) from None
        (file,) = bag.glob("*.db3")
        file.replace(path)


def _write_messages(
    writer: Any, store: Any, serialize: Callable[[Any, str], Any], drives: list[Positions]
) -> None:
    """Two topics for each drive: its poses, and its positions on the globe."""
    for drive in drives:
        make = _Messages(store, drive)
        built = {"odometry": ("nav_msgs/msg/Odometry", make.odometry),
                 "fix": ("sensor_msgs/msg/NavSatFix", make.fix)}  # fmt: skip
        for name, (kind, build) in built.items():
            topic = f"{_prefix(drive, drives)}/{name}"
            connection = writer.add_connection(topic, kind, typestore=store)
            for k in range(len(drive.time)):
                stamp = _stamp(drive, k)
                writer.write(connection, stamp, serialize(build(k, stamp), kind))


def _package(name: str, path: Path) -> Any:
    """A module of a package that only these formats need."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise WriteError(
            f"{path}: the package {name.partition('.')[0]} is needed to write it; it or another "
            'format was expected; pip install "whichroad[ros]"'
        ) from None


def _prefix(drive: Positions, drives: list[Positions]) -> str:
    """What topics of a drive begin with; names of drives hold what topics may not."""
    if len(drives) == 1:
        return "/whichroad"
    return "/whichroad/" + "".join(
        c if c.isalnum() and c.isascii() else "_" for c in drive.drive_id
    )


def _stamp(drive: Positions, k: int) -> int:
    """Nanoseconds since 1970, of whole microseconds."""
    return round(float(drive.time[k]) * 1e6) * 1000


def _in_map(drive: Positions) -> tuple[Array, Array, Array]:
    """East, north (m) about the first position, and yaw counter-clockwise from east (rad)."""
    plane = Plane(float(drive.lat[0]), float(drive.lon[0]))
    x, y = plane.from_geodetic(drive.lat, drive.lon)
    bearing = np.where(np.isfinite(drive.bearing_deg), drive.bearing_deg, 90.0)
    return x, y, heading_of(bearing, plane.convergence(x, y))


def _covariance(drive: Positions, k: int) -> list[float] | None:
    """East, north, up, row by row, m²; None: it is not known."""
    ee, en, nn = (float(c[k]) for c in (drive.cov_ee, drive.cov_en, drive.cov_nn))
    if not (math.isfinite(ee) and math.isfinite(en) and math.isfinite(nn)):
        return None
    return [ee, en, 0.0, en, nn, 0.0, 0.0, 0.0, _UNKNOWN]


def _location(drive: Positions, k: int) -> dict[str, Any]:
    cov = _covariance(drive, k)
    return {
        "frame_id": "base_link",
        "latitude": float(drive.lat[k]),
        "longitude": float(drive.lon[k]),
        "altitude": 0.0,
        "position_covariance": cov or [0.0] * 9,
        "position_covariance_type": _FULL if cov else 0,
    }


def _pose(x: Array, y: Array, yaw: Array, k: int) -> dict[str, Any]:
    half = 0.5 * float(yaw[k])
    place = {"x": float(x[k]), "y": float(y[k]), "z": 0.0}
    turned = {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)}
    return {"frame_id": "map", "pose": {"position": place, "orientation": turned}}


class _Messages:
    """Builds ROS's messages of a drive."""

    def __init__(self, store: Any, drive: Positions) -> None:
        self._types, self._drive = store.types, drive
        self._x, self._y, self._yaw = _in_map(drive)

    def _header(self, stamp: int, frame: str) -> Any:
        time = self._types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
        kind = self._types["std_msgs/msg/Header"]
        more = {"seq": 0} if "seq" in kind.__dataclass_fields__ else {}  # ROS 1 numbers them
        return kind(**more, stamp=time, frame_id=frame)

    def fix(self, k: int, stamp: int) -> Any:
        """A NavSatFix."""
        cov = _covariance(self._drive, k)
        return self._types["sensor_msgs/msg/NavSatFix"](
            header=self._header(stamp, "base_link"),
            status=self._types["sensor_msgs/msg/NavSatStatus"](status=0, service=1),
            latitude=float(self._drive.lat[k]),
            longitude=float(self._drive.lon[k]),
            altitude=0.0,
            position_covariance=np.array(cov or [0.0] * 9),
            position_covariance_type=_FULL if cov else 0,
        )

    def odometry(self, k: int, stamp: int) -> Any:
        """An Odometry, its pose in `map`, its twist in `base_link`."""
        t, d = self._types, self._drive
        vector, half = t["geometry_msgs/msg/Vector3"], 0.5 * float(self._yaw[k])
        point = t["geometry_msgs/msg/Point"](float(self._x[k]), float(self._y[k]), 0.0)
        turned = t["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(half), math.cos(half))
        cov, twist_cov = np.diag([_UNKNOWN] * 6), np.diag([_UNKNOWN] * 6)
        known, sigma = _covariance(d, k), radians(float(d.sigma_bearing_deg[k]))
        if known:
            cov[:2, :2] = np.array(known).reshape(3, 3)[:2, :2]
        if math.isfinite(sigma):
            cov[5, 5] = sigma**2
        speed = float(d.speed[k]) if math.isfinite(d.speed[k]) else 0.0
        twist = t["geometry_msgs/msg/Twist"](vector(speed, 0.0, 0.0), vector(0.0, 0.0, 0.0))
        pose = t["geometry_msgs/msg/Pose"](point, turned)
        return t["nav_msgs/msg/Odometry"](
            header=self._header(stamp, "map"),
            child_frame_id="base_link",
            pose=t["geometry_msgs/msg/PoseWithCovariance"](pose, cov.ravel()),
            twist=t["geometry_msgs/msg/TwistWithCovariance"](twist, twist_cov.ravel()),
        )
