import re
import signal

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray
from live_radars import FAST, RELIABLE, SCANS, Radars
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters import detections, diagnostics, estimates, stamps
from phd_jdtc_ros.core.types import Detections


def stamp_of(cloud):
    return stamps.to_ns(cloud.header.stamp)


def test_tracker_publishes_filtered_and_lagged_smoothed_estimates(radars):
    for index in range(6):
        radars.track(index)
    assert radars.peer.spin_until(lambda: len(radars.smoothed) >= 4)

    assert [stamp_of(c) for c in radars.filtered] == [SCANS[k].stamp_ns for k in range(6)]
    # The smoothed stamp is the time of the state, two scans back.
    assert [stamp_of(c) for c in radars.smoothed] == [SCANS[k].stamp_ns for k in range(4)]
    assert all(cloud.header.frame_id == "map" for cloud in radars.filtered + radars.smoothed)
    last = estimates.from_msg(radars.smoothed[-1])
    truth = np.array([[-10e3 + 36 * 18, 10e3 - 44 * 18]])
    assert np.hypot(*(last.state[:, [0, 2]] - truth).T).min() < 500.0


def test_tracker_takes_radars_in_any_order_of_arrival(radars):
    radars.send(0, radars=(1,))
    assert diagnostics.values_of(radars.drops(2))["received"] == "1"
    assert not radars.filtered
    radars.track(0, radars=(0,))

    assert len(radars.filtered) == 1


def test_tracker_flush_emits_the_last_scans_and_resets(radars):
    for index in range(4):
        radars.track(index)
    first = bytes(radars.filtered[0].data)
    reply = radars.peer.call(Trigger, "/tracker/flush")
    assert radars.peer.spin_until(lambda: len(radars.smoothed) == 4)

    assert reply.success
    assert [stamp_of(c) for c in radars.smoothed] == [SCANS[k].stamp_ns for k in range(4)]
    # After the flush the tracker is as new: the same scan again gives the same estimate.
    radars.track(0)
    assert bytes(radars.filtered[-1].data) == first


def test_tracker_flush_counts_the_smoothed_estimates_of_the_open_scan_too(radars):
    for index in range(3):
        radars.track(index)
    radars.send(3, radars=(0,))
    radars.peer.meet()
    before = len(radars.smoothed)
    reply = radars.peer.call(Trigger, "/tracker/flush")
    assert radars.peer.spin_until(lambda: len(radars.smoothed) == 4)

    assert reply.message == f"{4 - before} smoothed estimates published"


def test_tracker_reset_forgets_without_publishing(radars):
    for index in range(3):
        radars.track(index)
    first = bytes(radars.filtered[0].data)
    assert radars.peer.spin_until(lambda: len(radars.smoothed) == 1)
    assert radars.peer.call(Trigger, "/tracker/reset").success
    radars.track(0)
    # Smoothed estimates are published before the answer to what is asked after them.
    radars.peer.meet(times=2)

    assert len(radars.smoothed) == 1
    assert bytes(radars.filtered[-1].data) == first


def test_tracker_rejects_scans_that_do_not_fit_and_lives_on(radars):
    good = detections.to_msg(SCANS[0].detections[0], SCANS[0].stamp_ns, "radar_1")
    bad = []
    for change in ({"point_step": 13}, {"width": 10**6}, {"data": b"\0" * 7}, {"fields": []}):
        cloud = detections.to_msg(SCANS[0].detections[0], SCANS[0].stamp_ns, "radar_1")
        for name, value in change.items():
            setattr(cloud, name, value)
        bad.append(cloud)
    foreign = detections.to_msg(SCANS[0].detections[0], SCANS[0].stamp_ns, "base_link")
    for cloud in [*bad, foreign, PointCloud2()]:
        radars.outputs[0].publish(cloud)
    radars.outputs[0].publish(good)
    radars.track(0, radars=(1,))
    status = radars.drops(1)

    assert len(radars.filtered) == 1
    counts = diagnostics.values_of(status)
    assert counts["dropped_schema"] == "3"
    assert counts["dropped_oversize"] == "1"
    assert counts["dropped_frame"] == "2"
    assert status.level == DiagnosticStatus.WARN


