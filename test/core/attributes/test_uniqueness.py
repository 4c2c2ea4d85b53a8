"""Unique identities: the sources of a detection against the sum over all that could be so."""

import itertools

import numpy as np
import pytest
from lone import lone

from phd_jdtc_ros.core.association.claims import undetected
from phd_jdtc_ros.core.attributes import identity, uniqueness
from phd_jdtc_ros.core.attributes.identity import Belief, IdentityModel
from phd_jdtc_ros.core.types import UNKNOWN

# Few identities, so that all can be summed over; what answers shows its own.
SIZE = 5
MODEL = IdentityModel(SIZE, equipped=0.8, reply=0.9, garbled=0.0, unique=True)
SHOWN = 3
EXISTENCE, DETECTED = np.array([0.7, 0.9]), np.array([0.6, 0.95])
# Likelihoods of the detection: each target's state, then clutter and unknown targets.
LIKELIHOOD, CLUTTER, UNKNOWN_TARGETS = np.array([2.0, 0.1]), 0.3, 0.2


def beliefs():
    """Return two beliefs in the identity that is shown: half sure, and nearly so."""
    candidate = np.full((2, identity.CANDIDATES), UNKNOWN)
    weight = np.zeros((2, identity.CANDIDATES + 2))
    candidate[:, 0], candidate[:, 1] = SHOWN, 1
    weight[0, :2], weight[1, :2] = (0.5, 0.3), (0.92, 0.0)
    weight[:, identity.REST], weight[:, identity.ABSENT] = (0.15, 0.05), (0.05, 0.03)
    return Belief(candidate, weight)


def by_state(weight, candidates):
    """Return the probability of each identity, and of no transponder."""
    known = dict(zip(candidates.tolist(), weight.tolist(), strict=False))
    others = [k for k in range(SIZE) if k not in known]
    table = {k: weight[identity.REST] / len(others) for k in others}
    table.update((k, known[k]) for k in range(SIZE) if k in known)
    return {**table, UNKNOWN: weight[identity.ABSENT]}


def weights_of_all_events():
    """Return the weight of each source: the targets, clutter and an unknown target.

    The sum over who exists, what they have and which were missed. No other target has what
    the source of the detection has.
    """
    belief = beliefs()
    tables = [by_state(w, c) for w, c in zip(belief.weight, belief.candidate, strict=True)]
    fresh = dict.fromkeys(range(SIZE), MODEL.equipped / SIZE) | {UNKNOWN: 1.0 - MODEL.equipped}
    weight = dict.fromkeys((0, 1, "clutter", "unknown"), 0.0)
    own = [UNKNOWN, *range(SIZE)]
    for exist in itertools.product((0, 1), repeat=2):
        for has in itertools.product(own, repeat=2):
            prior = np.prod(
                [EXISTENCE[i] if e else 1.0 - EXISTENCE[i] for i, e in enumerate(exist)]
            )
            prior *= np.prod([tables[i][k] for i, k in enumerate(has)])
            missed = [1.0 - DETECTED[i] if e else 1.0 for i, e in enumerate(exist)]
            taken = [has[i] for i in range(2) if exist[i]]
            shows = MODEL.reply
            weight["clutter"] += prior * np.prod(missed) * CLUTTER
            if SHOWN not in taken:
                one = UNKNOWN_TARGETS * fresh[SHOWN] * shows
                weight["unknown"] += prior * np.prod(missed) * one
            for i in range(2):
                other = 1 - i
                if exist[i] and has[i] == SHOWN and not (exist[other] and has[other] == SHOWN):
                    one = DETECTED[i] * LIKELIHOOD[i] * shows
                    weight[i] += prior * missed[other] * one
    return weight


def test_sources_of_a_detection_have_the_weight_of_all_events():
    belief, target, column = beliefs(), np.arange(2), np.zeros(2, dtype=np.int64)
    shown = np.array([SHOWN])
    missed = EXISTENCE * (1.0 - DETECTED)
    left = undetected(EXISTENCE, missed)
    taken = uniqueness.identity_conflicts(belief, target, column, shown, left, MODEL)
    told = identity.compare(belief, target, shown[column], MODEL, taken.by_another)
    nobodys = MODEL.unknown_target_likelihood(shown)[0]
    alone = 1.0 - EXISTENCE + missed
    found = {
        i: EXISTENCE[i]
        * DETECTED[i]
        * LIKELIHOOD[i]
        * nobodys
        * np.exp(told.log_factor[i])
        * alone[1 - i]
        for i in range(2)
    }
    found["clutter"] = CLUTTER * alone.prod()
    found["unknown"] = UNKNOWN_TARGETS * nobodys * np.exp(taken.log_unknown[0]) * alone.prod()
    expected = weights_of_all_events()
    for source, weight in expected.items():
        assert found[source] == pytest.approx(weight, rel=1e-12), source


def test_taken_is_of_unique_identities_and_leaves_what_is_garbled():
    model = IdentityModel(1 << 24, garbled=0.01, unique=True)
    belief = Belief(np.full((1, 4), SHOWN), np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]]))
    one = np.zeros(1, dtype=np.int64)
    found = uniqueness.identity_conflicts(belief, one, one, np.array([SHOWN]), np.ones(1), model)
    garbled = 1.0 - model.genuine_probability(np.array([SHOWN]))[0]
    assert 0.01 < garbled < 0.012
    assert np.exp(found.log_unknown[0]) == pytest.approx(garbled, rel=1e-9)
    model = IdentityModel(SIZE, unique=False)
    one = np.zeros(2, dtype=np.int64)
    found = uniqueness.identity_conflicts(
        beliefs(), np.arange(2), one, np.array([SHOWN]), np.ones(2), model
    )
    assert found.by_another.tolist() == [0.0, 0.0]
    assert found.log_unknown.tolist() == [0.0]


def test_addresses_are_unique_and_codes_are_not():
    known = lone({"radar.fields.code": "code", "radar.fields.address": "address"}).model.attributes
    assert known.address.unique
    assert not known.code.unique


def test_lost_targets_are_those_shown_away_from_them():
    has, seen_ns = np.array([7, UNKNOWN, 8, 9]), np.array([10, 20, 30, 40]) * 10**9
    shown, shown_ns = np.array([9, 7, UNKNOWN, 8]), np.full(4, 41 * 10**9)
    near = np.array([0, 3]), np.array([1, 1])
    found = uniqueness.find_out_of_gate(has, seen_ns, shown, shown_ns, near)
    assert found.target.tolist() == [2, 3]
    assert found.column.tolist() == [3, 0]
    assert found.since_s.tolist() == [11.0, 1.0]
    has, seen_ns, shown = np.array([7, 8]), np.array([5, 9]), np.array([7, 8])
    near = np.array([0]), np.array([0])
    assert uniqueness.find_out_of_gate(has, seen_ns, shown, np.array([9, 9]), near) is None
