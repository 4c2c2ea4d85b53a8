"""A subscriber to what the replay of the reference scenario publishes."""

import time
from pathlib import Path

from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import names

BAG = Path(__file__).parents[3] / "bags" / "paper_scenario"
TOPICS = (names.detections("radar_1"), names.detections("radar_2"), names.TRUTH)
DEEP = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
CLOCK_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


def playing(rate, *flags, bag=BAG, **values):
    """Return the words of a replay at a rate, with other flags; ROS arguments may follow."""
    given = [word for name, value in values.items() for word in (f"--{name}", value)]
    return [bag, "--rate", rate, *flags, *given, "--ros-args"]


class Listener:
    """Keeps the bytes that arrive on every played topic, and when."""

    def __init__(self, peer):
        self.data = {topic: [] for topic in TOPICS}
        self.times_of_truth = []
        for topic in TOPICS:
            peer.node.create_subscription(
                PointCloud2,
                topic,
                lambda data, topic=topic: self._take(topic, data),
                DEEP,
                raw=True,
            )

    def _take(self, topic, data):
        self.data[topic].append(data)
        if topic == names.TRUTH:
            self.times_of_truth.append(time.monotonic())

    @property
    def scans(self):
        return len(self.data[names.TRUTH])
