"""What an operator sees of a live tracker: its life, its diagnostics, its optional outputs."""

import itertools
import re
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import GetState
from live_radars import FAST, RELIABLE, SCANS, Radars, change
from nav_msgs.msg import Odometry, Path
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
)
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters import detections, diagnostics, estimates, stamps

BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DETECTIONS = "/radar_1/detections"
ESTIMATES = "/tracker/filtered/estimates"


def start(processes, *arguments, qos=RELIABLE):
    return processes.start("tracker", "--ros-args", *FAST, *qos, *arguments)


def options(**values):
    return [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]


def line(group, name):
    """Return the line of that name in the next health report but one."""
    before = len(group.health)
    assert group.peer.spin_until(lambda: len(group.health) > before + 1)
    return next(s for s in group.health[-1].status if s.name == f"/tracker: {name}")


def wait_for_level(group, name, level):
    def reached():
        return any(s.name == f"/tracker: {name}" and s.level == level for s in statuses())

    def statuses():
        return group.health[-1].status if group.health else ()

    return group.peer.spin_until(reached)


def state(peer):
    return peer.call(GetState, "/tracker/get_state").current_state.label


def connected(peer):
    group = Radars(peer)
    group.connect()
    return group


def test_health_has_one_line_a_radar_one_for_the_step_and_one_for_the_outputs(processes, peer):
    start(processes)
    group = connected(peer)
    group.track(0)
    found = group.health
    assert peer.spin_until(
        lambda: found and {s.level for s in found[-1].status} == {DiagnosticStatus.OK}
    )
    assert {(s.name, s.hardware_id) for s in found[-1].status} == {
        ("/tracker: radar_1", "/tracker/radar_1"),
        ("/tracker: radar_2", "/tracker/radar_2"),
        ("/tracker: step time", "/tracker"),
        ("/tracker: outputs", "/tracker"),
    }


def test_silent_radar_is_noticed_while_the_other_is_tracked(processes, peer):
    """How soon is measured by ``make faults``: on a busy machine it is not the tracker's doing."""
    start(processes)
    group = connected(peer)
    for index in range(8):
        group.track(index)
        peer.pace(0.2)
    group.health.clear()

    def reported():
        return [s for m in group.health for s in m.status if s.level == DiagnosticStatus.STALE]

    for index in range(8, 80):
        group.send(index, radars=(0,))
        if peer.spin_until(reported, 0.2):
            break
    assert {s.name for s in reported()} == {"/tracker: radar_2"}
    values = diagnostics.values_of(reported()[0])
    assert float(values["age_s"]) > 2.0 * float(values["interval_s"])
    # Tracking goes on. The radar's return is noticed, though no scan waited for it.
    assert peer.spin_until(lambda: len(group.filtered) > 8)
    group.send(index)
    assert wait_for_level(group, "radar_2", DiagnosticStatus.WARN)


def test_second_publisher_is_an_error_while_it_publishes(processes, peer):
    start(processes)
    group = connected(peer)
    other = peer.publisher(PointCloud2, DETECTIONS, 50)
    assert peer.spin_until(lambda: other.get_subscription_count() and group.health)
    scans = iter(enumerate(SCANS))

    def first_until(fitting, both):
        """Send scans until the first radar's level fits; return its line."""
        for index, scan in scans:
            group.send(index)
            if both:
                other.publish(detections.to_msg(scan.detections[0], scan.stamp_ns, "radar_1"))
            peer.pace(0.3)
            first, second, *_ = group.health[-1].status
            assert second.level != DiagnosticStatus.ERROR
            if fitting(first.level):
                return first
        pytest.fail("no such level")

    listed = first_until(lambda level: level == DiagnosticStatus.WARN, both=False)
    assert listed.message.startswith("2 publishers listed")
    several = first_until(lambda level: level == DiagnosticStatus.ERROR, both=True)
    assert several.message == f"several publishers on {DETECTIONS}, must be one"
    peer.node.destroy_publisher(other)
    first_until(lambda level: level != DiagnosticStatus.ERROR, both=False)
    assert diagnostics.values_of(line(group, "radar_1"))["gaps"] == "0"


