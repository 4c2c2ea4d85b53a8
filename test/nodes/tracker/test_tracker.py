"""A live tracker's estimates of the reference scenario, its services and its subscriptions."""

import re
import signal

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from live_radars import SCANS, TOPICS, Radars, cloud, connected, options, start_tracker
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters.encoding import stamps
from msg_adapters.outgoing import diagnostics
from msg_adapters.targets import estimates
from phd_jdtc_ros.core.types import Detections

RELIABLY, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MODEST = QoSProfile(depth=50, reliability=BEST_EFFORT)


def stamps_of(clouds):
    return [stamps.to_ns(cloud.header.stamp) for cloud in clouds]


def stamps_at(indices):
    return [SCANS[index].stamp_ns for index in indices]


def same_but_for_numbers(clouds, one, other):
    """Return whether two of the clouds have the same estimates, of tracks with other numbers."""
    found, again = estimates.from_msg(clouds[one]), estimates.from_msg(clouds[other])
    numbers = [{*each.track_id.tolist()} - {0} for each in (found, again)]
    assert not numbers[0] & numbers[1]
    return np.array_equal(found.state, again.state) and len(numbers[0]) == len(numbers[1])


def test_tracker_publishes_filtered_and_lagged_smoothed_estimates(radars):
    radars.track_all(*range(6))
    radars.until_smoothed(4)
    assert stamps_of(radars.filtered) == stamps_at(range(6))
    # The smoothed stamp is the time of the state, two scans back.
    assert stamps_of(radars.smoothed) == stamps_at(range(4))
    assert all(cloud.header.frame_id == "map" for cloud in radars.filtered + radars.smoothed)
    last = estimates.from_msg(radars.smoothed[-1])
    truth = np.array([[-10e3 + 36 * 18, 10e3 - 44 * 18]])
    assert np.hypot(*(last.state[:, [0, 2]] - truth).T).min() < 500.0


def test_tracker_flush_publishes_what_is_pending_and_reset_does_not(radars):
    radars.track_all(0, 1, 2)
    radars.send(3, radars=(0,))
    radars.peer.meet()
    before = len(radars.smoothed)
    reply = radars.ask("flush")
    radars.until_smoothed(4)
    # The open scan's estimate is one of them.
    assert reply.message == f"{4 - before} smoothed estimates published"
    assert stamps_of(radars.smoothed) == stamps_at(range(4))
    # After the flush the tracker is as new, but for track numbers: the same scan again gives the
    # same estimate.
    again = len(radars.filtered)
    radars.track_all(0, 1, 2)
    assert same_but_for_numbers(radars.filtered, 0, again)
    radars.until_smoothed(5)
    assert radars.ask("reset").success
    radars.track(0)
    assert same_but_for_numbers(radars.filtered, 0, -1)
    # Smoothed estimates are published before the answer to what is asked after them.
    radars.peer.meet(times=2)
    assert len(radars.smoothed) == 5


def test_tracker_begins_again_when_stamps_jump(processes, peer):
    tracker = start_tracker(processes)
    radars = connected(peer)
    radars.track_all(*range(5))
    radars.track(0)
    assert same_but_for_numbers(radars.filtered, 0, -1)
    # All that was held back of the time before has come.
    radars.until_smoothed(5)
    before = len(radars.filtered) - 1
    radars.track_all(1, 2, 3)
    for index in range(4, 8):
        radars.track(index, stamp_ns=SCANS[index].stamp_ns + 3600 * 10**9)
    assert radars.health.values("step time")["run"] == "2"
    assert "stamps jumped ahead by 3606.0 s, more than max_gap_scans" in tracker.log.read_text()
    assert stamps_of(radars.smoothed)[:9] == stamps_at([*range(5), *range(4)])
    found = [
        set(estimates.from_msg(cloud).track_id.tolist()) - {0} for cloud in radars.filtered[before:]
    ]
    assert found[3]
    assert found[7]
    assert not set.union(*found[:4]) & set.union(*found[4:])


def test_tracker_takes_an_empty_scan_as_a_scan_and_counts_duplicate_and_late_ones(radars):
    for radar, output in enumerate(radars.outputs):
        output.publish(cloud(0, radar, Detections(np.zeros((0, 2)), np.zeros(0))))
    assert radars.peer.spin_until(lambda: len(radars.filtered) == 1)
    assert (radars.filtered[0].width, radars.filtered[0].point_step) == (0, 4 * 29)
    radars.track(1)
    radars.send(1, radars=(0,))
    radars.send(0, radars=(0,))
    radars.track(2)
    counts = radars.health.values("radar_1")
    assert (counts["dropped_duplicate"], counts["dropped_late"]) == ("1", "1")
    assert len(radars.filtered) == 3


