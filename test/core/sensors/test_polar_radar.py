from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scenes import small

from phd_jdtc_ros.core.arrays import wrap_angle
from phd_jdtc_ros.core.sensors.point_gate import DETECTION_GATE_SIGMA
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.sensors.visibility import Visibility, sector_probability
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.types import FULL_TURN, Coverage, Detections

RADAR = RadarModel(
    name="radar",
    position=(1000.0, -500.0),
    yaw=0.7,
    range_std=300.0,
    azimuth_std=np.radians(1.0),
    visibility=Visibility(max_range=17e3, clutter_max_range=15e3),
    clutter_rate=20.0,
    threshold=amplitude_density.threshold_for(1e-3),
)
# --- Detections with a time, a deviation and an amplitude of their own ----------------------------
MOVING = np.array([[9e3, -200.0, 4e3, 150.0, 0.0], [5e3, 30.0, -3e3, 240.0, 0.0]])
CLASSES = small().model.modes.classes
STD = np.radians(0.5)
TURN = np.linspace(-np.pi, np.pi, 721)
LIMITED = Visibility(
    *(60e3, 500.0, Coverage(-1.0, 2.0), (Coverage(0.2, 0.1), Coverage(0.25, 0.15))),
    ranges=(10e3, 50e3, 100e3),
    probabilities=(0.95, 0.9, 0.5),
)
# Means and standard deviations of (range, azimuth): near every limit, far inside, and outside.
PLACES = np.array([[450.0, 0.0], [30e3, 0.19], [30e3, 0.42], [59e3, 0.9], [62e3, 0.0], [9e3, -1.1]])
SPREAD = np.array([[300.0, 0.1], [2e3, 0.02], [9e3, 0.3], [3e3, 0.05], [2e3, 0.5], [4e3, 0.2]])


@settings(deadline=None, max_examples=300)
@given(angle=st.floats(-1e3, 1e3))
@example(angle=np.pi)
@example(angle=-np.pi)
@example(angle=np.nextafter(np.pi, 4.0))
@example(angle=np.nextafter(-np.pi, -4.0))
def test_wrap_angle_lies_in_the_half_open_turn(angle):
    wrapped = wrap_angle(np.array([angle]))[0]
    assert -np.pi < wrapped <= np.pi


@settings(deadline=None, max_examples=100)
@given(angle=st.floats(-3.1, 3.1), turns=st.integers(-50, 50))
def test_wrap_angle_undoes_whole_turns(angle, turns):
    wrapped = wrap_angle(np.array([angle + turns * 2.0 * np.pi]))[0]
    assert wrapped == pytest.approx(angle, abs=1e-12)


@settings(deadline=None, max_examples=100)
@given(x=st.floats(-2e4, 2e4), y=st.floats(-2e4, 2e4))
def test_to_world_inverts_measure(x, y):
    state = np.array([[x, 0.0, y, 0.0, 0.0]])
    np.testing.assert_allclose(RADAR.to_world(RADAR.measure(state)), [[x, y]], rtol=0, atol=1e-8)


def test_measure_counts_azimuths_counter_clockwise_with_its_derivative():
    radar = replace(RADAR, position=(0.0, 0.0), yaw=np.pi / 2)
    state = np.array([[0.0, 0, 10.0, 0, 0], [10.0, 0, 0.0, 0, 0], [-3.0, 0, -4.0, 0, 0]])
    expected = [[10.0, 0.0], [10.0, -np.pi / 2], [5.0, np.pi - np.arctan2(3.0, 4.0)]]
    np.testing.assert_allclose(radar.measure(state), expected, atol=1e-12)
    difference = (RADAR.measure(at(1e-3)) - RADAR.measure(at(-1e-3))) / 2e-3
    np.testing.assert_allclose(measurement_rate(RADAR), difference, rtol=1e-6, atol=1e-9)


def measurement_rate(radar):
    """Return the time derivatives of the measurements of what moves, (2, 2)."""
    _, slope = radar.linearise(MOVING[:, [0, 2]])
    return (slope @ MOVING[:, [1, 3], None])[..., 0]


