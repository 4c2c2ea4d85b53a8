import time
from collections import Counter

import numpy as np
import pytest

from msg_adapters.encoding import RejectedMessageError
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration import build
from phd_jdtc_ros.core.intake.posed_reports import RadarPose
from phd_jdtc_ros.core.pipeline import Drops
from phd_jdtc_ros.core.types import Detections, Pose
from phd_jdtc_ros.feed import Feed, StepClock
from phd_jdtc_ros.tally import DetectionCounts, Tally

MOVING = {"radar_1.pose": "/ship", "radar_2.pose": "/ship"}


def test_feed_reads_and_counts_an_unreadable_pose_at_once():
    config = build.resolve(MOVING)
    tally = Tally(config)

    def read():
        raise RejectedMessageError("frame", "frame_id is 'odom', must be 'map'")

    assert Feed(config, tally).pose("/ship", read) is None
    assert tally.dropped == {"pose_frame": 1}


def test_feed_counts_a_pose_that_comes_twice_once_for_all_its_radars():
    config = build.resolve(MOVING)
    tally = Tally(config)
    feed = Feed(config, tally)
    for _ in range(2):
        poses = [RadarPose(radar, 10**9, Pose((0.0, 0.0), 0.0)) for radar in (0, 1)]
        list(feed.add_poses("/ship", poses))
    assert tally.dropped.total() == 1


def test_half_of_the_detections_or_none_is_no_fault():
    used = DetectionCounts()
    used.read(5, {"range": 5})
    assert used.fault() is None
    assert DetectionCounts().fault() is None


def test_less_than_half_is_reported_with_the_main_reasons_and_their_parameters():
    used = DetectionCounts()
    used.read(20, {"range": 10, "azimuth": 1, "not_finite": 2})
    used.lost["late"] += 9
    used.unreadable("schema", "north: no field")
    assert used.fault() == (
        "11 of 34 detections could be used; most frequent reasons: range 10 (min_range, "
        "max_range), late 9 (reorder_s, late_reports), not_finite 2 (fields)"
    )


def test_messages_that_cannot_be_read_are_reported_as_such_with_the_first_ones_fault():
    tally = Tally(build.resolve({"sensors": ["mast"]}))
    for _ in range(3):
        error = RejectedMessageError("frame", "frame_id 'radar', must be 'mast'")
        tally.on_unreadable(0, error)
    assert tally.fault() == (
        "0 of 3 messages could be used; most frequent reasons: frame 3 (frame: mast: frame_id "
        "'radar', must be 'mast')"
    )


def test_recording_without_any_detection_is_a_fault():
    tally = Tally(build.resolve({"sensors": ["mast"]}))
    tally.on_report(0, Report(10**9, Detections(np.zeros((0, 2)), None), Counter()))
    assert tally.fault() == "nothing to track: no cloud has a detection"
    tally.on_report(0, Report(2 * 10**9, Detections(np.ones((1, 2)), None), Counter()))
    assert tally.fault() is None


@pytest.mark.parametrize(
    ("later_s", "apart"), [(0, []), (19, []), (20, [0, 1]), (3600, [0, 1]), (-3600, [0, 1])]
)
def test_radars_whose_stamps_do_not_overlap_are_warned_of(later_s, apart):
    tally = Tally(build.resolve({}))
    for stamp_s in range(4000, 4020):
        for radar in (0, 1):
            stamp_ns = (stamp_s + radar * later_s) * 10**9
            tally.on_report(radar, Report(stamp_ns, Detections(np.ones((1, 2)), None), Counter()))
    texts = {index: text for index, text in tally.about_radars() if "clock" in text}
    assert [*texts] == apart
    if apart:
        assert texts[0].startswith("its stamps, from 4000.000 to 4019.000 s, are all before")


def test_report_that_waited_for_a_pose_in_vain_counts_with_its_detections():
    tally = Tally(build.resolve({"sensors": ["mast"]}))
    tally.on_drops(0, Drops(Counter({"pose_missing": 3}), Counter({"pose_missing": 7})))
    assert tally.dropped == {"pose_missing": 3}
    assert tally.detections.lost == {"pose_missing": 7}


def test_a_missing_pose_is_explained_by_the_first_pose_that_cannot_be_read():
    tally = Tally(build.resolve({"sensors": ["mast"]}))
    for frame in ("odom", "other"):
        error = RejectedMessageError("frame", f"frame_id {frame!r}, must be the world frame, 'map'")
        tally.on_unreadable_pose("/odom", error)
    tally.on_report(0, Report(10**9, Detections(np.ones((7, 2)), None), Counter()))
    tally.on_drops(0, Drops(Counter({"pose_missing": 3}), Counter({"pose_missing": 7})))
    assert tally.fault() == (
        "0 of 7 detections could be used; most frequent reasons: pose_missing 7 (pose: /odom: "
        "frame_id 'odom', must be the world frame, 'map')"
    )


def test_points_that_fill_a_cloud_are_counted_and_no_lost_detections():
    tally = Tally(build.resolve({"sensors": ["mast"]}))
    tally.on_report(0, Report(10**9, Detections(np.ones((7, 2)), None), Counter({"padding": 121})))
    assert (tally.dropped["padding"], tally.detections.lost.total()) == (121, 0)
    assert tally.fault() is None


def test_feed_yields_a_scan_before_its_monitors_take_it():
    taken = []

    class Slow:
        def add_scan(self, scan, filtered):
            taken.append(scan.stamp_ns)

        def forget_tracks(self):
            pass

    config = build.resolve({})
    feed = Feed(config, Tally(config), [Slow()])
    for radar in range(2):
        report = Report(10**9, Detections(np.zeros((0, 2)), np.zeros(0)), Counter())
        for _ in feed.report(radar, report):
            assert not taken
    assert taken == [10**9]


def work(milliseconds):
    until = time.thread_time() + 1e-3 * milliseconds
    while time.thread_time() < until:
        pass


def test_step_clock_counts_the_work_of_blocks_by_step():
    clock = StepClock()
    with clock:
        work(20.0)
    work(200.0)
    with clock:
        work(10.0)
        assert clock.take_ms() == pytest.approx(30.0, abs=15.0)
    clock = StepClock()
    with clock:
        work(60.0)
        first = clock.take_ms()
        work(20.0)
        assert [first, clock.take_ms()] == pytest.approx([60.0, 20.0], abs=15.0)


def test_step_clock_forgets_discarded_work():
    clock = StepClock()
    with clock:
        work(60.0)
        clock.discard()
    with clock:
        assert clock.take_ms() < 15.0
