"""ROS 1 and ROS 2 bags and MCAP: fixes with covariance, odometry, twists and yaw rates.

`rosbags` reads messages of ROS, `mcap` those that Foxglove's JSON schemas describe.
"""

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ReadError
from ..geodesy.angles import course_of
from ..observations import Array, Drive, Fixes, OdometryLog
from ..wording import by_reason
from .checks import NO_TIME, Skipped, keep
from .drive_columns import nearby, odometer_from_speed, speed_yaw_rate
from .fix_quality import DIFFERENTIAL, FLOAT, SINGLE
from .reading import Reading
from .reported_fixes import Reported, make_fixes

SUFFIXES = (".bag", ".mcap", ".db3")
_METADATA = "metadata.yaml"  # of a folder that is a bag of ROS 2
_FIX, _ODOMETRY, _IMU = "NavSatFix", "Odometry", "Imu"
_TWISTS = ("TwistStamped", "TwistWithCovarianceStamped")
_WANTED = (_FIX, _ODOMETRY, _IMU, *_TWISTS)
_LOCATION = "foxglove.LocationFix"
_KNOWN_COVARIANCE = 1  # of NavSatFix: approximated, diagonal or full from here on
# By NavSatFix's status: single, satellite- and ground-based corrections; the last are fixed or
# float, which no status tells.
_QUALITIES = {0: SINGLE, 1: DIFFERENTIAL, 2: FLOAT}
_ASIDE = 0.5  # m/s across, from which a twist is in east and north and not in the vehicle
_NO_FIX = "message without a fix"


@dataclass(slots=True)
class _Topic:
    """Messages of one topic, as rows of numbers."""

    kind: str
    rows: list[tuple[float, ...]] = field(default_factory=list)


def is_bag(path: Path) -> bool:
    """Whether a file or a folder is a bag, by its name."""
    named = path.suffix.lower() in SUFFIXES and path.is_file()
    return named or (path.is_dir() and (path / _METADATA).is_file())


def read_bag(path: Path, reading: Reading) -> list[Drive]:
    """Read a bag of ROS 1 (.bag), of ROS 2 (a folder, .mcap, .db3) or Foxglove's MCAP.

    Args:
        path: The file or folder.
        reading: Gives the sigma of fixes that report none.

    Raises:
        ReadError: It is none, holds no message that is understood, or rosbags is missing.
    """
    topics: dict[str, _Topic] = {}
    skipped: Skipped = Counter()
    seen: Counter[str] = Counter()
    try:
        messages = _of_json(path, seen) if _is_json(path) else _of_ros(path, seen)
        for topic, kind, row in messages:
            if row is None:
                skipped[_NO_FIX] += 1
            else:
                topics.setdefault(topic, _Topic(kind)).rows.append(row)
    except ImportError as error:
        raise ReadError(
            f"{path.name}: a bag; the package {str(error.name).partition('.')[0]} is needed to "
            'read it; pip install "whichroad[ros]"'
        ) from None
    except Exception as error:  # rosbags lets out whatever its parsers meet
        reason = (str(error).splitlines() or [""])[0]
        raise ReadError(
            f"{path.name}: it cannot be read ({type(error).__name__}: {reason}); a bag of ROS 1 or "
            "ROS 2, or an MCAP, was expected; is it damaged?"
        ) from None
    if not topics:
        found = by_reason(seen.most_common(8)) or "no message"
        raise ReadError(
            f"{path.name}: no {', '.join(_WANTED)} in it ({found}); one of them was expected; "
            "record such a topic"
        )
    notes: list[str] = []
    twists, aside = _twists(topics, notes)
    fixes = _fixes(_best(topics, (_FIX,), notes), aside, reading, skipped)
    odometry = _odometry(topics, twists, skipped, notes)
    return [Drive(path.stem, fixes, odometry, (str(path),), dict(skipped), tuple(notes))]


