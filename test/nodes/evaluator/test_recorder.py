import errno
import json
import os
import resource
import signal

import numpy as np
import pytest
from live_radars import options
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from msg_adapters.encoding import names
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.run_scores import Evaluation
from phd_jdtc_ros.nodes.recorder import Completion, Recorder, watch_inputs
from phd_jdtc_ros.parameter_files import bag_parameters

STRING = "std_msgs/msg/String"
SHIPPED = resources.bag(resources.DEFAULT_BAG)
# The evaluator records 80 scans of truth and detections, about 150 kB.
TOO_LITTLE = 60_000


def test_recorder_writes_what_arrives(peer, tmp_path):
    recorder = Recorder(peer.node, tmp_path / "bag", {"/note": STRING})
    output = peer.publisher(String, "/note")
    assert peer.spin_until(output.get_subscription_count)
    for k in range(5):
        output.publish(String(data=f"note {k}"))
    assert peer.spin_until(lambda: recorder.written["/note"] == 5)
    recorder.close()
    bag = BagReader(tmp_path / "bag")
    assert bag.counts["/note"] == 5
    assert [b"note %d" % k in m.data for k, m in enumerate(bag.messages(["/note"]))] == [True] * 5


def test_a_recording_ends_after_its_last_score_and_not_before():
    evaluation = Evaluation(classes=1, cutoff=1000.0, order=2.0)
    completion = Completion(evaluation, wanted=1)
    assert not completion.is_reached(0.0, 0)
    one = PointSet(np.zeros((1, 2)), np.zeros(1, dtype=int))
    evaluation.add_truth(0, one)
    for source in SOURCES:
        evaluation.add_estimates(source, 0, one)
    # On a busy machine the two scores of the scan are recorded late, and one after the other.
    times = np.array([0.0, 0.4, 0.6, 0.8, 1.2, 1.4])
    reached = [completion.is_reached(*each) for each in zip(times, [0, 1, 1, 2, 2, 2], strict=True)]
    assert reached == [False, False, False, False, False, True]


def test_recorder_receives_drivers_that_offer_best_effort_alone(peer, tmp_path):
    recorder = Recorder(peer.node, tmp_path / "bag", {"/note": STRING})
    modest = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    outputs = [peer.publisher(String, "/note", modest), peer.publisher(String, "/note")]

    def modest_as_well():
        found = peer.node.get_subscriptions_info_by_topic("/note")
        return [info.qos_profile.reliability for info in found] == [ReliabilityPolicy.BEST_EFFORT]

    assert peer.spin_until(modest_as_well)
    peer.settled(*outputs)
    for output in outputs:
        output.publish(String(data="note"))
    assert peer.spin_until(lambda: recorder.written["/note"] == 2)
    recorder.close()

    # Each once, though one of them was received before too.
    assert BagReader(tmp_path / "bag").counts["/note"] == 2


def test_recorder_takes_static_frames_published_before_it_began(peer, tmp_path):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    # Its type is installed everywhere; only the name and the durability matter.
    peer.publisher(String, names.STATIC_FRAMES, latched).publish(String(data="map to radar_1"))
    recorder = Recorder(peer.node, tmp_path / "bag", {names.STATIC_FRAMES: STRING})
    assert peer.spin_until(lambda: recorder.written[names.STATIC_FRAMES])
    recorder.close()
    bag = BagReader(tmp_path / "bag")
    assert bag.counts[names.STATIC_FRAMES] == 1
    assert "transient_local" in (tmp_path / "bag" / "metadata.yaml").read_text()


def test_recorder_that_cannot_subscribe_completes_its_bag(peer, tmp_path):
    with pytest.raises(InvalidTopicNameException):
        Recorder(peer.node, tmp_path / "bag", {"/9//note": STRING})
    assert list(BagReader(tmp_path / "bag").messages()) == []
    assert (tmp_path / "bag" / "metadata.yaml").exists()


def test_evaluator_that_cannot_start_completes_its_bag(processes, tmp_path):
    bag = tmp_path / "bag"
    words = options(
        record=bag, **{f"qos_overrides.{names.TRUTH}.subscription.reliability": "mostly"}
    )
    status, text = processes.run("evaluator", "--ros-args", *words)
    assert status == 2
    assert "Unexpected QoS override" in text
    assert (bag / "metadata.yaml").exists()


