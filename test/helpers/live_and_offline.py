"""The clouds of one radar to a live tracker, each when the one before is answered; and offline."""

import numpy as np
import yaml
from sensor_msgs.msg import PointCloud2

from msg_adapters import detections, estimates, names
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.pipeline import Stepped

FILTERED = names.estimates("filtered")


def started(processes, peer, directory, given, types, node="/tracker", source="filtered", ros=()):
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
    process = processes.start("tracker", "--ros-args", "--params-file", file, *ros)
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


def tracked_live(processes, peer, radar, clouds, *arguments):
    """Start a tracker with these arguments; return its filtered estimates of the clouds."""
    filtered = peer.collect(PointCloud2, FILTERED)
    output = peer.publisher(PointCloud2, radar.topic, 50)
    processes.start(
        *("tracker", "--ros-args", *arguments),
        *("-p", f"qos_overrides.{radar.topic}.subscription.reliability:=reliable"),
    )
    assert peer.spin_until(
        lambda: output.get_subscription_count() and peer.node.count_publishers(FILTERED)
    )
    peer.meet()
    answered(peer, output, filtered, clouds)
    return [estimates.from_msg(message) for message in filtered]


def assert_alike(clouds, expected):
    """Compare estimates that came live with those offline, and return them."""
    heard = [estimates.from_msg(cloud) for cloud in clouds]
    assert [one.stamp_ns for one in heard] == [one.stamp_ns for one in expected]
    for one, other in zip(heard, expected, strict=True):
        np.testing.assert_allclose(one.state, other.state, rtol=1e-5, atol=1e-3)
    return heard


def tracked_offline(config, clouds):
    """Return the filtered estimates of the clouds, without a node."""
    pipeline, (radar,) = new_pipeline(config), config.inputs
    events = []
    for cloud in clouds:
        report = detections.from_msg(cloud, radar)
        assert not report.dropped
        events += pipeline.add(0, report.stamp_ns, report.detections)
    return [
        found for event in events if isinstance(event, Stepped) for found in event.step.filtered
    ]


def assert_same(live, offline):
    """Compare estimates with those that have been a message."""
    assert len(live) == len(offline)
    for ours, theirs in zip(live, offline, strict=True):
        np.testing.assert_array_equal(ours.track_id, theirs.track_id)
        # Clouds are FLOAT32.
        np.testing.assert_allclose(ours.state, theirs.state, rtol=1e-6, atol=1e-6)
