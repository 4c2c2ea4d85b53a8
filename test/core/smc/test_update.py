from dataclasses import replace

import numpy as np
import pytest
from scenes import TARGETS, intensity, no_detections, scattered, small
from scipy.stats import norm

from phd_jdtc_ros.configuration.engines import particle_filter
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.sensors.visibility import Visibility
from phd_jdtc_ros.core.smc.correction import POISSON
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.smc.resampling import ParticleBudget, resample
from phd_jdtc_ros.core.smc.update import ParticleSteps
from phd_jdtc_ros.core.targets.modes import ClassModel
from phd_jdtc_ros.core.types import Detections, Scan
from phd_jdtc_ros.core.window import update as window_update
from phd_jdtc_ros.core.window.update import update_scan

# The PHD filter's corrector; the other one is tested in test_correction.
CONFIG = small({"engine": "phd"})
FILTER = particle_filter(CONFIG)
MODEL = CONFIG.model
MODES = MODEL.modes
# Much clutter, so that the row_label of detections of low amplitude is uncertain.
RADARS = tuple(replace(radar, clutter_rate=200.0) for radar in MODEL.radars)
RADAR = RADARS[1]  # at the world's origin


def update(phd, detections, radar, modes):
    steps = ParticleSteps(replace(MODEL, modes=modes), POISSON, np.random.default_rng(0))
    return window_update.update(phd, Report(radar, detections), steps, 6.0).rows


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
    count, p_d = len(phd), radar.class_detection_probability(modes.classes)
    a = detections.amplitude
    p_fa = np.exp(-0.5 * radar.threshold**2)
    clutter = radar.clutter_rate / (2 * np.pi * radar.clutter_max_range)
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
        g = 2.0 * g / (a * np.log(high / low)) / p_d[c]  # given that it exceeds the threshold
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
    assert 0.05 < share[:3].min() < 0.95  # clutter and targets both matter
    assert component_mass(updated)[3] == 0.0  # nothing is near the clutter point


@pytest.mark.parametrize("previous", [False, True])
def test_update_with_no_detections_multiplies_by_the_missing_probability(previous):
    phd = scattered()
    if previous:
        phd = update(phd, reports(), RADAR, MODES)
    updated = update(phd, no_detections(), RADAR, MODES)
    p_d = RADAR.class_detection_probability(MODES.classes)[MODES.class_of[phd.mode]]
    np.testing.assert_allclose(updated.weight, phd.weight * (1.0 - p_d), rtol=1e-12)
    assert updated.components.shape == phd.components.shape


def test_update_explains_detections_and_no_misses_out_of_range():
    phd = scattered()
    radar = replace(RADAR, visibility=Visibility(max_range=9.5e3))
    beyond = radar.measure(phd.state)[:, 0] > 9.5e3
    updated = update(phd, reports(), radar, MODES)
    assert 0.2 < beyond.mean() < 0.8
    np.testing.assert_array_equal(updated.weight[beyond], phd.weight[beyond])
    assert (updated.poisson[~beyond] < phd.poisson[~beyond]).all()
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
    phd = intensity(state, [0.1, 0.2, 0.3, 0.05], mode=np.arange(4))
    detections = Detections(RADAR.measure(state[:1]), None)
    updated = update(phd, detections, RADAR, modes)
    np.testing.assert_allclose(updated.weight / updated.weight.sum(), phd.weight / 0.65)


def test_update_and_resample_of_nothing_are_nothing():
    updated = update(ParticleSet.empty(5), reports(), RADAR, MODES)
    assert (len(updated), updated.components.shape) == (0, (0, 4))
    kept = resample(ParticleSet.empty(5), MODES, FILTER.budget, np.random.default_rng(0))
    assert len(kept) == 0


def test_update_scan_applies_the_radars_in_order_and_skips_the_silent():
    phd = scattered()
    model = replace(MODEL, radars=RADARS)
    first, second = (reports(radar=radar) for radar in RADARS)
    rng = np.random.default_rng(0)
    steps = ParticleSteps(model, POISSON, rng)
    both = update_scan(phd, Scan(1, (first, second)), steps, 6.0, 1).rows
    one = update_scan(phd, Scan(1, (None, second)), steps, 6.0, 1).rows
    chained = update(update(phd, first, RADARS[0], MODES), second, RADARS[1], MODES)
    np.testing.assert_array_equal(both.weight, chained.weight)
    np.testing.assert_array_equal(one.weight, update(phd, second, RADARS[1], MODES).weight)


def updated_set():
    phd = scattered()
    for radar in RADARS:
        phd = update(phd, reports(radar=radar), radar, MODES)
    return phd


def group_mass(phd):
    mass = {}
    for c, o, w in zip(MODES.class_of[phd.mode], phd.row_label, phd.weight, strict=True):
        mass[int(c), int(o)] = mass.get((int(c), int(o)), 0.0) + w
    return mass


def test_resample_keeps_the_mass_of_every_class_and_origin():
    phd = updated_set()
    before = group_mass(phd)
    # Enough particles that no group is too small for one.
    budget = ParticleBudget(per_target=100_000, least=20, per_birth_term=64, most=10**6)
    after = group_mass(resample(phd, MODES, budget, np.random.default_rng(0)))
    assert len(before) == 6
    assert min(before.values()) > 1e-5
    for key, mass in before.items():
        assert after[key] == pytest.approx(mass, rel=1e-9)


def test_resample_scales_every_component_by_the_new_over_the_old_weight():
    phd = updated_set()
    kept = resample(phd, MODES, FILTER.budget, np.random.default_rng(0))
    by_state = {row.tobytes(): index for index, row in enumerate(phd.state)}
    source = np.array([by_state[row.tobytes()] for row in kept.state])
    factor = kept.weight / phd.weight[source]
    assert np.ptp(factor) > 0.1
    np.testing.assert_allclose(kept.poisson, phd.poisson[source] * factor, rtol=1e-10)
    expected = phd.components.toarray()[source] * factor[:, None]
    np.testing.assert_allclose(kept.components.toarray(), expected, rtol=1e-10)
    for name in ("mode", "row_label", "parent"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(phd, name)[source])


def test_resample_gives_sorted_unique_rows_of_equally_heavy_copies():
    kept = resample(updated_set(), MODES, FILTER.budget, np.random.default_rng(0))
    assert len(np.unique(kept.state, axis=0)) == len(kept)
    assert kept.multiplicity.max() > 1
    group = np.stack([MODES.class_of[kept.mode], kept.row_label], axis=1)
    assert (np.diff(group @ [100, 1]) >= 0).all()
    per_copy = kept.weight / kept.multiplicity
    for key in np.unique(group, axis=0):
        chosen = (group == key).all(axis=1)
        np.testing.assert_allclose(per_copy[chosen], per_copy[chosen][0], rtol=1e-9)


def test_resample_is_unbiased_in_every_component():
    phd = updated_set()
    rng = np.random.default_rng(1)
    budget = ParticleBudget(per_target=30, least=1, per_birth_term=64, most=10**6)
    before = component_mass(phd)
    trials = np.array([component_mass(resample(phd, MODES, budget, rng)) for _ in range(400)])
    error = 4.5 * trials.std(axis=0) / np.sqrt(len(trials)) + 1e-12
    assert (np.abs(trials.mean(axis=0) - before) <= error).all()
