"""The closed form against the equations, the Kalman filter, the RTS smoother and particles."""

from dataclasses import replace

import numpy as np
import pytest
from paper_room import plain, small
from scenes import TARGETS, no_detections, short_scenario
from scipy.stats import multivariate_normal
from textbook import kalman_smoother

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.phd import gaussian_mixture
from phd_jdtc_ros.core.phd.engine import Entry, backward_pass
from phd_jdtc_ros.core.phd.gaussian_filter import GaussianFilter
from phd_jdtc_ros.core.phd.gaussian_mixture import Mixture, Updated, correct, predict, reduce
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.targets.amplitude_density import of_classes
from phd_jdtc_ros.core.types import Detections, Scan
from phd_jdtc_ros.simulation.simulate import simulate

CONFIG = small({"engine": "phd_gaussian"})
MODEL = CONFIG.model
MODES = MODEL.modes
DT = 6.0


def mixture(mean, weight, mode=None, std=(100.0, 10.0, 100.0, 10.0, 1e-2), component=None):
    """Return Gaussians with the same deviations, zero outside the support of their modes."""
    mean, count = np.array(mean, dtype=float), len(mean)
    mode = np.zeros(count, dtype=int) if mode is None else np.asarray(mode)
    covariance = np.tile(np.diag(np.square(std)), (count, 1, 1))
    turns = mode % 2 == 1
    mean[~turns, 4], covariance[~turns, 4, 4] = 0.0, 0.0
    return Mixture(
        weight=np.asarray(weight, dtype=float),
        mean=mean,
        covariance=covariance,
        mode=mode,
        origin=np.zeros(count, dtype=int),
        component=np.full(count, -1) if component is None else np.asarray(component),
    )


def three_targets(seed=0):
    """Return two Gaussians about each of three places, in all modes."""
    rng = np.random.default_rng(seed)
    mean = np.zeros((6, 5))
    mean[:, [0, 2]] = np.repeat(TARGETS, 2, axis=0) + rng.normal(0.0, 100.0, (6, 2))
    mean[:, [1, 3, 4]] = rng.normal(0.0, [30.0, 30.0, 5e-3], (6, 3))
    return mixture(mean, rng.uniform(0.2, 0.8, 6), mode=[0, 1, 2, 3, 0, 3])


# --- Prediction ---------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [6.0, 2.0, 9.5])
def test_predict_mass_is_that_of_survivors_spawned_and_born(dt, monkeypatch):
    monkeypatch.setattr(gaussian_mixture, "LEAST_WEIGHT", 0.0)
    before = three_targets()
    after = predict(before, MODEL, dt, 3)
    share, mass = dt / 6.0, before.weight.sum()
    births = share * sum(term.rate.sum() for term in MODEL.births)
    survivors = after.mixture.weight[: len(after.parent)].sum()
    assert survivors == pytest.approx(0.99**share * mass, rel=1e-12)
    expected = survivors + 0.01 * share * mass + births
    assert after.mixture.weight.sum() == pytest.approx(expected, rel=1e-12)
    assert (after.mixture.component == -1).all()
    born = after.mixture.origin > 0
    assert set(after.mixture.origin[born]) == {12, 13, 14, 15}
    assert after.mixture.weight[born].sum() == pytest.approx(births, rel=1e-12)


def test_predict_keeps_the_class_of_survivors_and_not_of_spawned_targets():
    before = three_targets()
    after = predict(before, replace(MODEL, births=()), DT, 0)
    count, class_of = len(after.parent), MODES.class_of
    kept = class_of[before.mode[after.parent]]
    np.testing.assert_array_equal(class_of[after.mixture.mode[:count]], kept)
    spawned = after.mixture.take(np.arange(count, len(after.mixture)))
    by_class = np.bincount(class_of[spawned.mode], spawned.weight)
    assert by_class[0] == pytest.approx(by_class[1], rel=1e-9)


def test_predict_has_the_moments_of_particles():
    before = mixture([[0.0, 40.0, 0.0, 30.0, 2e-3]], [1.0], mode=[1])
    model = replace(MODEL, births=(), spawn=replace(MODEL.spawn, rate=0.0))
    after = predict(before, model, DT, 0).mixture
    rng = np.random.default_rng(0)
    state = rng.multivariate_normal(before.mean[0], before.covariance[0], 200_000)
    for mode, motion in enumerate(MODES.motions[:2]):
        moved, noise = motion.mean(state, DT), np.zeros((5, 5))
        noise[np.ix_(motion.support, motion.support)] = motion.noise_covariance(DT)
        (row,) = np.flatnonzero(after.mode == mode)
        np.testing.assert_allclose(after.mean[row], moved.mean(axis=0), atol=1.0)
        std = np.sqrt(np.maximum(np.diag(after.covariance[row]), 1e-12))
        expected = np.cov(moved.T) + noise
        np.testing.assert_allclose(
            after.covariance[row] / np.outer(std, std), expected / np.outer(std, std), atol=0.03
        )


