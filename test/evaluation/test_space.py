"""Distances, pairs and consistency of estimates in space."""

import numpy as np
import pytest

from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.core.types import Estimates, Truth
from phd_jdtc_ros.evaluation.comparison import ALL, Comparison, PairedScan, PointSet
from phd_jdtc_ros.evaluation.distances import Space

AXES = [*SPATIAL.place, *SPATIAL.motion]


def truth(places, motions=None):
    """Return targets at places with velocities, both (T, 3)."""
    places = np.asarray(places, dtype=float)
    motions = np.zeros_like(places) if motions is None else motions
    state = np.zeros((len(places), 5))
    state[:, [0, 2]], state[:, [1, 3]] = places[:, :2], motions[:, :2]
    height = np.stack([places[:, 2], motions[:, 2]], axis=1)
    return Truth(0, state, np.arange(1, len(places) + 1), np.zeros(len(places), int), height=height)


def estimates(states, covariance, largest_std=1e3):
    """Return estimates in space, given x, y, z and their velocities, (T, 6)."""
    count = len(states)
    state, full = np.zeros((count, 7)), np.zeros((count, 7, 7))
    state[:, AXES] = states
    full[:, np.array(AXES)[:, None], AXES] = covariance
    found = Estimates.empty(0, 0, 1, SPATIAL).changed(
        state=state,
        covariance=full,
        weight=np.ones(count),
        class_probability=np.ones((count, 1)),
        class_id=np.zeros(count, int),
        track_id=np.arange(1, count + 1),
        track_state=np.ones(count, int),
    )
    return found.with_heights(largest_std)


def values_of(true, found, cutoff=100.0):
    """Return the values of a scan by name, and its pairs."""
    scan = PairedScan.of(0, PointSet.of(true), PointSet.of(found), cutoff)
    values = Space(cutoff, 2.0).values(Comparison.of(scan, 0)[ALL])
    return dict(zip(Space.names, values, strict=True)), scan.pairs


def test_distances_have_three_axes():
    true = truth([[0, 0, 0], [500, 0, 300]])
    states = np.zeros((2, 6))
    states[:, :3] = [[3, 0, 4], [500, 0, 300]]
    values, _ = values_of(true, estimates(states, np.eye(6)))
    assert values["ospa_3d"] == pytest.approx(np.sqrt(25.0 / 2.0))
    assert values["gospa_3d"] == pytest.approx(5.0)


def test_targets_one_above_the_other_are_paired_by_their_heights():
    true = truth([[0, 0, 50], [0, 0, 90]])
    states = np.zeros((2, 6))
    states[:, :3] = [[0, 0, 88], [0, 0, 51]]
    _, (target, estimate) = values_of(true, estimates(states, np.eye(6)))
    assert dict(zip(target.tolist(), estimate.tolist(), strict=True)) == {0: 1, 1: 0}


def test_targets_that_pass_each_other_are_judged_by_their_own_velocities():
    motions = np.array([[15.0, 0.0, 0.0], [-15.0, 0.0, 0.0]])
    true = truth([[0, 0, 0], [0.2, 0, 0]], motions)
    # Each estimate is nearer to the other target.
    states = np.column_stack([[[0.2, 0, 0], [0, 0, 0]], motions])
    values, _ = values_of(true, estimates(states, 0.01 * np.eye(6)))
    assert values["judged_in_space"] == 2
    assert values["nees_3d_sum"] == pytest.approx(2.0 * 0.2**2 / 0.01 / 6.0)


def test_nees_of_six_axes_is_one_of_right_covariances():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(6, 6)) + 3.0 * np.eye(6)
    true = truth(np.column_stack([1e4 * np.arange(2000.0), np.zeros((2000, 2))]))
    states = np.zeros((2000, 6))
    states[:, 0] = 1e4 * np.arange(2000.0)
    states += rng.standard_normal((2000, 6)) @ root.T
    values, _ = values_of(true, estimates(states, root @ root.T))
    assert values["judged_in_space"] == 2000
    assert values["nees_3d_sum"] / 2000 == pytest.approx(1.0, abs=0.05)
    values, _ = values_of(true, estimates(states, 4.0 * root @ root.T))
    assert values["nees_3d_sum"] / 2000 == pytest.approx(0.25, abs=0.02)


def test_estimate_without_a_height_is_nowhere_in_space_and_paired_in_the_plane():
    true = truth([[0, 0, 50]])
    found = estimates(np.zeros((1, 6)), 1e4 * np.eye(6), largest_std=10.0)
    values, pairs = values_of(true, found)
    assert values["ospa_3d"] == pytest.approx(100.0)
    assert values["judged_in_space"] == 0
    assert len(pairs[0]) == 1


@pytest.mark.parametrize("what", ["truth", "estimates"])
def test_nothing_is_known_in_space_without_heights(what):
    true, found = truth([[0, 0, 50]]), estimates(np.zeros((1, 6)), np.eye(6))
    if what == "truth":
        true = Truth(0, true.state, true.track_id, true.class_id)
    else:
        planar = Estimates.empty(0, 0, 1)
        found = planar.changed(
            state=np.zeros((1, 5)),
            covariance=np.eye(5)[None],
            weight=np.ones(1),
            class_probability=np.ones((1, 1)),
            class_id=np.zeros(1, int),
            track_id=np.ones(1, int),
            track_state=np.ones(1, int),
        )
    values, pairs = values_of(true, found)
    assert (values["ospa_3d"], values["judged_in_space"]) == (None, 0)
    assert len(pairs[0]) == 1
