"""What the replay of a bag publishes, and how it is controlled."""

import os
import pty
import signal
import subprocess
import sys

import pytest
from altered_nodes import hasty_replay
from live_radars import options
from mcap_files import write
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from replay_listener import BAG, CLOCK_QOS, DEEP, TOPICS, Listener, playing
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger

from msg_adapters.encoding import interfaces, names, stamps
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.nodes.playback import GIVE_UP_S

AT_ONCE = options(subscriber_timeout_s=0.0)
SECOND = 10**9


def seek(peer, seconds):
    parameter = Parameter("start_s", value=seconds).to_parameter_msg()
    request = SetParametersAtomically.Request(parameters=[parameter])
    service = "/sensor_replay/set_parameters_atomically"
    return peer.call(SetParametersAtomically, service, request).result


@pytest.fixture
def listener(peer):
    return Listener(peer)


def played_s(listener):
    """Return the stamps of the truth, seconds since the bag's start."""
    start = BagReader(BAG).start_ns
    return [(stamps.of_cdr(data) - start) / SECOND for data in listener.data[names.TRUTH]]


def test_replay_publishes_the_bags_bytes_as_they_are(processes, peer, listener):
    process = processes.start("sensor_replay", *playing(1000))
    assert peer.spin_until(lambda: process.poll() is not None and listener.scans == 80)
    assert process.returncode == 0
    for topic in TOPICS:
        recorded = [message.data for message in BagReader(BAG).messages([topic])]
        assert len(listener.data[topic]) == len(recorded)
        for arrived, data in zip(listener.data[topic], recorded, strict=True):
            # The middleware fills messages up to whole words of four bytes.
            assert arrived[: len(data)] == data
            assert len(arrived) - len(data) < 4
    counts = ", ".join(f"{topic} 80" for topic in TOPICS)
    assert f"published: {counts}\n" in process.log.read_text()


def test_replay_has_a_clock_that_shows_every_stamp_and_what_is_between(processes, peer, listener):
    """How fast the clock ticks is measured by ``make bench``."""
    ticks = []

    def tick(message):
        ticks.append(stamps.to_ns(message.clock))

    # Deep, so that a late reader loses no tick.
    deep = QoSProfile(depth=1000, reliability=CLOCK_QOS.reliability)
    peer.node.create_subscription(Clock, "/clock", tick, deep)
    # Scans are 6 s apart, so 0.1 s at 60 times the speed.
    process = processes.start("sensor_replay", *playing(60, duration=120))
    assert peer.spin_until(lambda: process.poll() is not None and listener.scans == 21)

    assert process.returncode == 0
    recorded = [stamps.of_cdr(data) for data in listener.data[names.TRUTH]]
    assert set(ticks) >= set(recorded)
    assert ticks == sorted(ticks)
    assert set(ticks) - set(recorded)


def test_replay_pauses_steps_seeks_and_resumes(processes, peer, listener):
    processes.start("sensor_replay", *playing(30, "--start-paused"))
    # A whole number is a number too.
    for scans, seconds in enumerate((60.0, 6, 57.5), start=1):
        assert seek(peer, seconds).successful
        peer.call(Trigger, "/sensor_replay/step")
        assert peer.spin_until(lambda scans=scans: listener.scans == scans)
    peer.ticks(50)
    assert played_s(listener) == [60.0, 6.0, 60.0]
    peer.call(Trigger, "/sensor_replay/resume")
    assert peer.spin_until(lambda: listener.scans >= 6)
    peer.call(Trigger, "/sensor_replay/pause")
    peer.meet("/sensor_replay")
    held = listener.scans
    peer.ticks(60)
    assert listener.scans == held


def test_replay_loops_the_chosen_part_and_refuses_to_seek_outside(processes, peer, listener):
    processes.start(
        "sensor_replay", *playing(1000, "--start-paused", "--loop", start=12, duration=12)
    )
    for seconds in (11.9, 24.1, -1.0, float("nan"), "soon"):
        result = seek(peer, seconds)
        assert not result.successful
        assert result.reason == f"start_s: {seconds} given, must be a number from 12 to 24"
    peer.call(Trigger, "/sensor_replay/resume")
    assert peer.spin_until(lambda: listener.scans >= 7)
    assert played_s(listener)[:6] == [12.0, 18.0, 24.0] * 2


