# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A live tracker whose radar reports codes, addresses and heights, over DDS."""

import numpy as np
import pytest
import yaml
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from msg_adapters import detections, estimates
from phd_jdtc_ros.core.configuration.build import resolve
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.earth import SystemPlane

START_NS, PERIOD_S, SCANS = 1_700_000_000 * 10**9, 4.0, 6
# East, north and velocities at the start; codes, addresses and heights.
AIRCRAFT = np.array([[20e3, 5e3, -200.0, 0.0], [-12e3, -15e3, 100.0, 150.0]])
CODES, ADDRESSES = np.array([0o4521, 0o7000]), np.array([0x3C6444, 0x4CA123])
# Above the world's zero, which is 500 feet up.
HEIGHTS = np.array([3048.0, 9144.0])
PARAMETERS = {
    "radars": ["tower"],
    "world_origin": [50.0, 8.5, 152.4],
    "engine": "gaussian",
    "interval_s": PERIOD_S,
    "lag": 2,
    "classes": ["aircraft"],
    "motions": ["cv"],
    "births": [],
    "detection_births.rates": [0.1],
    "detection_births.velocity_std": 150.0,
    "spawn.rate": 0.0,
    "spawn.class_transition": [],
    "spawn.mode_transition": [],
    "aircraft.motions": ["cv"],
    "aircraft.mode_transition": [1.0],
    "amplitude": "none",
    "tower.topic": "/tower/plots",
    "tower.fields.amplitude": "",
    "tower.fields.code": "squawk",
    "tower.fields.address": "icao",
    "tower.fields.height": "altitude",
    "tower.detection_probability": 0.95,
    "tower.range_std": 30.0,
    "tower.azimuth_std_deg": 0.1,
    "tower.max_range": 60e3,
    "tower.clutter_rate": 2.0,
    "tower.clutter_max_range": 60e3,
}


def clouds(config):
    radar, rng = config.inputs[0], np.random.default_rng(6)
    for number in range(SCANS):
        world = AIRCRAFT[:, :2] + AIRCRAFT[:, 2:] * number * PERIOD_S
        distance = np.hypot(*world.T) + 30.0 * rng.standard_normal(2)
        azimuth = np.arctan2(*world.T[::-1]) + np.radians(0.1) * rng.standard_normal(2)
        found = Detections(
            *(np.stack([distance, azimuth], axis=1), None),
            code=CODES,
            address=ADDRESSES,
            height=HEIGHTS,
        )
        stamp_ns = START_NS + round(number * PERIOD_S * 1e9)
        yield detections.to_msg(found, stamp_ns, radar.frame, radar)


@pytest.mark.parametrize("source", ["filtered", "smoothed"])
def test_codes_addresses_and_heights_arrive_in_the_estimates(processes, peer, tmp_path, source):
    file = tmp_path / "tower.yaml"
    qos = {"qos_overrides./tower/plots.subscription.reliability": "reliable"}
    file.write_text(yaml.safe_dump({"/tracker": {"ros__parameters": {**PARAMETERS, **qos}}}))
    output = peer.publisher(PointCloud2, "/tower/plots", 50)
    found = peer.collect(PointCloud2, f"/tracker/{source}/estimates", 100)
    markers = peer.collect(MarkerArray, "/tracker/markers", 100)
    processes.start("tracker", "--ros-args", "--params-file", file)
    assert peer.spin_until(
        lambda: (
            output.get_subscription_count()
            and peer.node.count_publishers(f"/tracker/{source}/estimates")
        )
    )
    peer.meet()
    for cloud in clouds(resolve(PARAMETERS, SystemPlane)):
        output.publish(cloud)
    due = SCANS if source == "filtered" else SCANS - 2
    assert peer.spin_until(lambda: len(found) >= due and len(markers) > 0)

    last = estimates.from_msg(found[-1])
    order = np.argsort(last.attributes.code)
    assert last.attributes.code[order].tolist() == CODES.tolist()
    assert last.attributes.address[order].tolist() == ADDRESSES.tolist()
    np.testing.assert_allclose(last.attributes.height[order, 0], HEIGHTS, atol=15.0)
    assert (last.attributes.height_covariance[:, 0, 0] < 100.0).all()
    truth = AIRCRAFT[:, :2] + AIRCRAFT[:, 2:] * (last.stamp_ns - START_NS) * 1e-9
    assert np.hypot(*(last.position[order] - truth).T).max() < 200.0
    assert peer.spin_until(
        lambda: any("FL105 4521" in marker.text for sent in markers for marker in sent.markers)
    )
