import numpy as np
import pytest
from numpy.testing import assert_allclose

from phd_jdtc_ros.core.intake.poses import Mount, Platform, PoseFault, PoseTrack
from phd_jdtc_ros.core.types import Pose

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
    twist, mount = (SPEED, 0.0, TURN_RATE), ((4.0, 0.0), 0.3)
    platform = vehicle(times_s, NOISE, twist, mount, stabilised)
    for time_s in (0.01, 5.02, 9.93):
        # A stabilised mount does not turn with the vehicle.
        expected = velocity_at(time_s, 0.0 if stabilised else 4.0)
        found = platform.velocity(round(time_s * 1e9))
        assert_allclose(found, expected, atol=SPEED * TURN_RATE * INTERVAL_S)


def test_the_measured_velocity_is_interpolated():
    platform = Platform(PoseTrack(), Mount((0.0, 0.0), 0.0))
    platform.track.add(0, Pose((0.0, 0.0), 0.0, twist=(10.0, 1.0, 0.0)))
    platform.track.add(10**9, Pose((11.0, 1.0), 0.0, twist=(12.0, 1.0, 0.0)))
    assert platform.velocity(5 * 10**8) == pytest.approx((11.0, 1.0))
    assert platform.velocity(10**9 + 10**8) == pytest.approx((12.0, 1.0))


def test_a_pose_without_a_measured_velocity_leaves_it_to_the_positions():
    platform = Platform(PoseTrack(), Mount((0.0, 0.0), 0.0))
    platform.track.add(0, Pose((0.0, 0.0), 0.0, twist=(99.0, 0.0, 0.0)))
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
