import os
import pty
import signal
import subprocess
import sys
import time
from statistics import median

import numpy as np
import pytest
from mcap_files import write
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from replay_listener import BAG, DEEP, TOPICS, Listener
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger

from msg_adapters import interfaces, names, stamps
from phd_jdtc_ros.bags.reader import BagReader

BEST_EFFORT = ReliabilityPolicy.BEST_EFFORT
QUIET = ("--ros-args",)


def seek(peer, seconds):
    request = SetParametersAtomically.Request(
        parameters=[Parameter("seek_s", value=seconds).to_parameter_msg()]
    )
    service = "/sensor_replay/set_parameters_atomically"
    return peer.call(SetParametersAtomically, service, request).result


@pytest.fixture
def listener(peer):
    return Listener(peer)


def test_replay_publishes_the_bags_bytes_as_they_are(processes, peer, listener):
    process = processes.start("sensor_replay", BAG, "--rate", "1000", *QUIET)
    assert peer.spin_until(lambda: process.poll() is not None and listener.scans == 80)

    assert process.returncode == 0
    for topic in TOPICS:
        recorded = [message.data for message in BagReader(BAG).messages([topic])]
        assert len(listener.data[topic]) == len(recorded)
        for arrived, data in zip(listener.data[topic], recorded, strict=True):
            # The middleware fills messages up to whole words of four bytes.
            assert arrived[: len(data)] == data
            assert len(arrived) - len(data) < 4


def test_replay_keeps_the_pace(processes, peer, listener):
    # Scans are 6 s apart, so 0.1 s at 60 times the speed.
    process = processes.start("sensor_replay", BAG, "--rate", "60", "--duration", "120", *QUIET)
    assert peer.spin_until(lambda: process.poll() is not None and listener.scans == 21)

    assert process.returncode == 0
    # Some arrive late on a busy machine, and the next ones early then.
    assert median(np.diff(listener.times_of_truth)) == pytest.approx(0.1, rel=0.2)


def test_replay_plays_the_chosen_part(processes, peer, listener):
    process = processes.start(
        "sensor_replay", BAG, "--rate", "1000", "--start", "60", "--duration", "12", *QUIET
    )
    assert peer.spin_until(lambda: process.poll() is not None and listener.scans == 3)

    first = stamps.of_cdr(listener.data[names.TRUTH][0])
    assert first - BagReader(BAG).start_ns == 60_000_000_000


def test_replay_pauses_steps_and_resumes(processes, peer, listener):
    processes.start("sensor_replay", BAG, "--rate", "30", "--start-paused", *QUIET)
    peer.call(Trigger, "/sensor_replay/step")
    assert peer.spin_until(lambda: listener.scans == 1)
    peer.ticks(50)
    assert listener.scans == 1

    peer.call(Trigger, "/sensor_replay/resume")
    assert peer.spin_until(lambda: listener.scans >= 4)
    peer.call(Trigger, "/sensor_replay/pause")
    peer.meet("/sensor_replay")
    held = listener.scans
    peer.ticks(60)
    assert listener.scans == held


def test_replay_seeks_forward_and_back(processes, peer, listener):
    processes.start("sensor_replay", BAG, "--start-paused", *QUIET)
    # A whole number is a number too.
    for scans, seconds in enumerate((60.0, 6, 57.5), start=1):
        assert seek(peer, seconds).successful
        peer.call(Trigger, "/sensor_replay/step")
        assert peer.spin_until(lambda scans=scans: listener.scans == scans)

    start = BagReader(BAG).start_ns
    played = [stamps.of_cdr(data) - start for data in listener.data[names.TRUTH]]
    assert played == [60_000_000_000, 6_000_000_000, 60_000_000_000]


def test_replay_refuses_to_seek_outside_its_part_and_goes_on(processes, peer, listener):
    processes.start(
        *("sensor_replay", BAG, "--start-paused", "--start", "12", "--duration", "12", *QUIET)
    )
    for seconds in (11.9, 24.1, -1.0, float("nan"), "soon"):
        result = seek(peer, seconds)
        assert not result.successful
        assert result.reason == f"seek_s: {seconds} given, must be a number from 12 to 24"

    peer.call(Trigger, "/sensor_replay/step")
    assert peer.spin_until(lambda: listener.scans == 1)
    first = stamps.of_cdr(listener.data[names.TRUTH][0]) - BagReader(BAG).start_ns
    assert first == 12_000_000_000