def test_publisher_of_incompatible_qos_is_an_error(processes, peer):
    start(processes, *options(autostart=False))
    group = Radars(peer)
    for output in group.outputs:
        peer.node.destroy_publisher(output)
    group.outputs = [peer.publisher(PointCloud2, DETECTIONS, BEST_EFFORT)]
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    assert wait_for_level(group, "radar_1", DiagnosticStatus.ERROR)
    found = line(group, "radar_1")
    assert found.message.startswith(f"incompatible QoS on {DETECTIONS}: Best effort publisher")
    assert diagnostics.values_of(found)["incompatible_qos"] == "1"


def test_qos_override_is_for_its_topic_alone(processes, peer):
    override = f"qos_overrides.{DETECTIONS}.subscription.reliability:=best_effort"
    start(processes, "-p", override, qos=())
    group = connected(peer)
    wanted = [
        group.peer.node.get_subscriptions_info_by_topic(f"/radar_{k}/detections")[0].qos_profile
        for k in (1, 2)
    ]
    assert [qos.reliability for qos in wanted] == [
        ReliabilityPolicy.BEST_EFFORT,
        ReliabilityPolicy.RELIABLE,
    ]


def test_output_qos_can_be_overridden_and_incompatible_subscribers_are_logged(processes, peer):
    override = f"qos_overrides.{ESTIMATES}.publisher.reliability:=best_effort"
    start(processes, "-p", override)
    group = connected(peer)  # asks for reliable estimates
    heard = peer.collect(PointCloud2, ESTIMATES, BEST_EFFORT)
    assert wait_for_level(group, "outputs", DiagnosticStatus.WARN)
    values = diagnostics.values_of(line(group, "outputs"))
    peer.meet()
    group.send(0)
    assert peer.spin_until(lambda: heard)

    assert values == {f"incompatible_qos {ESTIMATES}": "1"}
    assert not group.filtered


def test_missed_deadline_is_counted(processes, peer):
    override = f"qos_overrides.{DETECTIONS}.subscription.deadline:={300_000_000}"
    start(processes, "-p", override)
    group = Radars(peer)
    peer.node.destroy_publisher(group.outputs[0])
    offer = QoSProfile(depth=50, deadline=Duration(nanoseconds=200_000_000))
    group.outputs[0] = peer.publisher(PointCloud2, DETECTIONS, offer)
    group.connect()
    group.track(0)
    assert wait_for_level(group, "radar_1", DiagnosticStatus.WARN)
    assert int(diagnostics.values_of(line(group, "radar_1"))["deadlines_missed"]) > 0


def test_messages_while_the_tracker_was_inactive_are_not_lost(processes, peer):
    start(processes, qos=())
    group = connected(peer)
    group.track(0)
    assert change(peer, Transition.TRANSITION_DEACTIVATE)
    for index in range(1, 5):
        group.send(index)
    peer.meet(times=10)
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    group.track(5)
    values = diagnostics.values_of(line(group, "radar_1"))
    assert (values["received"], values["gaps"]) == ("2", "0")


def test_wrong_topic_is_reported_with_the_existing_ones(processes, peer):
    tracker = start(processes, "-p", "radar_2.topic:=/plots")
    group = Radars(peer)
    other = peer.publisher(String, "/plots")
    assert wait_for_level(group, "radar_2", DiagnosticStatus.ERROR)
    assert line(group, "radar_2").message == (
        "/plots is published as std_msgs/msg/String, must be sensor_msgs/msg/PointCloud2"
    )
    peer.node.destroy_publisher(other)
    assert wait_for_level(group, "radar_2", DiagnosticStatus.STALE)
    told = (
        "nothing received yet; no publisher on /plots; sensor_msgs/msg/PointCloud2 is on "
        "/radar_2/detections"
    )
    # Its own outputs are of that type too, and the first radar has its topic.
    assert line(group, "radar_2").message == told
    assert peer.spin_until(lambda: told in tracker.log.read_text())


