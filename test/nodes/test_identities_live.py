"""A live tracker whose radar reports codes, addresses and heights, over DDS."""

import numpy as np
import tower
from live_and_offline import started
from sensor_msgs.msg import PointCloud2
from tower import PERIOD_S
from visualization_msgs.msg import MarkerArray

from msg_adapters import detections, estimates, names
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.earth import SystemPlane

START_NS, SCANS = 1_700_000_000 * 10**9, 6
# East, north and velocities at the start; codes, addresses and heights.
AIRCRAFT = np.array([[20e3, 5e3, -200.0, 0.0], [-12e3, -15e3, 100.0, 150.0]])
CODES, ADDRESSES = np.array([0o4521, 0o7000]), np.array([0x3C6444, 0x4CA123])
# Above the world's zero, which is 500 feet up.
HEIGHTS = np.array([3048.0, 9144.0])
PARAMETERS = {
    **tower.PARAMETERS,
    "world_origin": [50.0, 8.5, 152.4],
    "tower.fields.address": "icao",
    "tower.fields.height": "altitude",
}


def clouds(config):
    """Yield the plots of each scan."""
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
            kind=np.full(2, 3),
        )
        stamp_ns = START_NS + round(number * PERIOD_S * 1e9)
        yield detections.to_msg(found, stamp_ns, radar.frame, radar)


def test_codes_addresses_and_heights_arrive_in_the_estimates(processes, peer, tmp_path):
    topic = "/tower/plots"
    markers = peer.collect(MarkerArray, "/tracker/markers", 100)
    smoothed = peer.collect(PointCloud2, names.estimates("smoothed"), 100)
    types = {topic: PointCloud2}
    outputs, filtered, _ = started(processes, peer, tmp_path, PARAMETERS, types)
    for cloud in clouds(resolve(PARAMETERS, SystemPlane)):
        outputs[topic].publish(cloud)
    assert peer.spin_until(lambda: len(filtered) == SCANS and len(smoothed) >= SCANS - 2)

    for found in (filtered, smoothed):
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
