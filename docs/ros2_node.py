"""A node of ROS 2: NavSatFix and wheel Odometry in, the matched pose as Odometry out.

    python ros2_node.py city.map [vehicle.toml] --ros-args -r fix:=/gnss/fix -r wheels:=/car/odom

vehicle.toml says where the antenna is, of which the fixes are, and scales the wheels.  Frames are
those of REP-103 and REP-105: the pose is in `map`, x east and y north of the first position, the
vehicle is `base_link`, the middle of the rear axle.  `origin` says once, to whoever comes later
too, where `map` has its origin (WGS 84).  `road` says the edge, its source's id and its P as JSON.
rclpy comes with ROS 2, from no package index; all else is whichroad.
"""

import json
import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

import whichroad

UNKNOWN = 1e6  # variance of height, roll and pitch
AXES = [0, 1, 5]  # x, y, yaw in a covariance of 6 x 6
NO_FIX = 0  # NavSatStatus below which a message is no fix
FIRST_KNOWN = 1  # covariance type of NavSatFix from which on there is one


class Matcher:
    """Turns messages into observations, and estimates into messages.

    Args:
        roads: The map.
        new: Makes an empty message: `nav_msgs.msg.Odometry`.
        vehicle: Path of the car's vehicle.toml; None: antenna above the rear axle.
    """

    def __init__(
        self, roads: whichroad.RoadMap, new: Callable[[], Any], vehicle: str | None = None
    ) -> None:
        self._localizer = whichroad.Localizer(roads, vehicle=vehicle)
        self._roads, self._new = roads, new
        self.origin: Any = None  # of `map`: the first `whichroad.Pose`

    def fix(self, message: Any) -> tuple[Any, str] | None:
        """Odometry and the road's JSON after a NavSatFix; None: it is no fix."""
        if message.status.status < NO_FIX:
            return None
        cov = [float(message.position_covariance[k]) for k in (0, 1, 4)]
        if message.position_covariance_type < FIRST_KNOWN:
            cov = [math.inf, 0.0, math.inf]
        place = float(message.latitude), float(message.longitude)
        return self._after(whichroad.GeoFix(seconds(message), *place, *cov))

    def wheels(self, message: Any) -> tuple[Any, str] | None:
        """The same after an Odometry of the wheels; None: nothing is known yet."""
        twist = message.twist.twist
        speed, yaw_rate = float(twist.linear.x), float(twist.angular.z)
        return self._after(whichroad.SpeedYaw(seconds(message), speed, yaw_rate))

    def _after(self, observation: Any) -> tuple[Any, str] | None:
        estimate = self._localizer.update(observation)
        if estimate.pose is None:
            return None
        road = {"edge": estimate.edge, "p_road": estimate.p_road, "status": estimate.status,
                "p_off_road": estimate.p_off_road}  # fmt: skip
        if estimate.edge is not None:
            source = self._roads.source(estimate.edge, estimate.abscissa)[0]
            road["source_id"] = str(source)  # ids of OSM and of tables alike
        return self._odometry(estimate), json.dumps(road)

    def _odometry(self, estimate: Any) -> Any:
        pose, plane = estimate.pose, self._roads.plane
        if self.origin is None:
            self.origin = pose
        turn = plane.convergence(self.origin.x, self.origin.y)
        c, s = math.cos(turn), math.sin(turn)
        to_east = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # from the map's plane
        away = (pose.x - self.origin.x, pose.y - self.origin.y, pose.heading - turn)
        x, y, yaw = to_east @ away
        cov = np.diag([UNKNOWN] * 6)
        cov[np.ix_(AXES, AXES)] = to_east @ estimate.cov @ to_east.T
        message = self._new()
        nanos = round(estimate.time * 1e6) * 1000
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanos, 10**9)
        message.header.frame_id, message.child_frame_id = "map", "base_link"
        message.pose.pose.position.x, message.pose.pose.position.y = float(x), float(y)
        message.pose.pose.orientation.z = math.sin(0.5 * yaw)
        message.pose.pose.orientation.w = math.cos(0.5 * yaw)
        message.pose.covariance = cov.ravel()
        message.twist.twist.linear.x = float(estimate.speed)
        message.twist.covariance = np.diag([UNKNOWN] * 6).ravel()
        return message


def seconds(message: Any) -> float:
    """Time of a message, s since 1970."""
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def origin_of(pose: Any, message: Any, stamp: Any) -> Any:
    """Where `map` has its origin, as a NavSatFix."""
    message.header.frame_id, message.header.stamp = "map", stamp
    message.latitude, message.longitude, message.altitude = pose.lat, pose.lon, math.nan
    return message


def main() -> None:
    """Run the node."""
    import rclpy
    import rclpy.utilities
    from nav_msgs.msg import Odometry
    from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
    from sensor_msgs.msg import NavSatFix
    from std_msgs.msg import String

    rclpy.init()
    node = rclpy.create_node("whichroad")
    paths = rclpy.utilities.remove_ros_args(sys.argv)[1:]
    matcher = Matcher(whichroad.RoadMap.open(paths[0]), Odometry, *paths[1:2])
    pose, road = (
        node.create_publisher(Odometry, "odometry", 10),
        node.create_publisher(String, "road", 10),
    )
    kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    origin = node.create_publisher(NavSatFix, "origin", kept)

    def take(message: Any) -> None:
        begun, of_fix = matcher.origin is not None, isinstance(message, NavSatFix)
        answer = matcher.fix(message) if of_fix else matcher.wheels(message)
        if answer is not None:
            if not begun:
                origin.publish(origin_of(matcher.origin, NavSatFix(), answer[0].header.stamp))
            pose.publish(answer[0])
            road.publish(String(data=answer[1]))

    for kind, topic in ((NavSatFix, "fix"), (Odometry, "wheels")):
        node.create_subscription(kind, topic, take, qos_profile_sensor_data)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
