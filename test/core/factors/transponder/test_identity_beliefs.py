"""Identities as evidence: beliefs, and unique identities, against sums over all assignments."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import textbook
from lone import MEAN, START_NS, STD, UNREDUCED, lone, mixture_of, scan_at, start_from

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.association.claims import undetected
from phd_jdtc_ros.core.factors.transponder import identity, uniqueness
from phd_jdtc_ros.core.factors.transponder.height import HeightModel, Heights
from phd_jdtc_ros.core.factors.transponder.identity import Belief, IdentityModel
from phd_jdtc_ros.core.factors.transponder.records import AttributeModel, AttributeRecords, Beliefs
from phd_jdtc_ros.core.factors.transponder.reflections import FARTHEST, NEAREST, RATE
from phd_jdtc_ros.core.types import UNKNOWN

# Few codes, so that all can be summed over; code 0 is one that many share.
SIZE = 6
MODEL = IdentityModel(
    SIZE, equipped=0.8, reply=0.9, garbled=0.05, kept_s=500.0, shared=(0,), shared_probability=0.4
)
STATES = [*range(SIZE), UNKNOWN]
# Few identities, so that all can be summed over; what answers shows its own.
ADDRESS_SIZE = 5
UNIQUENESS = IdentityModel(ADDRESS_SIZE, equipped=0.8, reply=0.9, garbled=0.0, unique=True)
SHOWN = 3
EXISTENCE, DETECTED = np.array([0.7, 0.9]), np.array([0.6, 0.95])
# Likelihoods of the detection: each target's state, then clutter and undetected targets.
LIKELIHOOD, CLUTTER, UNDETECTED_TARGETS = np.array([2.0, 0.1]), 0.3, 0.2


def prior_of(code):
    return 0.4 if code == 0 else 0.6 / (SIZE - 1)


def shows(shown, own):
    """Return the probability that a target with a code, or without one, shows something."""
    if own == UNKNOWN:
        return 1.0 - MODEL.garbled if shown == UNKNOWN else MODEL.garbled * prior_of(shown)
    if shown == UNKNOWN:
        return 1.0 - MODEL.reply
    return MODEL.reply * ((1.0 - MODEL.garbled) * (shown == own) + MODEL.garbled / SIZE)


def test_fresh_belief_is_the_prior_of_replies_that_sum_to_one():
    everything = MODEL.unknown_target_likelihood(np.array([*range(SIZE), UNKNOWN]))
    assert everything.sum() == pytest.approx(1.0)
    assert everything[:-1].sum() == pytest.approx(MODEL.reply_probability)
    shown = np.array([0, 3, 5, UNKNOWN])
    fresh = Belief.fresh(4, MODEL)
    np.testing.assert_allclose(
        identity.compare(fresh, np.arange(4), shown, MODEL).log_factor, 0.0, atol=1e-12
    )
    total = MODEL.unknown_target_likelihood(np.array(STATES)).sum()
    assert total == pytest.approx(1.0)


def full(belief):
    """Return a belief by state of a target, one row for each target."""
    rows = []
    for candidates, weight in zip(belief.candidate.tolist(), belief.weight, strict=True):
        left = sum(prior_of(code) for code in range(SIZE) if code not in candidates)
        known = dict(zip(candidates, weight, strict=False))
        rest = weight[identity.REST]
        codes = [known.get(c, rest * prior_of(c) / left if left else 0.0) for c in range(SIZE)]
        rows.append([*codes, weight[identity.ABSENT]])
    return np.array(rows)


def belief_of(*rows):
    """Return a belief, of ({code: weight}, rest, absent) each."""
    candidate = np.full((len(rows), identity.CANDIDATES), UNKNOWN)
    weight = np.zeros((len(rows), identity.CANDIDATES + 2))
    for row, (known, rest, absent) in enumerate(rows):
        for place, (code, share) in enumerate(known.items()):
            candidate[row, place], weight[row, place] = code, share
        weight[row, identity.REST], weight[row, identity.ABSENT] = rest, absent
    return Belief(candidate, weight)


@pytest.mark.parametrize("shown", STATES)
def test_certain_detection_gives_the_posterior_of_bayes_rule(shown):
    belief = belief_of(({2: 0.5, 0: 0.1}, 0.3, 0.1))
    target = np.zeros(1, dtype=np.int64)
    seen = identity.compare(belief, target, np.array([shown]), MODEL)
    found = identity.update(seen, target, np.ones(1), np.zeros(1))
    expected = full(belief)[0] * [shows(shown, own) for own in STATES]
    evidence = expected.sum()
    np.testing.assert_allclose(full(found)[0], expected / evidence, rtol=1e-12)
    nobodys = MODEL.unknown_target_likelihood(np.array([shown]))[0]
    assert np.exp(seen.log_factor[0]) == pytest.approx(evidence / nobodys)


def test_beliefs_change_by_replies_and_forget_improbable_candidates():
    belief, target = belief_of(({2: 0.5}, 0.3, 0.2)), np.zeros(1, dtype=np.int64)
    seen = identity.compare(belief, target, np.array([identity.NOT_REPORTED]), MODEL)
    assert seen.log_factor[0] == 0.0
    after = identity.update(seen, target, np.ones(1), np.zeros(1))
    np.testing.assert_allclose(after.weight, belief.weight)
    model = replace(MODEL, size=4096)
    belief, target = Belief.fresh(1, model), np.zeros(1, dtype=np.int64)
    for shown in range(1, 12):
        seen = identity.compare(belief, target, np.array([shown]), model)
        belief = identity.update(seen, target, np.ones(1), np.zeros(1))
    assert belief.candidate.shape == (1, identity.CANDIDATES)
    assert belief.weight.sum() == pytest.approx(1.0)
    assert (belief.weight >= 0.0).all()


def test_new_code_replaces_the_old_one_after_a_few_answers():
    model = replace(MODEL, size=4096, garbled=0.01, kept_s=1800.0)
    belief, target = Belief.fresh(1, model), np.zeros(1, dtype=np.int64)
    reported = []
    for shown in [1234] * 20 + [2345] * 4:
        seen = identity.compare(
            belief.predict(np.array([4.0]), model), target, np.array([shown]), model
        )
        belief = identity.update(seen, target, np.ones(1), np.zeros(1))
        reported.append(belief.most_probable()[0])
    assert reported[1:20] == [1234] * 19
    assert reported[-1] == 2345


def enumerated(belief, existence, kinematic, shown, missed, clutter):
    """Return each target's posterior by state and none, summed over all that could have happened.

    Parameters
    ----------
    belief : array of shape (T, 7)
    existence : sequence of T numbers
    kinematic : array of shape (T, M)
        Of the detection probability times the density of each detection.
    shown : sequence of M codes
    missed : float
        Probability that a target is missed.
    clutter : array of shape (M,)
        Density of each detection, with what it shows, as clutter.
    """
    targets, count = kinematic.shape
    weight = np.zeros((targets, len(STATES)))
    nothing = np.zeros(targets)
    options = ["absent", None, *range(count)]
    for events in itertools.product(options, repeat=targets):
        claimed = [event for event in events if isinstance(event, int)]
        if len(set(claimed)) < len(claimed):
            continue
        base = np.prod([clutter[j] for j in range(count) if j not in claimed])
        factors = []
        for t, event in enumerate(events):
            if event == "absent":
                factors.append(np.append(np.zeros(len(STATES)), 1.0 - existence[t]))
            elif event is None:
                factors.append(np.append(existence[t] * missed * belief[t], 0.0))
            else:
                said = np.array([shows(shown[event], own) for own in STATES])
                factors.append(np.append(existence[t] * kinematic[t, event] * belief[t] * said, 0))
        for t in range(targets):
            others = np.prod([f.sum() for k, f in enumerate(factors) if k != t])
            weight[t] += base * others * factors[t][:-1]
            nothing[t] += base * others * factors[t][-1]
    total = weight.sum(axis=1) + nothing
    return weight / total[:, None], nothing / total


@pytest.mark.parametrize("shown", [(2, 3), (3, UNKNOWN), (0, 0), (5, 2)])
def test_joint_association_and_identities_are_those_of_the_sum_over_all(shown):
    detection, rate = 0.8, 3.0
    config = lone(
        {
            **UNREDUCED,
            "radar.detection_probability": detection,
            "radar.clutter_rate": rate,
            "radar.clutter_max_range": 2e4,
            "radar.fields.code": "code",
        }
    )
    attributes = AttributeModel(
        code=MODEL,
        address=IdentityModel(identity.ADDRESSES),
        height=HeightModel(),
        clutter_reply=0.1,
    )
    model = replace(config.model, attributes=attributes)
    config = replace(config, model=model)
    engine = new_engine(config)
    means = [MEAN, MEAN + np.array([150.0, 0.0, -100.0, 0.0, 0.0])]
    existence = [0.9, 0.7]
    stored = mixture_of(
        engine.forward.dynamics, [(r, m, STD) for r, m in zip(existence, means, strict=True)]
    )
    start_from(engine, START_NS, stored)
    belief = belief_of(({2: 0.6, 4: 0.1}, 0.2, 0.1), ({3: 0.5}, 0.2, 0.3))
    known = Beliefs(belief, Belief.fresh(2, attributes.address), Heights.fresh(2))
    factors = engine.forward.factors
    records = AttributeRecords.of(stored.sums.label, START_NS, known)
    transponders = factors.transponders.changed(records=records)
    engine.forward.factors = factors.changed(transponders=transponders)
    radar = model.radars[0]
    measurement = radar.measure(np.array(means)) + np.array([[100.0, 0.01], [-150.0, 0.004]])
    seconds = 6.0
    engine.step(scan_at(seconds, measurement, code=np.array(shown)))

    moved = belief.predict(np.full(2, seconds), MODEL)
    kinematic = np.zeros((2, 2))
    for t, mean in enumerate(means):
        motion = model.modes.motions[0]
        prior, _ = textbook.predict(textbook.initial(motion, mean, STD), motion, seconds)
        for j in range(2):
            kinematic[t, j] = detection * np.exp(textbook.update(prior, radar, measurement[j])[1])
    # Clutter answers less often than undetected targets, with the same codes.
    reply = MODEL.unknown_target_likelihood(np.arange(SIZE)).sum()
    odds = [0.9 / (1.0 - reply) if c == UNKNOWN else 0.1 / reply for c in shown]
    clutter = rate / (2.0 * np.pi * 2e4) * MODEL.unknown_target_likelihood(np.array(shown)) * odds
    # Each target's reflections reply as the target itself.
    for j, place in enumerate(radar.to_world(measurement)):
        if shown[j] != UNKNOWN:
            said = full(moved) @ [shows(shown[j], own) for own in STATES]
            apart = np.hypot(*(place - [m[[0, 2]] + seconds * m[[1, 3]] for m in means]).T)
            area = 2.0 * np.pi * apart**2 * np.log(FARTHEST / NEAREST)
            clutter[j] += measurement[j, 0] * RATE * (existence / area) @ said
    weight, nothing = enumerated(full(moved), existence, kinematic, shown, 1 - detection, clutter)

    stored = engine.forward.unswept[-1].entry.stored
    np.testing.assert_allclose(stored.sums.existence, 1.0 - nothing, rtol=1e-3)
    records = engine.forward.factors.transponders.records
    found = full(Belief(records.code, records.code_weight))
    np.testing.assert_allclose(found, weight / weight.sum(axis=1)[:, None], rtol=2e-3, atol=1e-9)


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
    others = [k for k in range(ADDRESS_SIZE) if k not in known]
    table = {k: weight[identity.REST] / len(others) for k in others}
    table.update((k, known[k]) for k in range(ADDRESS_SIZE) if k in known)
    return {**table, UNKNOWN: weight[identity.ABSENT]}


def weights_of_all_events():
    """Return the weight of each source: the targets, clutter and an undetected target.

    The sum over who exists, what they have and which were missed. Another target has what the
    source of the detection has only if the identity is cloned.
    """
    belief = beliefs()
    tables = [by_state(w, c) for w, c in zip(belief.weight, belief.candidate, strict=True)]
    fresh = dict.fromkeys(range(ADDRESS_SIZE), UNIQUENESS.equipped / ADDRESS_SIZE) | {
        UNKNOWN: 1.0 - UNIQUENESS.equipped
    }
    weight = dict.fromkeys((0, 1, "clutter", "unknown"), 0.0)
    own = [UNKNOWN, *range(ADDRESS_SIZE)]
    for exist in itertools.product((0, 1), repeat=2):
        for has in itertools.product(own, repeat=2):
            prior = np.prod(
                [EXISTENCE[i] if e else 1.0 - EXISTENCE[i] for i, e in enumerate(exist)]
            )
            prior *= np.prod([tables[i][k] for i, k in enumerate(has)])
            missed = [1.0 - DETECTED[i] if e else 1.0 for i, e in enumerate(exist)]
            taken = [has[i] for i in range(2) if exist[i]]
            shows = UNIQUENESS.reply
            weight["clutter"] += prior * np.prod(missed) * CLUTTER
            one = (
                UNDETECTED_TARGETS * fresh[SHOWN] * shows * UNIQUENESS.cloned ** taken.count(SHOWN)
            )
            weight["unknown"] += prior * np.prod(missed) * one
            for i in range(2):
                other = 1 - i
                if exist[i] and has[i] == SHOWN:
                    one = DETECTED[i] * LIKELIHOOD[i] * shows
                    one *= UNIQUENESS.cloned ** (taken.count(SHOWN) - 1)
                    weight[i] += prior * missed[other] * one
    return weight


def test_sources_of_a_detection_have_the_weight_of_all_events():
    belief, target, column = beliefs(), np.arange(2), np.zeros(2, dtype=np.int64)
    shown = np.array([SHOWN])
    missed = EXISTENCE * (1.0 - DETECTED)
    left = undetected(EXISTENCE, missed)
    taken = uniqueness.identity_conflicts(belief, target, column, shown, left, UNIQUENESS)
    compared = identity.compare(belief, target, shown[column], UNIQUENESS, taken.by_another)
    nobodys = UNIQUENESS.unknown_target_likelihood(shown)[0]
    alone = 1.0 - EXISTENCE + missed
    found = {
        i: EXISTENCE[i]
        * DETECTED[i]
        * LIKELIHOOD[i]
        * nobodys
        * np.exp(compared.log_factor[i])
        * alone[1 - i]
        for i in range(2)
    }
    found["clutter"] = CLUTTER * alone.prod()
    found["unknown"] = UNDETECTED_TARGETS * nobodys * np.exp(taken.log_undetected[0]) * alone.prod()
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
    left = garbled + model.cloned * (1.0 - garbled)
    assert np.exp(found.log_undetected[0]) == pytest.approx(left, rel=1e-9)
    model = IdentityModel(ADDRESS_SIZE, unique=False)
    one = np.zeros(2, dtype=np.int64)
    found = uniqueness.identity_conflicts(
        beliefs(), np.arange(2), one, np.array([SHOWN]), np.ones(2), model
    )
    assert found.by_another.tolist() == [0.0, 0.0]
    assert found.log_undetected.tolist() == [0.0]


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