def test_replay_plays_foreign_topics_and_warns_once_of_unknown_ones(processes, peer, tmp_path):
    notes, latched = [], []
    peer.node.create_subscription(String, "/note", notes.append, DEEP)
    peer.node.create_subscription(
        String,
        "/tf_static",
        latched.append,
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    )
    cloud = interfaces.encode(PointCloud2())
    topics = {
        names.detections("radar_1"): names.CLOUD,
        "/note": "std_msgs/msg/String",
        # Any installed type will do; the name matters.
        "/tf_static": "std_msgs/msg/String",
        "/other": "nobody_has_this/msg/Thing",
    }
    messages = [("/tf_static", 0, interfaces.encode(String(data="static")))]
    for k in range(1, 4):
        messages += [
            (names.detections("radar_1"), k * 10**9, cloud),
            ("/note", k * 10**9 + 1, interfaces.encode(String(data=f"note {k}"))),
            ("/other", k * 10**9 + 2, b"1234"),
        ]
    listener = Listener(peer)
    path = write(tmp_path / "foreign.mcap", topics, messages)
    process = processes.start("sensor_replay", path, "--rate", "10", "--start", "0.5", *QUIET)
    assert peer.spin_until(lambda: process.poll() is not None and len(notes) == 3)

    assert process.returncode == 0
    assert [note.data for note in notes] == ["note 1", "note 2", "note 3"]
    assert [note.data for note in latched] == ["static"]
    assert len(listener.data[names.detections("radar_1")]) == 3
    text = process.log.read_text()
    assert text.count("/other: type nobody_has_this/msg/Thing is not installed") == 1


def test_replay_remaps_its_topics(processes, peer, listener):
    found = []
    peer.node.create_subscription(PointCloud2, "/elsewhere", found.append, DEEP)
    process = processes.start(
        *("sensor_replay", BAG, "--rate", "1000", "--duration", "12", *QUIET),
        *("-r", f"{names.TRUTH}:=/elsewhere"),
    )
    assert peer.spin_until(lambda: process.poll() is not None and len(found) == 3)

    assert len(listener.data[names.detections("radar_1")]) == 3
    assert listener.scans == 0


def test_replay_draws_a_line_on_a_terminal_only(tmp_path, processes):
    arguments = (str(BAG), "--rate", "1000", "--ros-args", "-p", "subscriber_timeout_s:=0.0")
    _, piped = processes.run("sensor_replay", *arguments)
    master, terminal = pty.openpty()
    with os.fdopen(master, "rb") as screen, (tmp_path / "log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "phd_jdtc_ros", "sensor_replay", *arguments],
            stdout=terminal,
            stderr=log,
            env={**os.environ, "TERM": "xterm", "COLUMNS": "120"},
        )
        os.close(terminal)
        shown = b""
        try:
            while part := screen.read1(4096):
                shown += part
        except OSError:  # the terminal's other end is closed
            pass
        assert process.wait(30.0) == 0

    assert "80 scans" not in piped
    assert b"474.0 of 474.0 s" in shown
    assert b"80 scans" in shown


def test_replay_loops(processes, peer, listener):
    processes.start("sensor_replay", BAG, "--rate", "1000", "--duration", "12", "--loop", *QUIET)
    assert peer.spin_until(lambda: listener.scans >= 7)

    found = [stamps.of_cdr(data) for data in listener.data[names.TRUTH]]
    assert found[3:6] == found[:3]


def test_replay_publishes_the_clock_at_100_hz_and_before_every_stamp(processes, peer, listener):
    ticks = []
    peer.node.create_subscription(
        Clock,
        "/clock",
        lambda message: ticks.append((time.monotonic(), stamps.to_ns(message.clock))),
        QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT),
    )
    process = processes.start("sensor_replay", BAG, "--rate", "6", "--duration", "12", *QUIET)
    assert peer.spin_until(lambda: process.poll() is not None)
    recorded = [stamps.of_cdr(data) for data in listener.data[names.TRUTH]]
    played = [tick for tick in ticks if recorded[0] < tick[1] < recorded[-1]]
    rate = len(played) / (played[-1][0] - played[0][0])

    assert {stamp for _, stamp in ticks} >= set(recorded)
    assert [stamp for _, stamp in ticks] == sorted(stamp for _, stamp in ticks)
    assert 70.0 <= rate <= 130.0


