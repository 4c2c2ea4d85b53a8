"""The correlation of misses: its effect on the next look at a target, and its estimate."""

import itertools

import numpy as np

from phd_jdtc_ros.core.factors.correlated_misses import (
    MOST,
    CorrelatedMisses,
    DetectionChains,
    Trial,
    sums_of,
)

CORRELATION = 0.7
USUAL = 0.6
REVOLUTION_NS = 4e9
LABEL = np.array([3])
HIT, MISS = USUAL + CORRELATION * (1.0 - USUAL), USUAL * (1.0 - CORRELATION)


def look(detected=0.0, covered=1.0, expected=0.0, label=LABEL, existence=1.0):
    every = [np.broadcast_to(float(x), len(label)) for x in (covered, detected, expected)]
    existence = np.broadcast_to(existence, len(label))
    return Trial(label, *every, existence, existence >= 0.7)


def after(looks, stamps=None, revolution_ns=0.0):
    chains = DetectionChains()
    for number, each in enumerate(looks):
        stamp_ns = number if stamps is None else round(stamps[number])
        prediction = chains.predict(stamp_ns, revolution_ns, CORRELATION)
        chains = chains.after(each, prediction, stamp_ns, revolution_ns)
    return chains


def next_probability(chains, stamp_ns=10, revolution_ns=0.0, label=LABEL):
    prediction = chains.predict(stamp_ns, revolution_ns, CORRELATION)
    return of_next(prediction, np.full(len(label), USUAL), label)


def of_next(prediction, usual, label):
    """Return the probabilities of the next look at targets, given the usual ones."""
    looked, detected = prediction.of(label)
    return usual * (1.0 - looked) + detected


def test_usual_probability_is_that_of_unknown_targets_and_recovered():
    found = next_probability(after([look(1.0)]), label=np.array([1, 3, 5]))
    np.testing.assert_allclose(found, [USUAL, HIT, USUAL])
    chains = after([look(0.3)])
    prediction = chains.predict(9, 0.0, CORRELATION)
    usual = np.array([0.45])
    np.testing.assert_allclose(prediction.usual(of_next(prediction, usual, LABEL), LABEL), usual)


def test_looks_that_do_not_cover_the_target_are_looks_of_the_chain():
    """The sum over what the looks would have seen, from a detection before them."""
    expected = 0.0
    for seen in itertools.product([0, 1], repeat=3):
        probability, before = 1.0, 1
        for one in (*seen, 1):
            own = HIT if before else MISS
            probability *= own if one else 1.0 - own
            before = one
        expected += probability
    found = next_probability(after([look(1.0), *[look(0.0, covered=0.0)] * 3]))
    np.testing.assert_allclose(found, [expected])


def test_sectors_of_a_revolution_are_one_look_and_revolutions_without_one_weaken_it():
    """A target at the edge of two sectors is looked at once per revolution."""
    stamps = np.array([0.0, 0.1, 1.0, 1.1]) * REVOLUTION_NS
    parts = [look(1.0), look(0.0, covered=0.0), look(0.0, covered=0.5), look(0.0, covered=0.5)]
    chains = after(parts, stamps, REVOLUTION_NS)
    within = next_probability(
        after(parts[:3], stamps, REVOLUTION_NS), round(stamps[3]), REVOLUTION_NS
    )
    np.testing.assert_allclose(within, [HIT])
    np.testing.assert_allclose(
        next_probability(chains, round(2.0 * REVOLUTION_NS), REVOLUTION_NS), [MISS]
    )
    chains = after([look(1.0)], [0.0], REVOLUTION_NS)
    found = next_probability(chains, round(3.0 * REVOLUTION_NS), REVOLUTION_NS)
    np.testing.assert_allclose(found, [USUAL + CORRELATION**3 * (1.0 - USUAL)])


def test_pairs_count_when_the_target_is_detected_again():
    expected = {"expected": USUAL}
    chains = after([look(1.0, **expected), look(0.0, **expected), look(0.0, **expected)])
    unchanged, none = chains.count_pairs(look(0.0))
    np.testing.assert_allclose(none, 0.0)
    open_pairs, sums = unchanged.count_pairs(look(0.5, existence=0.8))
    np.testing.assert_allclose(sums[:2], [0.5 * 0.8 * 2.0, 0.0])
    np.testing.assert_allclose(open_pairs.pairs[0, 0], 1.0)


def test_looks_count_where_they_cover_a_target():
    expected = {"expected": USUAL}
    chains = after([look(1.0, **expected), look(0.0, 0.5, **expected), look(1.0, **expected)])
    np.testing.assert_allclose(chains.pairs, 0.0)
    parts = [look(one, existence=r, expected=USUAL) for one, r in ((1, 1.0), (0, 0.5), (0, 0.2))]
    assert after(parts).pairs[0, 0] == 2.0
    assert after(parts[1:]).pairs[0, 0] == 0.0
    label = np.array([2, 4, 6])
    kept = after([look(1.0, label=label)]).of(np.array([1, 4, 6, 7]))
    assert kept.label.tolist() == [4, 6]
    assert len(kept.detected) == len(kept.pairs) == 2


def learned(detected, expected, start=0.0):
    """Return the correlation after these looks at one target."""
    expected = np.broadcast_to(expected, detected.shape)
    sums = sums_of(detected[1:], detected[:-1], expected[1:], expected[:-1])
    return CorrelatedMisses(start, learned=True).after(sums.sum(axis=0))


def test_a_probability_that_falls_with_the_range_is_no_correlation():
    mean = np.linspace(0.95, 0.3, 2000)
    found = [
        learned((np.random.default_rng(s).random(2000) < mean).astype(float), mean).value
        for s in range(20)
    ]
    assert np.mean(found) < 0.02
    flat = [
        learned((np.random.default_rng(s).random(2000) < mean).astype(float), 0.6).value
        for s in range(20)
    ]
    assert np.mean(flat) > 0.1


def test_correlation_is_never_certain_and_not_learned_where_given():
    found = CorrelatedMisses(0.4, learned=False)
    sums = sums_of(np.ones(3), np.zeros(3), np.full(3, 0.5), np.full(3, 0.5))
    assert found.after(sums.sum(axis=0)).value == 0.4
    blocks = np.repeat([1.0, 0.0, 1.0, 0.0], 500)
    assert learned(blocks, 0.5).value <= MOST