def record(processes, peer, directory, restrict):
    """Run the evaluator with a recording into `directory` beside a replay of the shipped bag."""
    words = options(record=directory, report=directory.parent.parent / "report.json")
    evaluator = processes.start("evaluator", "--ros-args", *words)
    assert peer.spin_until(lambda: peer.node.count_subscribers(names.TRUTH) == 2)
    restrict(evaluator)
    processes.start("sensor_replay", SHIPPED, "--rate", "200")
    peer.said(evaluator, "recording stopped")
    alive = evaluator.poll() is None
    evaluator.send_signal(signal.SIGTERM)
    return alive, evaluator.wait(15.0), evaluator.log.read_text()


def check_stopped_cleanly(outcome, directory, reason):
    alive, status, text = outcome
    # Without a tracker there is nothing that the report could have.
    assert (alive, status) == (True, 1)
    assert text.count("recording stopped") == 1
    assert reason in text
    assert "Traceback" not in text
    # The bag is whole up to then.
    found, bag = [], BagReader(next(directory.glob("*.mcap")))
    with pytest.raises(BagError, match="is damaged"):
        found.extend(message.topic for message in bag.messages())
    assert found.count(names.detections("radar_1")) >= 5


def test_recorder_stops_at_the_largest_file_and_the_node_goes_on(processes, peer, tmp_path):
    directory = tmp_path / "recording" / "bag"

    def restrict(process):
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (TOO_LITTLE, TOO_LITTLE))

    outcome = record(processes, peer, directory, restrict)

    check_stopped_cleanly(outcome, directory, os.strerror(errno.EFBIG))
    assert json.loads((tmp_path / "report.json").read_text())["scans"] == 0


def test_recording_has_the_topics_that_are_on_and_the_parameters(processes, peer, tmp_path):
    bag = tmp_path / "bag"
    evaluator = processes.start("evaluator", "--ros-args", *options(record=bag))
    tracker = processes.start("tracker", "--ros-args", *options(outputs="[odometry]", lag=2))
    peer.said(tracker, "tracking ")
    assert peer.spin_until((bag / "parameters.yaml").exists)
    words = (SHIPPED, "--rate", "0", "--duration", "60", "--ros-args")
    replay = processes.start("sensor_replay", *words, *options(flush_service="/tracker/flush"))
    assert peer.spin_until(lambda: replay.poll() is not None)
    evaluator.send_signal(signal.SIGTERM)
    assert evaluator.wait(30.0) == 0
    reader = BagReader(bag)
    assert reader.counts["/tracker/odometry"] > 0
    assert reader.types["/tracker/odometry"] == "nav_msgs/msg/Odometry"
    assert "/tracker/tracks/path" not in reader.types
    assert bag_parameters.read(bag)["lag"] == 2
    assert "is not recorded" not in evaluator.log.read_text()


def test_recording_that_leaves_a_radar_out_is_warned_of(processes, peer, tmp_path):
    evaluator = processes.start("evaluator", "--ros-args", *options(record=tmp_path / "bag"))
    given = ("-p", "radar_2.topic:=/north/plots", "-r", "/radar_1/detections:=/south/plots")
    processes.start("tracker", "--ros-args", *given)
    for topic in ("/north/plots", "/south/plots"):
        text = f"{topic}, of which /tracker has a radar's detections, is not among record_topics"
        peer.said(evaluator, text)
    # It has looked again by then.
    peer.meet("/evaluator", times=2)
    assert evaluator.log.read_text().count("is not recorded") == 2


def test_inputs_of_a_tracker_whose_name_is_not_in_the_graph_are_warned_of(processes, peer, capfd):
    # The middleware forgets the name of a process that it has not heard for a while, and finds its
    # endpoints again without it.
    figures = names.cardinality()
    given = ("-r", "__node:=nameless", "-r", f"{names.cardinality('/nameless')}:={figures}")
    processes.start("tracker", "--ros-args", *options(lag=2), *given)
    assert peer.spin_until(lambda: peer.node.count_publishers(figures))
    watch_inputs(peer.node, "/tracker", {names.detections("radar_1")})
    said = []

    def warned():
        said.append(capfd.readouterr().err)
        return "/radar_2/detections, of which /tracker has a radar's detections" in "".join(said)

    assert peer.spin_until(warned)
    assert "/radar_1/detections" not in "".join(said)
