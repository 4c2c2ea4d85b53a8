"""A radar on a ship whose place is in transforms, offline: tracks, the report, and what is said."""

import moving
import numpy as np
import pytest
import transform_messages as tf_messages
from bag_content import recorded, write
from moving_messages import CLOUDS, sent
from transform_messages import LIVE, STATIC

from msg_adapters.encoding import names
from msg_adapters.incoming import moving_radars
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import Topic
from phd_jdtc_ros.core.intake.transforms import Placement
from phd_jdtc_ros.report import load
from phd_jdtc_ros.tools import recorded_plots, track_bag

CONFIG = moving.config(**tf_messages.PARAMETERS)


def child_of(message):
    """Return the frame whose transform a message has; None for a cloud."""
    topic, data, _ = message
    return (
        None
        if topic == CLOUDS
        else moving_radars.transforms_from_cdr(data, lambda frame: True)[0].child
    )


def tracked(path, messages, config=CONFIG, topics=(LIVE, STATIC)):
    """Track a bag of messages; return the tracker, and the estimates by stamp."""
    found = [Topic(CLOUDS, names.CLOUD), *tf_messages.topics(*topics)]
    if not topics:
        found.append(Topic(moving.ODOMETRY, names.ODOMETRY))
    write(path / "bag", found, messages)
    tracker = track_bag.track_bag(BagReader(path / "bag"), config, path / "out")
    return tracker, recorded(path / "out")


def mounted(messages, after=0):
    """Return messages with the static transform of the radar, after a number of them."""
    stamp_ns = messages[after][2]
    return [*messages[:after], (STATIC, tf_messages.mounting(), stamp_ns), *messages[after:]]


def test_a_radar_placed_by_transforms_is_tracked_as_by_odometry(tmp_path):
    messages = tf_messages.carried()
    odometry = [message for message in messages if message[0] == CLOUDS]
    for _, _, stamp_ns in (m for m in messages if m[0] == LIVE):
        pose = moving.ship((stamp_ns - moving.START_NS) * 1e-9)
        data = moving_radars.pose_to_cdr(pose, stamp_ns, "map", "odometry")
        odometry.append((moving.ODOMETRY, data, stamp_ns))
    odometry.sort(key=lambda message: message[2])
    _, expected = tracked(tmp_path / "odometry", odometry, moving.config(), topics=())
    tracker, found = tracked(tmp_path / "tf", mounted(messages))
    assert not tracker.tally.dropped
    assert [one.stamp_ns for one in found] == [one.stamp_ns for one in expected]
    assert len(found) == moving.SCANS
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.state, other.state, rtol=1e-9, atol=1e-6)
    assert moving.errors(found).max() < 25.0


def test_the_report_of_transforms_shows_where_the_radar_was(tmp_path):
    tracked(tmp_path, mounted(tf_messages.carried()))
    record = load.record(tmp_path / "out", CONFIG)
    assert len(record.plots) == moving.SCANS
    for index, plot in enumerate(record.plots):
        place, _ = moving.antenna(index * moving.INTERVAL_S)
        assert plot.sensor == pytest.approx(tuple(place), abs=1e-6)
    out = BagReader(tmp_path / "out")
    assert (out.start_ns, out.end_ns) == (moving.stamp(-1.0), moving.stamp(38.0))


@pytest.mark.parametrize("late", [0, 12])
def test_a_radar_at_rest_needs_no_moving_transform(tmp_path, late):
    place = tf_messages.upright(40.0, -20.0, 0.7)
    clouds = [each for each in sent() if each[0] == CLOUDS]
    static = STATIC, tf_messages.message(("/map", "/mast", 5, place)), clouds[late][2]
    messages = [*clouds[:late], static, *clouds[late:]]
    tracker, found = tracked(tmp_path, messages, topics=[STATIC])
    # A cloud waits for a pose for no longer than until the next cloud.
    dropped = max(late - 1, 0)
    assert tracker.tally.dropped == ({"pose_missing": dropped} if dropped else {})
    assert [one.stamp_ns for one in found] == [stamp_ns for _, _, stamp_ns in clouds[dropped:]]
    record = load.record(tmp_path / "out", CONFIG)
    assert {plot.sensor for plot in record.plots} == {(40.0, -20.0)}


