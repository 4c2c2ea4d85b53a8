from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros.core.gaussian.bounds import Bounds
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.gaussian.reduction import Branched, reduce_hypotheses
from phd_jdtc_ros.core.state_space import PLANAR

SIZE = len(PLANAR)

BOUNDS = Bounds(
    hypotheses=5,
    least_share=1e-3,
    merge_distance=0.5,
    least_existence=1e-4,
    most=1000,
    least_mode=1.0,
)


def bounds(**changed):
    return Bounds(**{**BOUNDS.__dict__, **changed})


def branched(rng, sizes, spread=30.0):
    """Return targets of some hypotheses, by target, the most probable first."""
    row_label = np.arange(len(sizes)).repeat(sizes) * 10
    count, modes, classes = len(row_label), 2, 2
    weight = rng.exponential(1.0, (count, modes, classes))
    total = np.bincount(row_label // 10, weight.sum(axis=(1, 2)))
    weight *= (rng.uniform(0.2, 1.0, len(sizes)) / total)[row_label // 10][:, None, None]
    order = np.lexsort((-weight.sum(axis=(1, 2)), row_label))
    factor = rng.normal(0.0, 10.0, (count, modes, SIZE, SIZE))
    return Branched(
        Mixture(
            row_label,
            weight[order],
            rng.normal(0.0, spread, (count, modes, SIZE)),
            factor @ factor.swapaxes(-1, -2) + 100.0 * np.eye(SIZE),
            rng.dirichlet(np.ones(3), (count, classes)),
        ),
        np.arange(count),
    )


def moments_of(mixture, mode):
    """Return weight, mean and covariance of one mode of each target."""
    found = []
    for target in range(len(mixture.sums.label)):
        rows = np.flatnonzero(mixture.sums.target == target)
        weight = mixture.sums.mode_weight[rows, mode]
        share = weight / weight.sum()
        centre = share @ mixture.mean[rows, mode]
        apart = mixture.mean[rows, mode] - centre
        spread = np.tensordot(share, mixture.covariance[rows, mode], axes=1)
        found.append((weight.sum(), centre, spread + (share[:, None] * apart).T @ apart))
    return found


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("distance", [0.0, 0.5, 3.0, 100.0])
def test_merging_conserves_weight_mean_and_covariance_of_each_mode(seed, distance):
    rng = np.random.default_rng(seed)
    before = branched(rng, [1, 4, 7, 2])
    after, ancestry, floored = reduce_hypotheses(before, bounds(merge_distance=distance))
    assert floored == 0
    np.testing.assert_allclose(after.sums.existence, before.mixture.sums.existence)
    for mode in range(2):
        for ours, theirs in zip(
            moments_of(before.mixture, mode), moments_of(after, mode), strict=True
        ):
            for part, other in zip(ours, theirs, strict=True):
                np.testing.assert_allclose(part, other, rtol=1e-8, atol=1e-7)
    # The weights of classes are summed too.
    np.testing.assert_allclose(after.weight.sum(axis=0), before.mixture.weight.sum(axis=0))
    if distance == 0.0:
        assert len(after) == len(before.mixture)
    if distance == 100.0:
        assert len(after) < len(before.mixture)
    total = np.zeros_like(after.weight)
    np.add.at(total, ancestry.child, ancestry.share)
    np.testing.assert_allclose(total, 1.0)
    np.testing.assert_allclose(
        after.weight[ancestry.child] * ancestry.share, before.mixture.weight[ancestry.parent]
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("least", [0.0, 0.3])
def test_probable_modes_go_on_as_hypotheses_of_their_own(seed, least):
    before = branched(np.random.default_rng(seed), [1, 4, 7])
    whole, _, _ = reduce_hypotheses(before, bounds(merge_distance=3.0))
    after, ancestry, _ = reduce_hypotheses(before, bounds(merge_distance=3.0, least_mode=least))
    share = whole.sums.mode_weight / whole.sums.mass[:, None]
    assert len(after) == np.maximum((share >= least).sum(axis=1), 1).sum() > len(whole)
    for mode in range(2):
        for ours, theirs in zip(moments_of(whole, mode), moments_of(after, mode), strict=True):
            for part, other in zip(ours, theirs, strict=True):
                np.testing.assert_allclose(part, other, rtol=1e-8, atol=1e-7)
    if least == 0.0:
        assert ((after.sums.mode_weight > 0.0).sum(axis=1) == 1).all()
    # Improbable modes stay with the most probable one.
    lost = np.sort(after.weight[after.weight > 0.0]) - np.sort(whole.weight[whole.weight > 0.0])
    np.testing.assert_allclose(lost, 0.0, atol=1e-15)
    assert (np.diff(ancestry.child) >= 0).all()
    total = np.zeros_like(before.mixture.weight)
    np.add.at(total, ancestry.parent, after.weight[ancestry.child] * ancestry.share)
    np.testing.assert_allclose(total, before.mixture.weight)


def test_hypotheses_within_the_distance_are_merged_and_no_others():
    rng = np.random.default_rng(0)
    part = branched(rng, [3]).mixture
    mean = np.zeros((3, 2, SIZE))
    mean[1, :, 0], mean[2, :, 0] = 0.6, 0.9
    whole = replace(part, mean=mean, covariance=np.broadcast_to(np.eye(SIZE), (3, 2, SIZE, SIZE)))
    after, ancestry, _ = reduce_hypotheses(
        Branched(whole, np.arange(3)), bounds(merge_distance=0.5)
    )
    # Square distances from the first: 0.36 and 0.81.
    assert len(after) == 2
    children = dict(zip(ancestry.parent.tolist(), ancestry.child.tolist(), strict=True))
    assert children[0] == children[1] != children[2]


@pytest.mark.parametrize("ratio", [0.1, 10.0])
def test_hypotheses_of_one_mean_and_other_widths_stay_apart(ratio):
    # As of a target that has flown straight on unseen, and one that may have turned meanwhile.
    part = branched(np.random.default_rng(0), [2]).mixture
    same, width = np.zeros((2, 2, SIZE)), np.array([1.0, ratio])[:, None, None, None]
    for widths, kept in ((width, 2), (np.ones_like(width), 1)):
        covariance = widths * np.broadcast_to(np.eye(SIZE), (2, 2, SIZE, SIZE))
        whole = Branched(replace(part, mean=same, covariance=covariance), np.arange(2))
        after, _, _ = reduce_hypotheses(whole, bounds(merge_distance=4.0))
        assert len(after) == kept
    # Twice the divergence of the absorbed from the absorbing one.
    twice = SIZE * (ratio - 1.0 - np.log(ratio))
    whole = replace(
        part, mean=same, covariance=width * np.broadcast_to(np.eye(SIZE), (2, 2, SIZE, SIZE))
    )
    for distance, kept in ((0.99 * twice, 2), (1.01 * twice, 1)):
        after, _, _ = reduce_hypotheses(
            Branched(whole, np.arange(2)), bounds(merge_distance=distance)
        )
        assert len(after) == kept


def test_targets_are_never_merged_with_each_other():
    rng = np.random.default_rng(0)
    part = branched(rng, [1, 1]).mixture
    same = replace(part, mean=part.mean[[0, 0]], covariance=part.covariance[[0, 0]])
    after, _, _ = reduce_hypotheses(Branched(same, np.arange(2)), bounds(merge_distance=100.0))
    assert after.row_label.tolist() == [0, 10]


def test_improbable_targets_are_dropped():
    part = branched(np.random.default_rng(0), [2, 2]).mixture
    weight = part.weight * np.array([1e-6, 1e-6, 1.0, 1.0])[:, None, None]
    faint = replace(part, weight=weight)
    after, _, _ = reduce_hypotheses(Branched(faint, np.arange(4)), BOUNDS)
    assert after.sums.label.tolist() == [10]
    before = branched(np.random.default_rng(1), [5] * 30, spread=1e4)
    after, _, _ = reduce_hypotheses(before, bounds(most=40))
    assert 30 <= len(after) <= 40
    existence = before.mixture.sums.existence
    dropped = np.setdiff1d(before.mixture.sums.label, after.sums.label) // 10
    assert existence[dropped].max() <= after.sums.existence.min()
    none = Mixture.empty(2, 2, 3, SIZE)
    after, ancestry, floored = reduce_hypotheses(Branched(none, np.zeros(0, dtype=int)), BOUNDS)
    assert (len(after), len(ancestry.child), floored) == (0, 0, 0)


@pytest.mark.parametrize(("most", "apart"), [(500, True), (300, False)])
def test_modes_that_go_on_apart_cost_no_target(most, apart):
    # Once for each of two modes, thirty targets of two hypotheses are 120.
    before = branched(np.random.default_rng(1), [2] * 30, spread=1e4)
    whole, _, _ = reduce_hypotheses(before, bounds(most=most))
    after, _, _ = reduce_hypotheses(before, bounds(most=most, least_mode=0.0))
    assert len(np.unique(after.sums.label)) == 30
    assert len(after) == (2 * len(whole) if apart else len(whole))


def test_merged_hypotheses_have_the_mean_snr_of_each_class():
    before = branched(np.random.default_rng(2), [1, 4, 7, 2])
    after, _, _ = reduce_hypotheses(before, bounds(merge_distance=100.0))
    for target in range(len(after.sums.label)):
        own, found = before.mixture.sums.target == target, after.sums.target == target
        weight = before.mixture.weight[own].sum(axis=1)
        expected = (weight[..., None] * before.mixture.snr[own]).sum(axis=0)
        merged = (after.weight[found].sum(axis=1)[..., None] * after.snr[found]).sum(axis=0)
        np.testing.assert_allclose(merged, expected, rtol=1e-9)


def mixture(row_label, modes=2, classes=3):
    count, rng = len(row_label), np.random.default_rng(row_label)
    factor = rng.normal(0.0, 1.0, (count, modes, SIZE, SIZE))
    return Mixture(
        np.array(row_label),
        rng.uniform(0.0, 0.05, (count, modes, classes)),
        rng.normal(0.0, 100.0, (count, modes, SIZE)),
        factor @ factor.swapaxes(-1, -2),
        rng.dirichlet(np.ones(4), (count, classes)),
    )


def test_extents_are_the_moments_of_each_target():
    found = mixture([3, 3, 8])
    extents = found.extents(PLANAR)
    for target, rows in enumerate(([0, 1], [2])):
        share = found.sums.mode_weight[rows].ravel() / found.sums.mode_weight[rows].sum()
        states = found.mean[rows].reshape(-1, SIZE)
        centre = share @ states
        apart = states - centre
        spread = np.tensordot(share, found.covariance[rows].reshape(-1, SIZE, SIZE), axes=1)
        spread = spread + (share[:, None] * apart).T @ apart
        variance = np.diag(spread)
        deviations = np.sqrt([variance[[0, 2]].sum(), variance[[1, 3]].sum()])
        expected = [*centre[[0, 2, 1, 3]], *deviations]
        np.testing.assert_allclose(extents.moments[target], expected)
    assert extents.target.tolist() == [0, 0, 1]


def test_empty_and_read_only_mixtures():
    with pytest.raises(ValueError, match="read-only"):
        mixture([1]).weight[0] = 1.0
    found = Mixture.empty(2, 1, 4, SIZE)
    assert len(found) == len(found.sums.label) == len(found.sums.existence) == 0
    assert found.class_mass().tolist() == [0.0]
    assert len(found.extents(PLANAR).label) == 0


def with_modes(shares, variances, means=(0.0, 0.0)):
    """Return two hypotheses of one target with their shares of two modes and their Gaussians."""
    covariance = np.zeros((2, 2, SIZE, SIZE))
    mean = np.zeros((2, 2, SIZE))
    for row in range(2):
        mean[row, :, 0] = means[row]
        for mode in range(2):
            covariance[row, mode] = variances[row][mode] * np.eye(SIZE)
    weight = np.array([[[0.5], [0.5]], [[0.2], [0.2]]]) * np.array(shares)[..., None]
    return Branched(
        Mixture(np.zeros(2, dtype=np.int64), weight, mean, covariance, np.ones((2, 1, 1))),
        np.arange(2),
    )


def test_hypotheses_that_differ_only_in_the_shares_of_their_modes_are_merged_without_loss():
    # The moments over both modes are far apart: one hypothesis is mostly narrow, the other wide.
    narrow_or_wide = [[1.0, 100.0], [1.0, 100.0]]
    before = with_modes([[0.98, 0.02], [0.02, 0.98]], narrow_or_wide)
    after, _, _ = reduce_hypotheses(before, bounds(merge_distance=1e-9))
    assert len(after) == 1
    np.testing.assert_allclose(after.mean[0], before.mixture.mean[0])
    np.testing.assert_allclose(after.covariance[0], before.mixture.covariance[0])
    np.testing.assert_allclose(after.weight[0], before.mixture.weight.sum(axis=0))


@pytest.mark.parametrize(
    ("variance", "mean", "is_merged"), [(1.0, 1.9, True), (1.0, 2.1, False), (20.0, 0.0, False)]
)
def test_the_distance_is_that_of_the_gaussians_of_each_mode(variance, mean, is_merged):
    before = with_modes([[0.9, 0.1]] * 2, [[1.0, 1.0], [variance] * 2], (0.0, mean))
    after, _, _ = reduce_hypotheses(before, bounds(merge_distance=4.0))
    assert len(after) == (1 if is_merged else 2)