# --- Correction ---------------------------------------------------------------------------------


def test_correct_is_the_printed_equation_with_extended_kalman_updates():
    radar = replace(MODEL.radars[1], clutter_rate=200.0)
    before, amplitude = three_targets(), np.array([20.0, 4.0])
    near = np.zeros((2, 5))
    near[:, [0, 2]] = TARGETS[[0, 2]] + [[100.0, -50.0], [0.0, 80.0]]
    detections = Detections(radar.measure(near), amplitude)
    report = View.of(radar, detections)
    after = correct(Updated(before, np.arange(6)), report, MODES)

    class_id = MODES.class_of[before.mode]
    p_d = of_classes(radar.threshold, MODES.classes)[class_id]
    likelihood = np.zeros((6, 2))
    for j in range(6):
        measured, slope = radar.linearise(before.mean[j : j + 1, [0, 2]])
        spread = slope[0] @ before.covariance[j][np.ix_([0, 2], [0, 2])] @ slope[0].T
        spread += np.diag(radar.noise_std**2)
        for z in range(2):
            error = radar.wrap(detections.measurement[z] - measured[0])
            amplitudes = report.log_class_likelihood(MODES.classes)[class_id[j], z]
            likelihood[j, z] = multivariate_normal.pdf(error, cov=spread) * np.exp(amplitudes)
    weighted = likelihood * before.weight[:, None]
    share = weighted / (np.exp(report.log_clutter) + weighted.sum(axis=0))
    for z in range(2):
        rows = np.flatnonzero(after.mixture.component == z)
        found = np.zeros(6)
        found[after.source[rows]] = after.mixture.weight[rows]
        # The linearisation is iterated, at the posterior position.
        np.testing.assert_allclose(found, share[:, z], rtol=0.02, atol=1e-4)
    missed = after.mixture.component < 0
    np.testing.assert_array_equal(after.source[missed], np.arange(6))
    np.testing.assert_allclose(after.mixture.weight[missed], before.weight * (1.0 - p_d))
    assert 0.05 < share.sum(axis=0).min() < 0.95


def test_correct_gives_each_detection_of_a_second_radar_a_component_of_its_own():
    before = mixture(np.r_[TARGETS[0], 0.0, 0.0, 0.0][None, [0, 2, 1, 3, 4]], [0.9])
    updated = Updated(before, np.arange(1))
    for radar in (radar.changed(clutter_rate=0.0) for radar in MODEL.radars):
        updated = correct(
            updated, View.of(radar, Detections(radar.measure(before.mean), None)), MODES
        )
    mass = np.bincount(updated.mixture.component[updated.mixture.component >= 0])
    assert len(mass) == 2
    masses = [
        updated.mixture.weight[updated.mixture.component == part].sum() for part in (-1, 0, 1)
    ]
    p_d = of_classes(MODEL.radars[0].threshold, MODES.classes)[0]
    np.testing.assert_allclose(masses[2], 1.0, atol=1e-3)
    # What the first radar saw was not missed by the second one.
    assert masses[1] == pytest.approx((1.0 - p_d) * 1.0, rel=0.01)


# --- Reduction ----------------------------------------------------------------------------------


def test_reduce_keeps_mass_and_moments_of_every_mode_and_component():
    rng = np.random.default_rng(3)
    count = 200
    mean = np.zeros((count, 5))
    mean[:, [0, 2]] = TARGETS[rng.integers(0, 3, count)] + rng.normal(0.0, 60.0, (count, 2))
    whole = mixture(
        mean,
        rng.exponential(0.05, count),
        mode=rng.integers(0, 4, count),
        component=rng.integers(-1, 3, count),
    )
    merged, row = reduce(whole, MODES)
    assert len(merged) < 0.4 * count
    for name in ("mode", "component", "origin"):
        np.testing.assert_array_equal(getattr(merged, name)[row], getattr(whole, name))
    for part in range(-1, 3):
        for mode in range(4):
            moments = []
            for each in (whole, merged):
                rows = np.flatnonzero((each.component == part) & (each.mode == mode))
                weight, means = each.weight[rows], each.mean[rows]
                square = each.covariance[rows] + means[..., None] * means[:, None]
                second = np.tensordot(weight, square, 1)
                moments.append((weight.sum(), weight @ means, second))
            for one, other in zip(*moments, strict=True):
                np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-6)