def test_replay_logs_at_the_end_how_much_it_published(processes):
    words = ("--duration", "12", *QUIET, "-p", "subscriber_timeout_s:=0.0")
    status, text = processes.run("sensor_replay", BAG, "--rate", "1000", *words)

    assert status == 0
    assert f"published: {TOPICS[0]} 3, {TOPICS[1]} 3, {TOPICS[2]} 3\n" in text


def test_replay_fails_where_the_flush_service_is_missing(processes):
    status, text = processes.run(
        *("sensor_replay", BAG, "--rate", "1000", *QUIET),
        *("-p", "subscriber_timeout_s:=0.0", "-p", "flush_service:=/nobody/flush"),
    )

    assert status == 1
    assert "/nobody/flush is not available" in text


def test_replay_plays_what_is_whole_of_a_damaged_bag_and_reports_it(processes, peer, tmp_path):
    whole = next(BAG.glob("*.mcap")).read_bytes()
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(whole[: len(whole) // 2])
    listener = Listener(peer)
    process = processes.start("sensor_replay", broken, "--rate", "1000", *QUIET)
    assert peer.spin_until(lambda: process.poll() is not None)
    text = process.log.read_text()

    assert process.returncode == 3
    assert 30 <= listener.scans < 80
    assert "broken.mcap: is damaged" in text
    assert "Traceback" not in text


def test_replay_fails_where_the_flush_is_refused(processes, peer, listener):
    def refuse(_, response):
        response.success, response.message = False, "not now"
        return response

    peer.node.create_service(Trigger, "/busy/flush", refuse)
    process = processes.start(
        *("sensor_replay", BAG, "--rate", "1000", "--duration", "12", *QUIET),
        *("-p", "flush_service:=/busy/flush"),
    )
    assert peer.spin_until(lambda: process.poll() is not None)

    assert process.returncode == 1
    assert "service /busy/flush refused: not now" in process.log.read_text()


def test_replay_stops_at_once_while_it_waits_for_an_absent_subscriber(processes, peer, listener):
    deaf = processes.start("evaluator")
    assert peer.spin_until(lambda: peer.node.count_subscribers(names.TRUTH) == 2)
    process = processes.start("sensor_replay", BAG, "--rate", "1000", *QUIET)
    assert peer.spin_until(lambda: listener.scans)
    deaf.send_signal(signal.SIGSTOP)
    try:
        assert peer.spin_until(lambda: listener.scans == 80)
        peer.ticks(5)
        assert process.poll() is None
        started = time.monotonic()
        process.send_signal(signal.SIGTERM)
        assert process.wait(15.0) == 0
        assert time.monotonic() - started < 2.0
    finally:
        deaf.send_signal(signal.SIGCONT)


def test_replay_reports_differences_between_the_bags_scene_and_the_tracker(processes, peer):
    tracker = processes.start("tracker")
    assert peer.spin_until(lambda: "tracking " in tracker.log.read_text())
    bag = BAG.parent / "one_radar"
    process = processes.start("sensor_replay", bag, "--start-paused", *QUIET)
    assert peer.spin_until(lambda: "was recorded with" in process.log.read_text())

    (line,) = (line for line in process.log.read_text().splitlines() if "recorded with" in line)
    assert "sensors: [radar_1] recorded, [radar_1, radar_2] given; radar_1.position: " in line
    assert line.endswith(f"those of the bag are in {bag / 'parameters.yaml'}")


def test_replay_logs_nothing_about_a_tracker_that_fits(processes, peer):
    tracker = processes.start("tracker")
    assert peer.spin_until(lambda: "tracking " in tracker.log.read_text())
    process = processes.start("sensor_replay", BAG, "--rate", "0", *QUIET)
    assert peer.spin_until(lambda: process.poll() is not None)

    assert process.returncode == 0
    assert "recorded with" not in process.log.read_text()


def test_replay_finds_a_shipped_bag_by_its_name(processes, peer, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ("--rate", "1000", "--duration", "12", *QUIET, "-p", "subscriber_timeout_s:=0.0")
    status, text = processes.run("sensor_replay", "one_radar", *words)
    assert status == 0, text
