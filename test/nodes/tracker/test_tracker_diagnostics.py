"""A live tracker's diagnostics, and the QoS that they judge."""

import itertools
import time

import pytest
import reference
from diagnostic_msgs.msg import DiagnosticStatus
from live_radars import (
    SCANS,
    TOPICS,
    Health,
    Radars,
    change,
    connected,
    options,
    reliable,
    start_tracker,
)
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger

from msg_adapters.outgoing import diagnostics

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
DETECTIONS, OTHER = TOPICS
ESTIMATES = "/tracker/filtered/estimates"


def with_publisher(peer, qos):
    """Return radars of which the first publishes with that QoS."""
    group = Radars(peer)
    peer.node.destroy_publisher(group.outputs[0])
    group.outputs[0] = peer.publisher(PointCloud2, DETECTIONS, qos)
    return group


def test_silent_radar_is_noticed_while_the_other_is_tracked(radars, peer):
    """How soon is measured by ``make faults``: on a busy machine it is not the tracker's doing."""
    radars.track(0)
    assert peer.spin_until(
        lambda: {found[-1].level for found in radars.health.all().values()} == {OK}
    )
    assert {name: found[-1].hardware_id for name, found in radars.health.all().items()} == {
        "radar_1": "/tracker/radar_1",
        "radar_2": "/tracker/radar_2",
        "step time": "/tracker",
        "outputs": "/tracker",
        "summary": "/tracker",
    }
    assert radars.health.fresh("summary").message == "all is well"
    assert radars.ask("health") == Trigger.Response(success=True, message="all is well")
    for index in range(1, 8):
        radars.track(index)
        peer.pace(0.2)
    radars.health.reports.clear()

    def stale():
        found = itertools.chain(*radars.health.all().values())
        return [status for status in found if status.level == STALE]

    for index in range(8, 80):
        radars.send(index, radars=(0,))
        if peer.spin_until(stale, 0.2):
            break
    assert {status.name for status in stale()} == {"/tracker: summary", "/tracker: radar_2"}
    told = radars.ask("health")
    assert not told.success
    assert told.message.startswith("radar_2: silent for ")
    values = diagnostics.values_of(stale()[1])
    assert float(values["age_s"]) > 2.0 * float(values["interval_s"])
    # Tracking goes on. The radar's return is noticed, though no scan waited for it.
    assert peer.spin_until(lambda: len(radars.filtered) > 8)
    radars.send(index)
    radars.health.until_level("radar_2", WARN)


def test_publisher_of_incompatible_qos_is_an_error(processes, peer):
    start_tracker(processes, *options(autostart=False))
    group = with_publisher(peer, BEST_EFFORT)
    assert change(peer, "CONFIGURE", "ACTIVATE")
    words = f"incompatible QoS on {DETECTIONS}: Best effort publisher"
    group.health.until_level("radar_1", ERROR, words)
    assert group.health.values("radar_1")["incompatible_qos"] == "1"


def test_qos_override_is_for_its_topic_alone_and_pauses_lose_nothing(processes, peer):
    override = f"qos_overrides.{DETECTIONS}.subscription.reliability:=best_effort"
    start_tracker(processes, "-p", override, qos=reliable(OTHER))
    group = connected(peer)
    wanted = [peer.node.get_subscriptions_info_by_topic(topic)[0].qos_profile for topic in TOPICS]
    assert [qos.reliability for qos in wanted] == [
        ReliabilityPolicy.BEST_EFFORT,
        ReliabilityPolicy.RELIABLE,
    ]
    group.track(0)
    assert change(peer, "DEACTIVATE")
    for index in range(1, 5):
        group.send(index)
    peer.meet(times=10)
    assert change(peer, "ACTIVATE")
    group.track(5)
    values = group.health.values("radar_2")
    assert (values["received"], values["gaps"]) == ("2", "0")


def test_output_qos_can_be_overridden_and_incompatible_subscribers_are_logged(processes, peer):
    override = f"qos_overrides.{ESTIMATES}.publisher.reliability:=best_effort"
    start_tracker(processes, "-p", override)
    group = connected(peer)  # Asks for reliable estimates
    heard = peer.collect(PointCloud2, ESTIMATES, BEST_EFFORT)
    found = group.health.until_level("outputs", WARN)
    peer.meet()
    group.send(0)
    assert peer.spin_until(lambda: heard)
    assert diagnostics.values_of(found) == {f"incompatible_qos {ESTIMATES}": "1"}
    assert not group.filtered


