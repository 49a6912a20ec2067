"""A node of ROS 2: NavSatFix and wheel Odometry in, the matched pose as Odometry out.

    python ros2_node.py city.map --ros-args -r fix:=/gnss/fix -r wheels:=/vehicle/odom

Frames are those of REP-103 and REP-105: the pose is in `map`, x east and y north of the first
position, the vehicle is `base_link`.  `road` says the edge, its source's id and its P as JSON.
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
    """

    def __init__(self, roads: whichroad.RoadMap, new: Callable[[], Any]) -> None:
        self._localizer, self._roads, self._new = whichroad.Localizer(roads), roads, new
        self._origin: tuple[float, float, float] | None = None  # of `map`: m, m, rad

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
            road["source_id"] = self._roads.source(estimate.edge, estimate.abscissa)[0]
        return self._odometry(estimate), json.dumps(road)

    def _odometry(self, estimate: Any) -> Any:
        pose = estimate.pose
        if self._origin is None:
            turn = self._roads.plane.convergence(np.array([pose.x]), np.array([pose.y]))
            self._origin = pose.x, pose.y, float(turn[0])
        x0, y0, turn = self._origin
        c, s = math.cos(turn), math.sin(turn)
        to_east = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # from the map's plane
        x, y, yaw = to_east @ (pose.x - x0, pose.y - y0, pose.heading - turn)
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


def main() -> None:
    """Run the node."""
    import rclpy
    from nav_msgs.msg import Odometry
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import NavSatFix
    from std_msgs.msg import String

    rclpy.init()
    node = rclpy.create_node("whichroad")
    matcher = Matcher(whichroad.RoadMap.open(sys.argv[1]), Odometry)
    pose, road = (
        node.create_publisher(Odometry, "odometry", 10),
        node.create_publisher(String, "road", 10),
    )

    def publish(answer: tuple[Any, str] | None) -> None:
        if answer is not None:
            pose.publish(answer[0])
            road.publish(String(data=answer[1]))

    for kind, topic, take in (
        (NavSatFix, "fix", matcher.fix), (Odometry, "wheels", matcher.wheels),
    ):  # fmt: skip
        node.create_subscription(
            kind, topic, lambda message, take=take: publish(take(message)), qos_profile_sensor_data
        )
    rclpy.spin(node)


if __name__ == "__main__":
    main()
