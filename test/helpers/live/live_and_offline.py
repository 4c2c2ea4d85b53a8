"""The clouds of one radar to a live tracker, each when the one before is answered; and offline."""

import numpy as np
import yaml
from sensor_msgs.msg import PointCloud2

from msg_adapters.targets import estimates


def started(
    processes,
    peer,
    directory,
    given,
    types,
    node="/tracker",
    source="filtered",
    ros=(),
    **environment,
):
    """Start a tracker with parameters and reliable inputs, and wait until all are connected.

    `types` has the message type of each input by its topic, and `ros` further ROS arguments.
    Returns the publishers by topic, the estimates that come, and the process.
    """
    qos = {f"qos_overrides.{topic}.subscription.reliability": "reliable" for topic in types}
    file = directory / f"{node.strip('/').replace('/', '_')}.yaml"
    file.write_text(yaml.safe_dump({node: {"ros__parameters": {**given, **qos}}}))
    outputs = {topic: peer.publisher(kind, topic, 50) for topic, kind in types.items()}
    estimates_topic = f"{node}/{source}/estimates"
    found = peer.collect(PointCloud2, estimates_topic, 1000)
    process = processes.start("tracker", "--ros-args", "--params-file", file, *ros, **environment)
    assert peer.spin_until(
        lambda: (
            all(output.get_subscription_count() for output in outputs.values())
            and peer.node.count_publishers(estimates_topic)
        )
    )
    peer.meet(node)
    return outputs, found, process


def answered(peer, output, found, clouds):
    """Publish each cloud once there are estimates of the one before."""
    for cloud in clouds:
        before = len(found)
        output.publish(cloud)
        assert peer.spin_until(lambda before=before: len(found) > before), before


def assert_alike(clouds, expected):
    """Compare estimates that came live with those offline, and return them."""
    received = [estimates.from_msg(cloud) for cloud in clouds]
    assert [one.stamp_ns for one in received] == [one.stamp_ns for one in expected]
    for one, other in zip(received, expected, strict=True):
        np.testing.assert_allclose(one.state, other.state, rtol=1e-5, atol=1e-3)
    return received
