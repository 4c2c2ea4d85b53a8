"""Cumulative sums of a sensor's changes, beside sums over single looks that the tests draw."""

import numpy as np
import pytest

from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.core.arrays import frozen
from phd_jdtc_ros.core.association.evidence import NoiseEvidence
from phd_jdtc_ros.core.factors.detection import (
    AZIMUTHS,
    CELLS,
    RANGES,
    Detection,
)
from phd_jdtc_ros.core.factors.noise import COMPONENTS, Noise
from phd_jdtc_ros.core.factors.prior import MOST_EVIDENCE, RAISED
from phd_jdtc_ros.core.factors.trials import TrialSums

LEARNED = 0.8


def each(value):
    return np.full(COMPONENTS, value)


def settled():
    """Return the factor of a sensor that is as configured, known from 640 looks."""
    looks = np.full(CELLS, 10.0)
    return Detection(1e4).after(TrialSums(looks, LEARNED * looks, LEARNED * looks))


def looks_of(rng, probability):
    """Return a look at a target in every cell, given the probabilities by azimuth."""
    detected = rng.random((RANGES, AZIMUTHS)) < probability
    hits = detected.ravel().astype(float)
    return frozen(TrialSums(np.ones(CELLS), np.full(CELLS, LEARNED), hits))


def after(probability, reports=6, seed=0):
    """Return a factor with the evidence of reports, whose looks it has not learned."""
    rng, alarm = np.random.default_rng(seed), settled()
    for _ in range(reports):
        alarm = alarm.with_alarm(looks_of(rng, probability))
    return alarm


def test_sums_are_those_of_single_looks():
    factor, sums = settled(), looks_of(np.random.default_rng(1), 0.1)
    found = factor.with_alarm(sums).alarm
    learned = (factor.by_cell * LEARNED).reshape(RANGES, AZIMUTHS)
    detected = sums.detected.reshape(RANGES, AZIMUTHS) > 0.0
    np.testing.assert_allclose(learned, learned[0, 0])
    p = learned[0, 0]
    of_sensor = np.where(detected, np.log(0.7), np.log((1 - 0.7 * p) / (1 - p)))
    of_sector = np.where(detected, np.log(0.15 / 0.6), np.log((1 - 0.15 * p) / (1 - 0.6 * p)))
    np.testing.assert_allclose(found[0], np.clip(of_sensor.sum(), 0.0, MOST_EVIDENCE))
    np.testing.assert_allclose(found[1:], np.clip(of_sector.sum(axis=0), 0.0, MOST_EVIDENCE))


def test_no_alarm_without_a_blind_sector():
    for seed in range(20):
        alarm = after(LEARNED, reports=20, seed=seed)
        assert not alarm.fewer_detections
        assert np.isnan(alarm.blind_azimuth)
    alarm = after(0.5 * LEARNED)
    assert alarm.fewer_detections
    assert np.isnan(alarm.blind_azimuth)


def test_blind_sector_is_found_until_the_sensor_is_as_before():
    by_azimuth = np.full(AZIMUTHS, LEARNED)
    by_azimuth[3] = 0.0
    assert after(by_azimuth).blind_azimuth == pytest.approx(3.5 * 2.0 * np.pi / AZIMUTHS)
    alarm, rng = after(0.3), np.random.default_rng(5)
    assert alarm.fewer_detections
    for _ in range(4):
        alarm = alarm.with_alarm(looks_of(rng, LEARNED))
    assert not alarm.fewer_detections


def test_unknown_sensors_and_components_raise_nothing():
    sums = looks_of(np.random.default_rng(0), 0.0)
    assert Detection(1e4).with_alarm(sums).alarm.max() == 0.0
    evidence = NoiseEvidence(each(100.0), each(300.0))
    assert Noise().with_alarm(evidence).alarm.max() == 0.0
    known = Noise(np.array([True, False, False]))
    known = known.after(NoiseEvidence(each(200.0), each(0.0)))
    evidence = NoiseEvidence(each(50.0), each(150.0))
    assert known.with_alarm(evidence).noisier.tolist() == [True, False, False]


@pytest.mark.parametrize(("factor", "raised"), [(1.0, False), (4.0, True)])
def test_noise_of_twice_the_deviation_is_found(factor, raised):
    rng = np.random.default_rng(7)
    alarm = Noise().after(NoiseEvidence(each(200.0), each(0.0)))
    for _ in range(50):
        square = factor * rng.standard_normal(COMPONENTS) ** 2
        alarm = alarm.with_alarm(NoiseEvidence(each(1.0), square - 1.0))
    assert alarm.noisier.tolist() == [raised] * COMPONENTS
    assert raised == bool((alarm.alarm >= RAISED).all())


def innovations(rng, factor, known):
    """Return the evidence of an innovation in each component, given the factor of variances."""
    square = factor * rng.standard_normal(COMPONENTS) ** 2
    return NoiseEvidence(each(1.0), square / known.variance - 1.0)


@pytest.mark.parametrize("seed", range(12))
def test_noise_is_found_while_it_is_learned_and_until_it_has_been(seed):
    rng, known = np.random.default_rng([seed, 3]), Noise()
    sums, raised = np.zeros(COMPONENTS), np.zeros(COMPONENTS, dtype=bool)
    before = known.variance
    for number in range(1200):
        evidence = innovations(rng, 1.0 if number < 60 else 4.0, known)
        # The same sums with the values of the time when each was last zero.
        before = np.where((sums > 0.0) & (sums < RAISED), before, known.variance)
        square = (1.0 + evidence.excess) * known.variance / before
        added = 0.25 * square - 0.5 * np.log(2.0)
        sums = np.clip(sums + (added if known.weight[0] >= 50.0 else 0.0), 0.0, MOST_EVIDENCE)
        known = known.with_alarm(evidence).after(evidence)
        np.testing.assert_allclose(known.alarm, sums, atol=1e-9)
        if number < 60:
            assert not known.noisier.any()
        elif number < 130:
            raised |= known.noisier
    assert raised.all()
    assert not known.noisier.any()


def test_blind_sector_is_found_while_its_probability_is_learned():
    by_azimuth = np.full(AZIMUTHS, LEARNED)
    by_azimuth[5] = 0.0
    for seed in range(8):
        rng, known = np.random.default_rng([seed, 4]), Detection(1e4)
        for _ in range(8):
            looks = looks_of(rng, LEARNED)
            known = known.with_alarm(looks).after(looks)
        assert np.isnan(known.blind_azimuth)
        for _ in range(6):
            looks = looks_of(rng, by_azimuth)
            known = known.with_alarm(looks).after(looks)
        assert known.blind_azimuth == pytest.approx(5.5 * 2.0 * np.pi / AZIMUTHS)


def test_warning_names_every_change():
    figures = {
        "fewer_detections": 1.0,
        "azimuth_noisier": 1.0,
        "range_rate_noisier": 1.0,
        "blind_azimuth_deg": 67.5,
    }
    text = anomalies.of_changes(figures)
    assert text == (
        "has changed: it detects fewer targets; its azimuth noise is larger; "
        "its range rate noise is larger; "
        "it detects hardly anything about 68 degrees from its x axis"
    )
    assert anomalies.of_changes({}) is None
