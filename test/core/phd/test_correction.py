from dataclasses import replace

import numpy as np
import pytest
from paper_room import particles, scattered, small
from scenes import TARGETS, no_detections
from scipy.stats import norm

from phd_jdtc_ros.core.phd.correction import correct
from phd_jdtc_ros.core.phd.particle_filter import ParticleFilter
from phd_jdtc_ros.core.phd.particles import Particles
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.sensors.visibility import Visibility
from phd_jdtc_ros.core.targets.amplitude_density import of_classes
from phd_jdtc_ros.core.targets.modes import ClassModel
from phd_jdtc_ros.core.types import Detections, Scan

MODEL = small().model
MODES = MODEL.modes
# Much clutter, so that the origin of detections of low amplitude is uncertain.
RADARS = tuple(replace(radar, clutter_rate=200.0) for radar in MODEL.radars)
RADAR = RADARS[1]  # At the world's origin


def update(phd, detections, radar, modes):
    return correct(phd, View.of(radar, detections), modes)


def reports(amplitudes=(20.0, 5.0, 4.0, 4.0), radar=RADAR):
    """Return one detection per target and one false detection."""
    state = np.zeros((4, 5))
    state[:, [0, 2]] = [*TARGETS, [3e3, -12e3]]
    offset = np.array([[150.0, 0.01], [-200.0, 0.0], [50.0, 0.005], [0.0, 0.0]])
    return Detections(radar.measure(state) + offset, np.array(amplitudes))


def component_mass(phd):
    return phd.components.toarray().sum(axis=0)


def dense_update(phd, detections, radar, modes):
    """Return (poisson, components) by the printed equation, loop by loop and ungated."""
    count, p_d = len(phd), of_classes(radar.threshold, modes.classes)
    a = detections.amplitude
    p_fa = np.exp(-0.5 * radar.threshold**2)
    clutter = radar.clutter_rate / (2 * np.pi * radar.visibility.clutter_range)
    clutter = clutter * a * np.exp(-(a**2) / 2.0) / p_fa
    numerator = np.zeros((count, len(detections)))
    missed = np.ones(count)
    for n, (x, _, y, _, _) in enumerate(phd.state):
        c = modes.class_of[phd.mode[n]]
        east, north = x - radar.position[0], y - radar.position[1]
        distance = np.hypot(east, north)
        if distance > radar.max_range:
            continue
        missed[n] = 1.0 - p_d[c]
        low, high = (1.0 + snr for snr in modes.classes[c].snr_band)
        g = np.exp(-(a**2) / (2 * high)) - np.exp(-(a**2) / (2 * low))
        g = 2.0 * g / (a * np.log(high / low)) / p_d[c]  # Given that it exceeds the threshold
        turn = np.exp(1j * (detections.measurement[:, 1] - np.arctan2(north, east) + radar.yaw))
        likelihood = (
            norm.pdf(detections.measurement[:, 0], distance, radar.range_std)
            * norm.pdf(np.angle(turn), 0.0, radar.azimuth_std)
            * g
        )
        numerator[n] = p_d[c] * likelihood * phd.weight[n]
    total = numerator.sum(axis=0)
    return phd.poisson * missed, numerator / (clutter + total), total / (clutter + total)


@pytest.mark.parametrize("radar", RADARS, ids=lambda radar: radar.name)
def test_update_equals_a_dense_evaluation(radar):
    phd, detections = scattered(), reports(radar=radar)
    updated = update(phd, detections, radar, MODES)
    poisson, components, share = dense_update(phd, detections, radar, MODES)
    np.testing.assert_allclose(updated.poisson, poisson, rtol=1e-12)
    # The gate at six sigma leaves out likelihoods below exp(-18) of their peak.
    assert np.abs(updated.components.toarray() - components).max() < 1e-8
    assert 0.05 < share[:3].min() < 0.95  # Clutter and targets both matter
    assert component_mass(updated)[3] == 0.0  # Nothing is near the clutter point


