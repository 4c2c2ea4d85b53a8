import itertools
import math

import moving
import numpy as np
import pytest
from lone import lone

from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.intake.posed_reports import Platform
from phd_jdtc_ros.core.intake.poses import Mount, PoseFault, PoseTrack
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import RunEnded
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.types import Detections, Pose

S = 10**9


def reports(count=moving.SCANS):
    """Return the radar's reports as steps: the name of the pipeline's method and its arguments."""
    return [
        ("add", (0, moving.stamp(index * moving.INTERVAL_S), found))
        for index, found in enumerate(moving.scans(count))
    ]


def poses(first_s=-0.1, last_s=moving.SCANS * moving.INTERVAL_S, every_s=0.2):
    times = np.arange(first_s, last_s, every_s)
    return [("add_pose", (0, moving.stamp(t), moving.ship(t))) for t in times]


def in_order(*parts):
    return sorted(itertools.chain(*parts), key=lambda step: step[1][1])


def fed(pipeline, steps):
    """Return the events of steps, those that were refused, and the flush's events."""
    events, refused = [], []
    for method, arguments in steps:
        found = getattr(pipeline, method)(*arguments)
        if isinstance(found, (Rejection, PoseFault)):
            refused.append(found)
        else:
            events += found
    events += pipeline.flush()
    return [event for event in events if not isinstance(event, RunEnded)], refused


def filtered(events):
    return [estimates for event in events for estimates in event.step.filtered]


def test_targets_are_tracked_in_the_world_from_a_ship_that_turns():
    events, refused = fed(new_pipeline(moving.config()), in_order(reports(), poses()))
    assert len(events) == moving.SCANS
    assert not refused
    assert np.median(moving.errors(filtered(events))) < 6.0
    assert moving.errors(filtered(events)).max() < 25.0


def test_a_ship_that_stands_is_the_same_as_a_fixed_radar():
    (x, y), yaw = (120.0, -40.0), 0.3
    place = {"mast.position": [x, y], "mast.yaw_deg": float(np.degrees(yaw))}
    fixed, _ = fed(new_pipeline(moving.config(**place, **{"mast.pose": "fixed"})), reports())
    still = [
        ("add_pose", (0, moving.stamp(t), Pose((x, y), float(np.radians(np.degrees(yaw))))))
        for t in range(-1, 60)
    ]
    there = {"mast.position": [0.0, 0.0], "mast.yaw_deg": 0.0}
    carried, _ = fed(new_pipeline(moving.config(**there)), in_order(reports(), still))
    for one, other in zip(filtered(fixed), filtered(carried), strict=True):
        np.testing.assert_array_equal(one.state, other.state)


def test_the_order_in_which_poses_and_reports_come_makes_no_difference():
    def delayed(later_ns):
        """Return the steps with poses that come this much later than their stamps."""
        return sorted(
            [*poses(), *reports()],
            key=lambda step: step[1][1] + (later_ns if step[0] == "add_pose" else 0),
        )

    runs = [
        filtered(fed(new_pipeline(moving.config()), delayed(later_ns))[0])
        for later_ns in (-1_500_000_000, 1_900_000_000)
    ]
    for one, other in zip(*runs, strict=True):
        assert one.stamp_ns == other.stamp_ns
        np.testing.assert_array_equal(one.state, other.state)


def test_a_report_waits_until_its_pose_is_known():
    pipeline = new_pipeline(moving.config())
    list(pipeline.add_pose(0, moving.stamp(-0.1), moving.ship(-0.1)))
    assert list(pipeline.add(*reports(1)[0][1])) == []
    assert pipeline.waiting
    (event,) = pipeline.add_pose(0, moving.stamp(0.1), moving.ship(0.1))
    assert event.scan.detections[0].pose.position == pytest.approx(moving.antenna(0.0)[0], abs=0.1)


def test_poses_that_stop_are_bridged_for_a_moment_and_then_reports_are_given_up():
    until_s = 10 * moving.INTERVAL_S - 0.5
    pipeline = new_pipeline(moving.config())
    events, _ = fed(pipeline, in_order(reports(), poses(last_s=until_s)))
    assert len(events) == 11
    assert pipeline.take_anomalies(0) == {"poses_extrapolated": 1}
    ((_, drops),), given_up = pipeline.take_drops(), reports()[11:]
    assert drops.reports == {"pose_missing": len(given_up)}
    assert drops.detections == {"pose_missing": sum(len(each[1][2]) for each in given_up)}


