import numpy as np
import pytest
from matchings import posterior
from scenes import intensity

from phd_jdtc_ros.core.association.claims import Claims
from phd_jdtc_ros.core.smc.correction import BERNOULLI, CORRECTORS, POISSON


def claims(likelihood, weight, other, p_d=0.9):
    """Return claims of a dense (N, M) likelihood; p_D is one number or one per particle."""
    row, column = np.nonzero(likelihood)
    p_d = np.broadcast_to(p_d, len(weight))
    mass = (p_d * weight)[row] * likelihood[row, column]
    return Claims(row, column, mass, np.asarray(other, dtype=float), p_d)


def corrected(likelihood, weight, other, p_d=0.9, row_label=None, corrector=BERNOULLI):
    weight = np.asarray(weight, dtype=float)
    phd = intensity(np.zeros((len(weight), 5)), weight, row_label=row_label)
    likelihood = np.asarray(likelihood, dtype=float)
    return corrector.correct(phd, claims(likelihood, weight, other, p_d))[:2]


def pair_weights(likelihood, weight, other, p_d, row_label, corrector):
    """Return the weight of each pair, (N, M); zero where there is none."""
    phd = intensity(np.zeros((len(weight), 5)), weight, row_label=row_label)
    pairs = claims(likelihood, weight, other, p_d)
    found = np.zeros_like(likelihood)
    found[pairs.row, pairs.column] = corrector.correct(phd, pairs).pair
    return found


@pytest.mark.parametrize("existence", [0.01, 0.5, 0.99, 1.0])
def test_bernoulli_missed_target_keeps_the_existence_of_bayes_rule(existence):
    phd, _ = corrected(np.zeros((2, 0)), [existence / 2.0] * 2, [])
    expected = existence * 0.1 / (1.0 - 0.9 * existence)
    assert phd.weight.sum() == pytest.approx(expected, rel=1e-12)


def test_poisson_keeps_components_for_detections_and_scales_misses():
    phd, _ = corrected(np.zeros((1, 0)), [0.99], [], corrector=POISSON)
    assert phd.weight.sum() == pytest.approx(0.099)
    phd, claimed = corrected(np.ones((3, 2)), [0.1, 0.2, 0.3], [1.0, 3.0], corrector=POISSON)
    np.testing.assert_allclose(claimed, [0.54 / 1.54, 0.54 / 3.54])
    np.testing.assert_array_equal(phd.label, [-1, -1])
    assert phd.components.format == "csr"
    masses = phd.components.toarray().sum(axis=0)
    np.testing.assert_allclose(masses, [0.54 / 1.54, 0.54 / 3.54])
    likelihood = np.array([[2.0, 0.0], [1.0, 4.0], [0.5, 3.0]])
    weight, other = np.array([0.1, 0.2, 0.3]), np.array([1.0, 3.0])
    mass = 0.9 * weight[:, None] * likelihood
    pairs = pair_weights(likelihood, weight, other, 0.9, None, POISSON)
    np.testing.assert_allclose(pairs, mass / (other + mass.sum(axis=0)), rtol=1e-12)


@pytest.mark.parametrize("targets", [1, 2, 3])
@pytest.mark.parametrize("detections", [0, 1, 2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_bernoulli_targets_have_the_posterior_of_all_association_events(targets, detections, seed):
    rng = np.random.default_rng(seed)
    row_label = np.repeat(np.array([11, 3, 40])[:targets], [5, 2, 4][:targets])
    order = rng.permutation(len(row_label))
    row_label, (label, target) = row_label[order], np.unique(row_label[order], return_inverse=True)
    existence = rng.uniform(0.05, 0.999, targets)
    weight = rng.uniform(0.1, 1.0, len(row_label))
    weight *= (existence / np.bincount(target, weight))[target]
    # One particle is out of sight, and some pairs are outside of the gate.
    p_d = rng.uniform(0.2, 0.999, len(row_label))
    p_d[0] = 0.0
    likelihood = rng.exponential(1.0, (len(row_label), detections))
    likelihood[rng.random(likelihood.shape) < 0.2] = 0.0
    other = rng.uniform(0.02, 1.0, detections)
    missed, detected = posterior(
        target, weight, weight * (1.0 - p_d), (weight * p_d)[:, None] * likelihood / other
    )
    phd, claimed = corrected(likelihood, weight, other, p_d, row_label)
    np.testing.assert_array_equal(phd.label, label)
    np.testing.assert_allclose(phd.weight, missed + detected.sum(axis=1), rtol=1e-9)
    np.testing.assert_allclose(
        phd.component_mass, np.bincount(target, missed + detected.sum(axis=1)), rtol=1e-9
    )
    np.testing.assert_allclose(claimed, detected.sum(axis=0), rtol=1e-9)
    pairs = pair_weights(likelihood, weight, other, p_d, row_label, BERNOULLI)
    np.testing.assert_allclose(pairs, detected, rtol=1e-9)


def test_bernoulli_keeps_one_target_where_poisson_makes_more():
    likelihood, weight, other = np.full((4, 2), 50.0), np.full(4, 0.2475), [0.01, 0.01]
    single, _ = corrected(likelihood, weight, other)
    double, _ = corrected(likelihood, weight, other, corrector=POISSON)
    assert single.weight.sum() <= 1.0
    assert double.weight.sum() > 1.9
    phd, _ = corrected(np.zeros((2, 0)), [0.6, 0.6], [], p_d=0.5)
    assert phd.weight.sum() == pytest.approx(1.0)


def test_bernoulli_of_small_masses_is_the_poisson_correction():
    # For a very small mass the limit of one target has no effect.
    rng = np.random.default_rng(1)
    likelihood, weight = rng.exponential(1.0, (6, 1)), rng.uniform(1e-7, 1e-6, 6)
    row_label = np.array([0, 0, 1, 1, 2, 2])
    phds = [
        corrected(likelihood, weight, [2e-7], row_label=row_label, corrector=c)[0]
        for c in (BERNOULLI, POISSON)
    ]
    np.testing.assert_allclose(phds[0].weight, phds[1].weight, rtol=1e-5)


def test_bernoulli_components_are_the_origins_and_hold_all_mass():
    row_label = np.array([7, 2, 7, 5])
    phd, _ = corrected(np.ones((4, 2)), [0.1, 0.2, 0.3, 0.4], [1.0, 1.0], row_label=row_label)
    np.testing.assert_array_equal(phd.label, [2, 5, 7])
    np.testing.assert_array_equal(phd.poisson, 0.0)
    dense = phd.components.toarray()
    np.testing.assert_array_equal(np.nonzero(dense)[1], [2, 0, 2, 1])
    np.testing.assert_allclose(dense.sum(axis=1), phd.weight)


@pytest.mark.parametrize("corrector", CORRECTORS.values(), ids=CORRECTORS)
def test_corrector_of_nothing_claims_nothing(corrector):
    # There is no clutter at the last detection.
    phd, claimed = corrected(np.zeros((0, 3)), [], [1.0, 1.0, 0.0], corrector=corrector)
    assert len(phd) == 0
    np.testing.assert_array_equal(claimed, 0.0)