def test_tracker_drops_bad_points_and_keeps_the_rest(processes, peer, radars):
    poison = Detections(
        np.array([[np.nan, 0.0], [-5.0, 0.0], [500.0, np.inf], [1e6, 0.0], [900.0, 1.0]]),
        np.array([5.0, 5.0, 5.0, 5.0, -1.0]),
    )
    good = SCANS[0].detections[0]
    mixed = Detections(
        np.concatenate([poison.measurement, good.measurement]),
        np.concatenate([poison.amplitude, good.amplitude]),
    )
    with np.errstate(invalid="ignore"):  # x and y of the points that are not finite
        radars.outputs[0].publish(detections.to_msg(mixed, SCANS[0].stamp_ns, "radar_1"))
    radars.track(0, radars=(1,))
    counts = diagnostics.values_of(radars.drops(1))
    with_poison = bytes(radars.filtered[-1].data)
    radars.peer.call(Trigger, "/tracker/reset")
    radars.track(0)

    assert counts["dropped_not_finite"] == "2"
    assert counts["dropped_range"] == "2"
    assert counts["dropped_amplitude"] == "1"
    assert bytes(radars.filtered[-1].data) == with_poison


def test_tracker_warns_of_azimuths_that_probably_are_degrees(radars):
    found = SCANS[0].detections[0]
    turned = Detections(found.measurement + np.array([0.0, 300.0]), found.amplitude)
    radars.outputs[0].publish(detections.to_msg(turned, SCANS[0].stamp_ns, "radar_1"))
    radars.track(0, radars=(1,))
    status = radars.drops(1)

    assert "azimuths beyond 2 pi rad; probably degrees" in status.message
    values = diagnostics.values_of(status)
    assert values["azimuths_beyond_a_turn"] == str(len(found))
    assert not [name for name in values if name.startswith("dropped_")]


def test_tracker_takes_an_empty_scan_as_a_scan(radars):
    empty = Detections(np.zeros((0, 2)), np.zeros(0))
    for radar in (0, 1):
        radars.outputs[radar].publish(
            detections.to_msg(empty, SCANS[0].stamp_ns, f"radar_{radar + 1}")
        )

    assert radars.peer.spin_until(lambda: len(radars.filtered) == 1)
    assert radars.filtered[0].width == 0
    assert radars.filtered[0].point_step == 4 * 29


def test_tracker_counts_duplicate_and_late_scans(radars):
    radars.track(0)
    radars.track(1)
    radars.send(1, radars=(0,))
    radars.send(0, radars=(0,))
    radars.track(2)
    counts = diagnostics.values_of(radars.drops(1))

    assert counts["dropped_duplicate"] == "1"
    assert counts["dropped_late"] == "1"
    assert len(radars.filtered) == 3


def test_tracker_starts_again_when_stamps_jump_back(radars):
    for index in range(5):
        radars.track(index)
    first = bytes(radars.filtered[0].data)
    radars.track(0)
    assert radars.peer.spin_until(lambda: len(radars.smoothed) == 5)

    assert bytes(radars.filtered[-1].data) == first


def epoch(radars):
    before = len(radars.health)
    assert radars.peer.spin_until(lambda: len(radars.health) > before + 1)
    line = next(s for s in radars.health[-1].status if s.name == "/tracker: step time")
    return int(diagnostics.values_of(line)["epoch"])


def test_tracker_restarts_after_a_long_gap_with_a_warning(processes, peer):
    tracker = processes.start("tracker", "--ros-args", *FAST, *RELIABLE)
    radars = Radars(peer)
    radars.connect()
    hour_ns = 3600 * 10**9
    for index in range(4):
        radars.track(index)
    for index in range(4, 8):
        before = len(radars.filtered)
        radars.send(index, stamp_ns=SCANS[index].stamp_ns + hour_ns)
        assert peer.spin_until(lambda before=before: len(radars.filtered) > before)

    assert epoch(radars) == 1
    assert "stamps jumped ahead by 3606.0 s, more than max_gap_scans" in tracker.log.read_text()
    # All that was held back of the time before has come, whole.
    expected = [SCANS[k].stamp_ns for k in range(4)]
    assert [stamp_of(cloud) for cloud in radars.smoothed][:4] == expected
    found = [set(estimates.from_msg(cloud).track_id.tolist()) - {0} for cloud in radars.filtered]
    assert found[3]
    assert found[7]
    assert not set.union(*found[:4]) & set.union(*found[4:])


def test_tracker_predicts_over_a_short_gap(radars):
    for index in range(3):
        radars.track(index)
    radars.track(15)

    assert epoch(radars) == 0


def test_tracker_goes_on_with_one_radar(radars):
    radars.track(0)
    for index in range(1, 4):
        radars.send(index, radars=(0,))
    # Twice the silent radar is waited for until a later stamp comes, then no longer.
    assert radars.peer.spin_until(lambda: len(radars.filtered) == 4)


def test_tracker_publishes_poses_markers_and_cardinality(processes, peer, radars):
    poses = [peer.collect(PoseArray, f"/tracker/filtered/class_{k}/poses") for k in (0, 1)]
    figures = peer.collect(DiagnosticArray, "/tracker/cardinality")
    latched = QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
    peer.meet()
    for index in range(3):
        radars.track(index)
    # A late joiner still gets the last markers.
    markers = peer.collect(MarkerArray, "/tracker/markers", latched)
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
    assert int(values["particles"]) > 0