def test_tracking_goes_on_when_poses_come_back():
    gap = [*poses(last_s=13.2), *poses(first_s=19.5)]
    pipeline = new_pipeline(moving.config())
    events, _ = fed(pipeline, in_order(reports(), gap))
    assert dict(pipeline.take_drops())[0].reports == {"pose_missing": 2}
    assert moving.errors(filtered(events), since=14).max() < 25.0


def test_a_pose_that_jumps_moves_no_detection():
    wild = [("add_pose", (0, moving.stamp(20.05), Pose((9e3, 9e3), 2.0)))]
    events, refused = fed(new_pipeline(moving.config()), in_order(reports(), poses(), wild))
    plain, _ = fed(new_pipeline(moving.config()), in_order(reports(), poses()))
    assert refused == [PoseFault.JUMP]
    for one, other in zip(filtered(events), filtered(plain), strict=True):
        np.testing.assert_array_equal(one.state, other.state)


def test_a_report_that_comes_twice_is_counted_when_its_pose_is_known():
    steps = in_order(reports(), reports()[3:4], poses())
    pipeline = new_pipeline(moving.config())
    events, _ = fed(pipeline, steps)
    assert len(events) == moving.SCANS
    assert dict(pipeline.take_drops())[0].reports == {"duplicate": 1}


def test_a_run_that_begins_again_is_tracked_again():
    steps = in_order(reports(), poses())
    pipeline = new_pipeline(moving.config())
    found = (getattr(pipeline, method)(*args) for method, args in steps + steps)
    # The first pose behind the jump back waits for the second.
    events = [event for each in found if each is not PoseFault.JUMP for event in each]
    events += pipeline.flush()
    stepped = [event for event in events if not isinstance(event, RunEnded)]
    assert len(stepped) >= 2 * moving.SCANS - 1
    assert len(events) - len(stepped) == 2