def _of_ros(path: Path, seen: Counter[str]) -> Iterator[tuple[str, str, Any]]:
    """Topic, kind and row of each message of ROS."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([path], default_typestore=store) as reader:
        for one in reader.connections:
            seen[one.msgtype] += one.msgcount
        wanted = [c for c in reader.connections if c.msgtype.rpartition("/")[2] in _WANTED]
        if not wanted:  # the package takes none as all
            return
        for connection, logged, raw in reader.messages(connections=wanted):
            message = reader.deserialize(raw, connection.msgtype)
            kind = connection.msgtype.rpartition("/")[2]
            yield connection.topic, kind, _row(kind, message, 1e-9 * logged)


def _row(kind: str, message: Any, logged: float) -> tuple[float, ...] | None:
    """Time and numbers of a message; None: it has no fix."""
    stamp = message.header.stamp
    time = stamp.sec + 1e-9 * stamp.nanosec
    time = time if time > 0.0 else logged
    if kind == _FIX:
        if message.status.status < 0:
            return None
        cov = message.position_covariance
        known = message.position_covariance_type >= _KNOWN_COVARIANCE
        ee, en, nn = (float(cov[k]) for k in (0, 1, 4)) if known else (np.nan,) * 3
        return time, message.latitude, message.longitude, ee, en, nn, message.status.status
    if kind == _IMU:
        return time, message.angular_velocity.z
    twist = message.twist
    twist = twist.twist if hasattr(twist, "twist") else twist
    return time, twist.linear.x, twist.linear.y, twist.angular.z


def _is_json(path: Path) -> bool:
    """Whether an MCAP holds JSON."""
    if path.suffix.lower() != ".mcap":
        return False
    from mcap.reader import make_reader

    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        if summary is None:
            return False
        return any(c.message_encoding == "json" for c in summary.channels.values())


def _of_json(path: Path, seen: Counter[str]) -> Iterator[tuple[str, str, Any]]:
    """Topic, kind and row of each of Foxglove's LocationFix."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            name = schema.name if schema is not None else "messages without a schema"
            seen[name] += 1
            if name == _LOCATION and channel.message_encoding == "json":
                yield channel.topic, _FIX, _location(json.loads(message.data), message.log_time)


def _location(fix: dict[str, Any], logged: int) -> tuple[float, ...] | None:
    """Time and numbers of a LocationFix; None: it has no place."""
    stamp = fix.get("timestamp") or {}
    time = float(stamp.get("sec", 0)) + 1e-9 * float(stamp.get("nsec", 0))
    cov = fix.get("position_covariance") or ()
    known = len(cov) == 9 and fix.get("position_covariance_type", 0) >= _KNOWN_COVARIANCE
    ee, en, nn = (float(cov[k]) for k in (0, 1, 4)) if known else (np.nan,) * 3
    lat, lon = fix.get("latitude"), fix.get("longitude")
    if lat is None or lon is None:
        return None
    return time if time > 0.0 else 1e-9 * logged, float(lat), float(lon), ee, en, nn, np.nan


def _columns(topic: _Topic) -> Array:
    """Its numbers, (fields, n)."""
    return np.array(topic.rows, np.float64).T


def _best(topics: dict[str, _Topic], kinds: tuple[str, ...], notes: list[str]) -> Array | None:
    """The numbers of the topic with most messages of some kinds; others are noted."""
    names = [name for name, topic in topics.items() if topic.kind in kinds]
    if not names:
        return None
    best = max(names, key=lambda name: len(topics[name].rows))
    others = ", ".join(sorted(set(names) - {best}))
    if others:
        notes.append(f"topic {best} used, {others} left out: one of a kind is used at a time")
    return _columns(topics[best])


def _twists(topics: dict[str, _Topic], notes: list[str]) -> tuple[Array | None, Array | None]:
    """Twists of the vehicle, and those that are velocities east and north."""
    twists = _best(topics, _TWISTS, notes)
    if twists is None:
        return None, None
    if np.nanmax(np.abs(twists[2]), initial=0.0) > _ASIDE:
        notes.append("twists are taken as velocities east and north: they point aside")
        return None, twists
    return twists, None


def _fixes(
    rows: Array | None, velocity: Array | None, reading: Reading, skipped: Skipped
) -> Fixes | None:
    """Fixes, with the velocities beside them."""
    if rows is None:
        return None
    rows = rows[:, keep(np.isfinite(rows[0]), NO_TIME, skipped)]
    speed = course = None
    if velocity is not None:
        east, north = (nearby(rows[0], velocity[0], velocity[k]) for k in (1, 2))
        speed, course = np.hypot(east, north), course_of(east, north)
    ee, en, nn, status = rows[3:7]
    quality = np.select([status == k for k in _QUALITIES], list(_QUALITIES.values()), np.nan)
    reported = Reported(
        rows[0], rows[1], rows[2], ee, np.where(np.isnan(en), 0.0, en), nn,
        quality=quality, speed=speed, bearing_deg=course,
    )  # fmt: skip
    return make_fixes(reported, reading.settings, skipped)


def _odometry(
    topics: dict[str, _Topic], twists: Array | None, skipped: Skipped, notes: list[str]
) -> OdometryLog | None:
    """Speed and yaw rate: of Odometry, else of the vehicle's twists, with the gyro's turns."""
    moving = _best(topics, (_ODOMETRY,), notes)
    moving = twists if moving is None else moving
    gyro = _best(topics, (_IMU,), notes)
    if moving is None:
        if gyro is not None:
            notes.append("yaw rate not used: a speed beside it was expected")
        return None
    time, speed, _, turn = moving
    if not np.any(turn) and gyro is not None:
        notes.append("turns are those of the Imu: the twists have none")
        turn = nearby(time, gyro[0], gyro[1])
    elif not np.any(turn):
        notes.append("distance integrated from speed: nothing turns")
        return odometer_from_speed(time, speed, skipped)
    return speed_yaw_rate(time, speed, turn, skipped)
