"""Pairs of hypotheses and detections: gates, pruning, and the cells of SNR after an update."""

from dataclasses import replace

import numpy as np
import pytest
from lone import MEAN, SIZE, STD, lone, mixture_of
from reference import resolve

from phd_jdtc_ros.core.arrays import frozen, wrap_angle
from phd_jdtc_ros.core.association.marginals import LEAST_CLUTTER
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement import likely_pairs
from phd_jdtc_ros.core.gaussian.measurement.amplitude import (
    Amplitudes,
    DetectionProbability,
    detection_probability,
    snr_after,
)
from phd_jdtc_ros.core.gaussian.measurement.missed import after_miss
from phd_jdtc_ros.core.gaussian.measurement.pair_association import most_probable
from phd_jdtc_ros.core.gaussian.measurement.pairs import PairLikelihoods
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.sensors.of_gaussians import polar
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import GATE_SIGMA
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections

RADAR = resolve({}).model.radars[0]
SCALE = np.array([80.0, 9.0, 120.0, 7.0, 0.002])
FAR = 15e3
MOST, LEAST_SHARE = 5, 1e-3
FIELD = {
    "radar.detection_probability": 0.9,
    "radar.min_range": 7e3,
    "radar.max_range": 20e3,
    "radar.clutter_max_range": 20e3,
    "radar.fov_deg": [-90.0, 80.0],
    "radar.blind_sectors_deg": [40.0, 42.0],
}
CONFIG = lone(FIELD)
(LIMITED,) = CONFIG.model.radars
NOTHING = View.of(LIMITED, Detections(np.zeros((0, 2)), None))
DYNAMICS = Dynamics(CONFIG.model)
# The position depends on the velocity.
ROOT = np.diag(STD)
ROOT[1, 0], ROOT[3, 2] = 20.0, -15.0
ROOT[4] = 0.0
LIMITS = {
    "largest range": (20e3, 0.5),
    "just within the largest range": (19_600.0, 0.5),
    "beyond the largest range": (20_250.0, 0.5),
    "least range": (7050.0, 0.5),
    "edge of the field": (12e3, np.radians(79.5)),
    "outside the field": (12e3, np.radians(-92.0)),
    "blind sector": (12e3, np.radians(40.5)),
}


def amplitudes_of_one(count):
    """Return amplitudes of detections that are as likely for the only class and cell."""
    return frozen(Amplitudes(np.zeros(count), np.ones((count, 1, 1))))


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("seed", range(4))
def test_likely_pairs_may_be_more_than_the_least_share_of_their_target(seed, count, monkeypatch):
    rng = np.random.default_rng(seed)
    monkeypatch.setattr(likely_pairs, "LEAST_SHARE", 0.3)
    config = lone()
    single = mixture_of(Dynamics(config.model), [(1.0, MEAN, STD)])
    row_label, rows = np.array([3, 3, 5, 9]), np.arange(4)
    mixture = Mixture(
        row_label,
        rng.uniform(0.1, 0.45, 4)[:, None, None],
        single.mean[0 * rows],
        single.covariance[0 * rows],
        single.snr[0 * rows],
    )
    row, column = map(np.ascontiguousarray, np.nonzero(rng.random((4, count)) < 0.9))
    weight = rng.exponential(1.0, len(row)) * 10.0 ** rng.uniform(-3, 0.5, len(row))
    detection_probability = 1.0 - rng.uniform(0.1, 0.9, (4, 1, 1))
    missed = mixture.weight * (1.0 - detection_probability)
    total = np.array([0.3, 1e-12, 2.0])[:count]
    log_likelihood = np.log(weight / mixture.sums.mass[row])
    no_amplitude, no_evidence = np.zeros(count), np.zeros(len(row))
    columns = log_likelihood[:, None], no_amplitude, no_evidence, np.log(total)[None]
    likelihoods = frozen(PairLikelihoods(row, column, *columns))
    found, _ = likely_pairs.select_likely(
        mixture, detection_probability, likelihoods, amplitudes_of_one(count)
    )

    scale = np.log(total)
    np.maximum.at(scale, column, log_likelihood)
    weight, total = weight * np.exp(-scale)[column], total * np.exp(-scale)
    odds = weight / np.maximum(total, LEAST_CLUTTER)[column]
    expected = []
    for pair in range(len(row)):
        own = row_label[row] == row_label[row[pair]]
        alone = 1.0 - mixture.weight[row_label == row_label[row[pair]]].sum()
        alone += missed[row_label == row_label[row[pair]]].sum()
        for z in range(count):
            here = column == z
            alone += odds[own & here].sum() / (1.0 + odds[~own & here].sum())
        if odds[pair] > 0.3 * max(alone, 1.0):
            expected.append(pair)
    np.testing.assert_array_equal(found, expected)


