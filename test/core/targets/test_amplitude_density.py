import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from phd_jdtc_ros.core.targets import amplitude_density

PAPER_BANDS_DB = [(30.0, 50.0), (10.0, 30.0)]
TAU = amplitude_density.threshold_for(1e-3)


def linear(band_db):
    return amplitude_density.snr_from_db(band_db[0]), amplitude_density.snr_from_db(band_db[1])


def mass_above(threshold, log_density, widest):
    # The density spreads over decades, so the integral is over ln a, in pieces.
    low = np.log(max(threshold, 1e-5))
    edges = np.linspace(low, np.log(12.0 * np.sqrt(widest)), 13)

    def integrand(u):
        return np.exp(u + log_density(np.array([np.exp(u)]))[0])

    return sum(
        quad(integrand, a, b, epsabs=1e-13, epsrel=1e-11)[0] for a, b in itertools.pairwise(edges)
    )


def target_mass_above(threshold, band):
    return mass_above(
        threshold, lambda a: amplitude_density.log_target_density(a, band), 1.0 + band[1]
    )


bands_db = st.tuples(st.floats(-20.0, 55.0), st.floats(0.5, 40.0)).map(
    lambda b: (b[0], b[0] + b[1])
)


@settings(deadline=None, max_examples=20)
@given(band_db=bands_db)
def test_target_density_integrates_to_one_for_any_band(band_db):
    assert target_mass_above(0.0, linear(band_db)) == pytest.approx(1.0, abs=1e-7)


def test_target_density_equals_the_printed_formula_with_a_minus():
    low, high = (1.0 + snr for snr in linear((10.0, 30.0)))
    a = np.array([0.5, 3.717, 12.0, 40.0])
    expected = (
        2.0
        * (np.exp(-(a**2) / (2.0 * high)) - np.exp(-(a**2) / (2.0 * low)))
        / (a * (np.log(high) - np.log(low)))
    )
    density = np.exp(amplitude_density.log_target_density(a, linear((10.0, 30.0))))
    np.testing.assert_allclose(density, expected, rtol=1e-10)


def test_narrow_bands_and_no_threshold_are_limits():
    snr = 100.0
    a = np.array([1.0, 5.0, 20.0])
    narrow = amplitude_density.log_target_density(a, (snr * (1 - 1e-5), snr * (1 + 1e-5)))
    rayleigh = np.log(a / (1.0 + snr)) - a**2 / (2.0 * (1.0 + snr))
    np.testing.assert_allclose(narrow, rayleigh, atol=1e-6)
    assert amplitude_density.detection_probability(0.0, linear((10.0, 30.0))) == 1.0


@settings(deadline=None, max_examples=20)
@given(band_db=bands_db, threshold=st.floats(0.01, 20.0))
def test_detection_probability_equals_the_integral_for_any_band(band_db, threshold):
    closed = amplitude_density.detection_probability(threshold, linear(band_db))
    assert closed == pytest.approx(target_mass_above(threshold, linear(band_db)), abs=1e-7)


@settings(deadline=None, max_examples=200)
@given(
    low_db=st.floats(-20.0, 199.0), width_db=st.floats(0.1, 100.0), threshold=st.floats(1e-5, 12.0)
)
def test_detection_probability_is_a_probability(low_db, width_db, threshold):
    # Above one by a rounding, 1 - p_D would give a particle a negative weight.
    band = linear((low_db, min(low_db + width_db, 200.0)))
    assert 0.0 <= amplitude_density.detection_probability(threshold, band) <= 1.0


def test_clutter_density_integrates_to_one_and_exceeds_the_threshold_as_often_as_asked_for():
    assert pytest.approx(3.717, abs=1e-3) == TAU
    whole, integral = (
        mass_above(threshold, amplitude_density.log_clutter_density, 1.0)
        for threshold in (0.0, TAU)
    )
    assert whole == pytest.approx(1.0, abs=1e-9)
    assert integral == pytest.approx(1e-3, rel=1e-9)


@pytest.mark.parametrize("a", [0.0, 1e-9, 38.0, 250.0, 1e4])
def test_log_densities_are_finite_where_the_densities_underflow(a):
    value = np.array([a])
    assert np.isfinite(amplitude_density.log_clutter_density(value)).all()
    for band_db in PAPER_BANDS_DB:
        assert np.isfinite(amplitude_density.log_target_density(value, linear(band_db))).all()
