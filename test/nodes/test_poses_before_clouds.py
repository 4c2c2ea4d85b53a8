# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A tracker that is behind: many poses and several clouds have arrived when it goes on.

By itself, because its node is in the process of the test, which has it in the graph for good.
"""

import moving
import rclpy
import yaml
from moving_messages import CLOUDS, sent
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.core.configuration.schema import flatten
from phd_jdtc_ros.nodes.common import arguments
from phd_jdtc_ros.nodes.tracker.node import Tracker


def test_clouds_do_not_overtake_poses_that_have_arrived(peer, tmp_path):
    file = tmp_path / "moving.yaml"
    qos = {
        f"qos_overrides.{topic}.subscription.reliability": "reliable"
        for topic in (CLOUDS, moving.ODOMETRY)
    }
    given = {"/tracker": {"ros__parameters": {**dict(flatten(moving.PARAMETERS)), **qos}}}
    file.write_text(yaml.safe_dump(given))
    argv = ["--ros-args", "--params-file", str(file)]
    rclpy.init(args=argv)
    # Here and not in a process of its own, because it is not to spin until all has arrived.
    tracker = Tracker(arguments.check("tracker", "", argv))
    executor = SingleThreadedExecutor()
    executor.add_node(tracker)
    outputs = {
        CLOUDS: peer.publisher(PointCloud2, CLOUDS, 50),
        moving.ODOMETRY: peer.publisher(Odometry, moving.ODOMETRY, 50),
    }
    found = peer.collect(PointCloud2, "/tracker/filtered/estimates", 1000)
    try:
        assert peer.spin_until(
            lambda: (
                all(output.get_subscription_count() for output in outputs.values())
                and peer.node.count_publishers("/tracker/filtered/estimates")
            )
        )
        for topic, data, _ in sent(count=9):
            outputs[topic].publish(data)
        assert all(output.wait_for_all_acked() for output in outputs.values())

        def done():
            executor.spin_once(timeout_sec=0.0)
            return len(found) == 8

        # The last scan waits for a pose that never comes.
        assert peer.spin_until(done)
    finally:
        tracker.close()
        executor.shutdown()
        tracker.destroy_node()
        rclpy.shutdown()