def a_mixture(rng, count=80):
    """Return hypotheses all around the radar; some have one motion mode, the first is near."""
    angle = rng.uniform(-np.pi, np.pi, (count, 1))
    mean = SCALE * rng.normal(size=(count, 2, 5))
    mean[..., 0] += RADAR.position[0] + FAR * np.cos(angle)
    mean[..., 2] += RADAR.position[1] + FAR * np.sin(angle)
    mean[0, :, [0, 2]] = np.array(RADAR.position)[:, None] + 30.0
    root = rng.normal(size=(count, 2, 5, 5)) * SCALE[:, None]
    weight = rng.random((count, 2, 2))
    weight[::3, 1] = 0.0
    covariance = root @ root.swapaxes(-1, -2)
    return Mixture(np.arange(count), weight, mean, covariance, np.ones((count, 2, 1)))


def by_brute_force(mixture, expected, detections):
    """Return (H, M, R) log likelihoods of the measurement, -inf outside of gates."""
    own = RADAR.noise_std_of(detections)
    measured, covariance = expected.measured[:, None], expected.covariance[:, None]
    if detections.time_s is not None:
        _, slope = RADAR.linearise(mixture.mean[..., [0, 2]])
        rate = (slope @ mixture.mean[..., [1, 3], None])[..., 0]
        measured = measured + rate[:, None] * detections.time_s[:, None, None]
    error = detections.measurement[:, None] - measured
    error[..., 1] = wrap_angle(error[..., 1])
    total = covariance + own[:, None, :, None] ** 2 * np.eye(2)
    square = np.einsum("hmri,hmrij,hmrj->hmr", error, np.linalg.inv(total), error)
    density = -0.5 * (square + np.log(np.linalg.det(total))) - np.log(2.0 * np.pi)
    near = (square <= GATE_SIGMA**2) & (mixture.sums.mode_weight > 0.0)[:, None]
    return np.where(near, density, -np.inf)


def gated(mixture, expected, detections):
    weight, report = mixture.sums.mode_weight, View.of(RADAR, detections)
    return RADAR.of_gaussians.gate_pairs(weight, mixture.mean, expected, report)


@pytest.mark.parametrize("timed", [False, True], ids=["at the stamp", "when passed"])
@pytest.mark.parametrize("own_noise", [False, True], ids=["one noise", "each its own"])
def test_gate_pairs_finds_the_pairs_of_a_brute_force_search(timed, own_noise):
    rng = np.random.default_rng(6)
    mixture = a_mixture(rng)
    true = mixture.mean[:, 0] + SCALE * rng.normal(size=(len(mixture), 5))
    true[0] = mixture.mean[0, 0]
    measurement = RADAR.measure(np.concatenate([true, true[::-1]]))
    measurement[:, 1] = wrap_angle(measurement[:, 1])
    detections = Detections(measurement, None)
    if own_noise:
        std = RADAR.noise_std * rng.uniform(0.5, 2.0, measurement.shape)
        detections = replace(detections, noise_std=std)
    if timed:
        detections = replace(detections, time_s=rng.uniform(-2.0, 2.0, len(measurement)))
    expected = RADAR.of_gaussians.expected(mixture.mean, mixture.covariance)
    row, column, log_likelihood = gated(mixture, expected, detections)
    right = by_brute_force(mixture, expected, detections)
    found = np.full_like(right, -np.inf)
    found[row, column] = log_likelihood
    assert len(row) == len(np.unique(row * len(measurement) + column)) > len(mixture)
    np.testing.assert_allclose(found[1:], right[1:], rtol=1e-9)
    # A Gaussian that surrounds the radar may be seen at any azimuth.
    inside = np.isfinite(right[0])
    np.testing.assert_allclose(found[0][inside], right[0][inside], rtol=1e-9)
    near = measurement[:, 0] < GATE_SIGMA * RADAR.range_std / 2.0
    assert near.any()
    assert np.isfinite(found[0][near][:, mixture.sums.mode_weight[0] > 0.0]).all()


