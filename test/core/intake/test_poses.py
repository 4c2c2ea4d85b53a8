import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from phd_jdtc_ros.core.intake.posed_reports import Platform
from phd_jdtc_ros.core.intake.poses import Mount, PoseFault, PoseTrack
from phd_jdtc_ros.core.sensors.gaussians import HeightPrior
from phd_jdtc_ros.core.sensors.spatial_radar import SpatialRadar
from phd_jdtc_ros.core.sensors.visibility import Visibility
from phd_jdtc_ros.core.types import LEVEL, Detections, Pose, rotation_of

LEVEL_TURN = (0.0,) * 4  # Of a twist that is level and straight

SPEED, TURN_RATE = 14.0, 0.1
INTERVAL_S, NOISE = 0.05, 0.1


def vehicle(times_s, noise=0.0, twist=None, mount=((0.0, 0.0), 0.0), stabilised=False):
    """Return a vehicle that turns to the left, with poses at these times."""
    rng = np.random.default_rng(2)
    platform = Platform(PoseTrack(yaw_applies=not stabilised), Mount(*mount))
    for time_s in times_s:
        yaw = TURN_RATE * time_s
        x, y = SPEED / TURN_RATE * np.array([np.sin(yaw), 1.0 - np.cos(yaw)])
        x, y = rng.normal([x, y], noise)
        assert platform.track.add(round(time_s * 1e9), Pose((x, y), yaw, twist=twist)) is None
    return platform


def velocity_at(time_s, ahead_m=0.0):
    yaw = TURN_RATE * time_s
    left = TURN_RATE * ahead_m
    return [
        SPEED * np.cos(yaw) - left * np.sin(yaw),
        SPEED * np.sin(yaw) + left * np.cos(yaw),
    ]


@pytest.mark.parametrize("stabilised", [False, True])
def test_the_measured_velocity_is_used_whatever_the_positions_say(stabilised):
    times_s = np.arange(0.0, 10.0, INTERVAL_S)
    twist, mount = (SPEED, 0.0, 0.0, 0.0, 0.0, TURN_RATE), ((4.0, 0.0), 0.3)
    platform = vehicle(times_s, NOISE, twist, mount, stabilised)
    for time_s in (0.01, 5.02, 9.93):
        # A stabilised mount does not turn with the vehicle.
        expected = velocity_at(time_s, 0.0 if stabilised else 4.0)
        found = platform.velocity(round(time_s * 1e9))
        assert_allclose(found, expected, atol=SPEED * TURN_RATE * INTERVAL_S)


def test_the_measured_velocity_is_interpolated():
    platform = Platform(PoseTrack(), Mount((0.0, 0.0), 0.0))
    platform.track.add(0, Pose((0.0, 0.0), 0.0, twist=(10.0, 1.0, *LEVEL_TURN)))
    platform.track.add(10**9, Pose((11.0, 1.0), 0.0, twist=(12.0, 1.0, *LEVEL_TURN)))
    assert platform.velocity(5 * 10**8) == pytest.approx((11.0, 1.0))
    assert platform.velocity(10**9 + 10**8) == pytest.approx((12.0, 1.0))


def test_a_pose_without_a_measured_velocity_leaves_it_to_the_positions():
    platform = Platform(PoseTrack(), Mount((0.0, 0.0), 0.0))
    platform.track.add(0, Pose((0.0, 0.0), 0.0, twist=(99.0, 0.0, *LEVEL_TURN)))
    platform.track.add(10**9, Pose((10.0, 0.0), 0.0))
    assert platform.velocity(5 * 10**8) == pytest.approx((10.0, 0.0))


