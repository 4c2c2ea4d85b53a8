"""The radar in space: geometry, unknown elevations, births and the edges of its elevations."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from phd_jdtc_ros.core.arrays import frozen
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD, HeightPrior
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import (
    Linearised,
    Measured,
    Pairs,
    WeightedGaussians,
)
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.sensors.spatial_radar import SpatialRadar
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.sensors.visibility import Visibility
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.core.types import Detections

PRIOR = HeightPrior(3000.0, 2000.0, 100.0)
LOW, HIGH = np.radians([-2.0, 50.0])
RADAR = SpatialRadar(
    name="radar",
    position=(1000.0, -500.0),
    yaw=0.7,
    height=20.0,
    range_std=10.0,
    azimuth_std=np.radians(0.5),
    elevation_std=np.radians(0.8),
    visibility=Visibility(max_range=60e3, elevations=(LOW, HIGH)),
    clutter_rate=20.0,
    threshold=3.7,
    height_prior=PRIOR,
)
ROUND = replace(RADAR, curvature=1.0 / 6.4e6)
TILTED = replace(RADAR, tilt=(0.4, -0.15))
RADARS = pytest.mark.parametrize("radar", [RADAR, ROUND, TILTED], ids=["plane", "round", "tilted"])
PLACES = np.array(
    [
        [1300.0, -200.0, 250.0],
        [9000.0, 7500.0, 80.0],
        [-25e3, 12e3, 9000.0],
        [1020.0, -480.0, 400.0],
        [5000.0, -9000.0, -300.0],
    ]
)
AXES = [*SPATIAL.place, *SPATIAL.motion]


@RADARS
def test_jacobians_are_differences_of_measurements(radar):
    _, jacobian = radar.linearise(PLACES)
    for axis, step in enumerate(1e-3 * np.eye(3)):
        later, earlier = radar.linearise(PLACES + step)[0], radar.linearise(PLACES - step)[0]
        slope = radar.wrap(later - earlier) / 2e-3
        scale = np.abs(jacobian).max(axis=2)
        np.testing.assert_allclose(slope / scale, jacobian[:, :, axis] / scale, atol=1e-6)


@RADARS
def test_places_are_measured_and_found_again(radar):
    measured, _ = radar.linearise(PLACES)
    np.testing.assert_allclose(radar.to_world(measured), PLACES, atol=1e-6)


def test_measurements_on_the_sphere_are_those_of_straight_rays_around_its_centre():
    measured, _ = ROUND.linearise(PLACES)
    radius = 1.0 / ROUND.curvature
    along = np.hypot(*(PLACES[:, :2] - ROUND.position).T) / radius
    distance = radius + PLACES[:, 2] - ROUND.height
    line = np.stack([distance * np.sin(along), distance * np.cos(along) - radius], axis=1)
    np.testing.assert_allclose(measured[:, 0], np.hypot(*line.T), rtol=1e-9)
    np.testing.assert_allclose(measured[:, 2], np.arctan2(line[:, 1], line[:, 0]), rtol=1e-6)


@RADARS
def test_covariance_of_a_detection_is_that_of_drawn_measurements(radar):
    measured, _ = radar.linearise(PLACES[1:3])
    plots = radar.in_plane(Detections(measured, None))
    rng = np.random.default_rng(1)
    for row, covariance in enumerate(plots.covariance):
        drawn = measured[row] + radar.noise_std * rng.standard_normal((200_000, 3))
        exact = np.cov(radar.to_world(drawn).T)
        scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
        np.testing.assert_allclose(covariance / scale, exact / scale, atol=0.02)


def gaussians(rng, count=40, modes=2):
    """Return Gaussians about places in the field, some of which nearly overhead, with pairs."""
    around = rng.uniform(-1.0, 1.0, (count, modes, 3)) * [20e3, 20e3, 3e3] + [0.0, 0.0, 4e3]
    around[0] = [1050.0, -470.0, 900.0]
    mean = np.zeros((count, modes, len(SPATIAL)))
    mean[..., SPATIAL.place] = around
    mean[..., SPATIAL.motion] = rng.normal(0.0, [80.0, 80.0, 8.0], around.shape)
    scale = np.array([40.0, 9.0, 50.0, 7.0, 2e-3, 60.0, 3.0])
    root = rng.normal(size=(count, modes, len(SPATIAL), len(SPATIAL))) * scale[:, None]
    return mean, root @ root.swapaxes(-1, -2)


def detections(radar, mean, rng, timed):
    """Return a detection of each Gaussian; some without an elevation, some with their own noise."""
    measured = radar.measure(mean[:, 0]) + 2.0 * radar.noise_std * rng.standard_normal((40, 3))
    std = np.full(measured.shape, np.nan)
    std[::3] = 1.5 * radar.noise_std
    measured[::4, 2], std[::4, 2] = 0.0, UNKNOWN_STD
    time_s = rng.uniform(-0.5, 0.5, len(measured)) if timed else None
    return Detections(measured, None, noise_std=std, time_s=time_s)


@RADARS
@pytest.mark.parametrize("timed", [False, True], ids=["at the stamp", "at their own times"])
def test_compiled_measurements_are_those_of_array_operations(radar, timed):
    rng = np.random.default_rng(3)
    mean, covariance = gaussians(rng)
    weight = np.ones(mean.shape[:2])
    weight[5] = 0.0
    report = View.of(radar, detections(radar, mean, rng, timed))
    compiled, arrays = radar.of_gaussians, Linearised(radar)
    expected = compiled.expected(mean, covariance)
    for found, right in zip(expected, arrays.expected(mean, covariance), strict=True):
        np.testing.assert_allclose(found, right, rtol=1e-7, atol=1e-9)

    correction = radar.log_correction(report.detection_std[:, 2])
    found = compiled.gate_pairs(weight, mean, expected, report)
    right = arrays.gate_pairs(weight, mean, expected, report)
    assert len(right[0]) > 30
    # The first target is nearly overhead: its azimuth is any, and its gate has no edge.
    kept = found[0] > 0
    np.testing.assert_array_equal(found[0][kept], right[0][right[0] > 0])
    np.testing.assert_array_equal(found[1][kept], right[1][right[0] > 0])
    np.testing.assert_allclose(
        found[2][kept], (right[2] + correction[right[1]][:, None])[right[0] > 0], atol=1e-6
    )

    pairs = frozen(Pairs(right[0], right[1], modes=2, iterations=5, converged=0.0))
    flat = WeightedGaussians.of(
        mean.reshape(-1, 7), covariance.reshape(-1, 7, 7), weight.reshape(-1)
    )
    seen = report.detections
    measured = Measured(seen.measurement, report.detection_std, None, seen.time_s)
    one = compiled.innovations(flat, measured, pairs)
    other = arrays.innovations(flat, measured, pairs)
    far = pairs.group.repeat(2) > 0
    for found_part, right_part in zip(one[:3], other[:3], strict=True):
        np.testing.assert_allclose(found_part[far], right_part[far], rtol=1e-4, atol=1e-6)
    log_likelihood = other[3] + correction[pairs[1]].repeat(2)
    np.testing.assert_allclose(one[3][far], log_likelihood[far], atol=1e-5)


def test_detection_without_an_elevation_has_the_density_of_a_uniform_one():
    rng = np.random.default_rng(4)
    mean, covariance = (part[3:4] for part in gaussians(rng))
    measured = RADAR.measure(mean[:, 0])
    std = np.array([[np.nan, np.nan, UNKNOWN_STD]])
    flat = Detections(measured * [[1.0, 1.0, 0.0]], None, noise_std=std)
    report, sensor = View.of(RADAR, flat), RADAR.of_gaussians
    expected = sensor.expected(mean, covariance)
    *_, log_likelihood = sensor.gate_pairs(np.ones((1, 2)), mean, expected, report)
    spread = expected.covariance[0, 0, :2, :2] + np.diag(RADAR.noise_std[:2] ** 2)
    density = -0.5 * np.log(np.linalg.det(2.0 * np.pi * spread)) - np.log(HIGH - LOW)
    assert log_likelihood[0, 0] == pytest.approx(density, abs=1e-3)
    # That of false detections has the same factor.
    plane = replace(RADAR.visibility, elevations=None).log_clutter(20.0)
    assert RADAR.visibility.log_clutter(20.0) == pytest.approx(plane - np.log(HIGH - LOW))
    assert RADAR.visibility.size == pytest.approx(2.0 * np.pi * 60e3 * (HIGH - LOW))


def born(radar, slant):
    """Return the hypotheses of births at detections, of which the second has an elevation."""
    measured = np.array([[slant, 0.3, 0.0], [slant, -2.0, 0.2], [slant, 2.0, 0.0]])
    std = np.full((3, 3), np.nan)
    std[[0, 2], 2] = UNKNOWN_STD
    return measured, radar.places_of_births(Detections(measured, None, noise_std=std))


def test_births_of_a_tilted_array_are_where_it_has_measured_them():
    measured, births = born(TILTED, 9e3)
    assert (births.row == 1).sum() == 1
    for row in (0, 2):
        own = births.row == row
        assert births.share[own].sum() == pytest.approx(1.0)
        place = births.plots.position[own]
        assert (place[:, 2] >= PRIOR.floor).all()
        seen, _ = TILTED.linearise(place)
        np.testing.assert_allclose(seen[:, :2], np.tile(measured[row, :2], (own.sum(), 1)))
        assert ((seen[:, 2] > LOW) & (seen[:, 2] < HIGH)).all()


def test_tilted_array_sees_the_axes_of_its_frame():
    # Pitched by 30 degrees, a place as high as that ahead of it is on its x axis.
    radar = replace(RADAR, yaw=0.0, tilt=(np.radians(30.0), 0.0))
    ahead = radar.origin[0] + 1e3 * np.array([np.cos(np.pi / 6.0), 0.0, 0.5])
    np.testing.assert_allclose(radar.linearise(ahead[None])[0], [[1e3, 0.0, 0.0]], atol=1e-9)
    # Rolled by 90 degrees, its left side is up.
    radar = replace(RADAR, yaw=0.0, tilt=(0.0, np.pi / 2.0))
    up = radar.origin[0] + np.array([1e3, 0.0, 200.0])
    distance, azimuth = np.hypot(1e3, 200.0), np.arctan2(200.0, 1e3)
    np.testing.assert_allclose(radar.linearise(up[None])[0], [[distance, azimuth, 0.0]], atol=1e-9)


@pytest.mark.parametrize("radar", [RADAR, ROUND], ids=["plane", "round"])
@pytest.mark.parametrize("slant", [400.0, 5e3, 50e3])
def test_births_without_an_elevation_are_at_all_heights_of_the_beam_and_the_prior(radar, slant):
    measured, (row, share, plots) = born(radar, slant)
    cells = HeightPrior.CELLS
    np.testing.assert_array_equal(row, [0] * cells + [1] + [2] * cells)
    for index in range(3):
        assert share[row == index].sum() == pytest.approx(1.0)
    again, _ = radar.linearise(plots.position)
    np.testing.assert_allclose(again[:, 0], slant, rtol=1e-6)
    np.testing.assert_allclose(radar.wrap(again - measured[row])[:, 1], 0.0, atol=1e-9)
    unknown = row != 1
    assert (again[unknown, 2] > LOW - 1e-6).all()
    assert (again[unknown, 2] < HIGH + 1e-6).all()
    height, deviation = plots.position[unknown, 2], plots.root[unknown, 2, 2]
    low = radar.to_world(np.array([[slant, 0.0, LOW]]))[0, 2]
    high = radar.to_world(np.array([[slant, 0.0, HIGH]]))[0, 2]
    bottom, top = max(low, PRIOR.floor), min(high, PRIOR.mean + 2.0 * PRIOR.std)
    np.testing.assert_allclose(deviation, (top - bottom) / cells / np.sqrt(12.0), rtol=1e-6)
    assert height[0] == pytest.approx(bottom + 0.5 * (top - bottom) / cells)
    centre = share[:cells] @ height[:cells]
    inside = np.linspace(bottom, top, 20001)
    weight = norm.pdf(inside, PRIOR.mean, PRIOR.std)
    exact = weight @ inside / weight.sum()
    assert centre == pytest.approx(exact, abs=0.02 * (top - bottom))


def test_covariance_of_a_height_is_tilted_along_the_circle_of_the_slant_range():
    _, (row, _, plots) = born(RADAR, 5e3)
    for hypothesis in np.flatnonzero(row != 1):
        _, slope = RADAR.linearise(plots.position[hypothesis])
        spread = slope @ plots.covariance[hypothesis] @ slope.T
        level = np.hypot(*(plots.position[hypothesis, :2] - RADAR.position))
        assert np.sqrt(spread[0, 0]) == pytest.approx(RADAR.range_std, rel=1e-6)
        assert np.sqrt(spread[1, 1]) == pytest.approx(RADAR.azimuth_std, rel=1e-6)
        assert np.sqrt(spread[2, 2]) * level == pytest.approx(
            plots.root[hypothesis, 2, 2], rel=0.05
        )


def test_prior_above_the_beam_leaves_the_whole_beam():
    high = replace(RADAR, height_prior=HeightPrior(40e3, 1e3, 30e3))
    _, (row, share, plots) = born(high, 5e3)
    np.testing.assert_allclose(share[row == 0], 1.0 / HeightPrior.CELLS)
    top = RADAR.to_world(np.array([[5e3, 0.0, HIGH]]))[0, 2]
    assert plots.position[row == 0, 2].max() < top


def test_elevations_limit_the_coverage_as_ranges_do():
    elevation = np.array([LOW - 0.1, LOW + 1e-3, 0.4, HIGH - 0.02, HIGH + 0.02, HIGH + 0.3])
    predicted = np.stack([np.full(6, 5e3), np.zeros(6), elevation], axis=1)
    std = np.full((6, 3), [50.0, 0.01, 0.02])
    certain = RADAR.visibility.probability_in_view(predicted)
    np.testing.assert_array_equal(certain, [0, 1, 1, 1, 0, 0])
    found = RADAR.visibility.probability_in_view(predicted, std)
    inside = norm.cdf(HIGH, elevation, 0.02) - norm.cdf(LOW, elevation, 0.02)
    np.testing.assert_allclose(found, inside, atol=1e-12)
    component, limits = RADAR.visibility.limits
    np.testing.assert_array_equal(limits[component == 2], [[LOW, HIGH]])
    # A radar in the plane has none.
    flat = Visibility(max_range=60e3)
    assert set(flat.limits[0]) <= {0, 1}


def test_range_rate_is_along_the_line_of_sight_in_space():
    radar = replace(RADAR, range_rate=RangeRateModel(0.1, 0.0), velocity=(3.0, -4.0))
    state = np.zeros((len(PLACES), len(SPATIAL)))
    state[:, SPATIAL.place] = PLACES
    state[:, SPATIAL.motion] = np.random.default_rng(5).normal(0.0, 20.0, PLACES.shape)
    later = state[:, SPATIAL.place] + 1e-3 * (state[:, SPATIAL.motion] - [3.0, -4.0, 0.0])
    change = radar.linearise(later)[0][:, 0] - radar.linearise(PLACES)[0][:, 0]
    np.testing.assert_allclose(radar.range_rate_of(state), change / 1e-3, rtol=1e-3)


def test_scaled_noise_has_a_factor_for_each_component_and_for_range_rates():
    radar = replace(RADAR, range_rate=RangeRateModel(0.1, 0.0))
    scaled = radar.with_scaled_noise(np.array([2.0, 3.0, 4.0, 5.0]))
    np.testing.assert_allclose(scaled.noise_std, radar.noise_std * [2.0, 3.0, 4.0])
    assert scaled.range_rate.std == pytest.approx(0.5)


def test_range_rates_without_an_elevation_have_the_noise_of_climbs_at_the_usual_heights():
    radar = replace(RADAR, range_rate=RangeRateModel(0.3, 0.0, climb_std=5.0))
    measurement = np.array([[20e3, 0.0, 0.2], [20e3, 0.0, 0.0], [40e3, 1.0, 0.0], [10.0, 1.0, 0.0]])
    noise_std = np.full(measurement.shape, np.nan)
    noise_std[1:, 2] = UNKNOWN_STD
    seen = Detections(measurement, None, noise_std=noise_std, range_rate=np.full(4, 9.0))
    found = radar.motion_of(seen)
    # Root mean square of undetected targets' heights; the beam ends at 50 degrees.
    above = np.hypot(PRIOR.mean - 20.0, PRIOR.std)
    rise = np.array([0.0, above / 20e3, above / 40e3, np.sin(HIGH)])
    np.testing.assert_allclose(found.std, np.hypot(0.3, 5.0 * rise), rtol=1e-12)
    np.testing.assert_array_equal(found.rate, seen.range_rate)
    # The radar's own noise is learned from the others alone.
    own = View.of(radar, seen).sensors_own_rate_std(found)
    np.testing.assert_array_equal(own, [0.3, np.nan, np.nan, np.nan])
    assert radar.motion_of(seen.changed(range_rate=None)) is None
    # A reported height shows the elevation.
    told = radar.motion_of(seen.changed(z=np.array([np.nan, 3000.0, np.nan, np.nan])))
    np.testing.assert_array_equal(told.std, np.where(np.arange(4) == 1, 0.3, found.std))
