"""A live tracker whose radar is placed by transforms, as those of a robot are.

The stand-ins have the bytes of tf2_msgs, which are all that the tracker reads.
"""

import moving
import stand_ins
import transform_messages as tf_messages
from bag_content import recorded, write
from diagnostic_msgs.msg import DiagnosticStatus
from live_and_offline import assert_alike, started
from live_radars import Health, options
from moving_messages import CLOUDS
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from transform_messages import LIVE, STATIC

from msg_adapters.encoding import names
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import Topic
from phd_jdtc_ros.configuration.schema import flatten
from phd_jdtc_ros.exit_status import USAGE
from phd_jdtc_ros.tools import track_bag

GIVEN = {**dict(flatten(moving.PARAMETERS)), **tf_messages.PARAMETERS}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_a_radar_is_placed_by_transforms_live_as_offline(processes, peer, tmp_path):
    kind = stand_ins.message_class(names.TRANSFORMS)
    types = {CLOUDS: PointCloud2, LIVE: kind}
    packages = stand_ins.write(tmp_path / "packages")
    health = Health(peer)
    # A second robot sends transforms too: it is a publisher more, and of no concern.
    other = peer.publisher(kind, LIVE)
    outputs, found, _ = started(processes, peer, tmp_path, GIVEN, types, **packages)
    messages = tf_messages.carried()
    other.publish(tf_messages.message(("map", "robot", 0, tf_messages.upright(1.0, 2.0, 3.0))))
    outputs[LIVE].publish(messages[0][1])
    text = "the chain from 'mast' ends at 'mast'"
    health.until_level("pose of mast", DiagnosticStatus.ERROR, text)

    static = peer.publisher(kind, STATIC, LATCHED)
    static.publish(tf_messages.mounting())
    health.until_level("static frames of mast", DiagnosticStatus.ERROR, "from 'odom' to 'map'")
    for topic, data, stamp_ns in messages[1:]:
        outputs[topic].publish(data)
        if topic == LIVE and b"map\0" in data:
            due = sum(other == CLOUDS and ns <= stamp_ns for other, _, ns in messages)
            assert peer.spin_until(lambda due=due: len(found) >= due)
    for name in ("pose of mast", "static frames of mast"):
        health.until_level(name, DiagnosticStatus.OK, "receiving")

    kinds = [Topic(CLOUDS, names.CLOUD), *tf_messages.topics(LIVE, STATIC)]
    entries = [(STATIC, tf_messages.mounting(), messages[0][2]), *messages]
    bag = write(tmp_path / "bag", kinds, entries)
    config = moving.config(**tf_messages.PARAMETERS)
    track_bag.track_bag(BagReader(bag), config, tmp_path / "out")
    heard = assert_alike(found, recorded(tmp_path / "out"))
    assert moving.errors(heard).max() < 25.0


def test_a_radar_whose_transforms_are_all_static_is_not_silent(processes, peer, tmp_path):
    kind = stand_ins.message_class(names.TRANSFORMS)
    static = peer.publisher(kind, STATIC, LATCHED)
    place = tf_messages.upright(40.0, -20.0, 0.7)
    static.publish(tf_messages.message(("map", "mast", 0, place)))
    health = Health(peer)
    packages = stand_ins.write(tmp_path / "packages")
    types = {CLOUDS: PointCloud2}
    outputs, found, _ = started(processes, peer, tmp_path, GIVEN, types, **packages)
    health.until_level("static frames of mast", DiagnosticStatus.OK, "receiving")
    clouds = [data for topic, data, _ in tf_messages.carried() if topic == CLOUDS]
    for data in clouds[:3]:
        outputs[CLOUDS].publish(data)
    assert peer.spin_until(lambda: len(found) >= 3)
    assert health.fresh("pose of mast").level == DiagnosticStatus.OK


def test_transforms_without_their_package_are_refused_by_its_name(processes, tmp_path):
    broken = tmp_path / "packages" / "tf2_msgs"
    broken.mkdir(parents=True)
    (broken / "__init__.py").write_text("raise ImportError('not in this installation')")
    words = options(sensors="[mast]", **{"mast.pose": "tf"})
    status, log = processes.run("tracker", "--ros-args", *words, PYTHONPATH=str(broken.parent))
    assert status == USAGE
    assert "mast.pose: tf given, but tf2_msgs is not installed" in log
