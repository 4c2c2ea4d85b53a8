import math

import numpy as np
import pytest

from phd_jdtc_ros.core.intake import transforms
from phd_jdtc_ros.core.intake.poses import PoseFault, PoseTrack
from phd_jdtc_ros.core.intake.transforms import Placement, Transform, TransformBuffer

S = 10**9


def turned(axis, angle):
    """Return the quaternion of a turn about an axis."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return (*(math.sin(0.5 * angle) * axis).tolist(), math.cos(0.5 * angle))


def at(x, y, yaw=0.0):
    return Placement((x, y, 0.0), turned((0, 0, 1), yaw))


def matrix(placement):
    """Return a placement as a matrix of homogeneous coordinates, by Rodrigues' formula."""
    axis, w = np.array(placement.rotation[:3]), placement.rotation[3]
    sine = np.linalg.norm(axis)
    unit, angle = axis / sine, 2.0 * math.atan2(sine, w)
    cross = np.cross(np.eye(3), unit)
    whole = np.eye(4)
    turn = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    whole[:3, :3], whole[:3, 3] = turn, placement.translation
    return whole


def buffer(*links, world="map", frames=("radar",), **options):
    """Return a buffer with static links, (parent, child, placement)."""
    made = TransformBuffer(world, frames, **options)
    for parent, child, placement in links:
        made.add(Transform(parent, child, 0, placement), static=True)
    return made


@pytest.mark.parametrize("seed", range(5))
def test_a_chain_composes_as_matrices_also_where_the_world_is_on_another_branch(seed):
    rng = np.random.default_rng(seed)
    # Tilts are small, so that the radar's z axis points up, as those of vehicles are.
    up, mast, down = (
        Placement(tuple(rng.normal(0.0, 50.0, 3)), turned((*rng.normal(0.0, 0.1, 2), 1.0), yaw))
        for yaw in rng.uniform(-3.0, 3.0, 3)
    )
    found = buffer(("earth", "base", up), ("base", "radar", mast), ("earth", "map", down))
    ((stamp_ns, pose),) = found.poses("radar")
    expected = np.linalg.inv(matrix(down)) @ matrix(up) @ matrix(mast)
    assert stamp_ns is None
    np.testing.assert_allclose(pose.position, expected[:2, 3], atol=1e-9)
    assert pose.yaw == pytest.approx(math.atan2(expected[1, 0], expected[0, 0]))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.4, 3.0])
def test_interpolation_turns_at_a_constant_rate_the_shorter_way(angle, sign):
    later = Placement((4.0, -2.0, 6.0), tuple(sign * part for part in turned((1, 2, 2), angle)))
    found = Placement((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)).between(later, 0.25)
    assert found.translation == (1.0, -0.5, 1.5)
    np.testing.assert_allclose(found.rotation, turned((1, 2, 2), 0.25 * angle), atol=1e-12)


def test_poses_come_at_the_stamps_of_all_moving_links_as_far_as_all_reach():
    found = buffer(("base", "radar", at(1.0, 0.0)))
    for stamp_s in (1, 2, 3):
        placed = at(0.0, float(stamp_s), math.pi / 2)
        found.add(Transform("odom", "base", stamp_s * S, placed), static=False)
    assert found.poses("radar") == []
    for stamp_s in (0, 2):
        found.add(Transform("map", "odom", stamp_s * S, at(10.0 * stamp_s, 0.0)), static=False)
    poses = found.poses("radar")
    assert [stamp_ns / S for stamp_ns, _ in poses] == [1, 2]
    assert [pose.position for _, pose in poses] == [
        pytest.approx((10.0, 2.0)),
        pytest.approx((20.0, 3.0)),
    ]
    assert found.poses("radar") == []
    found.add(Transform("map", "odom", 4 * S, at(40.0, 0.0)), static=False)
    assert [stamp_ns / S for stamp_ns, _ in found.poses("radar")] == [3]
    assert found.late("radar") == "the transform from 'base' to 'odom' ends at 3.000 s"


def test_a_static_chain_gives_its_pose_once_and_again_if_it_changes():
    found = buffer(("map", "radar", at(5.0, 6.0, 1.0)))
    assert [stamp_ns for stamp_ns, _ in found.poses("radar")] == [None]
    assert found.is_fixed("radar")
    assert found.poses("radar") == []
    found.add(Transform("map", "radar", 9, at(7.0, 6.0)), static=True)
    assert [pose.position for _, pose in found.poses("radar")] == [(7.0, 6.0)]


def test_a_broken_chain_names_its_missing_link_and_a_late_one_mends_it():
    found = buffer(("base_link", "radar", at(1.0, 0.0)))
    assert found.broken("radar") == (
        "no transform from 'base_link' to 'map': the chain from 'radar' ends at 'base_link'"
    )
    assert found.poses("radar") == []
    found.add(Transform("map", "base_link", 0, at(3.0, 0.0)), static=True)
    assert found.broken("radar") == ""
    assert [pose.position for _, pose in found.poses("radar")] == [(4.0, 0.0)]


