"""A ROS 2 node that tracks readings in V, which come as Float64MultiArray on ``readings``.

It publishes ``force`` (WrenchStamped) and ``place`` (PointStamped) with ``place_covariance``.
"""

from __future__ import annotations

import math
import sys

import numpy as np
import rclpy
from geometry_msgs.msg import PointStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray

from pvdf_fem import Response, Tracker

FRAME = "sensor"  # its origin is the stage's, and z points into the film


def main(response: str) -> None:
    """Publish while something touches, until the node is stopped."""
    rclpy.init()
    node = rclpy.create_node("touches")
    tracker = Tracker(Response.load(response))
    forces = node.create_publisher(WrenchStamped, "force", 10)
    places = node.create_publisher(PointStamped, "place", 10)
    covariances = node.create_publisher(Float64MultiArray, "place_covariance", 10)

    def track_sample(message: Float64MultiArray) -> None:
        """Track a sample at the time of its arrival, and publish the touch."""
        now = node.get_clock().now()
        row = tracker.update(1e-9 * now.nanoseconds, message.data)
        if math.isnan(row.force_N):
            return
        force = WrenchStamped()
        place = PointStamped()
        for stamped in (force, place):
            stamped.header.stamp = now.to_msg()
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

    node.create_subscription(Float64MultiArray, "readings", track_sample, 100)
    rclpy.spin(node)
    rclpy.shutdown()


if __name__ == "__main__":
    main(sys.argv[1])  # sensor.response