@pytest.mark.parametrize("seed", range(5))
def test_existence_is_unchanged_by_pruning_and_bounds_hold(seed):
    rng = np.random.default_rng(seed)
    target = rng.integers(0, 6, 80)
    target[:6] = np.arange(6)
    mass = rng.exponential(1.0, 80) ** 6
    mass /= np.bincount(target, mass)[target]
    mass *= rng.uniform(0.1, 1.0, 6)[target]
    kept, factor = most_probable(MOST, LEAST_SHARE, target, mass)
    existence = np.bincount(target, mass)
    np.testing.assert_allclose(np.bincount(target[kept], mass[kept] * factor), existence)
    assert np.bincount(target[kept]).max() <= MOST
    assert (mass[kept] >= LEAST_SHARE * existence[target[kept]]).all()
    for one in range(6):
        own = kept[target[kept] == one]
        assert (np.diff(mass[own]) <= 0.0).all()
        dropped = np.setdiff1d(np.flatnonzero(target == one), own)
        assert mass[dropped].max(initial=0.0) <= mass[own].min()


@pytest.mark.parametrize("scale", [1.0, 1e-310])
def test_snr_after_a_detection_is_bayes_rule_however_improbable_the_class_is(scale):
    prior, likelihood = np.array([[[0.2, 0.5, 0.3]]]), np.array([[[1.0, 4.0, 2.0]]])
    one, first = np.ones((1, 1, 1)), np.zeros(1, dtype=np.int64)
    mixture = Mixture(first, one, np.zeros((1, 1, SIZE)), np.eye(SIZE)[None, None], prior)
    in_revolution = frozen(DetectionProbability(one, np.ones((1, 3)), np.ones((1, 1))))
    amplitudes = frozen(Amplitudes(np.zeros(1), scale * likelihood))
    found = snr_after(mixture.hypotheses, one, in_revolution, amplitudes, first, first, first)
    expected = prior * likelihood
    np.testing.assert_allclose(found, expected / expected.sum(), rtol=1e-10)


def target_at(place):
    """Return a target at a range and an azimuth, and what is expected of it."""
    mean = np.zeros(5)
    mean[[0, 2]] = LIMITED.to_world(np.array([place]))[0]
    mixture = mixture_of(DYNAMICS, [(0.9, mean, STD)])
    mixture = mixture.changed(covariance=(ROOT @ ROOT.T)[None, None])
    return mean, mixture, LIMITED.of_gaussians.expected(mixture.mean, mixture.covariance)


def missed_at(place):
    """Return the mean of a target, and its mean and covariance after a miss, or None."""
    mean, mixture, expected = target_at(place)
    probability = detection_probability(expected, mixture.snr, NOTHING, DYNAMICS).by_class
    return mean, after_miss(mixture, expected, LIMITED, probability)


@pytest.mark.parametrize("place", LIMITS.values(), ids=LIMITS)
def test_gaussian_after_a_miss_at_a_limit_has_the_moments_of_drawn_states(place):
    mean, (found, covariance) = missed_at(place)
    drawn = mean + np.random.default_rng(6).standard_normal((10**6, 5)) @ ROOT.T
    share = 1.0 - 0.9 * LIMITED.visibility.probability_in_view(LIMITED.measure(drawn))
    exact = share @ drawn / share.sum()
    apart = drawn - exact
    spread = (apart * share[:, None]).T @ apart / share.sum()
    std = np.maximum(np.sqrt(np.diag(ROOT @ ROOT.T)), 1e-9)
    np.testing.assert_allclose((found[0, 0, :5] - exact) / std, 0.0, atol=0.02)
    scale = std[:, None] * std
    np.testing.assert_allclose(covariance[0, 0, :5, :5] / scale, spread / scale, atol=0.03)


@pytest.mark.parametrize("place", [(15e3, 0.5), (24e3, 0.5), (15e3, np.radians(-120.0))])
def test_gaussians_away_from_all_limits_do_not_change(place):
    assert missed_at(place)[1] is None


def test_gaussians_beside_the_sensor_do_not_change(monkeypatch):
    monkeypatch.setattr(polar, "LARGEST_AZIMUTH_STD", 0.01)
    assert missed_at(LIMITS["least range"])[1] is None