def test_reduce_leaves_apart_what_is_far_apart():
    mean = np.zeros((3, 5))
    mean[:, 0] = [0.0, 150.0, 250.0]  # 1.5 and 2.5 deviations
    merged, row = reduce(mixture(mean, [0.5, 0.3, 0.2]), MODES)
    assert row.tolist() == [0, 0, 1]
    np.testing.assert_allclose(merged.weight, [0.8, 0.2])


# --- One target: Kalman filter and Rauch-Tung-Striebel smoother -----------------------------------


def single_target(given):
    config = plain(
        {"engine": "phd_gaussian", "spawn.rate": 0.0, "radar.clutter_rate": 0.0, **given}
    )
    return replace(config.model, births=())


def window_of(model, start, scans):
    """Return the window after scans of one radar; the first one corrects `start` as it is."""
    recursion, window = GaussianFilter(model), []
    (radar,) = model.radars
    for index, detections in enumerate(scans):
        if index:
            scan = Scan(index + 1, (detections,))
            step = recursion.step(window[-1].stored, scan, DT, linked=True)
            window.append(Entry(index + 1, step.stored, step.link))
        else:
            updated = correct(
                Updated(start, np.arange(len(start))), View.of(radar, detections), model.modes
            )
            window.append(Entry(1, reduce(updated.mixture, model.modes)[0], None))
    return recursion, window


def test_one_target_has_the_moments_of_kalman_filter_and_rts_smoother():
    # Ranges to 3 m and azimuths to 3 m at 10 km: the arc's sagitta is below a millimetre.
    model = single_target(
        {
            "radar.range_std": 3.0,
            "radar.azimuth_std_deg": 0.016,
            "cv.noise_density": 0.05,
            "target.survival_probability": 1.0,
        }
    )
    (radar,), motion = model.radars, model.modes.motions[0]
    rng, truth = np.random.default_rng(11), np.array([[8e3, 10.0, 6e3, -20.0, 0.0]])
    detections, points, noises = [], [], []
    for _ in range(6):
        measurement = radar.measure(truth) + rng.standard_normal((1, 2)) * radar.noise_std
        detections.append(Detections(measurement, None))
        points.append(radar.to_world(measurement)[0])
        cos, sin = np.cos(measurement[0, 1]), np.sin(measurement[0, 1])
        turn = np.array([[cos, -sin], [sin, cos]])
        spread = np.array([radar.range_std, measurement[0, 0] * radar.azimuth_std]) ** 2
        noises.append(turn @ np.diag(spread) @ turn.T)
        truth = motion.mean(truth, DT)
    std = np.array([5.0, 5.0, 5.0, 5.0])
    prior = np.array([8e3 + 2.0, 12.0, 6e3 - 3.0, -18.0])
    step = np.eye(4)
    step[0, 1] = step[2, 3] = DT
    exact = kalman_smoother(
        prior, np.diag(std**2), points, noises, step, motion.noise_covariance(DT)
    )
    start = mixture([[*prior, 0.0]], [1.0], std=(*std, 0.0))
    recursion, window = window_of(model, start, detections)
    smoothed = list(backward_pass(window, recursion))[::-1]
    filtered = [each.stored for each in window]
    for found, expected in ((filtered, exact[0]), (smoothed, exact[1])):
        for each, (mean, covariance) in zip(found, expected, strict=True):
            # The mass of a PHD filter is up to (1 - p_D) / p_D too large.
            assert each.weight.max() == pytest.approx(1.0, abs=2e-3)
            row = each.weight.argmax()
            deviation = np.sqrt(np.diag(covariance))
            assert (np.abs(each.mean[row, :4] - mean) < 0.01 * deviation).all()
            np.testing.assert_allclose(
                each.covariance[row, :4, :4] / np.outer(deviation, deviation),
                covariance / np.outer(deviation, deviation),
                atol=0.01,
            )
    assert np.diag(exact[1][0][1])[1] < 0.5 * np.diag(exact[0][0][1])[1]