@pytest.mark.parametrize(
    ("child", "said"),
    [
        ("mast", "no transform from 'mast' to 'map': the chain from 'mast' ends at 'mast'"),
        ("base_link", "no transform from 'base_link' to 'map': the chain from 'mast' ends at"),
        ("odom", "no transform from 'odom' to 'map': the chain from 'mast' ends at 'odom'"),
    ],
)
def test_a_missing_link_of_the_chain_is_named_by_tracking_and_tuning(tmp_path, child, said):
    messages = [m for m in mounted(tf_messages.carried()) if child_of(m) != child]
    tracker, found = tracked(tmp_path, messages)
    assert not found
    assert said in tracker.tally.fault()
    read = recorded_plots.read(BagReader(tmp_path / "bag"), CONFIG, 100.0)
    with pytest.raises(BagError, match=f"mast: none of its messages can be used; {said}"):
        recorded_plots.findings_of(tmp_path / "bag", read)


def test_transforms_that_end_are_named(tmp_path):
    messages, end_ns = mounted(tf_messages.carried()), moving.stamp(10.0)
    messages = [m for m in messages if child_of(m) != "base_link" or m[2] < end_ns]
    tracker, _ = tracked(tmp_path, messages)
    said = "the transform from 'base_link' to 'odom' ends at 1700000009.500 s"
    assert f"no pose on /tf within 1 s: {said}" in tracker.tally.fault()


def test_a_frame_with_two_parents_is_warned_of_and_not_dropped(tmp_path):
    messages = mounted(tf_messages.carried())
    other = STATIC, tf_messages.mounting("odom"), messages[9][2]
    tracker, _ = tracked(tmp_path, [*messages[:9], other, *mounted(messages[9:])])
    assert not tracker.tally.dropped
    text = "got another parent, or is on /tf and on /tf_static, 2 times; the latest counts"
    assert [line for line in tracker.warnings() if line.endswith(text)]


def test_a_radar_on_its_side_is_refused_for_that_and_not_for_late_transforms(tmp_path):
    optical = Placement((10.0, -3.0, 12.0), (-0.5, 0.5, -0.5, 0.5))
    messages = [m for m in mounted(tf_messages.carried()) if child_of(m) != "mast"]
    placed = STATIC, tf_messages.message(("base_link", "mast", 0, optical)), messages[0][2]
    tracker, found = tracked(tmp_path, [placed, *messages])
    assert not found
    assert "its z axis does not point up" in tracker.tally.fault()


def test_transforms_that_come_too_late_are_named_and_not_the_beginning_without_any(tmp_path):
    messages = mounted(tf_messages.carried())
    late = [(*m[:2], m[2] + (0 if m[0] == CLOUDS else 4 * 10**9)) for m in messages]
    tracker, _ = tracked(tmp_path, sorted(late, key=lambda message: message[2]))
    assert "the transform from 'base_link' to 'odom' ends at" in tracker.tally.fault()


@pytest.mark.parametrize("world", ["map", "odom", "arena"])
def test_with_nothing_set_a_sensor_is_where_transforms_place_it(tmp_path, world):
    messages = [m for m in mounted(tf_messages.carried()) if child_of(m) in (None, "mast")]
    above = "earth" if world != "arena" else ""
    for parent, child in [(world, "base_link"), *([(above, world)] if above else [])]:
        place = tf_messages.upright(1.0, 2.0, 0.0)
        data = tf_messages.message((parent, child, messages[0][2], place))
        messages.insert(0, (LIVE, data, messages[0][2]))
    kinds = [Topic(CLOUDS, names.CLOUD), *tf_messages.topics(LIVE, STATIC)]
    found = recorded_plots.recognised_radars(BagReader(write(tmp_path / "bag", kinds, messages)))
    assert (found["world_frame"], found["mast.pose"]) == (world, "tf")


def test_a_bag_without_transforms_is_refused(tmp_path):
    with pytest.raises(BagError, match=r"/tf is missing, must be .*; /tf_static is missing"):
        tracked(tmp_path, [each for each in sent() if each[0] == CLOUDS], topics=())
