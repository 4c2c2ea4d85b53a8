"""Values of a radar that may be learned: a number, or auto with or without one."""

import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError


def radar_of(**given):
    return resolve({f"radar_1.{name}": value for name, value in given.items()}).model.radars[0]


@pytest.mark.parametrize(
    ("value", "std", "learned", "outliers"),
    [
        (45.0, 45.0, False, False),
        (45, 45.0, False, False),
        ("auto 45", 45.0, True, False),
        ("auto", 300.0, True, False),
        ("45 outliers", 45.0, False, True),
        ("auto 45 outliers", 45.0, True, True),
        ("auto outliers", 300.0, True, True),
    ],
)
def test_deviation_is_a_number_or_learned_and_may_have_outliers(value, std, learned, outliers):
    radar = radar_of(range_std=value)
    assert radar.range_std == std
    assert (radar.noise_factor is not None) == learned
    assert (radar.outliers is not None) == outliers


def test_each_component_is_learned_alone_if_it_is_used():
    factor = radar_of(azimuth_std_deg="auto 0.08").noise_factor
    assert factor.learned.tolist() == [False, True, False]
    rates = {"range_rate_std": "auto 0.3", "fields.range_rate": "range_rate"}
    assert radar_of(**rates).noise_factor.learned.tolist() == [False, False, True]
    assert radar_of(**rates).range_rate.std == 0.3
    assert radar_of(range_rate_std="auto").noise_factor is None


@pytest.mark.parametrize(
    ("value", "probability", "learned", "correlation"),
    [
        (0.8, 0.8, False, None),
        ("auto 0.8", 0.8, True, None),
        ([0.0, 0.9, 1e4, 0.7], 0.8, False, None),
        ("auto 0 0.9 1e4 0.7", 0.8, True, None),
        ("0.8 correlated 0.5", 0.8, False, (0.5, False)),
        ("0.8 correlated", 0.8, False, (0.0, True)),
        ("auto 0.8 correlated", 0.8, True, (0.0, True)),
        ("0 0.9 1e4 0.7 correlated 0.5", 0.8, False, (0.5, False)),
    ],
)
def test_detection_probability_is_a_number_a_table_or_is_learned_and_may_be_correlated(
    value, probability, learned, correlation
):
    radar = radar_of(detection_probability=value)
    found = radar.configured_detection_probability(np.array([[5e3, 0.0]]))
    np.testing.assert_allclose(found, [probability])
    assert (radar.detection_factor is not None) == learned
    chain = radar.correlation and (radar.correlation.start, radar.correlation.learned)
    assert chain == correlation


def test_particles_refuse_outliers():
    with pytest.raises(ConfigError, match=r"radar_1.range_std: outliers given with engine partic"):
        resolve({"engine": "particles", "radar_1.range_std": "45 outliers"})


def test_correlated_detections_may_follow_from_the_snr_bands():
    radar = radar_of(detection_probability="correlated 0.5")
    assert radar.configured_detection_probability(np.zeros((1, 2))) is None
    assert radar.correlation.start == 0.5


@pytest.mark.parametrize("value", [0.0, "auto"])
def test_detection_probability_may_follow_from_the_snr_bands(value):
    radar = radar_of(detection_probability=value)
    assert radar.configured_detection_probability(np.zeros((1, 2))) is None
    assert (radar.detection_factor is not None) == (value == "auto")


@pytest.mark.parametrize(("value", "period_s"), [("auto", 0.0), (0, 0.0), (4, 4.0), (3.97, 3.97)])
def test_rotation_period_is_given_or_learned(value, period_s):
    config = resolve({"sensors": ["radar"], "radar.rotation_s": value})
    assert config.radars[0].rotation_s == config.turns()[0].configured_period_s == period_s


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rotation_s", "auto 4"),
        ("rotation_s", -1.0),
        ("rotation_s", "4"),
        ("detection_probability", "0.8 correlated 0.99"),
        ("detection_probability", "0.8 correlated -0.1"),
        ("detection_probability", "0.8 correlated 0.5 0.6"),
        ("detection_probability", "1.2 correlated 0.5"),
        ("detection_probability", "often correlated 0.5"),
        ("detection_probability", "0.8 correlated correlated"),
        ("range_std", "45 outliers 0.1"),
        ("range_std", "outliers"),
        ("range_std", "auto many outliers"),
        ("azimuth_std_deg", "1 outliers"),
        ("range_std", "auto 0"),
        ("range_std", "auto 45 60"),
        ("range_std", "auto many"),
        ("range_std", "learned"),
        ("azimuth_std_deg", "auto 200"),
        ("range_rate_std", "auto 2e3"),
        ("range_rate_std", "0.3 outliers"),
        ("detection_probability", "auto 1.5"),
        ("detection_probability", "auto 0 0.9 1e4"),
        ("detection_probability", "auto 1e4 0.9 0 0.7"),
        ("detection_probability", "auto auto"),
        ("detection_probability", []),
    ],
)
def test_other_words_and_numbers_are_refused(name, value):
    with pytest.raises(ConfigError, match=rf"radar_1.{name}: .* given, must be .*auto"):
        radar_of(**{name: value})