def test_tracker_publishes_poses_markers_and_cardinality_with_the_contracted_qos(peer, radars):
    poses = [peer.collect(PoseArray, f"/tracker/filtered/class_{k}/poses") for k in (0, 1)]
    figures = peer.collect(DiagnosticArray, "/tracker/cardinality")
    peer.meet()
    radars.track_all(0, 1, 2)
    # A late joiner still gets the last markers.
    markers = peer.collect(MarkerArray, "/tracker/markers", LATCHED)
    assert peer.spin_until(lambda: markers and len(figures) == 3 and len(poses[1]) == 3)

    found = estimates.from_msg(radars.filtered[-1])
    assert [len(arrays[-1].poses) for arrays in poses] == [
        int((found.class_id == k).sum()) for k in (0, 1)
    ]
    assert markers[-1].markers[0].action == Marker.DELETEALL
    labels = [marker for marker in markers[-1].markers if marker.ns.endswith("/label")]
    assert len(labels) == len(found)
    values = diagnostics.values_of(figures[-1].status[0])
    assert float(values["total"]) == pytest.approx(
        float(values["class_0"]) + float(values["class_1"])
    )
    assert float(values["step_ms"]) > 0.0
    assert int(values["hypotheses"]) > 0
    offered = peer.node.get_publishers_info_by_topic("/tracker/filtered/estimates")[0].qos_profile
    assert offered.reliability == RELIABLY
    assert asked_for(peer) == [RELIABLY]  # It is overridden


def asked_for(peer):
    """Return how reliable the tracker's subscriptions to the first radar are."""
    found = peer.node.get_subscriptions_info_by_topic(TOPICS[0])
    return [info.qos_profile.reliability for info in found]


def test_busy_tracker_loses_no_cloud_of_a_reliable_radar(processes, peer):
    tracker = start_tracker(processes, qos=())
    radars = connected(peer)
    radars.track(0)
    tracker.send_signal(signal.SIGSTOP)  # So it is in one long step
    for index in range(1, 46):
        radars.send(index)
    tracker.send_signal(signal.SIGCONT)
    assert peer.spin_until(lambda: len(radars.filtered) == 46)
    assert {radars.health.values(f"radar_{k}")["gaps"] for k in (1, 2)} == {"0"}


def test_tracker_receives_as_reliably_as_its_radar_offers(processes, peer):
    start_tracker(processes, qos=())
    assert peer.spin_until(lambda: asked_for(peer) == [RELIABLY])
    radars = Radars(peer)
    for index, (qos, wanted) in enumerate(((MODEST, BEST_EFFORT), (50, RELIABLY))):
        peer.node.destroy_publisher(radars.outputs[0])
        radars.outputs[0] = peer.publisher(PointCloud2, TOPICS[0], qos)
        assert peer.spin_until(lambda wanted=wanted: asked_for(peer) == [wanted])
        radars.connect()
        radars.track(index)
    assert radars.health.values("radar_1")["incompatible_qos"] == "0"


def test_tracker_without_amplitudes_warns_once_and_logs_its_losses_at_the_end(processes, peer):
    tracker = start_tracker(processes, *options(**{"radar_1.fields.amplitude": "rcs"}))
    radars = connected(peer)
    radars.track_all(0, 1, 2)
    assert len(estimates.from_msg(radars.filtered[-1])) >= 2
    # While it sleeps more comes than its queues hold.
    tracker.send_signal(signal.SIGSTOP)
    for index in range(3, 63):
        radars.send(index, radars=(0,))
    tracker.send_signal(signal.SIGCONT)
    radars.health.until("radar_1", lambda _, v: int(v["received"]) + int(v["gaps"]) == 63)
    tracker.send_signal(signal.SIGTERM)
    assert tracker.wait(30.0) == 0
    log = tracker.log.read_text()
    assert log.count("no field 'rcs'") == 1
    (said,) = re.findall(r"stopped; .*", log)
    received, lost = map(int, re.findall(r"(\d+) clouds received.* radar_1 (\d+), ", said)[0])
    assert lost > 0
    # Three of the other radar.
    assert received + lost == 63 + 3
