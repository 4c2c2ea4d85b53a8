"""A live tracker and a radar on a ship that turns, over DDS; and its recording, played again."""

import moving
import pytest
from bag_content import recorded, write
from geometry_msgs.msg import PoseStamped
from live_and_offline import assert_alike, started
from live_radars import options
from moving_messages import CLOUDS, sent
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import names
from msg_adapters.incoming import moving_radars
from msg_adapters.targets import estimates
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import Topic
from phd_jdtc_ros.configuration.schema import flatten
from phd_jdtc_ros.core.types import Pose
from phd_jdtc_ros.tools import track_bag

KINDS = {"odometry": Odometry, "pose_stamped": PoseStamped}


def write_bag(path, messages, kind="odometry"):
    topics = [Topic(CLOUDS, names.CLOUD), Topic(moving.ODOMETRY, moving_radars.POSE_TYPES[kind])]
    return write(path, topics, messages)


@pytest.fixture
def tracker(processes, peer, tmp_path):
    """Return a function that starts a tracker; it returns publishers by topic, and estimates."""

    def start(kind="odometry", source="filtered"):
        given = {**dict(flatten(moving.PARAMETERS)), "mast.pose_message": kind}
        types = {CLOUDS: PointCloud2, moving.ODOMETRY: KINDS[kind]}
        return started(processes, peer, tmp_path, given, types, source=source)[:2]

    return start


def test_a_moving_radar_is_tracked_live_as_offline(tracker, peer, tmp_path):
    kind = "pose_stamped"
    outputs, found = tracker(kind)
    messages = sent(kind)
    for topic, data, stamp_ns in messages:
        outputs[topic].publish(data)
        if topic == moving.ODOMETRY:
            due = sum(other == CLOUDS and ns <= stamp_ns for other, _, ns in messages)
            assert peer.spin_until(lambda due=due: len(found) >= due)
    bag = write_bag(tmp_path / "bag", messages, kind)
    config = moving.config(**{"mast.pose_message": kind})
    offline = track_bag.track_bag(BagReader(bag), config, tmp_path / "out")
    expected = recorded(tmp_path / "out")
    # The last scan waits for a pose that never comes, until the end of the bag.
    assert len(expected) == moving.SCANS
    assert not offline.tally.dropped
    heard = assert_alike(found, expected[:-1])
    assert moving.errors(heard).max() < 25.0


def test_offline_faults_of_poses_are_counted_and_reported(tmp_path):
    messages = [
        (topic, data, stamp_ns)
        for topic, data, stamp_ns in sent()
        if topic == CLOUDS or not 11.4 < (stamp_ns - moving.START_NS) * 1e-9 < 17.0
    ]
    stamp_ns = moving.stamp(20.2)
    wild = moving_radars.pose_to_cdr(Pose((9e3, 0.0), 0.0), stamp_ns, "map", "odometry")
    foreign = moving_radars.pose_to_cdr(moving.ship(20.25), stamp_ns, "odom", "odometry")
    messages += [(moving.ODOMETRY, wild, stamp_ns), (moving.ODOMETRY, foreign, stamp_ns)]
    bag = write_bag(tmp_path / "bag", sorted(messages, key=lambda message: message[2]))
    tracker = track_bag.track_bag(BagReader(bag), moving.config(), tmp_path / "out")
    assert tracker.tally.dropped == {"pose_missing": 2, "pose_jump": 1, "pose_frame": 1}
    said = [line for line in tracker.warnings() if "extrapolated" in line]
    assert said == [
        f"{CLOUDS}: 2 clouds, or parts of revolutions, are later than the poses on "
        f"{moving.ODOMETRY}; the platform's pose is extrapolated with its last velocity"
    ]


def test_poses_that_are_not_recorded_are_warned_of(processes, peer, tracker, tmp_path):
    tracker()
    words = options(record=tmp_path / "r", record_topics=f"[{CLOUDS}]")
    evaluator = processes.start("evaluator", "--ros-args", *words)
    peer.said(
        evaluator, f"{moving.ODOMETRY}, of which /tracker has the poses of a radar that moves"
    )


def test_a_moving_radar_is_replayed_and_recorded_with_poses(processes, peer, tracker, tmp_path):
    bag = write_bag(tmp_path / "bag", sent())
    outputs, found = tracker(source="smoothed")
    for output in outputs.values():  # The replay is the only one that sends
        peer.node.destroy_publisher(output)
    record = tmp_path / "recorded"
    topics = {
        "record_topics": f"[{CLOUDS}, {moving.ODOMETRY}]",
        "record_types": "[cloud, odometry]",
    }
    words = options(record=record, **topics)
    recorder = processes.start("evaluator", "--ros-args", *words)
    assert peer.spin_until(lambda: peer.node.count_subscribers(moving.ODOMETRY) == 2)
    both = options(flush_service="/tracker/flush", subscribers=2)
    status, log = processes.run("sensor_replay", bag, "--rate", "0", "--ros-args", *both)
    assert status == 0, log
    assert peer.spin_until(lambda: len(found) == moving.SCANS)
    heard = [estimates.from_msg(cloud) for cloud in found]
    assert moving.errors(heard).max() < 20.0
    recorder.terminate()
    recorder.wait(20.0)
    expected = [data for topic, data, _ in sent() if topic == moving.ODOMETRY]
    played = [entry.data for entry in BagReader(record).messages([moving.ODOMETRY])]
    assert played == expected
