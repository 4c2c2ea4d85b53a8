import itertools
from dataclasses import replace

import numpy as np
import pytest
from paper_room import particles, plain
from scenes import gaussian_cloud, no_detections
from scipy import sparse
from textbook import kalman_smoother

from phd_jdtc_ros.core.phd import kernel
from phd_jdtc_ros.core.phd.correction import correct
from phd_jdtc_ros.core.phd.kernel import Kernel
from phd_jdtc_ros.core.phd.prediction import predict
from phd_jdtc_ros.core.phd.resampling import resample
from phd_jdtc_ros.core.phd.smoothing import (
    backward_step,
    bernoulli_death_term,
    printed_death_term,
)
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections

DT = 6.0
DEATH_TERMS = {"bernoulli": bernoulli_death_term, "printed": printed_death_term}


def single_target(given):
    """Return a model of one target without births, spawning and clutter, and its budget."""
    config = plain({"spawn.rate": 0.0, "radar.clutter_rate": 0.0, **given})
    return replace(config.model, births=()), config.budget


def forward(start, model, budget, scans, rng):
    """Return the stored set after every scan; the first scan corrects `start` as it is."""
    stored = []
    for index, detections in enumerate(scans):
        predicted = predict(stored[-1], model, budget, DT, index, rng) if index else start
        updated = correct(predicted, View.of(model.radars[0], detections), model.modes)
        stored.append(resample(updated, model.modes, budget, rng))
    return stored


def step(phd, link, later_weight, death_term):
    # Only the weights of the later set matter.
    later = particles(np.zeros((len(later_weight), 5)), later_weight)
    return backward_step(phd, link, later, death_term)


def backward(stored, model, death_term):
    """Return the smoothed set of every scan, given all scans."""
    smoothed = [stored[-1]]
    for earlier, later in zip(stored[-2::-1], stored[::-1], strict=False):
        link = kernel.build(earlier, later, model, DT)
        smoothed.append(backward_step(earlier, link, smoothed[-1], death_term))
    return smoothed[::-1]


# --- The exact Bernoulli smoother ---------------------------------------------------------------


def bernoulli_paths(prior, motion, survival, likelihoods):
    """Return P(state at each scan | all), by enumerating every path of states and deaths.

    State index -1 means dead. `likelihoods[t][s]` is that of scan t's data given state s, the
    last entry that given death.
    """
    states, scans = len(prior), len(likelihoods)
    alive = [*range(states), -1]
    posterior = np.zeros((scans, states + 1))
    for path in itertools.product(alive, repeat=scans):
        probability = prior[path[0]] if path[0] >= 0 else 1.0 - prior.sum()
        for before, after in itertools.pairwise(path):
            if before < 0:
                probability *= float(after < 0)
            elif after < 0:
                probability *= 1.0 - survival[before]
            else:
                probability *= survival[before] * motion[before, after]
        for t, state in enumerate(path):
            probability *= likelihoods[t][state]
        for t, state in enumerate(path):
            posterior[t, state] += probability
    return posterior[:, :states] / posterior.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("survival", [[0.99, 0.99, 0.99], [0.9, 0.5, 0.97], [1.0, 1.0, 1.0]])
@pytest.mark.parametrize("death", [0.001, 0.5, 20.0])
def test_bernoulli_step_is_exact_for_a_component_that_alone_feeds_mu(survival, death):
    # A target of three states that may not survive, with a likelihood in every scan. The last
    # scans have the given likelihood of its absence.
    rng = np.random.default_rng(4)
    survival = np.array(survival)
    motion = rng.dirichlet(np.ones(3), size=3)
    prior = np.array([0.3, 0.2, 0.25])
    likelihoods = [np.append(rng.uniform(0.1, 1.0, 3), d) for d in (0.05, 0.2, death, death)]

    filtered, predicted = [], prior
    for likelihood in likelihoods:
        part = predicted * likelihood[:3]
        part = part / (part.sum() + (1.0 - predicted.sum()) * likelihood[3])
        filtered.append(part)
        predicted = (survival * part) @ motion

    smoothed = [filtered[-1]]
    for part in filtered[-2::-1]:
        moved = survival[:, None] * motion  # K, transposed: [from, to]
        link = Kernel(sparse.csr_array(moved / (part @ moved)), survival, 0)
        phd = particles(np.zeros((3, 5)), np.zeros(3), components=part[:, None])
        smoothed.append(step(phd, link, smoothed[-1], bernoulli_death_term).weight)
    expected = bernoulli_paths(prior, motion, survival, likelihoods)
    np.testing.assert_allclose(smoothed[::-1], expected, rtol=0.0, atol=1e-12)


# --- One backward step --------------------------------------------------------------------------

