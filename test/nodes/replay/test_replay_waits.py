"""The replay waits for its subscribers, and in lock-step for the tracker's replies."""

import re

import pytest
from altered_nodes import hasty_replay
from live_radars import options
from replay_listener import BAG, CLOCK_QOS, DEEP, TOPICS, Listener, playing
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters.encoding import names, stamps
from phd_jdtc_ros.bags.reader import BagReader

ESTIMATES = names.estimates("filtered")


@pytest.fixture
def listener(peer):
    return Listener(peer)


def replies(peer, topic=ESTIMATES):
    """Return a function that publishes a tracker's reply to a stamp."""
    output = peer.publisher(PointCloud2, topic)

    def answer(stamp_ns):
        cloud = PointCloud2()
        cloud.header.stamp = stamps.from_ns(stamp_ns)
        output.publish(cloud)

    return answer


def test_replay_waits_for_its_subscribers(processes, peer):
    process = processes.start("sensor_replay", *playing(1000))
    assert peer.spin_until(lambda: peer.node.count_publishers(names.TRUTH) == 1)
    peer.ticks(50)
    late = Listener(peer)
    assert peer.spin_until(lambda: process.poll() is not None and late.scans == 80)


def test_replay_in_lock_step_keeps_it_from_revolution_to_turn_of_a_loop(processes, peer, listener):
    topic = names.estimates("filtered", "/west/tracker")
    answer = replies(peer, topic)
    remapped = ("-r", f"{ESTIMATES}:={topic}")
    processes.start("sensor_replay", *playing(0, "--loop", duration=6), *remapped)

    def played(count):
        """Wait until so many scans have been played, and a while longer."""
        assert peer.spin_until(lambda: listener.scans == count)
        peer.ticks(10)
        assert listener.scans == count
        return stamps.of_cdr(listener.data[names.TRUTH][-1])

    first = played(1)
    answer(first)
    # The last scan has not been answered, so the next revolution does not begin.
    last = played(2)
    answer(last)
    assert played(3) == first
    # An estimate that is late comes from the revolution before and answers nothing of this one.
    answer(last)
    assert played(3) == first
    answer(first)
    assert played(4) == last


@pytest.mark.parametrize("on", ["resume", "step"])
def test_replay_in_lock_step_outlasts_a_long_pause(processes, peer, listener, on):
    replies(peer)
    process = processes.start(hasty_replay, *playing(0))
    assert peer.spin_until(lambda: listener.scans == 1)
    peer.call(Trigger, "/sensor_replay/pause")
    peer.ticks(350)
    before = listener.scans
    peer.call(Trigger, f"/sensor_replay/{on}")
    assert peer.spin_until(lambda: listener.scans > before)
    assert process.poll() is None


def test_replay_warns_without_subscribers(processes):
    status, text = processes.run(
        "sensor_replay", *playing(1000), *options(subscriber_timeout_s=0.3)
    )
    assert status == 0
    topics = "/radar_1/detections, /radar_2/detections"
    assert re.search(f"nothing is connected to {topics} after [0-9]+ s: playing", text)


def test_replay_waits_for_the_configured_number_of_subscribers(processes, listener):
    """The peer is the only one."""
    words = options(subscriber_timeout_s=3.0, subscribers=2)
    status, text = processes.run("sensor_replay", *playing(1000), *words)
    assert status == 0
    assert "fewer than 2 subscribers are connected to /radar_1/detections, /radar_2/det" in text


def test_replay_waits_for_the_truths_subscribers_for_a_limited_time(processes, peer):
    """Far shorter than for the radars' subscribers, whose time is longer than the test has."""
    clock = peer.collect(Clock, "/clock", CLOCK_QOS)
    for topic in TOPICS[:2]:
        peer.collect(PointCloud2, topic, DEEP)
    waiting = options(subscriber_timeout_s=3600.0)
    process = processes.start(hasty_replay, *playing(1000), *waiting)
    # Longer than it would wait otherwise, by its own clock of 100 Hz.
    assert peer.spin_until(lambda: len(clock) > 100)
    assert {stamps.to_ns(tick.clock) for tick in clock} == {BagReader(BAG).start_ns}
    log = peer.said(process, "playing")
    assert re.search(f"nothing is connected to {names.TRUTH} after [2-9] s: playing", log)
    assert process.wait(30.0) == 0