def test_smoothed_covariances_are_positive_where_wide_gaussians_join_a_narrow_one():
    model = single_target({"radar.range_std": 3.0, "radar.azimuth_std_deg": 0.016})
    (radar,), place = model.radars, [8e3, 0.0, 6e3, 0.0, 0.0]
    hit = Detections(radar.measure(np.array([place])), None)
    none = Detections(np.zeros((0, 2)), None)
    # They are apart in the first set and merged in the next one.
    wide = mixture([place], [0.1], std=(90.0, 10.0, 90.0, 10.0, 0.0), component=[0])
    narrow = mixture([place], [0.9], std=(10.0, 1.0, 10.0, 1.0, 0.0), component=[1])
    recursion, window = window_of(model, Mixture.concatenate(wide, narrow), [none, *[hit] * 4])
    for each in backward_pass(window, recursion):
        least = np.linalg.eigvalsh(each.covariance[:, :4, :4]).min(axis=1)
        assert (least > 0.0).all()


# --- Existence ------------------------------------------------------------------------------------

# A target of fixed SNR d is seen with p_FA^(1/(1+d)): 25.33 dB gives 0.98, 17.24 dB 0.88.
SNR_OF_P_D = {0.98: 25.33, 0.88: 17.24}


def masses(p_d, seen):
    """Return filtered and smoothed masses of one target, detected or not scan by scan."""
    snr_db = SNR_OF_P_D[p_d]
    model = single_target({"target.snr_band_db": [snr_db - 0.01, snr_db + 0.01]})
    (radar,), place = model.radars, [8e3, 0.0, 6e3, 0.0, 0.0]
    hit = Detections(radar.measure(np.array([place])), None)
    scans = [hit if detected else no_detections() for detected in seen]
    scans = [each if len(each) else Detections(np.zeros((0, 2)), None) for each in scans]
    start = mixture([place], [1.0], std=(100.0, 3.0, 100.0, 3.0, 0.0))
    recursion, window = window_of(model, start, scans)
    smoothed = list(backward_pass(window, recursion))[::-1]
    return [each.stored.weight.sum() for each in window], [each.weight.sum() for each in smoothed]


@pytest.mark.parametrize(("p_d", "bias"), [(0.98, 0.02), (0.88, 0.135)])
def test_smoothing_keeps_the_existence_before_a_death(p_d, bias):
    filtered, smoothed = masses(p_d, [1, 1, 1, 0, 0, 0])
    assert 1.0 < max(filtered) < 1.0 + 1.03 * bias
    for mass in smoothed[:2]:
        assert 1.0 + 0.7 * bias < mass < 1.0 + 1.03 * bias
    assert 0.9 < smoothed[2] < 1.0 + bias
    assert max(smoothed[3:]) < 0.01


@pytest.mark.parametrize("p_d", [0.98, 0.88])
def test_smoothing_repairs_a_miss_and_adds_no_mass_to_a_target_that_lives(p_d):
    filtered, smoothed = masses(p_d, [1, 1, 0, 1, 1, 1])
    assert filtered[2] < 0.2
    assert smoothed[2] > 0.9
    filtered, smoothed = masses(p_d, [1] * 6)
    assert np.abs(np.array(smoothed) - filtered[-1]).max() < 0.02 * (1.0 - p_d) / 0.02


# --- Particles --------------------------------------------------------------------------------


def test_particles_agree_with_the_closed_form():
    given = {
        "particles": [4000, 4096],
        "spawning.particles_per_target": 400,
        "lag": 4,
    }
    scans = [scan for _, scan in simulate(short_scenario(14), 5)]
    found = {}
    for engine in ("phd", "phd_gaussian"):
        tracker = new_engine(small({**given, "engine": engine}))
        steps = [tracker.step(scan) for scan in scans]
        smoothed = [each for step in steps for each in step.smoothed]
        mass = np.array([step.class_mass for step in steps])
        found[engine] = mass, [*(step.filtered[0] for step in steps)], smoothed
    (mass, *exact), (closed_mass, *closed) = found.values()
    np.testing.assert_allclose(mass[2:], closed_mass[2:], atol=0.08)
    for kind in range(2):
        distances = []
        for one, other in zip(exact[kind][2:], closed[kind][2:], strict=True):
            assert len(one) == len(other) == 3
            apart = np.linalg.norm(one.position[:, None] - other.position, axis=2)
            std = np.sqrt(np.trace(other.position_covariance, axis1=1, axis2=2))
            distances.append(apart.min(axis=0) / std)
        assert np.mean(distances) < 0.25