def test_tracker_offers_the_contracted_qos(radars):
    offered = {
        topic: radars.peer.node.get_publishers_info_by_topic(topic)[0].qos_profile
        for topic in ("/tracker/filtered/estimates", "/tracker/markers")
    }
    wanted = radars.peer.node.get_subscriptions_info_by_topic("/radar_1/detections")[0].qos_profile

    assert offered["/tracker/filtered/estimates"].reliability == ReliabilityPolicy.RELIABLE
    assert offered["/tracker/markers"].durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert wanted.reliability == ReliabilityPolicy.RELIABLE  # as overridden


def asked_for(peer):
    """Return how reliable the tracker's subscriptions to the first radar are."""
    found = peer.node.get_subscriptions_info_by_topic("/radar_1/detections")
    return [info.qos_profile.reliability for info in found]


def test_busy_tracker_loses_no_cloud_of_a_reliable_radar(processes, peer):
    tracker = processes.start("tracker", "--ros-args", *FAST)
    radars = Radars(peer)
    radars.connect()
    radars.track(0)
    tracker.send_signal(signal.SIGSTOP)  # as in one long step
    for index in range(1, 46):
        radars.send(index)
    tracker.send_signal(signal.SIGCONT)

    assert peer.spin_until(lambda: len(radars.filtered) == 46)
    assert diagnostics.values_of(radars.drops(1))["gaps"] == "0"
    assert diagnostics.values_of(radars.drops(2))["gaps"] == "0"


def test_tracker_receives_a_radar_that_offers_best_effort_only(processes, peer):
    processes.start("tracker", "--ros-args", *FAST)
    assert peer.spin_until(lambda: asked_for(peer) == [ReliabilityPolicy.RELIABLE])
    radars, modest = Radars(peer), QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
    peer.node.destroy_publisher(radars.outputs[0])
    radars.outputs[0] = peer.publisher(PointCloud2, "/radar_1/detections", modest)
    assert peer.spin_until(lambda: asked_for(peer) == [ReliabilityPolicy.BEST_EFFORT])
    radars.connect()
    radars.track(0)
    assert diagnostics.values_of(radars.drops(1))["incompatible_qos"] == "0"


def test_tracker_is_reliable_again_when_its_radar_is(processes, peer):
    processes.start("tracker", "--ros-args", *FAST)
    radars, modest = Radars(peer), QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
    peer.node.destroy_publisher(radars.outputs[0])
    radars.outputs[0] = peer.publisher(PointCloud2, "/radar_1/detections", modest)
    assert peer.spin_until(lambda: asked_for(peer) == [ReliabilityPolicy.BEST_EFFORT])
    peer.node.destroy_publisher(radars.outputs[0])
    radars.outputs[0] = peer.publisher(PointCloud2, "/radar_1/detections", 50)
    assert peer.spin_until(lambda: asked_for(peer) == [ReliabilityPolicy.RELIABLE])
    radars.connect()
    radars.track(0)


def test_tracker_without_amplitudes_warns_once_and_tracks(processes, peer):
    tracker = processes.start(
        "tracker", "--ros-args", *FAST, *RELIABLE, "-p", "radar_1.fields.amplitude:=rcs"
    )
    radars = Radars(peer)
    radars.connect()
    for index in range(3):
        radars.track(index)

    assert len(estimates.from_msg(radars.filtered[-1])) >= 2
    assert tracker.log.read_text().count("no field 'rcs'") == 1


def test_tracker_logs_lost_messages_at_the_end(processes, peer):
    tracker = processes.start("tracker", "--ros-args", *FAST, *RELIABLE)
    group = Radars(peer)
    group.connect()
    group.track(0)
    # While it sleeps more comes than its queues hold.
    tracker.send_signal(signal.SIGSTOP)
    for index in range(1, 60):
        group.send(index, radars=(0,))
    tracker.send_signal(signal.SIGCONT)

    def counted():
        values = diagnostics.values_of(group.drops(1))
        return int(values["received"]) + int(values["gaps"]) == 60

    assert peer.spin_until(counted)
    tracker.send_signal(signal.SIGTERM)

    assert tracker.wait(30.0) == 0
    (said,) = re.findall(r"stopped; .*", tracker.log.read_text())
    received, lost = map(int, re.findall(r"(\d+) clouds received.* radar_1 (\d+), ", said)[0])
    assert lost > 0
    # One of the other radar.
    assert received + lost == 60 + 1
