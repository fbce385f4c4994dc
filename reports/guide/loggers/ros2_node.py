"""A ROS 2 node that tracks readings in V, which come as JointState on ``readings``.

``name`` has the names of the electrodes, ``effort`` their readings, and ``header.stamp`` the time
at which they were taken. The node publishes ``force`` (WrenchStamped) and ``place`` (PointStamped)
with ``place_covariance``.
"""

from __future__ import annotations

import math
import sys

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped, WrenchStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from pvdf_fem import Response, Tracker

FRAME = "sensor"  # its origin is the stage's, and z points into the film
#: A reliable subscription gets nothing from a driver that sends with best effort. The queue holds
#: the samples of a second, since a node that is late must not lose them.
QUALITY = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


def main(response: str) -> None:
    """Publish while something touches, until the node is stopped."""
    rclpy.init()
    node = rclpy.create_node("touches")
    tracker = Tracker(Response.load(response))
    forces = node.create_publisher(WrenchStamped, "force", 10)
    places = node.create_publisher(PointStamped, "place", 10)
    covariances = node.create_publisher(Float64MultiArray, "place_covariance", 10)

    def track_sample(message: JointState) -> None:
        """Track a sample at the time of its stamp, and publish the touch."""
        stamp = message.header.stamp
        # Seconds since 1970 are exact to 0.2 µs as a float.
        readings = dict(zip(message.name, message.effort, strict=True))
        row = tracker.update(stamp.sec + 1e-9 * stamp.nanosec, readings)
        if math.isnan(row.force_N):
            return
        force = WrenchStamped()
        place = PointStamped()
        seconds = math.floor(row.t_s)
        for stamped in (force, place):
            stamped.header.stamp = Time(sec=seconds, nanosec=int(1e9 * (row.t_s - seconds)))
            stamped.header.frame_id = FRAME
        force.wrench.force.z = row.force_N
        place.point.x = 1e-3 * row.x_mm
        place.point.y = 1e-3 * row.y_mm
        # In m², row by row of x, y, z. The height is that of the film, which is certain.
        deviations_m = [1e-3 * row.x_deviation_mm, 1e-3 * row.y_deviation_mm, 0.0]
        covariance = Float64MultiArray()
        covariance.data = np.diag(np.square(deviations_m)).ravel().tolist()
        forces.publish(force)
        places.publish(place)
        covariances.publish(covariance)

    node.create_subscription(JointState, "readings", track_sample, QUALITY)
    rclpy.spin(node)
    rclpy.shutdown()


if __name__ == "__main__":
    main(sys.argv[1])  # sensor.response