def brute_pairs(radar, predicted, detections):
    error = predicted[:, None, :] - detections.measurement[None, :, :]
    turn = np.exp(1j * error[..., 1])
    scaled = np.stack([error[..., 0], np.angle(turn)], axis=-1) / radar.noise_std
    near = (scaled**2).sum(axis=-1) <= DETECTION_GATE_SIGMA**2
    log_likelihood = -0.5 * (scaled**2).sum(axis=-1) - np.log(
        2.0 * np.pi * radar.range_std * radar.azimuth_std
    )
    return {(n, m): log_likelihood[n, m] for n, m in np.argwhere(near)}


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    particles=st.integers(0, 40),
    reports=st.integers(0, 25),
    azimuth_std=st.sampled_from([0.001, 0.02, 0.3, 2.0]),
    centre=st.sampled_from([0.0, np.pi, -np.pi]),
)
def test_gated_pairs_equal_brute_force(seed, particles, reports, azimuth_std, centre):
    rng = np.random.default_rng(seed)
    radar = replace(RADAR, azimuth_std=azimuth_std)

    def draw(count):
        azimuth = centre + rng.normal(0.0, 5.0 * azimuth_std, count)
        return np.stack([rng.uniform(0.0, 5e3, count), wrap_angle(azimuth)], axis=1)

    predicted, detections = draw(particles), Detections(draw(reports), None)
    particle, detection, log_likelihood = radar.gated_pairs(predicted, detections)
    expected = brute_pairs(radar, predicted, detections)
    found = list(zip(particle.tolist(), detection.tolist(), strict=True))
    assert len(found) == len(expected)
    assert set(found) == set(expected)
    np.testing.assert_allclose(
        log_likelihood, [expected[pair] for pair in found], rtol=0, atol=1e-9
    )


def test_log_clutter_intensity_integrates_to_the_rate_and_its_amplitudes():
    # Uniform over 2 pi x 15 km, times an amplitude density that integrates to one above tau.
    detections = Detections(np.array([[5e3, 1.0]]), None)
    area = 2.0 * np.pi * RADAR.visibility.clutter_range
    assert np.exp(View.of(RADAR, detections).log_clutter)[0] * area == pytest.approx(20.0)
    measurement = np.full((3, 2), 1.0)
    a = np.array([4.0, 5.0, 6.0])
    plain = View.of(RADAR, Detections(measurement, None)).log_clutter
    full = View.of(RADAR, Detections(measurement, a)).log_clutter
    np.testing.assert_allclose(np.exp(full - plain), a * np.exp(-(a**2) / 2.0) / 1e-3, rtol=1e-9)
    radar = replace(RADAR, clutter_rate=0.0)
    detections = Detections(np.ones((1, 2)), np.array([250.0]))
    assert np.isfinite(View.of(radar, detections).log_clutter).all()


def test_log_class_likelihood_is_the_untruncated_density():
    classes = small().model.modes.classes
    a = np.array([4.0, 20.0, 250.0])
    likelihood = View.of(RADAR, Detections(np.ones((3, 2)), a)).log_class_likelihood(classes)
    expected = [amplitude_density.log_target_density(a, c.snr_band) for c in classes]
    np.testing.assert_array_equal(likelihood, expected)
    likelihood = View.of(RADAR, Detections(np.ones((3, 2)), None)).log_class_likelihood(classes)
    p_d = amplitude_density.of_classes(RADAR.threshold, classes)
    assert likelihood.shape == (2, 3)
    np.testing.assert_allclose(np.exp(likelihood), np.repeat(p_d[:, None], 3, axis=1))


def at(seconds):
    state = MOVING.copy()
    state[:, [0, 2]] += seconds * state[:, [1, 3]]
    return state


def test_gated_pairs_takes_each_detections_own_deviation():
    far = RADAR.measure(MOVING) + np.array([900.0, 0.0])
    std = np.tile(RADAR.noise_std, (2, 1))
    std[1, 0] = 100.0
    particle, _, found = RADAR.gated_pairs(
        RADAR.measure(MOVING), Detections(far, None, noise_std=std)
    )
    assert particle.tolist() == [0]
    assert found[0] == pytest.approx(
        -0.5 * 3.0**2 - np.log(2.0 * np.pi * RADAR.range_std * RADAR.azimuth_std)
    )


def test_detection_noise_is_the_radars_unless_reported_by_the_driver():
    own = np.array([[np.nan, np.nan], [50.0, 0.01]])
    found = RADAR.noise_std_of(Detections(np.array([[10e3, 0.0]] * 2), None, noise_std=own))
    np.testing.assert_allclose(found[0], [RADAR.range_std, RADAR.azimuth_std])
    np.testing.assert_allclose(found[1], [50.0, 0.01])


