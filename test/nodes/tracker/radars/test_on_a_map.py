"""What places detections on a map: the tracker's own cloud, and the radars' frames."""

import numpy as np
import pytest
import stand_ins
from diagnostic_msgs.msg import DiagnosticArray
from live_radars import SCANS, change, connected, options, start_tracker
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import names, point_cloud, stamps
from msg_adapters.incoming import detections
from msg_adapters.targets import truth
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.types import Truth

STORE = get_typestore(Stores.ROS2_JAZZY)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# The second radar's driver has names and units of its own.
FOREIGN = {
    "radar_2.fields.range": "dist",
    "radar_2.fields.azimuth": "angle",
    "radar_2.fields.amplitude": "snr",
    "radar_2.units.amplitude": "db",
    "radar_2.units.azimuth": "deg",
    "radar_2.units.azimuth_convention": "compass_cw",
}
NO_TARGETS = (np.zeros((0, 5)), np.zeros(0, dtype=int), np.zeros(0, dtype=int))
MISSING = "tf2_msgs is not installed"


def transforms(data):
    """Return (parent, child, x, y) of every transform of a serialised message."""
    return [
        (t.header.frame_id, t.child_frame_id, t.transform.translation.x, t.transform.translation.y)
        for t in STORE.deserialize_cdr(data, names.TRANSFORMS).transforms
    ]


def test_every_radar_looks_alike_whatever_its_driver(processes, peer):
    shown = peer.collect(PointCloud2, names.detections_in_map())
    start_tracker(processes, *options(**FOREIGN))
    group = connected(peer)
    (own, foreign), config = SCANS[0].detections, resolve(FOREIGN)
    before = SCANS[0].stamp_ns
    for output, found, radar in zip(group.outputs, (own, foreign), config.inputs, strict=True):
        output.publish(detections.to_msg(found, before, radar.frame, radar))
    assert peer.spin_until(lambda: shown)

    kinds = dict.fromkeys(("x", "y", "z", "amplitude"), point_cloud.FLOATS)
    seen = point_cloud.decode(shown[0], {**kinds, "radar_index": point_cloud.UNSIGNED})
    expected = [
        radar.to_world(found.measurement)
        for radar, found in zip(config.model.radars, (own, foreign), strict=True)
    ]
    assert (shown[0].header.frame_id, stamps.to_ns(shown[0].header.stamp)) == ("map", before)
    assert seen["radar_index"].tolist() == [0] * len(own) + [1] * len(foreign)
    # Single precision of a driver's degrees, at 17 km.
    places = np.stack([seen["x"], seen["y"]], axis=1)
    np.testing.assert_allclose(places, np.concatenate(expected), atol=0.1)
    amplitude = np.concatenate([own.amplitude, foreign.amplitude])
    np.testing.assert_allclose(seen["amplitude"], amplitude, rtol=1e-5)


@pytest.fixture
def installed(tmp_path):
    """Return the environment of a process that has tf2_msgs."""
    return stand_ins.write(tmp_path / "packages")


def test_tracker_publishes_the_radars_frames_for_whoever_comes_later(processes, peer, installed):
    kind, found = stand_ins.message_class(names.TRANSFORMS), []
    start_tracker(processes, **installed)
    connected(peer)
    peer.node.create_subscription(kind, names.STATIC_FRAMES, found.append, LATCHED, raw=True)
    assert peer.spin_until(lambda: found)
    assert transforms(found[0]) == [("map", "radar_1", 1000.0, 0.0), ("map", "radar_2", 0.0, 0.0)]
    assert peer.node.count_publishers(names.STATIC_FRAMES) == 1


def test_frames_and_detections_in_map_can_be_left_out(processes, peer, installed):
    start_tracker(processes, *options(outputs="[markers]"), **installed)
    connected(peer)
    assert not peer.node.count_publishers(names.STATIC_FRAMES)
    assert not peer.node.count_publishers(names.detections_in_map())


def test_missing_type_of_the_frames_is_logged_once(processes, peer, tmp_path):
    broken = tmp_path / "packages" / "tf2_msgs"
    broken.mkdir(parents=True)
    (broken / "__init__.py").write_text("raise ImportError('not in this installation')")
    node = start_tracker(processes, PYTHONPATH=str(broken.parent))
    connected(peer)
    assert change(peer, "DEACTIVATE", "CLEANUP", "CONFIGURE", "ACTIVATE")
    log = peer.said(node, "tracking 2 classes", times=2)
    assert log.count(MISSING) == 1


def test_output_whose_package_has_other_fields_is_left_out_and_others_go_on(
    processes, peer, installed
):
    tracker = start_tracker(processes, *options(outputs="[obstacles, odometry]"), **installed)
    group = connected(peer)
    peer.collect(stand_ins.message_class(names.OBSTACLES), "/tracker/obstacles")
    found = peer.collect(Odometry, "/tracker/odometry")
    assert peer.spin_until(lambda: peer.node.count_subscribers("/tracker/odometry"))
    group.track_all(*range(6))
    assert peer.spin_until(lambda: found)
    log = peer.said(tracker, "outputs: obstacles is left out, its message package")
    assert log.count("is left out") == 1
    assert peer.spin_until(lambda: not peer.node.count_publishers("/tracker/obstacles"))


def test_recording_places_detections_on_a_map(processes, peer, tmp_path, installed):
    where = tmp_path / "bag"
    evaluator = processes.start("evaluator", "--ros-args", "-p", f"record:={where}", **installed)
    assert peer.spin_until(lambda: peer.node.count_subscribers(names.detections_in_map()))
    start_tracker(processes, **installed)
    group = connected(peer)
    scores = peer.collect(DiagnosticArray, names.OSPA)
    targets = peer.publisher(PointCloud2, names.TRUTH)
    # The evaluator subscribes for itself and for the recording.
    assert peer.spin_until(lambda: targets.get_subscription_count() == 2)

    # A score means that the evaluator has what came before that scan's estimates. The first scans
    # may be too early for it, as it has to find the tracker by itself.
    def scored():
        return len({stamps.to_ns(score.header.stamp) for score in scores})

    sent = 0
    while scored() < 6 and sent < len(SCANS):
        targets.publish(truth.to_msg(Truth(SCANS[sent].stamp_ns, *NO_TARGETS), "map"))
        group.track(sent)
        sent += 1
        peer.spin_until(lambda: scored() >= 6, 0.2)
    assert scored() >= 6
    evaluator.terminate()
    assert evaluator.wait(15.0) == 0

    bag = BagReader(where)
    frames = [m.data for m in bag.messages([names.STATIC_FRAMES])]
    assert [transforms(data)[0][:2] for data in frames] == [("map", "radar_1")]
    assert bag.counts[names.detections_in_map()] >= 3
