"""The replay waits for its subscribers, and in lock-step for the tracker's replies."""

import re
import subprocess
import sys

import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from replay_listener import BAG, DEEP, TOPICS, Listener
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import names, stamps
from phd_jdtc_ros.bags.reader import BagReader

BEST_EFFORT = ReliabilityPolicy.BEST_EFFORT
QUIET = ("--ros-args",)


@pytest.fixture
def listener(peer):
    return Listener(peer)


def test_replay_waits_for_its_subscribers(processes, peer):
    process = processes.start("sensor_replay", BAG, "--rate", "1000", *QUIET)
    assert peer.spin_until(lambda: peer.node.count_publishers(names.TRUTH) == 1)
    peer.ticks(50)
    late = Listener(peer)
    assert peer.spin_until(lambda: process.poll() is not None and late.scans == 80)


@pytest.mark.parametrize("tracker", [names.TRACKER, "/west/tracker"])
def test_replay_in_lock_step_publishes_a_stamp_once_the_estimate_came_back(
    processes, peer, tracker
):
    listener = Listener(peer)
    topic = names.estimates("filtered", tracker)
    estimates = peer.publisher(PointCloud2, topic)
    remapped = ("-r", f"{names.estimates('filtered')}:={topic}")
    processes.start("sensor_replay", BAG, "--rate", "0", *QUIET, *remapped)
    assert peer.spin_until(lambda: listener.scans == 1)
    peer.ticks(10)
    assert listener.scans == 1

    for expected in (2, 3, 4):
        cloud = PointCloud2()
        cloud.header.stamp = stamps.from_ns(stamps.of_cdr(listener.data[names.TRUTH][-1]))
        estimates.publish(cloud)
        assert peer.spin_until(lambda expected=expected: listener.scans == expected)
        peer.ticks(10)
        assert listener.scans == expected


def test_replay_in_lock_step_keeps_it_from_one_turn_of_a_loop_to_the_next(processes, peer):
    listener = Listener(peer)
    estimates = peer.publisher(PointCloud2, names.estimates("filtered"))

    def answer(stamp_ns):
        cloud = PointCloud2()
        cloud.header.stamp = stamps.from_ns(stamp_ns)
        estimates.publish(cloud)

    processes.start("sensor_replay", BAG, "--rate", "0", "--loop", "--duration", "6", *QUIET)
    assert peer.spin_until(lambda: listener.scans == 1)
    first = stamps.of_cdr(listener.data[names.TRUTH][0])
    answer(first)
    assert peer.spin_until(lambda: listener.scans == 2)
    last = stamps.of_cdr(listener.data[names.TRUTH][1])
    # The last scan has not been answered, so the next turn does not begin.
    peer.ticks(10)
    assert listener.scans == 2
    answer(last)
    assert peer.spin_until(lambda: listener.scans == 3)
    # An estimate that is late comes from the turn before and answers nothing of this one.
    answer(last)
    peer.ticks(10)
    assert listener.scans == 3
    answer(first)
    assert peer.spin_until(lambda: listener.scans == 4)

    played = [stamps.of_cdr(data) for data in listener.data[names.TRUTH]]
    assert played == [first, last, first, last]


# This replay gives up as soon as a test can wait for.
HASTY = """
import sys
from phd_jdtc_ros.nodes.replay import lock_step, node
lock_step.GIVE_UP_S = 3.0
sys.exit(node.main(sys.argv[1:]))
"""


@pytest.mark.parametrize("on", ["resume", "step"])
def test_replay_in_lock_step_outlasts_a_long_pause(peer, listener, on):
    peer.publisher(PointCloud2, names.estimates("filtered"))
    process = subprocess.Popen([sys.executable, "-c", HASTY, str(BAG), "--rate", "0", *QUIET])
    try:
        assert peer.spin_until(lambda: listener.scans == 1)
        peer.call(Trigger, "/sensor_replay/pause")
        peer.ticks(350)
        before = listener.scans
        peer.call(Trigger, f"/sensor_replay/{on}")
        assert peer.spin_until(lambda: listener.scans > before)
        assert process.poll() is None
    finally:
        process.kill()
        process.wait()


def test_replay_warns_without_subscribers(processes):
    status, text = processes.run(
        *("sensor_replay", BAG, "--rate", "1000"),
        *(*QUIET, "-p", "subscriber_timeout_s:=0.3"),
    )

    assert status == 0
    topics = "/radar_1/detections, /radar_2/detections"
    assert re.search(f"nothing is connected to {topics} after [0-9]+ s: playing", text)


def test_replay_waits_for_the_configured_number_of_subscribers(processes, peer):
    """The peer is the only one."""
    Listener(peer)
    status, text = processes.run(
        *("sensor_replay", BAG, "--rate", "1000", *QUIET),
        *("-p", "subscriber_timeout_s:=3.0", "-p", "subscribers:=2"),
    )

    assert status == 0
    assert "fewer than 2 subscribers are connected to /radar_1/detections, /radar_2/det" in text


def test_replay_without_an_evaluator_hardly_waits_for_one(processes, peer):
    """Far shorter than for the radars' subscribers, whose time is longer than the test has."""
    for topic in TOPICS[:2]:
        peer.collect(PointCloud2, topic, DEEP)
    status, text = processes.run(
        *("sensor_replay", BAG, "--rate", "1000", *QUIET, "-p", "subscriber_timeout_s:=3600.0")
    )

    assert status == 0
    assert re.search(f"nothing is connected to {names.TRUTH} after [0-9]+ s: playing", text)


def test_replay_waits_for_the_truths_subscribers_for_the_configured_time(processes, peer):
    clock = peer.collect(Clock, "/clock", QoSProfile(depth=1, reliability=BEST_EFFORT))
    for topic in TOPICS[:2]:
        peer.collect(PointCloud2, topic, DEEP)
    words = ("-p", "subscriber_timeout_s:=3600.0")
    process = processes.start("sensor_replay", BAG, "--rate", "1000", *QUIET, *words)
    # Longer than it would wait otherwise, by its own clock of 100 Hz.
    assert peer.spin_until(lambda: len(clock) > 200)
    assert {stamps.to_ns(tick.clock) for tick in clock} == {BagReader(BAG).start_ns}
    late = peer.collect(PointCloud2, names.TRUTH, DEEP)
    assert peer.spin_until(lambda: process.poll() is not None and len(late) == 80)