def test_unknown_amplitude_is_as_one_that_no_radar_reports():
    place = np.array([[5e3, 0.0], [5e3, 0.0]])
    some = View.of(RADAR, Detections(place, np.array([20.0, np.nan])))
    none = View.of(RADAR, Detections(place, None))
    likelihood = some.log_class_likelihood(CLASSES)
    assert np.isfinite(likelihood).all()
    expected = none.log_class_likelihood(CLASSES)
    np.testing.assert_array_equal(likelihood[:, 1], expected[:, 1])
    assert (likelihood[:, 0] != expected[:, 0]).all()
    assert some.log_clutter[1] == none.log_clutter[1]


def test_configured_detection_probability_replaces_that_of_the_bands():
    given = replace(
        RADAR, visibility=replace(RADAR.visibility, ranges=(0.0,), probabilities=(0.5,))
    )
    report = Detections(np.array([[5e3, 0.0]]), np.array([20.0]))
    configured, from_snr = (
        View.of(radar, report).log_class_likelihood(CLASSES) for radar in (given, RADAR)
    )
    expected = np.log(0.5 / amplitude_density.of_classes(RADAR.threshold, CLASSES))
    np.testing.assert_allclose((configured - from_snr)[:, 0], expected)


def test_coverage_probability_is_what_the_antenna_passed_of_the_field_of_view():
    predicted = np.array([[5e3, 0.1], [5e3, 1.0], [20e3, 0.1]])
    assert RADAR.visibility.coverage_probability(
        predicted, Coverage(0.0, 0.5), RADAR.noise_std
    ).tolist() == pytest.approx([1.0, 0.0, 0.0])
    assert RADAR.visibility.probability_in_view(predicted).tolist() == [1.0, 1.0, 0.0]


def test_linearised_is_the_measurement_and_its_derivative():
    rng = np.random.default_rng(0)
    position = rng.uniform(-12e3, 12e3, (40, 2))
    measured, jacobian = RADAR.linearise(position)

    def measure(places):
        state = np.zeros((len(places), 5))
        state[:, [0, 2]] = places
        return RADAR.measure(state)

    np.testing.assert_allclose(measured, measure(position), rtol=1e-12, atol=1e-12)
    for axis in (0, 1):
        away = np.zeros(2)
        away[axis] = 0.1
        apart = measure(position + away) - measure(position - away)
        apart[:, 1] = wrap_angle(apart[:, 1])
        np.testing.assert_allclose(jacobian[..., axis], apart / 0.2, rtol=1e-5, atol=1e-9)


def test_linearised_is_finite_and_keeps_leading_axes():
    position = np.random.default_rng(1).uniform(-9e3, 9e3, (3, 4, 2))
    measured, jacobian = RADAR.linearise(position)
    flat, matrix = RADAR.linearise(position.reshape(-1, 2))
    np.testing.assert_array_equal(measured, flat.reshape(3, 4, 2))
    np.testing.assert_array_equal(jacobian, matrix.reshape(3, 4, 2, 2))
    measured, jacobian = RADAR.linearise(np.array([RADAR.position]))
    assert np.isfinite(measured).all()
    assert np.isfinite(jacobian).all()


def resting(position):
    """Return states at rest, (N, 5), of positions, (N, 2)."""
    state = np.zeros((len(position), 5))
    state[:, [0, 2]] = position
    return state


def field_radar(rng):
    """Return a radar with a drawn place, field of view and range limits."""
    low, high = np.sort(rng.uniform(0.0, 900.0, 2))
    field = Coverage(rng.uniform(-np.pi, np.pi), rng.uniform(0.2, 2.0 * np.pi))
    return replace(
        RADAR,
        position=tuple(rng.uniform(-200.0, 200.0, 2)),
        yaw=rng.uniform(-np.pi, np.pi),
        range_std=3.0,
        azimuth_std=0.01,
        visibility=Visibility(high, low, field),
    )


def test_may_be_swept_by_a_whole_report_is_who_may_be_in_the_field_of_view():
    rng, whole = np.random.default_rng(8), Detections(np.zeros((0, 2)), None)
    decided = np.zeros(2, dtype=int)
    for _ in range(60):
        radar = field_radar(rng)
        centre, radius = rng.uniform(-1e3, 1e3, (40, 2)), rng.uniform(0.0, 150.0, 40)
        place, field = radar.measure(resting(centre)), radar.visibility
        near = field.may_be_swept(place, radius, radar.noise_std, whole)
        # Places of each circle, in polar rings.
        angle, share = np.meshgrid(np.linspace(-np.pi, np.pi, 90), np.linspace(0.0, 1.0, 12))
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * share[..., None]
        points = centre[:, None] + radius[:, None, None] * ring.reshape(-1, 2)
        inside = (
            radar.visibility.probability_in_view(radar.measure(resting(points.reshape(-1, 2))))
            > 0.0
        )
        seen = inside.reshape(40, -1).any(axis=1)
        assert near[seen].all()
        # Nobody is near who is out of the gate of every place of the field.
        distance = np.hypot(*(centre - radar.position).T)
        gate = DETECTION_GATE_SIGMA * radar.range_std
        out = distance - radius > radar.max_range + gate
        out |= distance + radius < radar.visibility.min_range - gate
        assert not near[out].any()
        decided += seen.sum(), out.sum()
    assert decided.min() > 200


