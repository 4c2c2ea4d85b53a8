"""Owners against an enumeration of all assignments of sources to tracks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from phd_jdtc_ros.core.reports.owners import LIKELY, SECOND, owner_probabilities

PRIOR = 0.3


def _enumerated(log_weight, second=0.0):
    """Return the probability of each owner, (S, T), by all assignments to places of tracks."""
    sources, targets = log_weight.shape
    total, found = 0.0, np.zeros(log_weight.shape)
    contested = (log_weight > LIKELY).sum(axis=0) > 1
    for owners in itertools.product(range(2 * targets + 1), repeat=sources):
        if any(owners.count(g) > 1 for g in range(2 * targets)):
            continue
        pairs = [(s, g % targets) for s, g in enumerate(owners) if g < 2 * targets]
        weight = np.exp(sum(log_weight[pair] for pair in pairs))
        for g in owners:
            if targets <= g < 2 * targets:
                weight *= second * contested[g - targets]
        total += weight
        for pair in pairs:
            found[pair] += weight
    return found / total


@pytest.mark.parametrize("size", [2, 3])
def test_owners_equal_the_enumeration_of_assignments(size):
    rng, errors, exclusive = np.random.default_rng(size), [], []
    source, label = map(np.ravel, np.mgrid[:size, :size])
    for _ in range(600 // size**2):
        log_weight = np.full((size, size), np.log(PRIOR / (1.0 - PRIOR)))
        for _ in range(8):
            own = int(rng.integers(size))
            log_weight[own] += rng.normal(-0.5, 1.0, size)
            found = owner_probabilities(
                source, label, np.full(size**2, 2), log_weight.ravel()
            ).reshape(size, size)
            errors.append(np.abs(found - _enumerated(log_weight, SECOND)).max())
            if size == 2:
                exclusive.append(np.abs(found - _enumerated(log_weight)).max())
    assert np.mean(errors) < 1e-9
    assert max(errors) < 1e-7
    # Second transmitters are so rare that the result is nearly that of exclusive owners.
    assert np.mean(exclusive or [0.0]) < 0.003


def test_sources_of_two_spaces_may_own_one_track():
    certain = np.array([9.0, 9.0])
    both = owner_probabilities(np.array([1, 2]), np.array([7, 7]), np.array([1, 2]), certain)
    np.testing.assert_allclose(both, 1.0 / (1.0 + np.exp(-9.0)))


def test_two_transmitters_of_one_ship_do_not_fight():
    source, label, space = np.array([1, 2]), np.array([7, 7]), np.array([2, 2])
    assert (owner_probabilities(source, label, space, np.array([9.0, 9.0])) > 0.8).all()
    # One that is less likely than the other one takes nothing from it.
    found = owner_probabilities(source, label, space, np.array([9.0, 0.0]))
    np.testing.assert_allclose(found, [1.0, 0.0], atol=1e-3)


def test_owners_of_certain_pairs_are_finite():
    found = owner_probabilities(
        np.array([1, 1]), np.array([3, 4]), np.array([2, 2]), np.array([1e6, -1e6])
    )
    np.testing.assert_allclose(found, [1.0, 0.0], atol=1e-9)
