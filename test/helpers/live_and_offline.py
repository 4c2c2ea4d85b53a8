"""The clouds of one radar to a live tracker, each when the one before is answered; and offline."""

import numpy as np
from sensor_msgs.msg import PointCloud2

from msg_adapters import detections, estimates, names
from phd_jdtc_ros.configuration.assembly import new_pipeline
from phd_jdtc_ros.core.pipeline import Stepped

FILTERED = names.estimates("filtered")


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
    for number, cloud in enumerate(clouds):
        output.publish(cloud)
        assert peer.spin_until(lambda number=number: len(filtered) > number), number
    return [estimates.from_msg(message) for message in filtered]


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
