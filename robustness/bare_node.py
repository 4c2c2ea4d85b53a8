# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A node of rclpy's own that answers every cloud with an empty one: what any restart costs."""

from __future__ import annotations

import contextlib
import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from sensor_msgs.msg import PointCloud2


def main() -> None:
    """Answer under the tracker's name until killed."""
    rclpy.init(args=sys.argv)
    node = rclpy.create_node("tracker")
    answers = node.create_publisher(PointCloud2, "~/filtered/estimates", 10)

    def answer(cloud: PointCloud2) -> None:
        answers.publish(PointCloud2(header=cloud.header))

    for name in ("radar_1", "radar_2"):
        node.create_subscription(PointCloud2, f"/{name}/detections", answer, 10)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    main()