@pytest.mark.parametrize("sectors", [0, 8])
def test_slices_of_a_revolution_have_poses_of_their_own(sectors):
    rotation_s = 4.0
    settings = moving.config(
        **{"mast.rotation_s": rotation_s, "mast.sectors": sectors, "mast.fields.time": "time"}
    )
    pipeline, given = new_pipeline(settings), []
    rng = np.random.default_rng(3)
    list(pipeline.add_pose(0, moving.stamp(-0.1), moving.ship(-0.1)))
    parts = max(sectors, 1)
    for part in range(6 * parts):
        end_s = rotation_s * (part + 1) / parts
        time_s = np.sort(rng.uniform(end_s - rotation_s / parts, end_s, 48 // parts))
        azimuth = np.mod(2 * np.pi * time_s / rotation_s + np.pi, 2 * np.pi) - np.pi
        found = moving.Detections(
            np.stack([np.full(len(time_s), 800.0), azimuth], axis=1), None, time_s - end_s
        )
        given += pipeline.add(0, moving.stamp(end_s), found)
        for t in np.arange(end_s - rotation_s / parts + 0.05, end_s + 0.1, 0.1):
            events = pipeline.add_pose(0, moving.stamp(t), moving.ship(t))
            given += [] if isinstance(events, PoseFault) else events
    slices = [event.scan for event in given if not isinstance(event, RunEnded)]
    assert len(slices) > 40
    for part in slices:
        (found,) = part.detections
        time_s = (part.stamp_ns - moving.START_NS) * 1e-9
        place, yaw = moving.antenna(time_s)
        assert found.pose.position == pytest.approx(tuple(place), abs=0.02)
        assert np.cos(found.pose.yaw - yaw) == pytest.approx(1.0, abs=1e-6)


def test_a_radar_at_a_pose_measures_from_there():
    model: RadarModel = moving.config().model.radars[0]
    pose = Pose((100.0, -50.0), 1.0)
    state = np.array([[300.0, 2.0, 400.0, -1.0, 0.0]])
    measured = model.at(pose).measure(state)
    line = state[0, [model.space.position[0], model.space.position[1]]] - pose.position
    assert measured[0, 0] == pytest.approx(np.hypot(*line))
    assert measured[0, 1] == pytest.approx(np.arctan2(line[1], line[0]) - 1.0)
    assert model.at(None) is model


def track(*poses, **settings):
    """Return a track with poses given as (time in seconds, x, y, yaw)."""
    found = PoseTrack(**settings)
    for time_s, x, y, yaw in poses:
        found.add(round(time_s * S), Pose((x, y), yaw))
    return found


def test_poses_are_interpolated_between_messages():
    found, extrapolated = track((10, 0, 0, 0.1), (11, 4, -2, 0.3)).at(round(10.25 * S))
    assert found.position == pytest.approx((1.0, -0.5))
    assert found.yaw == pytest.approx(0.15)
    assert not extrapolated
    poses = track((10, 1.1, 2.3, 0.1), (11, 4, -2, 0.3))
    assert poses.at(10 * S) == (Pose((1.1, 2.3), 0.1), False)
    assert poses.at(11 * S) == (Pose((4, -2), 0.3), False)
    found, _ = track((0, 0, 0, 3.1), (1, 0, 0, -3.1)).at(S // 2)
    assert abs(found.yaw) == pytest.approx(math.pi)


def test_there_is_no_pose_in_long_gaps_and_beside_one_message():
    poses = track((0, 0, 0, 0), (10, 10, 0, 0), max_age_s=1.0)
    assert poses.at(S) == (Pose((1.0, 0.0), 0.0), False)
    assert poses.at(5 * S)[0] is None
    poses = track((1, 0, 0, 0))
    assert poses.at(round(1.1 * S))[0] is None
    assert poses.at(round(0.9 * S))[0] is None


def test_poses_beyond_the_last_are_extrapolated_and_change_no_velocity():
    poses = track((0, 0, 0, 0), (0.5, 5, 0, 0.1), (1, 10, 0, 0.2), max_age_s=1.0)
    found, extrapolated = poses.at(round(1.8 * S))
    assert found.position == pytest.approx((18.0, 0.0))
    assert found.yaw == pytest.approx(0.36)
    assert extrapolated
    assert poses.at(round(2.1 * S))[0] is None
    poses = [(0.05 * k, 0.5 * k + 0.1 * (k % 3), 0.0, 0.0) for k in range(9)]
    known = [
        Platform(track(*poses[:count]), Mount((0.0, 0.0), 0.0)).velocity(round(0.21 * S))
        for count in (6, 7, 9)
    ]
    assert known[0] == known[1] == known[2]


def test_poses_at_close_times_do_not_give_a_velocity_of_noise_nor_fill_the_memory():
    noise = [0.02, -0.02]
    poses = track(*((k / 100, k / 10 + noise[k % 2], 0, 0) for k in range(200)))
    found, _ = poses.at(round(2.49 * S))
    assert found.position[0] == pytest.approx(24.9, abs=0.1)
    poses = PoseTrack(reset_threshold_s=10.0)
    for index in range(5000):
        poses.add(index * S, Pose((float(index), 0.0), 0.0))
    assert len(poses._poses) < 20


def test_jumps_are_left_out():
    poses = track((0, 0, 0, 0), (1, 5, 0, 0))
    assert poses.add(2 * S, Pose((5000.0, 0.0), 0.0)) is PoseFault.JUMP
    assert poses.add(3 * S, Pose((15.0, 0.0), 0.0)) is None
    assert poses.at(2 * S)[0].position == pytest.approx((10.0, 0.0))
    poses = track((0, 0, 0, 0), (0.1, 0, 0, 0))
    assert poses.add(round(0.2 * S), Pose((0.0, 0.0), math.pi)) is PoseFault.JUMP


def test_a_relocated_platform_is_followed_and_not_interpolated_across_its_jump():
    poses = track((0, 0, 0, 0), (1, 5, 0, 0), max_age_s=0.3)
    assert poses.add(2 * S, Pose((5000.0, 0.0), 0.0)) is PoseFault.JUMP
    assert poses.add(3 * S, Pose((5005.0, 0.0), 0.0)) is None
    assert poses.at(round(2.2 * S))[0].position == pytest.approx((5001.0, 0.0))
    assert poses.at(round(1.2 * S)) == (Pose((6.0, 0.0), 0.0), True)
    assert poses.at(round(1.5 * S))[0] is None


def test_old_messages_are_left_out_and_jumps_back_begin_a_new_run():
    poses = track((0, 0, 0, 0), (1, 5, 0, 0), reset_threshold_s=10.0)
    assert poses.add(S, Pose((6.0, 0.0), 0.0)) is PoseFault.DUPLICATE
    assert poses.add(S // 2, Pose((2.0, 0.0), 0.0)) is PoseFault.LATE
    poses = track((100, 900, 0, 0), (101, 905, 0, 0), reset_threshold_s=10.0)
    # A single wrong stamp ends nothing.
    for far in (0, 86400 * S):
        assert poses.add(far, Pose((905.0, 0.0), 0.0)) is PoseFault.JUMP
        assert poses.at(101 * S)[0].position == (905.0, 0.0)
    assert poses.add(102 * S, Pose((910.0, 0.0), 0.0)) is None
    assert poses.at(102 * S) == (Pose((910.0, 0.0), 0.0), False)
    assert poses.add(0, Pose((0.0, 0.0), 0.0)) is PoseFault.JUMP
    assert poses.add(S, Pose((5.0, 0.0), 0.0)) is None
    assert poses.at(0)[0].position == (0.0, 0.0)
    assert not poses.reaches(2 * S)
    assert poses.at(101 * S)[0] is None


def test_a_mount_is_in_the_platforms_frame_and_may_need_no_yaw():
    unknown = Pose((3.0, 4.0), math.nan)
    assert track().add(0, unknown) is PoseFault.ORIENTATION
    stabilised = track(yaw_applies=False)
    assert stabilised.add(0, unknown) is None
    assert stabilised.at(0) == (Pose((3.0, 4.0), 0.0), False)
    found = Mount((10.0, 2.0), 0.25).on(Pose((100.0, 50.0), math.pi / 2))
    assert found.position == pytest.approx((98.0, 60.0))
    assert found.yaw == pytest.approx(math.pi / 2 + 0.25)


def test_detections_with_times_become_what_is_seen_from_the_stamps_pose():
    platform = Platform(track((0, 0, 0, 0), (2, 20, 0, 0.4)), Mount((0.0, 0.0), 0.1))
    time_s, target = np.array([-0.5, 0.0, 0.5]), np.array([100.0, 40.0])
    seen = []
    for since in time_s:
        line = target - [10.0 * (1.0 + since), 0.0]
        seen.append((np.hypot(*line), np.arctan2(line[1], line[0]) - 0.1 - 0.2 * (1.0 + since)))
    posed, extrapolated = platform.with_pose(S, Detections(np.array(seen), None, time_s))
    line = target - [10.0, 0.0]
    expected = np.hypot(*line), np.arctan2(line[1], line[0]) - 0.3
    np.testing.assert_allclose(posed.measurement, [expected] * 3)
    assert posed.pose.position == pytest.approx((10.0, 0.0))
    assert posed.pose.yaw == pytest.approx(0.3)
    assert not extrapolated


def rated(rate, time_s=None):
    measured = np.tile([50.0, 0.5], (len(rate), 1))
    return Detections(measured, None, time_s, range_rate=np.array(rate))


def test_range_rates_need_the_velocity_of_the_radar():
    # 10 m/s ahead and a turn of 0.2 rad/s about the platform; the radar is 3 m to its left.
    mount = Mount((0.0, 3.0), 0.3)
    poses = track(*((0.05 * k, 0.5 * k, 0.0, 0.01 * k) for k in range(9)))
    found, _ = Platform(poses, mount).with_pose(round(0.2 * S), rated([1.0]))
    # By the revolution, the velocity to the right of a place to the left is backwards.
    assert found.pose.velocity == pytest.approx((10.0 - 0.2 * 3.0, -0.2 * 3.0 * 0.03), abs=0.02)
    assert found.range_rate.tolist() == [1.0]
    poses = track(*((0.05 * k, 0.5 * k, 0.0, 0.0) for k in range(9)))
    found, _ = Platform(poses, Mount((0.0, 0.0), 0.0)).with_pose(
        round(0.2 * S), Detections(np.array([[50.0, 0.5]]), None)
    )
    assert found.pose.velocity == (0.0, 0.0)
    alone = Platform(track((0, 0, 0, 0)), Mount((0.0, 0.0), 0.0))
    found, _ = alone.with_pose(0, rated([1.0]))
    assert found.range_rate is None
    assert len(found) == 1


def test_range_rates_at_times_of_their_own_become_those_from_the_velocity_at_the_stamp():
    # It brakes: 10 m/s before 1 s, 4 m/s after.
    poses = track(*((0.1 * k, min(k, 10) * 1.0 + max(k - 10, 0) * 0.4, 0, 0) for k in range(21)))
    platform = Platform(poses, Mount((0.0, 0.0), 0.0))
    found, _ = platform.with_pose(2 * S, rated([3.0, 3.0], np.array([0.0, -1.2])))
    assert found.pose.velocity == pytest.approx((4.0, 0.0))
    expected = [3.0, 3.0 + (10.0 - 4.0) * math.cos(0.5)]
    np.testing.assert_allclose(found.range_rate, expected, atol=1e-9)


def test_a_radar_that_moves_measures_what_stands_as_it_passes_it():
    poses = track(*((0.1 * k, 1.5 * k, 0.0, 0.0) for k in range(11)))
    (radar,) = lone({"radar.fields.range_rate": "rr", "radar.position": [0.0, 0.0]}).model.radars
    found, _ = Platform(poses, Mount((0.0, 0.0), 0.0)).with_pose(S, rated([0.0]))
    standing = np.array([[15.0 + 40.0, 0.0, 30.0, 0.0, 0.0]])
    assert radar.at(found.pose).range_rate_of(standing) == pytest.approx(-15.0 * 40.0 / 50.0)
