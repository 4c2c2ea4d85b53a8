"""The Bernoulli corrector of rows of any kind."""

import numpy as np
import pytest

from phd_jdtc_ros.core.association import marginals
from phd_jdtc_ros.core.association.claims import Claims
from phd_jdtc_ros.core.association.shares import posterior_shares


def scene(seed=0, rows=12, targets=4, detections=3):
    """Return the target and the weight of each row, and claims with two thirds of all pairs."""
    rng = np.random.default_rng(seed)
    target = np.arange(rows) % targets
    weight = rng.uniform(0.05, 0.3, rows)
    p_d = rng.uniform(0.5, 0.99, rows)
    row, column = np.nonzero(rng.random((rows, detections)) < 0.67)
    mass = (weight * p_d)[row] * rng.exponential(1.0, len(row))
    return target, weight, Claims(row, column, mass, rng.uniform(0.1, 1.0, detections), p_d)


def shares_of(target, targets, weight, claims):
    """Return the factors by which the detections change the weights, as an engine gets them."""
    claims = Claims(*map(np.ascontiguousarray, claims))
    return posterior_shares(
        marginals.MOST_WORK, targets, *map(np.ascontiguousarray, (target, weight)), claims
    )


def posterior(target, weight, claims):
    """Return the mass of each row that was missed, and that of each pair."""
    shares = shares_of(target, 4, weight, claims)
    missed = shares.prior * (1.0 - claims.detection_probability) * shares.missed[target]
    return missed, claims.mass * shares.pair, shares.claimed


def test_row_may_be_split_into_equal_ones():
    target, weight, claims = scene()
    twice = Claims(
        np.concatenate([claims.row, claims.row + len(target)]),
        np.tile(claims.column, 2),
        np.tile(claims.mass / 2.0, 2),
        claims.other,
        np.tile(claims.detection_probability, 2),
    )
    whole = posterior(target, weight, claims)
    halves = posterior(np.tile(target, 2), np.tile(weight / 2.0, 2), twice)
    for one, other in zip(whole[:2], halves[:2], strict=True):
        np.testing.assert_allclose(np.tile(one / 2.0, 2), other, rtol=1e-9)
    np.testing.assert_allclose(whole[2], halves[2], rtol=1e-9)


def test_mass_above_one_is_scaled_down_for_that_target_alone():
    # Far from each other, with a detection each: the first of mass 1.5, in two rows.
    weight, target = np.array([0.75, 0.75, 0.4]), np.array([0, 0, 1])
    likelihood, other = np.array([2.0, 4.0, 3.0]), np.array([0.5, 0.7])
    p_d = np.full(3, 0.9)
    claims = Claims(np.arange(3), target, 0.9 * weight * likelihood, other, p_d)
    missed, detected, claimed = posterior(target, weight, claims)
    # Hypotheses of a target: it does not exist, is missed, or is the source of the detection.
    certain = np.array([0.5, 0.5, 0.4])
    absent, unseen = np.array([0.0, 0.6]), certain * 0.1
    source = certain * 0.9 * likelihood / other[target]
    total = (absent + np.bincount(target, unseen + source))[target]
    np.testing.assert_allclose(missed, unseen / total, rtol=1e-9)
    np.testing.assert_allclose(detected, source / total, rtol=1e-9)
    np.testing.assert_allclose(claimed, np.bincount(target, source / total), rtol=1e-9)


@pytest.mark.parametrize("p_d", [0.9, 0.995, 0.9999, 1.0 - 2e-6])
def test_certain_target_that_is_missed_exists_however_good_the_radar(p_d):
    none, empty = np.zeros(0, dtype=np.int64), np.zeros(0)
    claims = Claims(none, none, empty, empty, np.array([p_d, p_d]))
    missed, _, _ = posterior(np.zeros(2, dtype=np.int64), np.array([0.7, 0.3]), claims)
    np.testing.assert_allclose(missed, [0.7, 0.3], rtol=1e-9)


@pytest.mark.parametrize("p_d", [0.995, 0.9999, 1.0 - 2e-6])
def test_detection_of_a_certain_target_is_weighed_against_clutter_as_by_bayes_rule(p_d):
    one = np.zeros(1, dtype=np.int64)
    claims = Claims(one, one, np.array([p_d * 0.01]), np.array([2.0]), np.array([p_d]))
    missed, detected, _ = posterior(one, np.ones(1), claims)
    source, unseen = p_d * 0.01 / 2.0, 1.0 - p_d
    np.testing.assert_allclose(detected, [source / (source + unseen)], rtol=1e-9)
    np.testing.assert_allclose(missed, [unseen / (source + unseen)], rtol=1e-9)


def test_no_rows_and_no_detections_are_valid():
    none, empty = np.zeros(0, dtype=np.int64), np.zeros(0)
    shares = shares_of(none, 0, empty, Claims(none, none, empty, np.ones(2), empty))
    np.testing.assert_array_equal(shares.claimed, [0.0, 0.0])
    shares = shares_of(
        np.zeros(2, dtype=np.int64),
        1,
        np.array([0.3, 0.2]),
        Claims(none, none, empty, empty, np.array([0.9, 0.9])),
    )
    np.testing.assert_allclose(0.5 * 0.1 * shares.missed, [0.05 / 0.55])


def test_part_of_claims_is_that_of_some_rows_of_each_detection():
    row, column = np.array([0, 1, 2, 0, 2]), np.array([0, 0, 0, 1, 1])
    mass = np.array([0.1, 0.2, 0.5, 0.3, 0.9])
    claims = Claims(row, column, mass, np.array([0.1, 0.2, 0.3]), np.full(3, 0.9))
    part = claims.share_of(np.array([True, True, False]))
    np.testing.assert_allclose(part, [0.375, 0.25, 0.0])


def test_pair_of_a_row_that_is_not_detected_has_no_mass():
    # The second target is out of the radar's sight, but within the gate.
    weight, p_d = np.array([0.5, 0.6]), np.array([0.9, 0.0])
    claims = Claims(np.arange(2), np.zeros(2, dtype=int), weight * p_d, np.ones(1), p_d)
    shares = shares_of(np.arange(2), 2, weight, claims)
    alone = Claims(np.arange(1), np.zeros(1, dtype=int), weight[:1] * p_d[:1], np.ones(1), p_d[:1])
    expected = shares_of(np.arange(1), 1, weight[:1], alone)
    np.testing.assert_array_equal(shares.pair, [expected.pair[0], 0.0])
    np.testing.assert_array_equal(shares.claimed, expected.claimed)
    np.testing.assert_allclose(shares.missed, [expected.missed[0], 1.0], rtol=1e-12)