@pytest.mark.parametrize("stabilised", [False, True])
def test_own_pose_has_the_radars_place_and_the_platforms_heading(stabilised):
    mount = ((4.0, 0.0), 0.3)
    platform = vehicle(np.arange(0.0, 10.0, INTERVAL_S), mount=mount, stabilised=stabilised)
    pose = platform.own_pose(5 * 10**9)
    x, y = SPEED / TURN_RATE * np.array([np.sin(0.5), 1.0 - np.cos(0.5)])
    yaw = 0.0 if stabilised else 0.5
    assert_allclose(pose.position, [x + 4.0 * np.cos(yaw), y + 4.0 * np.sin(yaw)], atol=1e-9)
    assert_allclose(pose.yaw, np.nan if stabilised else 0.5)
    assert_allclose(pose.velocity, velocity_at(5.0, 0.0 if stabilised else 4.0), atol=0.2)


def test_own_pose_is_unknown_before_the_first_pose_and_its_velocity_after_it():
    platform = Platform(PoseTrack(), Mount((0.0, 0.0), 0.0))
    assert platform.own_pose(0) is None
    platform.track.add(0, Pose((1.0, 2.0), 0.5))
    pose = platform.own_pose(0)
    assert (pose.position, pose.yaw) == ((1.0, 2.0), 0.5)
    assert np.isnan(pose.velocity).all()


def test_noisy_positions_are_differenced_over_a_longer_interval():
    times_s = np.arange(0.0, 20.0, INTERVAL_S)
    errors = []
    for time_s in times_s[times_s > 2.0]:
        platform = vehicle(times_s[times_s <= time_s + 1e-6], NOISE)
        found = platform.velocity(round(time_s * 1e9))
        errors.append(np.subtract(found, velocity_at(time_s)))
    # Over the shortest interval the noise alone is sqrt(2) NOISE / 0.1 = 1.41 m/s.
    assert np.sqrt(np.mean(np.square(errors))) < 0.6


def test_exact_positions_are_differenced_over_the_shortest_interval():
    platform = vehicle(np.arange(0.0, 5.0, INTERVAL_S))
    found = platform.velocity(round(4.95e9))
    assert_allclose(found, velocity_at(4.95 - 0.05), atol=1e-3)


def test_a_pose_without_a_stamp_holds_at_all_times_until_one_has_a_stamp():
    platform, still = Platform(PoseTrack(), Mount((0.0, 0.0), 0.0)), Pose((3.0, 4.0), 0.5)
    assert platform.track.add(None, still) is None
    for stamp_ns in (0, 10**18):
        assert platform.track.reaches(stamp_ns)
        assert platform.track.at(stamp_ns) == (still, False)
        assert platform.velocity(stamp_ns) == (0.0, 0.0)
    assert platform.track.add(10**9, Pose((5.0, 4.0), 0.5)) is None
    assert platform.track.at(10**9)[0] == Pose((5.0, 4.0), 0.5)
    assert not platform.track.reaches(2 * 10**9)
    assert platform.track.add(None, Pose((0.0, 0.0), np.nan)) is PoseFault.ORIENTATION


def test_a_radar_on_a_swaying_mast_sees_a_target_where_it_is():
    mount = Mount((4.0, -1.0), 0.3, height=20.0, tilt=(0.1, -0.05))
    track = PoseTrack(in_space=True, max_age_s=1.0)
    poses = {}
    for time_s in np.arange(0.0, 2.0, 0.05):
        tilt = 0.05 * math.sin(1.3 * time_s), 0.12 * math.sin(0.9 * time_s)
        pose = Pose((8.0 * time_s, -3.0), 0.4 * time_s, height=2.0 + 0.5 * time_s, tilt=tilt)
        poses[round(time_s, 2)] = pose
        track.add(round(1e9 * time_s), pose)
    platform, target = Platform(track, mount), np.array([400.0, -250.0, 130.0])

    def seen(pose):
        turn = pose.rotation @ rotation_of(mount.yaw, mount.tilt)
        at = np.array([*pose.position, pose.height]) + pose.rotation @ mount.arm
        x, y, z = turn.T @ (target - at)
        return [math.hypot(x, y, z), math.atan2(y, x), math.atan2(z, math.hypot(x, y))]

    times = [0.9, 1.0, 1.1]
    sent = Detections(np.array([seen(poses[time_s]) for time_s in times]), None)
    at_once, _ = platform.with_pose(10**9, sent.take(np.array([1])))
    radar = SpatialRadar(
        name="mast",
        position=(0.0, 0.0),
        yaw=0.0,
        height=0.0,
        range_std=1.0,
        azimuth_std=0.01,
        elevation_std=0.01,
        visibility=Visibility(max_range=1e3),
        clutter_rate=1.0,
        threshold=3.7,
        height_prior=HeightPrior(100.0, 50.0),
    ).at(at_once.pose)
    assert_allclose(radar.to_world(at_once.measurement), [target], atol=1e-9)
    assert_allclose(radar.linearise(target)[0], at_once.measurement[0], atol=1e-12)
    timed = replace(sent, time_s=np.array(times) - 1.0)
    found, _ = platform.with_pose(10**9, timed)
    assert_allclose(radar.to_world(found.measurement), [target] * 3, atol=1e-6)


