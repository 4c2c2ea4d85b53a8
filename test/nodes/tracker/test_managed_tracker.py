"""A managed tracker's life, its log, and its optional outputs."""

import re

from live_radars import (
    SCANS,
    TOPICS,
    Health,
    change,
    cloud,
    connected,
    options,
    start_tracker,
    state_of,
)
from nav_msgs.msg import Odometry, Path
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters.encoding import stamps
from msg_adapters.targets import estimates

LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ESTIMATES = "/tracker/filtered/estimates"


def test_every_rejected_radar_and_every_transition_is_logged(processes, peer):
    tracker = start_tracker(processes)
    group = connected(peer)
    for output in group.outputs:
        output.publish(cloud(0, 0, frame="nowhere"))
    log = peer.said(tracker, "scan rejected", times=2)
    assert re.findall(r"(radar_\d): scan rejected", log) == ["radar_1", "radar_2"]
    group.track_all(0, 1, 2)
    assert change(peer, "DEACTIVATE", "CLEANUP", "UNCONFIGURED_SHUTDOWN")
    text = tracker.log.read_text()
    said = [line.split("]: ")[-1] for line in text.splitlines() if "[tracker]: " in line]
    received = "8 clouds received, lost on the way: none, dropped: radar_1 frame 1, radar_2 frame 1"
    assert said[-3:] == [
        f"deactivated, 2 smoothed estimates published; {received}",
        "cleaned up; every parameter may change until the next configure",
        f"shut down from unconfigured; {received}",
    ]


def test_tracks_are_published_as_odometry_and_paths_from_their_beginning(processes, peer):
    start_tracker(processes, *options(outputs="[paths, odometry]"))
    group = connected(peer)
    markers = peer.collect(MarkerArray, "/tracker/markers")
    # Paths begin before the first who asks for them.
    group.track_all(0, 1, 2)
    odometry = peer.collect(Odometry, "/tracker/odometry", 50)
    paths = peer.collect(Path, "/tracker/tracks/path", 50)
    peer.meet()
    group.track(3)
    found = estimates.from_msg(group.filtered[-1])
    tracks = sorted(found.track_id[found.track_id > 0].tolist())
    assert tracks

    def latest(messages):
        # The scan before may still be on its way when the first one asks.
        return [m for m in messages if stamps.to_ns(m.header.stamp) == SCANS[3].stamp_ns]

    assert peer.spin_until(lambda: len(latest(paths)) == len(latest(odometry)) == len(tracks))
    assert [m.child_frame_id for m in latest(odometry)] == [f"track_{k}" for k in tracks]
    lengths = {len(path.poses) for path in latest(paths)}
    assert lengths <= {1, 2, 3, 4}
    assert max(lengths) >= 2
    for path, message in zip(latest(paths), latest(odometry), strict=True):
        assert path.poses[-1].pose == message.pose.pose
    # An output that is not asked for is left out.
    assert markers == []


def test_markers_are_taken_back_when_they_are_switched_off_and_at_a_reset(radars, peer):
    radars.track(0)
    late = peer.collect(MarkerArray, "/tracker/markers", LATCHED)

    def cleared():
        return late and [m.action for m in late[-1].markers] == [Marker.DELETEALL]

    def switch(shown):
        outputs = ["detections", "frames", "curves", *(["markers"] if shown else [])]
        parameter = Parameter("outputs", value=outputs).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        assert peer.call(SetParameters, "/tracker/set_parameters", request).results[0].successful

    radars.track_all(1, 2)
    assert peer.spin_until(lambda: late and not cleared())
    switch(False)
    assert peer.spin_until(cleared)
    switch(True)
    radars.track(3)
    assert peer.spin_until(lambda: not cleared())
    assert radars.ask("reset").success
    assert peer.spin_until(cleared)


def test_tracker_that_cannot_be_configured_stays_so_and_keeps_no_topic(processes, peer, tmp_path):
    wrong = {
        "/a": (f"qos_overrides.{TOPICS[0]}.subscription.reliability", "mostly"),
        "/b": ("checkpoint.path", tmp_path / "none" / "tracker.ckpt"),
    }
    for site, (name, value) in wrong.items():
        given = options(**{"autostart": False, name: value})
        tracker = start_tracker(processes, "-r", f"__ns:={site}", *given, qos=())
        health = Health(peer, f"{site}/tracker")
        assert not change(peer, "CONFIGURE", node=f"{site}/tracker")
        assert "not configured: " in tracker.log.read_text()
        assert name.removesuffix(".subscription.reliability") in tracker.log.read_text()
        # Discovery is slower than a service, and faster than the second report from now on.
        assert health.fresh("step time").message == "the tracker is unconfigured"
        assert not peer.node.count_publishers(f"{site}{ESTIMATES}")


def test_cleaned_up_tracker_can_be_configured_again_and_is_as_new(radars, peer):
    topics = {name for name, _ in peer.node.get_topic_names_and_types()}
    assert "/tracker/markers" in topics
    assert not topics & {"/tracker/odometry", "/tracker/tracks/path"}
    first, *_ = radars.track_all(0, 1)
    assert change(peer, "DEACTIVATE")
    assert not radars.ask("flush").success
    assert change(peer, "CLEANUP")
    assert peer.spin_until(lambda: not peer.node.count_publishers(ESTIMATES))
    assert change(peer, "CONFIGURE", "ACTIVATE")
    radars.connect()
    assert radars.track(0) == first
    assert radars.health.values("radar_1")["received"] == "1"


def test_shut_down_tracker_brings_out_what_was_held_back(radars, peer):
    radars.track_all(0, 1, 2)
    radars.until_smoothed(1)
    assert change(peer, "ACTIVE_SHUTDOWN")
    radars.until_smoothed(3)
    radars.send(3)
    assert state_of(peer) == "finalized"