def test_replay_plays_foreign_topics_and_warns_once_of_unknown_ones(processes, peer, tmp_path):
    notes, latched, radar = [], [], names.detections("radar_1")
    peer.node.create_subscription(String, "/elsewhere", notes.append, DEEP)
    once = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    peer.node.create_subscription(String, "/tf_static", latched.append, once)
    topics = {
        radar: names.CLOUD,
        "/note": "std_msgs/msg/String",
        # Any installed type will do; the name matters.
        "/tf_static": "std_msgs/msg/String",
        "/other": "nobody_has_this/msg/Thing",
    }
    messages = [("/tf_static", 0, interfaces.encode(String(data="static")))]
    for k in range(1, 4):
        messages += [
            (radar, k * SECOND, interfaces.encode(PointCloud2())),
            ("/note", k * SECOND + 1, interfaces.encode(String(data=f"note {k}"))),
            ("/other", k * SECOND + 2, b"1234"),
        ]
    listener = Listener(peer)
    path = write(tmp_path / "foreign.mcap", topics, messages)
    words = playing(10, bag=path, start=0.5)
    process = processes.start("sensor_replay", *words, "-r", "/note:=/elsewhere")
    assert peer.spin_until(lambda: process.poll() is not None and len(notes) == 3)

    assert process.returncode == 0
    assert [note.data for note in notes] == ["note 1", "note 2", "note 3"]
    assert [note.data for note in latched] == ["static"]
    assert len(listener.data[radar]) == 3
    text = process.log.read_text()
    assert text.count("/other: type nobody_has_this/msg/Thing is not installed") == 1


def test_replay_draws_a_line_on_a_terminal_only(tmp_path, processes):
    words = [*map(str, playing(1000)), *AT_ONCE]
    _, piped = processes.run("sensor_replay", *words)
    master, terminal = pty.openpty()
    with os.fdopen(master, "rb") as screen, (tmp_path / "log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "phd_jdtc_ros", "sensor_replay", *words],
            stdout=terminal,
            stderr=log,
            env={**os.environ, "TERM": "xterm", "COLUMNS": "120"},
        )
        os.close(terminal)
        shown = b""
        try:
            while part := screen.read1(4096):
                shown += part
        except OSError:  # The terminal's other end is closed
            pass
        assert process.wait(30.0) == 0

    assert "80 scans" not in piped
    assert b"474.0 of 474.0 s" in shown
    assert b"80 scans" in shown


def test_replay_fails_where_the_flush_service_is_missing_or_refuses(processes, peer, listener):
    words = (hasty_replay, *playing(1000, duration=12))
    status, text = processes.run(*words, *AT_ONCE, *options(flush_service="/nobody/flush"))
    assert status == 1
    assert "/nobody/flush is not available" in text

    def refuse(_, response):
        response.success, response.message = False, "not now"
        return response

    peer.node.create_service(Trigger, "/busy/flush", refuse)
    process = processes.start(*words, *options(flush_service="/busy/flush"))
    assert peer.spin_until(lambda: process.poll() is not None)
    assert process.returncode == 1
    assert "service /busy/flush refused: not now" in process.log.read_text()


def test_replay_plays_what_is_whole_of_a_damaged_bag(processes, peer, listener, tmp_path):
    whole = next(BAG.glob("*.mcap")).read_bytes()
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(whole[: len(whole) // 2])
    process = processes.start("sensor_replay", *playing(1000, bag=broken))
    assert peer.spin_until(lambda: process.poll() is not None)
    text = process.log.read_text()
    assert process.returncode == 3
    assert 30 <= listener.scans < 80
    assert "broken.mcap: is damaged" in text
    assert "Traceback" not in text


def test_replay_stops_at_once_while_it_waits_for_an_absent_subscriber(processes, peer, listener):
    deaf = processes.start("evaluator")
    assert peer.spin_until(lambda: peer.node.count_subscribers(names.TRUTH) == 2)
    process = processes.start("sensor_replay", *playing(1000))
    assert peer.spin_until(lambda: listener.scans)
    deaf.send_signal(signal.SIGSTOP)
    try:
        assert peer.spin_until(lambda: listener.scans == 80)
        peer.ticks(5)
        assert process.poll() is None
        process.send_signal(signal.SIGTERM)
        # It would wait for twice this time.
        assert process.wait(0.5 * GIVE_UP_S) == 0
    finally:
        deaf.send_signal(signal.SIGCONT)


def test_replay_reports_differences_between_the_bags_scene_and_the_tracker(processes, peer):
    peer.said(processes.start("tracker"), "tracking ")
    bag = BAG.parent / "one_radar"
    # A shipped bag is found by its name.
    different = processes.start("sensor_replay", *playing(1, "--start-paused", bag=bag.name))
    log = peer.said(different, "was recorded with")
    (line,) = (line for line in log.splitlines() if "recorded with" in line)
    assert "sensors: [radar_1] recorded, [radar_1, radar_2] given; radar_1.position: " in line
    assert line.endswith(f"{bag.name}/parameters.yaml")
    same = processes.start("sensor_replay", *playing(0, duration=120))
    assert peer.spin_until(lambda: same.poll() is not None)
    assert same.returncode == 0
    assert "recorded with" not in same.log.read_text()
