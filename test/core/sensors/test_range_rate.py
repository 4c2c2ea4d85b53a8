from dataclasses import replace

import numpy as np
import pytest
from lone import lone
from scipy.stats import norm

from phd_jdtc_ros.core.models.detection_birth import DetectionBirthModel
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections

RATED = {
    "radar.fields.range_rate": "range_rate",
    "radar.range_rate_std": 0.2,
    "radar.range_std": 0.5,
    "radar.azimuth_std_deg": 0.5,
    "radar.fov_deg": [-60.0, 60.0],
}
CONFIG = lone({**RATED, "detection_births.rates": [0.1], "detection_births.std": [12.0, 2e-3]})
(RADAR,) = CONFIG.model.radars
BIRTHS = DetectionBirthModel(np.array([0.1]), 12.0, 1e-3)
AMBIGUOUS = replace(RADAR, range_rate=RangeRateModel(0.2, 30.0), velocity=(4.0, -3.0))


def test_range_rates_wrap_and_unknown_ones_say_nothing():
    model = RangeRateModel(0.1, 20.0)
    np.testing.assert_allclose(model.wrap(np.array([-33.0, -9.0, 9.0, 29.0])), [7, -9, 9, 9])
    np.testing.assert_array_equal(RangeRateModel(0.1).wrap(np.array([-3e3])), [-3e3])
    found = RangeRateModel(0.1, 20.0).log_density(np.array([np.nan, 0.0]), 0.01)
    np.testing.assert_allclose(found, [0.0, norm.logpdf(0.0, 0.0, 0.1)])


@pytest.mark.parametrize("std", [0.3, 6.0, 25.0])
def test_folded_has_the_moments_of_all_folds(std):
    model = RangeRateModel(0.1, 20.0)
    error = np.array([0.0, 3.0, 9.5, -51.0])
    innovation, spread, log_density = model.fold(error, np.full(4, std**2))
    each = error + 20.0 * np.arange(-40, 41)[:, None]
    density = norm.pdf(each, 0.0, std)
    share = density / density.sum(axis=0)
    mean = (share * each).sum(axis=0)
    np.testing.assert_allclose(log_density, np.log(density.sum(axis=0)), atol=1e-3)
    np.testing.assert_allclose(innovation, mean, atol=1e-2 * std)
    np.testing.assert_allclose(spread, (share * (each - mean) ** 2).sum(axis=0), atol=0.02 * std**2)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (15.0, -4.0)])
def test_range_rate_is_the_change_of_the_range(velocity):
    radar = replace(RADAR, velocity=velocity)
    state = np.array([[540.0, -7.0, -280.0, 12.0, 0.0], [700.0, 20.0, 100.0, 3.0, 0.0]])
    step = 1e-3
    later = replace(radar, position=tuple(np.add(radar.position, np.multiply(step, velocity))))
    moved = state.copy()
    moved[:, [0, 2]] += step * state[:, [1, 3]]
    expected = (later.measure(moved)[:, 0] - radar.measure(state)[:, 0]) / step
    np.testing.assert_allclose(radar.range_rate_of(state), expected, atol=1e-2)


def test_range_rate_at_a_time_of_its_own_is_that_from_where_the_target_is_then():
    state = np.array([[540.0, -7.0, -280.0, 12.0, 0.0]])
    moved = state.copy()
    moved[:, [0, 2]] += 1.5 * state[:, [1, 3]]
    found = RADAR.range_rate_of(state, np.array([1.5]))
    np.testing.assert_allclose(found, RADAR.range_rate_of(moved))


@pytest.mark.parametrize("model", [RangeRateModel(0.2, 30.0), RangeRateModel(0.2, 0.0, 80.0)])
def test_intensities_of_clutter_and_births_sum_to_those_without_range_rates(model):
    radar = replace(RADAR, range_rate=model, velocity=(4.0, -3.0), clutter_rate=7.0)
    width = model.clutter_width
    rate = (np.arange(4000) + 0.5) / 4000.0 * width - 0.5 * width
    place = np.tile([100.0, 0.3], (4000, 1))
    rated, plain = Detections(place, None, range_rate=rate), Detections(place[:1], None)
    step = width / 4000.0
    clutter = np.exp(View.of(radar, rated).log_clutter).sum() * step
    assert clutter == pytest.approx(np.exp(View.of(radar, plain).log_clutter)[0], rel=1e-9)
    area = np.radians(120.0) * radar.visibility.clutter_range
    assert clutter == pytest.approx(7.0 / area, rel=1e-9)
    births = [
        np.exp(BIRTHS.log_intensity(View.of(radar, found), CONFIG.model.modes, 6.0)).sum()
        for found in (rated, plain)
    ]
    assert births[0] * step == pytest.approx(births[1], rel=2e-3)


def test_intensities_of_detections_without_a_known_range_rate_are_those_without_any():
    place = np.array([[100.0, 0.3]])
    unknown = Detections(place, None, range_rate=np.array([np.nan]))
    plain = Detections(place, None)
    views = [View.of(RADAR, one) for one in (unknown, plain)]
    assert views[0].log_clutter == views[1].log_clutter
    modes = CONFIG.model.modes
    found = [BIRTHS.log_intensity(view, modes, 6.0) for view in views]
    np.testing.assert_array_equal(*found)


def test_detections_that_are_taken_keep_their_range_rates():
    report = Detections(
        np.ones((3, 2)), None, range_rate=np.arange(3.0), range_rate_std=np.arange(3.0) + 1.0
    )
    taken = report.take(np.array([2, 0]))
    np.testing.assert_array_equal(taken.range_rate, [2.0, 0.0])
    np.testing.assert_array_equal(taken.range_rate_std, [3.0, 1.0])
    with pytest.raises(ValueError, match="range_rate"):
        Detections(np.ones((3, 2)), None, range_rate=np.ones(2))
