"""A live tracker whose radar reports codes, addresses and heights, over DDS."""

import numpy as np
import pytest
import tower
from live_and_offline import answered, started
from sensor_msgs.msg import PointCloud2
from tower import PERIOD_S
from visualization_msgs.msg import MarkerArray

from msg_adapters import detections, estimates
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.types import UNKNOWN, Detections
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


def clouds(config, answers=SCANS):
    """Yield the plots of each scan; after so many scans no transponder answers any more."""
    radar, rng = config.inputs[0], np.random.default_rng(6)
    for number in range(SCANS):
        world = AIRCRAFT[:, :2] + AIRCRAFT[:, 2:] * number * PERIOD_S
        distance = np.hypot(*world.T) + 30.0 * rng.standard_normal(2)
        azimuth = np.arctan2(*world.T[::-1]) + np.radians(0.1) * rng.standard_normal(2)
        found = Detections(
            *(np.stack([distance, azimuth], axis=1), None),
            code=CODES if number < answers else np.full(2, UNKNOWN),
            address=ADDRESSES if number < answers else np.full(2, UNKNOWN),
            height=HEIGHTS,
            kind=np.full(2, 3 if number < answers else 1),
        )
        stamp_ns = START_NS + round(number * PERIOD_S * 1e9)
        yield detections.to_msg(found, stamp_ns, radar.frame, radar)


class Tower:
    """A live tracker and its radar."""

    def __init__(self, processes, peer, directory, name):
        self.peer, self.node, topic = peer, f"/{name}/tracker", f"/{name}/plots"
        given = {
            **PARAMETERS,
            "tower.topic": topic,
            "tower.fields.kind": "kind",
            "checkpoint.path": str(directory / f"{name}.ckpt"),
            "checkpoint.every": 1,
        }
        outputs, self.found, self.process = started(
            *(processes, peer, directory, given, {topic: PointCloud2}, self.node),
            ros=("-r", f"__ns:=/{name}"),
        )
        self.output = outputs[topic]
        peer.settled(self.output)

    def track(self, sent):
        """Return the tracker's estimates of each cloud."""
        answered(self.peer, self.output, self.found, sent)
        # A checkpoint is written after the estimates have gone out.
        self.peer.meet(self.node)
        return [bytes(cloud.data) for cloud in self.found[-len(sent) :]]


def test_codes_addresses_and_heights_are_kept_across_a_restart(processes, peer, tmp_path):
    sent = list(
        clouds(resolve({**PARAMETERS, "tower.fields.kind": "kind"}, SystemPlane), answers=4)
    )
    whole = Tower(processes, peer, tmp_path, "whole").track(sent)
    first = Tower(processes, peer, tmp_path, "again")
    assert first.track(sent[:4]) == whole[:4]
    first.process.kill()
    first.process.wait(10.0)
    peer.node.destroy_publisher(first.output)
    second = Tower(processes, peer, tmp_path, "again")
    # The plots have no identities any more: only the checkpoint has them.
    assert second.track(sent[4:]) == whole[4:]
    assert "going on from" in second.process.log.read_text()
    known = estimates.from_msg(second.found[0]).attributes
    order = np.argsort(known.code)
    assert known.code[order].tolist() == CODES.tolist()
    assert known.address[order].tolist() == ADDRESSES.tolist()
    np.testing.assert_allclose(known.height[order, 0], HEIGHTS, atol=15.0)
    ages = (second.found[0].header.stamp.sec * 10**9 - known.seen_ns) / 1e9
    assert ages[:, :2].tolist() == [[0.0, PERIOD_S]] * 2


@pytest.mark.parametrize("source", ["filtered", "smoothed"])
def test_codes_addresses_and_heights_arrive_in_the_estimates(processes, peer, tmp_path, source):
    topic = "/tower/plots"
    markers = peer.collect(MarkerArray, "/tracker/markers", 100)
    outputs, found, _ = started(
        processes, peer, tmp_path, PARAMETERS, {topic: PointCloud2}, source=source
    )
    for cloud in clouds(resolve(PARAMETERS, SystemPlane)):
        outputs[topic].publish(cloud)
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