@pytest.mark.parametrize(
    ("parent", "child"), [("radar", "odom"), ("radar", "map"), ("map", "map"), ("base", "base")]
)
def test_a_transform_that_closes_a_circle_changes_no_pose(parent, child):
    chain = ("base", "radar", at(1.0, 0.0)), ("odom", "base", at(5.0, 0.0))
    found = buffer(*chain, ("map", "odom", at(0.0, 2.0)))
    circle = Transform(parent, child, 0, at(900.0, 0.0))
    assert found.add(circle, static=True) is PoseFault.CIRCLE
    assert [pose.position for _, pose in found.poses("radar")] == [(6.0, 2.0)]


def test_a_stray_transform_of_the_world_frame_does_not_keep_out_the_chain_to_it():
    found = buffer(("radar", "map", at(900.0, 0.0)), ("base", "radar", at(1.0, 0.0)))
    odometry = Transform("map", "base", 0, at(0.0, 2.0))
    assert found.add(odometry, static=True) is PoseFault.CIRCLE
    assert not found.add(odometry, static=True)
    assert [pose.position for _, pose in found.poses("radar")] == [(1.0, 2.0)]


def test_a_transform_of_another_clock_is_named_beside_the_one_that_it_does_not_reach():
    found = buffer(("base", "radar", at(1.0, 0.0)))
    for stamp_s in range(3):
        found.add(Transform("map", "odom", stamp_s * S, at(0.0, 0.0)), static=False)
        found.add(Transform("odom", "base", (3600 + stamp_s) * S, at(0.0, 0.0)), static=False)
    assert found.poses("radar") == []
    assert found.late("radar") == (
        "the transform from 'odom' to 'map' ends at 2.000 s, before that from 'base' to 'odom' "
        "begins at 3600.000 s"
    )


def test_a_frame_with_two_parents_has_the_latest_and_is_noticed_if_it_is_in_a_chain():
    found = buffer(("map", "radar", at(1.0, 0.0)), ("map", "other", at(5.0, 0.0)))
    assert not found.add(Transform("map", "radar", 1, at(2.0, 0.0)), static=True)
    moved = Transform("other", "radar", 2, at(2.0, 0.0))
    assert found.add(moved, static=True) is PoseFault.PARENT
    assert [pose.position for _, pose in found.poses("radar")] == [(7.0, 0.0)]
    found.add(Transform("map", "far", 0, at(0.0, 0.0)), static=True)
    assert not found.add(Transform("other", "far", 1, at(0.0, 0.0)), static=True)


def test_a_frame_on_both_topics_has_the_latest_transform_and_is_noticed():
    found = buffer(("map", "radar", at(1.0, 0.0)))
    moving = Transform("map", "radar", S, at(2.0, 0.0))
    assert found.add(moving, static=False) is PoseFault.PARENT
    assert [pose.position for _, pose in found.poses("radar")] == [(2.0, 0.0)]


@pytest.mark.parametrize("steep", [False, True])
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (1, 1, 0)])
def test_a_frame_that_lies_on_its_side_has_no_pose_in_the_plane_but_in_space(axis, steep):
    for angle in (math.pi / 2, math.pi, 4.0) if steep else (0.0, 0.5, 0.9):
        placed = Placement((1.0, 2.0, 3.0), turned(axis, angle)).pose()
        assert PoseTrack().add(0, placed) is (PoseFault.ORIENTATION if steep else None)
        assert PoseTrack(in_space=True).add(0, placed) is None


def test_stamps_that_jump_back_begin_a_new_run():
    found = buffer(("base", "radar", at(0.0, 0.0)), reset_threshold_s=3.0)
    for stamp_s in (100, 101, 1, 2, 3):
        found.add(Transform("map", "base", stamp_s * S, at(stamp_s, 0.0)), static=False)
        poses = found.poses("radar")
        assert [(stamp_ns, pose.position[0]) for stamp_ns, pose in poses] == [
            (stamp_s * S, stamp_s)
        ]
    found.add(Transform("map", "base", 2 * S + 1, at(0.0, 0.0)), static=False)
    assert found.poses("radar") == []


def test_only_chains_have_a_history_and_all_is_bounded(monkeypatch):
    monkeypatch.setattr(transforms, "MOST_FRAMES", 20)
    found = buffer(("base", "radar", at(0.0, 0.0)))
    for stamp_s in range(100):
        found.add(Transform("map", "base", stamp_s * S, at(0.0, 0.0)), static=False)
        found.add(Transform("map", "other", stamp_s * S, at(0.0, 0.0)), static=False)
        found.add(Transform("map", f"frame {stamp_s}", 0, at(0.0, 0.0)), static=True)
    lengths = {name: len(link.stamps_ns) for name, link in found._links.items()}
    assert len(lengths) == 20
    assert lengths.pop("base") == transforms.HISTORY_S + 1
    assert set(lengths.values()) == {1}
    assert found.broken("radar") == ""