PARTS = np.array([[0.5, 0.0], [0.4, 0.1], [0.0, 0.0], [0.0, 0.6]])
FREE = np.array([0.01, 0.02, 0.3, 0.0])
SURVIVAL = np.array([0.99, 0.99, 0.9, 0.9])
RATIO = np.random.default_rng(0).uniform(0.0, 1.0, (4, 5))
LATER = np.array([0.1, 0.2, 0.05, 0.3, 0.15])


def one_step(death_term, survival=SURVIVAL, later=LATER, parts=PARTS):
    phd = particles(np.zeros((4, 5)), FREE, components=parts)
    link = Kernel(sparse.csr_array(RATIO), survival, 0)
    return phd, step(phd, link, later, death_term)


@pytest.mark.parametrize("term", list(DEATH_TERMS.values()), ids=list(DEATH_TERMS))
def test_backward_step_leaves_the_filtered_set_alone(term):
    phd, _ = one_step(term)
    np.testing.assert_array_equal(phd.components.toarray(), PARTS)
    np.testing.assert_array_equal(phd.poisson, FREE)


def test_bernoulli_term_gives_only_vanished_components_their_existence_back():
    # No target exists at t + 1, but the component was certain, so it did not survive.
    certain = PARTS / PARTS.sum(axis=0)
    _, smoothed = one_step(bernoulli_death_term, later=np.zeros(5), parts=certain)
    np.testing.assert_allclose(smoothed.components.toarray().sum(axis=0), [1.0, 1.0], rtol=1e-12)
    _, smoothed = one_step(bernoulli_death_term, later=LATER * 100.0)
    phd, _ = one_step(bernoulli_death_term)
    b = RATIO @ (LATER * 100.0)
    expected = phd.components.toarray() * b[:, None]
    np.testing.assert_allclose(smoothed.components.toarray(), expected, rtol=1e-12)
    filtered, smoothed = toy_masses(SNR_OF_P_D[0.98], [1] * 6, "bernoulli")
    # Only the Poisson mass (1 - p_D = 0.02) grows, by 1 - P_s = 0.01 of itself per lag.
    assert np.abs(np.array(smoothed) - filtered[-1]).max() < 5 * 0.02 * 0.01 * 1.2


@pytest.mark.parametrize("excess", [1.0, 1.0 + 1e-9, 1.05])
def test_bernoulli_term_is_finite_for_a_component_rounded_above_one(excess):
    parts = PARTS / PARTS.sum(axis=0) * excess
    for survival in (SURVIVAL, np.ones(4)):
        phd = particles(np.zeros((4, 5)), FREE, components=parts)
        mass, surviving = (phd.by_component(value) for value in (np.ones(4), survival))
        factor = bernoulli_death_term(mass, surviving, np.zeros(2))
        assert np.isfinite(factor).all()
        assert (factor >= 0.0).all()


# --- Small examples: a target that ends, one that exists -----------------------------------------


def toy_masses(snr_db, seen, death_term):
    """Return filtered and smoothed masses of one target, detected or not scan by scan."""
    band = [snr_db - 0.01, snr_db + 0.01]
    model, budget = single_target(
        {
            "target.snr_band_db": band,
            "particles": [400],
            "budget.least": 100,
        }
    )
    rng = np.random.default_rng(1)
    start = gaussian_cloud(rng, 1500, [8e3, 0.0, 6e3, 0.0, 0.0], [100.0, 3.0, 100.0, 3.0, 0.0])
    radar = model.radars[0]
    hit = Detections(radar.measure(np.array([[8e3, 0.0, 6e3, 0.0, 0.0]])), None)
    scans = [hit if detected else no_detections() for detected in seen]
    scans = [s if len(s) else Detections(np.zeros((0, 2)), None) for s in scans]
    stored = forward(particles(start, np.full(1500, 1.0 / 1500)), model, budget, scans, rng)
    smoothed = backward(stored, model, DEATH_TERMS[death_term])
    return [[phd.weight.sum() for phd in phds] for phds in (stored, smoothed)]


# A target of fixed SNR d is seen with p_FA^(1/(1+d)): 25.33 dB gives 0.98, 17.24 dB 0.88.
SNR_OF_P_D = {0.98: 25.33, 0.88: 17.24}


@pytest.mark.parametrize(("p_d", "bias"), [(0.98, 0.02), (0.88, 0.135)])
def test_bernoulli_term_keeps_the_existence_before_a_death(p_d, bias):
    # The mass of a PHD filter for one target is at most 1 + (1 - p_D)/p_D; smoothing may keep this
    # bias of the filter, but must neither increase it nor lose the target.
    filtered, smoothed = toy_masses(SNR_OF_P_D[p_d], [1, 1, 1, 0, 0, 0], "bernoulli")
    assert 1.0 < max(filtered) < 1.0 + 1.03 * bias
    for mass in smoothed[:2]:
        assert 1.0 + 0.7 * bias < mass < 1.0 + 1.03 * bias
    # At the target's last scan only the death term is left: (1 - P_s) a / (1 - P_s a), which is 0.9
    # for a component with a = 0.999 after resampling.
    assert 0.9 < smoothed[2] < 1.0 + bias
    assert max(smoothed[3:]) < 0.01