@given(start=st.floats(-10.0, 10.0), width=st.floats(0.01, FULL_TURN))
def test_within_without_noise_is_inside_or_outside(start, width):
    sector = Coverage(start, width)
    inside = sector_probability(start + width * np.array([1e-6, 0.5, 1.0 - 1e-6]), sector)
    assert inside.tolist() == [1.0, 1.0, 1.0]
    if width < FULL_TURN - 0.01:
        assert sector_probability(
            np.array([start - 0.004, start + width + 0.004]), sector
        ).tolist() == [0, 0]


def test_within_counts_every_azimuth_once():
    sectors = [Coverage(0.3 + k * FULL_TURN / 16, FULL_TURN / 16) for k in range(16)]
    total = sum(sector_probability(TURN, sector, STD) for sector in sectors)
    np.testing.assert_allclose(total, 1.0, atol=1e-12)
    share = sector_probability(np.array([0.0, 1.0]), Coverage(0.0, 1.0), STD)
    np.testing.assert_allclose(share, 0.5, atol=1e-9)
    assert (sector_probability(TURN, Coverage(1.0, FULL_TURN), STD) == 1.0).all()


@pytest.mark.parametrize("width", [0.0, -1.0, 7.0, np.nan])
def test_coverage_must_be_a_part_of_a_revolution(width):
    with pytest.raises(ValueError, match="coverage"):
        Coverage(0.0, width)


def test_probability_is_linear_and_bounded():
    seen = Visibility(100e3, ranges=(10e3, 50e3, 100e3), probabilities=(0.95, 0.9, 0.5))
    expected = [0.95, 0.95, 0.925, 0.7, 0.5]
    distance = np.array([0.0, 10e3, 30e3, 75e3, 120e3])
    np.testing.assert_allclose(seen.probability(distance), expected)
    found = LIMITED.probability(np.array([90e3]), np.array([100.0]))
    np.testing.assert_allclose(found, LIMITED.probability(np.array([90e3])))


def test_sees_what_is_in_range_in_the_field_and_not_hidden():
    seen = Visibility(
        max_range=10e3, min_range=500.0, fov=Coverage(-1.0, 2.0), blind=(Coverage(0.2, 0.1),)
    )
    measured = np.array([[400.0, 0.0], [600.0, 0.0], [11e3, 0.0], [5e3, 1.1], [5e3, 0.25]])
    assert seen.probability_in_view(measured).tolist() == [0.0, 1.0, 0.0, 0.0, 0.0]


def drawn_around(place, spread):
    """Return a million (range, azimuth) rows of a normal density, with ranges above 0."""
    drawn = place + spread * np.random.default_rng(1).standard_normal((10**6, 2))
    return drawn[drawn[:, 0] > 0.0]


@pytest.mark.parametrize("row", range(len(PLACES)))
def test_sees_and_probability_of_a_density_are_means_over_its_places(row):
    drawn = drawn_around(PLACES[row], SPREAD[row])
    found = LIMITED.probability_in_view(PLACES[[row]], SPREAD[[row]])[0]
    assert found == pytest.approx(LIMITED.probability_in_view(drawn).sum() / 10**6, abs=3e-3)
    distance = drawn_around(PLACES[row], SPREAD[row])[:, 0]
    inside = distance[(distance >= LIMITED.min_range) & (distance <= LIMITED.max_range)]
    found = LIMITED.probability(PLACES[[row], 0], SPREAD[[row], 0])[0]
    assert found == pytest.approx(LIMITED.probability(inside).mean(), abs=3e-4)


@pytest.mark.parametrize("std", [0.1, 1.0, 2.5])
def test_sector_of_a_wide_density_is_its_share_of_the_wrapped_azimuths(std):
    sector = Coverage(0.1, FULL_TURN - 0.7)
    azimuth = 0.2 + std * np.random.default_rng(2).standard_normal(10**6)
    found = sector_probability(np.array([0.2]), sector, std)[0]
    assert found == pytest.approx(sector_probability(azimuth, sector).mean(), abs=3e-3)