def test_noise_set_much_too_large_is_reported(processes, peer):
    wide = {"range_std": 3000.0, "azimuth_std_deg": 10.0}
    start(processes, *options(**{f"radar_{k}.{n}": v for k in (1, 2) for n, v in wide.items()}))
    group = connected(peer)

    def reported():
        statuses = [s for message in group.health for s in message.status]
        return any(" times smaller than the noise predicts" in s.message for s in statuses)

    for index in range(len(SCANS)):
        group.track(index)
        # Reports once a second, of a radar that is not silent meanwhile.
        if index > 30 and peer.spin_until(reported, 0.2):
            break
    assert reported()


def test_diagnostics_show_a_radars_topic_after_remapping(processes, peer):
    start(processes, "-r", f"{DETECTIONS}:=/drivers/north/plots")
    group = Radars(peer)
    assert peer.spin_until(lambda: group.health)
    assert diagnostics.values_of(line(group, "radar_1"))["topic"] == "/drivers/north/plots"
    assert diagnostics.values_of(line(group, "radar_2"))["topic"] == "/radar_2/detections"
    assert peer.node.count_subscribers("/drivers/north/plots") == 1


def test_every_radar_that_is_rejected_is_named_in_the_log(processes, peer):
    tracker = start(processes)
    group = connected(peer)
    for output in group.outputs:
        output.publish(detections.to_msg(SCANS[0].detections[0], SCANS[0].stamp_ns, "nowhere"))
    assert peer.spin_until(lambda: tracker.log.read_text().count("scan rejected") == 2)
    said = [text for text in tracker.log.read_text().splitlines() if "scan rejected" in text]
    assert [re.search(r"(radar_\d): scan", text)[1] for text in said] == ["radar_1", "radar_2"]


def test_every_transition_is_logged(processes, peer):
    tracker = start(processes)
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


def test_overload_is_the_trackers_fault_and_not_a_silent_radars(processes, peer):
    """Two radars of some 50 Hz, and so many particles that a step takes several of their scans."""
    many = options(engine="particles", particles_per_target=8000)
    tracker = start(processes, *many, qos=())
    group = connected(peer)
    found = {}
    for index in itertools.count():
        stamp_ns = SCANS[0].stamp_ns + index * 20_000_000
        group.send(index % 40, stamp_ns=stamp_ns)
        peer.pace(0.02)
        for message in group.health:
            for status in message.status:
                found.setdefault(status.name, set()).add((status.level, status.message))
        group.health.clear()
        step = [text for _, text in found.get("/tracker: step time", ()) if "overloaded" in text]
        lost = {
            radar: [text for _, text in found.get(radar, ()) if "lost" in text]
            for radar in ("/tracker: radar_1", "/tracker: radar_2")
        }
        if (step and all(lost.values())) or index > 3000:
            break
    tracker.kill()  # it would finish its step first
    assert step, found
    assert "turn down accuracy, particles_per_target" in step[0]
    for radar, texts in lost.items():
        assert all("the tracker is too slow" in text for text in texts), found
        assert texts
        assert not [text for _, text in found[radar] if text.startswith("silent")], found


def test_wait_by_the_wall_clock_closes_a_scan_and_is_counted(processes, peer):
    start(processes, *options(max_wait_s=0.4))
    group = connected(peer)
    group.track(0)
    sent = time.monotonic()
    group.send(1, radars=(0,))
    # How soon is not asked here, because on a busy machine it is not the tracker's doing.
    assert peer.spin_until(lambda: len(group.filtered) == 2)
    assert time.monotonic() - sent >= 0.4
    group.send(1, radars=(1,))  # too late for its scan
    group.track(2)
    assert diagnostics.values_of(line(group, "step time"))["closed_by_wait"] == "1"
    assert diagnostics.values_of(line(group, "radar_2"))["dropped_late"] == "1"
    assert len(group.filtered) == 3