def test_range_rates_on_a_swaying_mast_are_relative_to_the_antenna():
    mount = Mount((3.0, 1.0), 0.0, height=15.0)
    track, rates = PoseTrack(in_space=True), (0.3, -0.2, 0.1)
    # It rolls, pitches about the y axis, and yaws, from the level.
    twist = (9.0, 0.5, 1.5, *rates)
    for time_s in (0.0, 0.1):
        track.add(round(1e9 * time_s), Pose((9.0 * time_s, 0.0), 0.0, twist=twist))
    rated = Detections(np.array([[500.0, 0.2, 0.1]]), None, range_rate=np.zeros(1))
    pose = Platform(track, mount).with_pose(0, rated)[0].pose
    expected = np.array(twist[:3]) + np.cross(rates, mount.arm)
    assert_allclose((*pose.velocity, pose.climb), expected)
    # Without a twist, from the positions of the antenna in two poses.
    track = PoseTrack(in_space=True)
    for time_s in (0.0, 0.1):
        own = Pose((0.0, 0.0), 0.0, height=2.0 * time_s, tilt=(0.0, 0.3 * time_s))
        track.add(round(1e9 * time_s), own)
    pose = Platform(track, Mount((0.0, 0.0), 0.0, height=15.0)).with_pose(10**8, rated)[0].pose
    assert_allclose((*pose.velocity, pose.climb), [0.0, -4.5, 2.0], atol=0.1)


def test_positions_on_a_tilted_platform_are_levelled():
    track = PoseTrack(in_space=True)
    own = Pose((10.0, 20.0), 0.5, height=4.0, tilt=(0.2, -0.1))
    track.add(None, own)
    mount = Mount((1.0, 2.0), 0.3, height=1.5)
    targets = np.array([[40.0, 30.0, 9.0], [20.0, 60.0, 2.0]])
    at, turn = mount.on(own), mount.on(own).rotation
    local = (targets - (*at.position, at.height)) @ turn
    std = np.array([[0.3, 0.3]] * 2)
    sent = Detections(
        local[:, :2], None, noise_std=std, z=local[:, 2] + mount.height, z_std=std[:, 0]
    )
    found, _ = Platform(track, mount, positions=True).with_pose(0, sent)
    level = found.pose
    assert level.tilt == LEVEL
    cos, sin = math.cos(level.yaw), math.sin(level.yaw)
    world = found.measurement @ np.array([[cos, sin], [-sin, cos]]) + level.position
    assert_allclose(world, targets[:, :2], atol=1e-9)
    assert_allclose(found.z, targets[:, 2], atol=1e-9)
    assert_allclose(found.noise_std, std, atol=1e-12)
    nothing, _ = Platform(track, mount, positions=True).with_pose(
        0, replace(sent, z=np.array([np.nan, local[1, 2] + mount.height]))
    )
    assert np.isnan(nothing.z[0])
    assert_allclose(nothing.z[1], targets[1, 2])


def test_in_the_plane_a_pose_has_neither_height_nor_tilt():
    track = PoseTrack()
    track.add(None, Pose((1.0, 2.0), 0.3, height=40.0, tilt=(0.4, 0.1)))
    assert track.at(0)[0] == Pose((1.0, 2.0), 0.3)
