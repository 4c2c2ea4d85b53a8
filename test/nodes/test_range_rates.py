"""A live tracker and a radar that measures range rates, over DDS; and the same clouds offline."""

from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_and_offline import assert_same, tracked_live, tracked_offline

from msg_adapters import detections, diagnostics, names
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.simulate import simulate

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


def test_live_tracks_with_range_rates_are_those_of_offline_ones(processes, peer):
    config = resolve(from_arguments.load(PROFILE))
    sent, truth = clouds(config)
    health = peer.collect(DiagnosticArray, names.DIAGNOSTICS)
    found = tracked_live(processes, peer, config.inputs[0], sent, "--params-file", PROFILE)

    assert_same(found, tracked_offline(config, sent))
    assert len(found) == SCANS
    apart = np.hypot(*(found[-1].position[:, None] - truth.position).transpose(2, 0, 1))
    assert apart.min(axis=0).max() < 3.0

    def radar_values():
        statuses = [status for message in health for status in message.status]
        mine = [diagnostics.values_of(status) for status in statuses if "front" in status.name]
        return mine[-1] if mine else {}

    assert peer.spin_until(lambda: int(radar_values().get("received", 0)) == SCANS)
    assert not [key for key in radar_values() if key.startswith(("range_rate", "dropped"))]
