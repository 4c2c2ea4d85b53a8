"""A tracker that is behind: poses and clouds of two ships have arrived when it goes on.

By itself, because its node is in the process of the test, which has it in the graph for good.
"""

import copy

import moving
import rclpy
import yaml
from moving_messages import CLOUDS, sent
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.configuration.schema import flatten
from phd_jdtc_ros.nodes.common import parameters
from phd_jdtc_ros.nodes.tracker.node import Tracker

SCANS = 9
# Another ship beside it: the same radar, at the same place.
CONSORT = {CLOUDS: "/consort/detections", moving.ODOMETRY: "/consort/odometry"}
PARAMETERS = {
    **moving.PARAMETERS,
    "sensors": ["mast", "consort"],
    "consort": {**copy.deepcopy(moving.PARAMETERS["mast"]), "pose": CONSORT[moving.ODOMETRY]},
}


def test_clouds_do_not_overtake_poses_that_have_arrived(peer, tmp_path):
    file = tmp_path / "moving.yaml"
    topics = [*CONSORT, *CONSORT.values()]
    qos = {f"qos_overrides.{topic}.subscription.reliability": "reliable" for topic in topics}
    given = {"/tracker": {"ros__parameters": {**dict(flatten(PARAMETERS)), **qos}}}
    file.write_text(yaml.safe_dump(given))
    argv = ["--ros-args", "--params-file", str(file)]
    rclpy.init(args=argv)
    # Here and not in a process of its own, because it is not to spin until all has arrived.
    tracker = Tracker(parameters.given_files("tracker", "", argv))
    executor = SingleThreadedExecutor()
    executor.add_node(tracker)
    outputs = {
        topic: peer.publisher(Odometry if topic.endswith("odometry") else PointCloud2, topic, 50)
        for topic in topics
    }
    found = peer.collect(PointCloud2, "/tracker/filtered/estimates", 1000)
    try:
        assert peer.spin_until(
            lambda: (
                all(output.get_subscription_count() for output in outputs.values())
                and peer.node.count_publishers("/tracker/filtered/estimates")
            )
        )
        ships = zip(sent(count=SCANS), sent(count=SCANS, radar="consort"), strict=True)
        for (topic, own, _), (_, other, _) in ships:
            outputs[topic].publish(own)
            outputs[CONSORT[topic]].publish(other)
        assert all(output.wait_for_all_acked() for output in outputs.values())

        def done():
            executor.spin_once(timeout_sec=0.0)
            return len(found) == SCANS - 1

        # The last scan waits for a pose that never comes. Of each ship fewer poses are kept than
        # have arrived.
        assert peer.spin_until(done)
        assert not any(health.dropped for health in tracker._live.inputs.radars)
    finally:
        tracker.close()
        executor.shutdown()
        tracker.destroy_node()
        rclpy.shutdown()
