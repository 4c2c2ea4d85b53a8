# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A live tracker and a radar that measures range rates, over DDS; and the same clouds offline."""

from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import PointCloud2

from msg_adapters import detections, diagnostics, estimates, names
from phd_jdtc_ros import yaml_files
from phd_jdtc_ros.core.configuration.build import resolve
from phd_jdtc_ros.core.pipeline import Stepped, new_pipeline
from phd_jdtc_ros.core.simulation import scenario_file
from phd_jdtc_ros.core.simulation.simulate import simulate
from phd_jdtc_ros.tools import params_file

pytestmark = pytest.mark.live
CONFIG = Path(__file__).parents[2] / "config"
PROFILE = CONFIG / "automotive.yaml"
SCANS = 10


def clouds(config):
    """Return the first clouds of the scenario, and the truth of the last one."""
    document = yaml_files.load(CONFIG / "scenarios" / "automotive.yaml")
    run = simulate(scenario_file.resolve(document, config.model.radars), 3)[:SCANS]
    (radar,) = config.inputs
    sent = [
        detections.to_msg(scan.detections[0], truth.stamp_ns, radar.frame, radar)
        for truth, scan in run
    ]
    return sent, run[-1][0]


def offline(config, sent):
    """Return the filtered estimates of clouds, without a node."""
    pipeline, (radar,) = new_pipeline(config), config.inputs
    events = []
    for cloud in sent:
        report = detections.from_msg(cloud, radar)
        events += pipeline.add(0, report.stamp_ns, report.detections)
    return [
        found for event in events if isinstance(event, Stepped) for found in event.step.filtered
    ]


def test_live_tracks_with_range_rates_are_those_of_offline_ones(processes, peer):
    config = resolve(params_file.load(PROFILE))
    sent, truth = clouds(config)
    filtered = peer.collect(PointCloud2, names.estimates("filtered"))
    health = peer.collect(DiagnosticArray, names.DIAGNOSTICS)
    output = peer.publisher(PointCloud2, "/front/detections", 50)
    processes.start(
        *("tracker", "--ros-args", "--params-file", PROFILE),
        *("-p", "qos_overrides./front/detections.subscription.reliability:=reliable"),
    )
    answer = names.estimates("filtered")
    assert peer.spin_until(
        lambda: output.get_subscription_count() and peer.node.count_publishers(answer)
    )
    peer.meet()
    for number, cloud in enumerate(sent):
        output.publish(cloud)
        assert peer.spin_until(lambda number=number: len(filtered) > number), number

    expected = offline(config, sent)
    found = [estimates.from_msg(message) for message in filtered]
    assert len(found) == len(expected) == SCANS
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_array_equal(ours.track_id, theirs.track_id)
        # Clouds are FLOAT32.
        np.testing.assert_allclose(ours.state, theirs.state, rtol=1e-6, atol=1e-6)
    apart = np.hypot(*(found[-1].position[:, None] - truth.position).transpose(2, 0, 1))
    assert apart.min(axis=0).max() < 3.0

    def radar_values():
        statuses = [status for message in health for status in message.status]
        mine = [diagnostics.values_of(status) for status in statuses if "front" in status.name]
        return mine[-1] if mine else {}

    assert peer.spin_until(lambda: int(radar_values().get("received", 0)) == SCANS)
    assert not [key for key in radar_values() if key.startswith(("range_rate", "dropped"))]