@pytest.mark.parametrize("previous", [False, True])
def test_update_with_no_detections_multiplies_by_the_missing_probability(previous):
    phd = scattered()
    if previous:
        phd = update(phd, reports(), RADAR, MODES)
    updated = update(phd, no_detections(), RADAR, MODES)
    p_d = of_classes(RADAR.threshold, MODES.classes)[MODES.class_of[phd.mode]]
    np.testing.assert_allclose(updated.weight, phd.weight * (1.0 - p_d), rtol=1e-12)
    assert updated.components.shape == phd.components.shape


@pytest.mark.parametrize(("nearest", "farthest"), [(0.0, 9.5e3), (9.5e3, 60e3)])
def test_update_neither_misses_nor_explains_by_targets_outside_the_field_of_view(nearest, farthest):
    visibility = Visibility(farthest, min_range=nearest)
    phd, radar = scattered(), replace(RADAR, visibility=visibility)
    outside = visibility.probability_in_view(radar.measure(phd.state)) == 0.0
    updated = update(phd, reports(), radar, MODES)
    assert 0.2 < outside.mean() < 0.8
    np.testing.assert_array_equal(updated.weight[outside], phd.weight[outside])
    assert (updated.poisson[~outside] < phd.poisson[~outside]).all()


def test_update_explains_every_detection_without_clutter():
    radar = replace(RADAR, clutter_rate=0.0)
    mass = component_mass(update(scattered(), reports(), radar, MODES))
    np.testing.assert_allclose(mass, [1.0, 1.0, 1.0, 0.0], rtol=1e-12)


@pytest.mark.parametrize("strength", [38.0, 250.0, 1000.0])
def test_update_with_a_huge_amplitude_gives_one_target_of_the_strong_class(strength):
    phd = scattered()
    updated = update(phd, reports((strength, 20.0, 20.0, 20.0)), RADAR, MODES)
    assert np.isfinite(updated.weight).all()
    component = updated.components.toarray()[:, 0]
    # Clutter of that amplitude does not occur.
    assert component.sum() == pytest.approx(1.0, abs=1e-9)


def test_update_without_amplitudes_keeps_the_class_shares_at_equal_detectability():
    # With one p_D for both classes a detection without amplitude leaves the class open.
    band = MODES.classes[0].snr_band
    classes = tuple(
        ClassModel(c.name, band, c.motions, c.mode_transition, 0.99) for c in MODES.classes
    )
    modes = replace(MODES, classes=classes)
    state = np.repeat([[6e3, 0.0, 8e3, 0.0, 0.0]], 4, axis=0)
    phd = particles(state, [0.1, 0.2, 0.3, 0.05], mode=np.arange(4))
    detections = Detections(RADAR.measure(state[:1]), None)
    updated = update(phd, detections, RADAR, modes)
    np.testing.assert_allclose(updated.weight / updated.weight.sum(), phd.weight / 0.65)


def test_update_of_nothing_is_nothing():
    updated = update(Particles.empty(5), reports(), RADAR, MODES)
    assert (len(updated), updated.components.shape) == (0, (0, 4))


def test_radars_correct_in_turn_and_one_without_a_report_does_not():
    model = replace(MODEL, radars=RADARS, births=(), spawn=replace(MODEL.spawn, rate=0.0))
    budget, phd = small().budget, scattered()
    reported = [reports(radar=radar) for radar in RADARS]

    def stepped(*detections):
        recursion = ParticleFilter(model, budget, 0, None, None)
        return recursion.step(phd, Scan(1, detections), 6.0, linked=False).corrected

    predicted = stepped(None, None)
    first = update(predicted, reported[0], RADARS[0], MODES)
    for found, expected in (
        (stepped(*reported), update(first, reported[1], RADARS[1], MODES)),
        (stepped(None, reported[1]), update(predicted, reported[1], RADARS[1], MODES)),
    ):
        np.testing.assert_array_equal(found.weight, expected.weight)
