"""A live tracker's diagnostics, and the QoS that they judge."""

import itertools
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from live_radars import (
    SCANS,
    Radars,
    change,
    connected,
    options,
    start_tracker,
    status_of,
    wait_for_level,
)
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from msg_adapters import detections, diagnostics

BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
DETECTIONS = "/radar_1/detections"
ESTIMATES = "/tracker/filtered/estimates"


def test_health_has_one_line_a_radar_one_for_the_step_and_one_for_the_outputs(processes, peer):
    start_tracker(processes)
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
    start_tracker(processes)
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
    start_tracker(processes)
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
    assert diagnostics.values_of(status_of(group, "radar_1"))["gaps"] == "0"


def test_publisher_of_incompatible_qos_is_an_error(processes, peer):
    start_tracker(processes, *options(autostart=False))
    group = Radars(peer)
    for output in group.outputs:
        peer.node.destroy_publisher(output)
    group.outputs = [peer.publisher(PointCloud2, DETECTIONS, BEST_EFFORT)]
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    assert wait_for_level(group, "radar_1", DiagnosticStatus.ERROR)
    found = status_of(group, "radar_1")
    assert found.message.startswith(f"incompatible QoS on {DETECTIONS}: Best effort publisher")
    assert diagnostics.values_of(found)["incompatible_qos"] == "1"


def test_qos_override_is_for_its_topic_alone(processes, peer):
    override = f"qos_overrides.{DETECTIONS}.subscription.reliability:=best_effort"
    start_tracker(processes, "-p", override, qos=())
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
    start_tracker(processes, "-p", override)
    group = connected(peer)  # asks for reliable estimates
    heard = peer.collect(PointCloud2, ESTIMATES, BEST_EFFORT)
    assert wait_for_level(group, "outputs", DiagnosticStatus.WARN)
    values = diagnostics.values_of(status_of(group, "outputs"))
    peer.meet()
    group.send(0)
    assert peer.spin_until(lambda: heard)

    assert values == {f"incompatible_qos {ESTIMATES}": "1"}
    assert not group.filtered


def test_missed_deadline_is_counted(processes, peer):
    override = f"qos_overrides.{DETECTIONS}.subscription.deadline:={300_000_000}"
    start_tracker(processes, "-p", override)
    group = Radars(peer)
    peer.node.destroy_publisher(group.outputs[0])
    offer = QoSProfile(depth=50, deadline=Duration(nanoseconds=200_000_000))
    group.outputs[0] = peer.publisher(PointCloud2, DETECTIONS, offer)
    group.connect()
    group.track(0)
    assert wait_for_level(group, "radar_1", DiagnosticStatus.WARN)
    assert int(diagnostics.values_of(status_of(group, "radar_1"))["deadlines_missed"]) > 0


def test_messages_while_the_tracker_was_inactive_are_not_lost(processes, peer):
    start_tracker(processes, qos=())
    group = connected(peer)
    group.track(0)
    assert change(peer, Transition.TRANSITION_DEACTIVATE)
    for index in range(1, 5):
        group.send(index)
    peer.meet(times=10)
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    group.track(5)
    values = diagnostics.values_of(status_of(group, "radar_1"))
    assert (values["received"], values["gaps"]) == ("2", "0")


def test_wrong_topic_is_reported_with_the_existing_ones(processes, peer):
    tracker = start_tracker(processes, "-p", "radar_2.topic:=/plots")
    group = Radars(peer)
    other = peer.publisher(String, "/plots")
    assert wait_for_level(group, "radar_2", DiagnosticStatus.ERROR)
    assert status_of(group, "radar_2").message == (
        "/plots is published as std_msgs/msg/String, must be sensor_msgs/msg/PointCloud2"
    )
    peer.node.destroy_publisher(other)
    assert wait_for_level(group, "radar_2", DiagnosticStatus.STALE)
    told = (
        "nothing received yet; no publisher on /plots; sensor_msgs/msg/PointCloud2 is on "
        "/radar_2/detections"
    )
    # Its own outputs are of that type too, and the first radar has its topic.
    assert status_of(group, "radar_2").message == told
    assert peer.spin_until(lambda: told in tracker.log.read_text())


def test_noise_set_much_too_large_is_reported(processes, peer):
    wide = {"range_std": 3000.0, "azimuth_std_deg": 10.0}
    given = {f"radar_{k}.{name}": value for k in (1, 2) for name, value in wide.items()}
    start_tracker(processes, *options(**given))
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
    start_tracker(processes, "-r", f"{DETECTIONS}:=/drivers/north/plots")
    group = Radars(peer)
    assert peer.spin_until(lambda: group.health)
    assert diagnostics.values_of(status_of(group, "radar_1"))["topic"] == "/drivers/north/plots"
    assert diagnostics.values_of(status_of(group, "radar_2"))["topic"] == "/radar_2/detections"
    assert peer.node.count_subscribers("/drivers/north/plots") == 1


def test_overload_is_the_trackers_fault_and_not_a_silent_radars(processes, peer):
    """Two radars of some 50 Hz, and so many particles that a step takes several of their scans."""
    many = options(engine="particles", particles_per_target=8000)
    tracker = start_tracker(processes, *many, qos=())
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
    start_tracker(processes, *options(max_wait_s=0.4))
    group = connected(peer)
    group.track(0)
    sent = time.monotonic()
    group.send(1, radars=(0,))
    # How soon is not asked here, because on a busy machine it is not the tracker's doing.
    assert peer.spin_until(lambda: len(group.filtered) == 2)
    assert time.monotonic() - sent >= 0.4
    group.send(1, radars=(1,))  # too late for its scan
    group.track(2)
    assert diagnostics.values_of(status_of(group, "step time"))["closed_by_wait"] == "1"
    assert diagnostics.values_of(status_of(group, "radar_2"))["dropped_late"] == "1"
    assert len(group.filtered) == 3


@pytest.mark.parametrize(
    "wrong", ["depth:=-1", "depth:=deep", "deadline:=-5", "history:=7", "reliability:=mostly"]
)
def test_tracker_refuses_an_impossible_qos(processes, wrong):
    override = f"qos_overrides.{DETECTIONS}.subscription.{wrong}"
    status, text = processes.run("tracker", "--ros-args", "-p", override)
    assert status == 2
    assert f"qos_overrides.{DETECTIONS}" in text
    assert "Traceback" not in text


def test_health_is_reported_while_simulated_time_stands_still(processes, peer):
    start_tracker(processes, *options(use_sim_time=True))
    health = peer.collect(DiagnosticArray, "/diagnostics")
    assert peer.spin_until(lambda: len(health) > 1)