def test_tracks_are_published_as_odometry_and_paths_if_asked_for(processes, peer):
    start(processes, *options(outputs="[paths, odometry]"))
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
    start(processes, *options(outputs="[paths]"))
    group = connected(peer)
    for index in range(3):
        group.track(index)
    paths = peer.collect(Path, "/tracker/tracks/path", 50)
    peer.meet()
    group.track(3)
    assert peer.spin_until(lambda: paths)
    assert max(len(path.poses) for path in paths) >= 2


def test_tracks_are_not_published_unless_asked_for(processes, peer):
    start(processes)
    connected(peer)
    topics = {name for name, _ in peer.node.get_topic_names_and_types()}
    assert "/tracker/markers" in topics
    assert not topics & {"/tracker/odometry", "/tracker/tracks/path"}


def test_markers_can_be_left_out(processes, peer):
    start(processes, *options(outputs="[plots]"))
    group = connected(peer)
    markers = peer.collect(MarkerArray, "/tracker/markers")
    for index in range(2):
        group.track(index)
    peer.meet(times=2)
    assert markers == []


def test_markers_are_taken_back_when_they_are_switched_off_and_at_a_reset(processes, peer):
    start(processes)
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
    start(processes, *options(autostart=False, **path))
    assert not change(peer, Transition.TRANSITION_CONFIGURE)
    assert state(peer) == "unconfigured"
    # Discovery is slower than a service, and faster than the second report from now on.
    before = len(health)
    assert peer.spin_until(lambda: len(health) > before + 1)
    assert not peer.node.count_publishers(ESTIMATES)


def test_cleaned_up_tracker_can_be_configured_again_and_is_as_new(processes, peer):
    start(processes)
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
    assert diagnostics.values_of(line(group, "radar_1"))["received"] == "1"


def test_tracker_that_cannot_be_configured_stays_unconfigured(processes, peer):
    override = f"qos_overrides.{DETECTIONS}.subscription.reliability:=mostly"
    tracker = start(processes, *options(autostart=False), qos=("-p", override))
    assert not change(peer, Transition.TRANSITION_CONFIGURE)
    assert state(peer) == "unconfigured"
    assert f"not configured: qos_overrides.{DETECTIONS}" in tracker.log.read_text()
    # Nothing of the attempt is left over.
    assert not peer.node.count_publishers(ESTIMATES)


@pytest.mark.parametrize(
    "wrong", ["depth:=-1", "depth:=deep", "deadline:=-5", "history:=7", "reliability:=mostly"]
)
def test_tracker_refuses_an_impossible_qos(processes, wrong):
    override = f"qos_overrides.{DETECTIONS}.subscription.{wrong}"
    status, text = processes.run("tracker", "--ros-args", "-p", override)
    assert status == 2
    assert f"qos_overrides.{DETECTIONS}" in text
    assert "Traceback" not in text


def test_single_parameters_are_set_and_refused_one_by_one(processes, peer):
    start(processes)
    assert peer.spin_until(lambda: state(peer) == "active")
    wanted = {"radar_1.clutter_rate": 30, "lag": 4, "use_sim_time": True, "survival": 1.0}
    request = SetParameters.Request(
        parameters=[Parameter(n, value=v).to_parameter_msg() for n, v in wanted.items()]
    )
    results = peer.call(SetParameters, "/tracker/set_parameters", request).results
    assert [(r.successful, r.reason) for r in results] == [
        (True, ""),
        (False, "lag: cannot change while the tracker is configured, clean it up before"),
        (True, ""),
        (False, "survival: unknown parameter"),
    ]


def test_own_parameters_given_again_are_no_change(processes, peer):
    """As by ``ros2 param load`` of what ``ros2 param dump`` has written."""
    tracker = start(processes)
    assert peer.spin_until(lambda: state(peer) == "active")
    names = peer.call(ListParameters, "/tracker/list_parameters").result.names
    values = peer.call(
        GetParameters, "/tracker/get_parameters", GetParameters.Request(names=names)
    ).values
    own = [ParameterMessage(name=n, value=v) for n, v in zip(names, values, strict=True)]
    threshold = next(p for p in own if p.name == "confirm_probability")
    threshold.value.double_value = 0.875
    request = SetParameters.Request(parameters=own)
    results = peer.call(SetParameters, "/tracker/set_parameters", request).results
    refused = [p.name for p, result in zip(own, results, strict=True) if not result.successful]
    # What rclpy declares for itself is read-only.
    assert all(name.startswith(("qos_overrides.", "start_type")) for name in refused), refused
    assert len(own) > 50
    assert peer.spin_until(lambda: "changed: " in tracker.log.read_text())
    (line,) = [row for row in tracker.log.read_text().splitlines() if "changed: " in row]
    assert line.endswith("changed: confirm_probability 0.875")