@pytest.mark.parametrize("p_d", [0.98, 0.88])
def test_printed_term_loses_a_target_that_was_certain_in_the_whole_window(p_d):
    _, smoothed = toy_masses(SNR_OF_P_D[p_d], [1, 1, 1, 0, 0, 0], "printed")
    assert max(smoothed[:3]) < 0.05


# --- One target that lives: the Rauch-Tung-Striebel smoother -----------------------------------


RTS_SEEDS = 10


@pytest.fixture(scope="module")
def rts_comparison():
    """Return particle and Kalman moments of one run, filtered and smoothed.

    Ranges to 30 m and azimuths to 28 m at 10 km: the arc's sagitta is 0.04 m, so the problem is
    linear for the purpose, and there is one association: no clutter, no births.
    """
    scans, density = 5, 9.0
    model, budget = single_target(
        {
            "radar.range_std": 30.0,
            "radar.azimuth_std_deg": 0.16,
            "cv.noise_density": density,
            "particles": [3000],
            "target.survival_probability": 1.0,
        }
    )
    radar = model.radars[0]
    rng = np.random.default_rng(11)
    truth = np.array([[8e3, 10.0, 6e3, -20.0, 0.0]])
    detections, points, noises = [], [], []
    for _ in range(scans):
        measurement = radar.measure(truth) + rng.standard_normal((1, 2)) * radar.noise_std
        detections.append(Detections(measurement, None))
        points.append(radar.to_world(measurement)[0])
        cos, sin = np.cos(measurement[0, 1]), np.sin(measurement[0, 1])
        turn = np.array([[cos, -sin], [sin, cos]])
        spread = np.array([radar.range_std, measurement[0, 0] * radar.azimuth_std]) ** 2
        noises.append(turn @ np.diag(spread) @ turn.T)
        truth = model.modes.motions[0].mean(truth, DT)

    prior_mean = np.array([8e3 + 15.0, 12.0, 6e3 - 20.0, -18.0])
    prior_std = np.array([40.0, 5.0, 40.0, 5.0])
    step = np.eye(4)
    step[0, 1] = step[2, 3] = DT
    process = model.modes.motions[0].noise_covariance(DT)
    kalman = kalman_smoother(prior_mean, np.diag(prior_std**2), points, noises, step, process)

    moments = np.zeros((RTS_SEEDS, 2, scans, 2, 4))
    for seed in range(RTS_SEEDS):
        rng = np.random.default_rng(seed)
        cloud = gaussian_cloud(rng, 3000, [*prior_mean, 0.0], [*prior_std, 0.0])
        start = particles(cloud, np.full(3000, 1.0 / 3000))
        stored = forward(start, model, budget, detections, rng)
        smoothed = backward(stored, model, bernoulli_death_term)
        for kind, phds in enumerate((stored, smoothed)):
            for t, phd in enumerate(phds):
                weight = phd.weight / phd.weight.sum()
                mean = weight @ phd.state[:, :4]
                moments[seed, kind, t] = mean, weight @ (phd.state[:, :4] - mean) ** 2
    return moments, kalman


@pytest.mark.parametrize("kind", [0, 1], ids=["filtered", "smoothed"])
def test_smoothed_means_are_those_of_rauch_tung_striebel(rts_comparison, kind):
    moments, kalman = rts_comparison
    means = moments[:, kind, :, 0]
    expected = np.array([mean for mean, _ in kalman[kind]])
    # The Monte Carlo error is measured over independent runs: standard error of their mean, with
    # five of them because ten runs estimate it to a quarter only.
    error = means.std(axis=0, ddof=1) / np.sqrt(RTS_SEEDS)
    assert (np.abs(means.mean(axis=0) - expected) < 5.0 * error).all()
    # The test has power: that error is small against the effect of smoothing.
    std = np.array([np.sqrt(np.diag(covariance)) for _, covariance in kalman[kind]])
    assert (5.0 * error < 0.15 * std).all()


def test_smoothed_covariances_are_those_of_rauch_tung_striebel(rts_comparison):
    moments, (filtered, smoothed) = rts_comparison
    variances = moments[:, :, :, 1].mean(axis=0)
    for found, exact in zip(variances, (filtered, smoothed), strict=True):
        expected = np.array([np.diag(covariance) for _, covariance in exact])
        # A variance from n effective samples is good to sqrt(2/n); the smoothed sets of ten runs
        # hold more than 3000, and the fewer of one run bias its variance by 1/n.
        np.testing.assert_allclose(found, expected, rtol=0.06)
    # Smoothing reduces the variance by the ratio of the exact smoother.
    promised = np.diag(smoothed[0][1]) / np.diag(filtered[0][1])
    assert promised.max() < 0.8
    assert (variances[1, 0] < 0.9 * variances[0, 0]).all()