def test_missed_deadline_is_counted(processes, peer):
    override = f"qos_overrides.{DETECTIONS}.subscription.deadline:={300_000_000}"
    start_tracker(processes, "-p", override)
    offer = QoSProfile(depth=50, deadline=Duration(nanoseconds=200_000_000))
    group = with_publisher(peer, offer)
    group.connect()
    group.track(0)
    group.health.until(
        "radar_1", lambda status, v: status.level == WARN and v["deadlines_missed"] > "0"
    )


def test_wrong_and_remapped_topics_are_reported_with_the_existing_ones(processes, peer):
    north = "/drivers/north/plots"
    words = ("-r", f"{DETECTIONS}:={north}", "-p", "radar_2.topic:=/plots")
    tracker = start_tracker(processes, *words)
    health = Health(peer)
    _, used = (peer.publisher(PointCloud2, topic) for topic in (OTHER, north))
    other = peer.publisher(String, "/plots")
    wrong = "/plots is published as std_msgs/msg/String, must be sensor_msgs/msg/PointCloud2"
    assert health.until_level("radar_2", ERROR).message == wrong
    peer.node.destroy_publisher(other)
    peer.settled(used)
    told = (
        f"nothing received yet; no publisher on /plots; sensor_msgs/msg/PointCloud2 is on {OTHER}"
    )
    # Its own outputs are of that type too, and the first radar has its topic.
    assert health.until_level("radar_2", STALE, "no publisher").message == told
    peer.said(tracker, told)
    assert health.values("radar_1")["topic"] == north
    assert peer.node.count_subscribers(north) == 1


def test_noise_set_much_too_large_is_reported(processes, peer):
    wide = {"range_std": 3000.0, "azimuth_std_deg": 10.0}
    # Noise that is learned becomes the true one.
    wide["learn"] = []
    given = {f"radar_{k}.{name}": value for k in (1, 2) for name, value in wide.items()}
    start_tracker(processes, *options(**given))
    group = connected(peer)

    def reported():
        found = itertools.chain(*group.health.all().values())
        return any(" times smaller than the noise predicts" in s.message for s in found)

    for index in range(len(SCANS)):
        group.track(index)
        # Reports once a second, of a radar that is not silent meanwhile.
        if index > 30 and peer.spin_until(reported, 0.2):
            break
    assert reported()


def test_overload_is_the_trackers_fault_and_not_a_silent_radars(processes, peer):
    """Two radars of some 50 Hz, and so many particles that a step takes several of their scans."""
    given = {"engine": "phd", "particles": [8000]}
    many = options(**reference.parameters(given))
    tracker = start_tracker(processes, *many, qos=())
    group = connected(peer)
    for index in range(3000):
        group.send(index % 40, stamp_ns=SCANS[0].stamp_ns + index * 20_000_000)
        peer.pace(0.02)
        found = {name: {s.message for s in all_} for name, all_ in group.health.all().items()}
        step = [text for text in found.get("step time", ()) if "overloaded" in text]
        radars = [found.get(f"radar_{k}", set()) for k in (1, 2)]
        lost = [[text for text in texts if "lost" in text] for texts in radars]
        if step and all(lost):
            break
    tracker.kill()  # It would finish its step first
    assert step, found
    assert "turn down accuracy, particles" in step[0]
    for texts in lost:
        assert texts
        assert all("the tracker is too slow" in text for text in texts), found
    assert not [text for texts in radars for text in texts if text.startswith("silent")], found


def test_wait_by_the_wall_clock_closes_a_scan_and_is_counted(processes, peer):
    """Also where simulated time stands still: here there is no /clock."""
    start_tracker(processes, *options(max_wait_s=0.4, use_sim_time=True))
    group = connected(peer)
    group.track(0)
    sent = time.monotonic()
    group.send(1, radars=(0,))
    # How soon is not asked here, because on a busy machine it is not the tracker's doing.
    assert peer.spin_until(lambda: len(group.filtered) == 2)
    assert time.monotonic() - sent >= 0.4
    group.send(1, radars=(1,))  # Too late for its scan
    group.track(2)
    assert group.health.values("step time")["closed_by_wait"] == "1"
    assert group.health.values("radar_2")["dropped_late"] == "1"
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
