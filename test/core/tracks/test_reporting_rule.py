"""The existence probabilities at which tracks are confirmed and deleted."""

import numpy as np
import pytest
from scenes import seen_with

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.tracks.reporting_rule import rule_of

MODEL = resolve({"amplitude": "band"}).model


def test_derived_thresholds_follow_from_the_detection_probability():
    rule = rule_of(MODEL, True)
    # The second class is missed by both radars with probability 0.03.
    assert rule.confirm == pytest.approx([2.0 / 3.0, 1.97 / 2.97], abs=2e-3)
    assert rule.delete == pytest.approx([1.0 / 3.0, 1.0 / 2.97], abs=2e-3)
    assert rule.hidden == pytest.approx([0.5, 0.5])
    # A target that is hardly ever detected would not be back soon.
    rare = rule_of(seen_with(MODEL, 0.05), True)
    assert rare.confirm == pytest.approx((2.0 - 0.95**2) / (3.0 - 0.95**2))
    assert rare.delete == pytest.approx(1.0 / (3.0 - 0.95**2))


def test_thresholds_bound_each_other():
    assert rule_of(MODEL, True, confirm=0.2).delete == pytest.approx([0.2, 0.2])
    assert rule_of(MODEL, True, delete=0.9).confirm == pytest.approx([0.9, 0.9])
    with pytest.raises(ConfigError, match=r"delete_probability: 0\.9 given, must be at most"):
        resolve({"confirm_probability": 0.5, "delete_probability": 0.9})


def test_records_weigh_what_the_band_leaves_open_without_memory():
    rng = np.random.default_rng(0)
    low, high = MODEL.modes.classes[1].snr_band
    snr = np.exp(rng.uniform(np.log1p(low), np.log1p(high), 1_000_000)) - 1.0
    missed = (1.0 - np.exp(-0.5 * MODEL.radars[0].threshold ** 2 / (1.0 + snr))) ** 2
    expected = missed.mean() ** 2 / missed.var()
    assert rule_of(MODEL, True).record_weight[1] == pytest.approx(expected, rel=0.01)
    # A given detection probability is that of every target.
    assert np.isinf(rule_of(seen_with(MODEL, 0.9), True).record_weight).all()
    model = resolve({"amplitude": "memory"}).model
    assert np.isinf(rule_of(model, True).record_weight).all()
