"""A managed tracker's life, its log, and its optional outputs."""

import re

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from live_radars import (
    SCANS,
    Radars,
    change,
    connected,
    options,
    start_tracker,
    state_of,
    status_of,
)
from nav_msgs.msg import Odometry, Path
from rcl_interfaces.srv import (
    SetParameters,
)
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters import detections, diagnostics, estimates, stamps

LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DETECTIONS = "/radar_1/detections"
ESTIMATES = "/tracker/filtered/estimates"


def test_every_radar_that_is_rejected_is_named_in_the_log(processes, peer):
    tracker = start_tracker(processes)
    group = connected(peer)
    for output in group.outputs:
        output.publish(detections.to_msg(SCANS[0].detections[0], SCANS[0].stamp_ns, "nowhere"))
    assert peer.spin_until(lambda: tracker.log.read_text().count("scan rejected") == 2)
    said = [text for text in tracker.log.read_text().splitlines() if "scan rejected" in text]
    assert [re.search(r"(radar_\d): scan", text)[1] for text in said] == ["radar_1", "radar_2"]


def test_every_transition_is_logged(processes, peer):
    tracker = start_tracker(processes)
    group = connected(peer)
    for index in range(3):
        group.track(index)
    for transition in (
        Transition.TRANSITION_DEACTIVATE,
        Transition.TRANSITION_CLEANUP,
        Transition.TRANSITION_UNCONFIGURED_SHUTDOWN,
    ):
        assert change(peer, transition)
    text = tracker.log.read_text()
    said = [line.split("]: ")[-1] for line in text.splitlines() if "[tracker]: " in line]
    received = "6 clouds received, lost on the way: none, dropped: none"
    assert said[-3:] == [
        f"deactivated, 2 smoothed estimates published; {received}",
        "cleaned up; every parameter may change until the next configure",
        f"shut down from unconfigured; {received}",
    ]


def test_tracks_are_published_as_odometry_and_paths_if_asked_for(processes, peer):
    start_tracker(processes, *options(outputs="[paths, odometry]"))
    group = Radars(peer)
    odometry = peer.collect(Odometry, "/tracker/odometry", 50)
    paths = peer.collect(Path, "/tracker/tracks/path", 50)
    group.connect()
    for index in range(4):
        group.track(index)
    found = estimates.from_msg(group.filtered[-1])
    tracks = sorted(found.track_id[found.track_id > 0].tolist())
    assert tracks

    def latest(messages):
        stamp_ns = SCANS[3].stamp_ns
        return [m for m in messages if stamps.to_ns(m.header.stamp) == stamp_ns]

    assert peer.spin_until(lambda: len(latest(paths)) == len(latest(odometry)) == len(tracks))
    assert [m.child_frame_id for m in latest(odometry)] == [f"track_{k}" for k in tracks]
    lengths = {len(path.poses) for path in latest(paths)}
    assert lengths <= {1, 2, 3, 4}
    assert max(lengths) >= 2
    for path, message in zip(latest(paths), latest(odometry), strict=True):
        assert path.poses[-1].pose == message.pose.pose


def test_paths_begin_before_the_first_who_asks_for_them(processes, peer):
    start_tracker(processes, *options(outputs="[paths]"))
    group = connected(peer)
    for index in range(3):
        group.track(index)
    paths = peer.collect(Path, "/tracker/tracks/path", 50)
    peer.meet()
    group.track(3)
    assert peer.spin_until(lambda: paths)
    assert max(len(path.poses) for path in paths) >= 2


def test_tracks_are_not_published_unless_asked_for(processes, peer):
    start_tracker(processes)
    connected(peer)
    topics = {name for name, _ in peer.node.get_topic_names_and_types()}
    assert "/tracker/markers" in topics
    assert not topics & {"/tracker/odometry", "/tracker/tracks/path"}


def test_markers_can_be_left_out(processes, peer):
    start_tracker(processes, *options(outputs="[plots]"))
    group = connected(peer)
    markers = peer.collect(MarkerArray, "/tracker/markers")
    for index in range(2):
        group.track(index)
    peer.meet(times=2)
    assert markers == []


def test_markers_are_taken_back_when_they_are_switched_off_and_at_a_reset(processes, peer):
    start_tracker(processes)
    group = connected(peer)
    group.track(0)
    late = peer.collect(MarkerArray, "/tracker/markers", LATCHED)

    def cleared():
        return late and [m.action for m in late[-1].markers] == [Marker.DELETEALL]

    def switch(shown):
        outputs = ["detections", "frames", "plots", *(["markers"] if shown else [])]
        parameter = Parameter("outputs", value=outputs).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        assert peer.call(SetParameters, "/tracker/set_parameters", request).results[0].successful

    for index in (1, 2):
        group.track(index)
    assert peer.spin_until(lambda: late and not cleared())
    switch(False)
    assert peer.spin_until(cleared)
    switch(True)
    group.track(3)
    assert peer.spin_until(lambda: not cleared())
    assert peer.call(Trigger, "/tracker/reset").success
    assert peer.spin_until(cleared)


def test_tracker_that_cannot_be_configured_keeps_no_topic(processes, peer, tmp_path):
    path = {"checkpoint.path": tmp_path / "none" / "tracker.ckpt"}
    health = peer.collect(DiagnosticArray, "/diagnostics")
    start_tracker(processes, *options(autostart=False, **path))
    assert not change(peer, Transition.TRANSITION_CONFIGURE)
    assert state_of(peer) == "unconfigured"
    # Discovery is slower than a service, and faster than the second report from now on.
    before = len(health)
    assert peer.spin_until(lambda: len(health) > before + 1)
    assert not peer.node.count_publishers(ESTIMATES)


def test_cleaned_up_tracker_can_be_configured_again_and_is_as_new(processes, peer):
    start_tracker(processes)
    group = connected(peer)
    group.track(0)
    group.track(1)
    first = bytes(group.filtered[0].data)
    assert change(peer, Transition.TRANSITION_DEACTIVATE)
    assert not peer.call(Trigger, "/tracker/flush").success
    assert change(peer, Transition.TRANSITION_CLEANUP)
    assert peer.spin_until(lambda: not peer.node.count_publishers(ESTIMATES))
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    group.connect()
    group.filtered.clear()
    group.track(0)
    assert bytes(group.filtered[0].data) == first
    assert diagnostics.values_of(status_of(group, "radar_1"))["received"] == "1"


def test_tracker_that_cannot_be_configured_stays_unconfigured(processes, peer):
    override = f"qos_overrides.{DETECTIONS}.subscription.reliability:=mostly"
    tracker = start_tracker(processes, *options(autostart=False), qos=("-p", override))
    assert not change(peer, Transition.TRANSITION_CONFIGURE)
    assert state_of(peer) == "unconfigured"
    assert f"not configured: qos_overrides.{DETECTIONS}" in tracker.log.read_text()
    # Nothing of the attempt is left over.
    assert not peer.node.count_publishers(ESTIMATES)


def test_shut_down_tracker_brings_out_what_was_held_back(processes, peer):
    start_tracker(processes)
    group = connected(peer)
    for index in range(3):
        group.track(index)
    assert peer.spin_until(lambda: len(group.smoothed) == 1)
    assert change(peer, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert peer.spin_until(lambda: len(group.smoothed) == 3)
    cloud = detections.to_msg(SCANS[3].detections[0], SCANS[3].stamp_ns, "radar_1")
    group.outputs[0].publish(cloud)
    assert state_of(peer) == "finalized"