def test_parameters_have_descriptions_ranges_and_whether_they_may_change(processes, peer):
    start(processes)
    assert peer.spin_until(lambda: state(peer) == "active")
    asked = ["confirm_probability", "lag", "checkpoint.every"]
    request = DescribeParameters.Request(names=asked)
    reply = peer.call(DescribeParameters, "/tracker/describe_parameters", request)
    threshold, lag, every = reply.descriptors
    assert not any(d.read_only for d in reply.descriptors)
    when = "; changes while the node is not configured"
    told = [d.additional_constraints.endswith(when) for d in reply.descriptors]
    assert told == [False, True, True]
    assert (threshold.floating_point_range[0].to_value, lag.dynamic_typing) == (1.0, True)
    assert (
        every.description
        == "Number of scans between checkpoints; 0 for checkpoints on request only."
    )
    assert every.integer_range[0].to_value == 10**6


def set_one_by_one(peer, **values):
    request = SetParameters.Request(
        parameters=[
            Parameter(name.replace("__", "."), value=value).to_parameter_msg()
            for name, value in values.items()
        ]
    )
    return peer.call(SetParameters, "/tracker/set_parameters", request).results


def test_every_parameter_may_change_after_a_cleanup(processes, peer):
    start(processes)
    group = connected(peer)
    group.track(0)
    assert change(peer, Transition.TRANSITION_DEACTIVATE)
    (refused,) = set_one_by_one(peer, lag=3)
    assert not refused.successful
    assert change(peer, Transition.TRANSITION_CLEANUP)

    # One by one they do not fit together for a while, in whatever order they come.
    results = set_one_by_one(
        peer,
        lag=3,
        sensors=["radar_1", "north"],
        north__topic="/north/plots",
        detection_births__rates=[0.1],
        births=[],
        outputs=["paths"],
    )
    assert [result.successful for result in results] == [True] * 6
    assert "detection_births.rates" in results[3].reason
    (wrong,) = set_one_by_one(peer, radar_2__topic="/gone")
    assert (wrong.successful, wrong.reason) == (False, "radar_2.topic: unknown parameter")
    assert not change(peer, Transition.TRANSITION_CONFIGURE)
    assert state(peer) == "unconfigured"

    (right,) = set_one_by_one(peer, detection_births__rates=[])
    assert right.successful
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    assert peer.spin_until(lambda: peer.node.count_subscribers("/north/plots"))
    assert not peer.node.count_subscribers("/radar_2/detections")
    assert peer.spin_until(lambda: peer.node.count_publishers("/tracker/tracks/path"))
    (locked,) = set_one_by_one(peer, lag=4)
    assert locked.reason == "lag: cannot change while the tracker is configured, clean it up before"


def test_health_is_reported_while_simulated_time_stands_still(processes, peer):
    start(processes, *options(use_sim_time=True))
    health = peer.collect(DiagnosticArray, "/diagnostics")
    assert peer.spin_until(lambda: len(health) > 1)


def test_shut_down_tracker_brings_out_what_was_held_back(processes, peer):
    start(processes)
    group = connected(peer)
    for index in range(3):
        group.track(index)
    assert peer.spin_until(lambda: len(group.smoothed) == 1)
    assert change(peer, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert peer.spin_until(lambda: len(group.smoothed) == 3)
    cloud = detections.to_msg(SCANS[3].detections[0], SCANS[3].stamp_ns, "radar_1")
    group.outputs[0].publish(cloud)
    assert state(peer) == "finalized"
