import itertools
from dataclasses import replace

import numpy as np
import pytest
from scenes import gaussian_cloud, intensity, no_detections, plain, predict
from scipy import sparse

from phd_jdtc_ros.configuration.engines import particle_filter
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.smc.kernel import backward_kernel
from phd_jdtc_ros.core.smc.kernel.backward_kernel import Transition
from phd_jdtc_ros.core.smc.resampling import resample
from phd_jdtc_ros.core.smc.smoother import (
    DEATH_TERMS,
    backward_pass,
    backward_step,
    bernoulli_death_term,
    paper_death_term,
)
from phd_jdtc_ros.core.smc.update import ParticleSteps
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.core.window.entries import Entry, Source
from phd_jdtc_ros.core.window.update import update

DT = 6.0


def single_target_model(given):
    """Return a plain model of one target without births, spawning and clutter."""
    config = plain({"spawn.rate": 0.0, "radar.clutter_rate": 0.0, **given})
    method = particle_filter(config)
    return replace(config.model, births=()), method


def forward(start, model, method, scans, rng):
    """Return the stored set after every scan; the first scan updates `start` as it is."""
    stored = []
    for index, detections in enumerate(scans):
        predicted = start
        if index:
            predicted = predict(stored[-1], model, method.corrector, method.budget, DT, index, rng)
        report, steps = (
            Report(model.radars[0], detections),
            ParticleSteps(model, method.corrector, rng),
        )
        updated = update(predicted, report, steps, DT).rows
        stored.append(resample(updated, model.modes, method.budget, rng))
    return stored


def step(particles, link, later_weight, death_term):
    return backward_step(particles, link.survival, link.ratio @ later_weight, death_term)


def backward(stored, model, method, death_term):
    """Return the smoothed set of every scan, given all scans."""
    smoothed = [stored[-1]]
    for earlier, later in zip(stored[-2::-1], stored[::-1], strict=False):
        link = backward_kernel.build(earlier, later, model, method.corrector, DT)
        smoothed.append(step(earlier, link, smoothed[-1].weight, death_term))
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
        kernel = survival[:, None] * motion  # K, transposed: [from, to]
        link = Transition(sparse.csr_array(kernel / (part @ kernel)), survival, 0)
        phd = intensity(np.zeros((3, 5)), np.zeros(3), components=part[:, None])
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
    phd = intensity(np.zeros((4, 5)), FREE, components=parts)
    link = Transition(sparse.csr_array(RATIO), survival, 0)
    return phd, step(phd, link, later, death_term)


def test_backward_step_with_the_paper_term_is_the_printed_equation():
    phd, smoothed = one_step(paper_death_term)
    expected = phd.weight * (RATIO @ LATER + 1.0 - SURVIVAL)
    np.testing.assert_allclose(smoothed.weight, expected, rtol=1e-14)


def test_backward_step_with_the_bernoulli_term_scales_each_component_death():
    _, smoothed = one_step(bernoulli_death_term)
    b = RATIO @ LATER
    components = np.zeros_like(PARTS)
    for j in range(2):
        alive = min(sum(PARTS[s, j] * b[s] for s in range(4)), 1.0)
        phi = (1.0 - alive) / (1.0 - sum(SURVIVAL[s] * PARTS[s, j] for s in range(4)))
        for s in range(4):
            components[s, j] = PARTS[s, j] * (b[s] + (1.0 - SURVIVAL[s]) * phi)
    np.testing.assert_allclose(smoothed.components.toarray(), components, rtol=1e-13)
    np.testing.assert_allclose(smoothed.poisson, FREE * (b + 1.0 - SURVIVAL), rtol=1e-13)


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
        phd = intensity(np.zeros((4, 5)), FREE, components=parts)
        factor = bernoulli_death_term(phd, survival, np.zeros(4))
        assert np.isfinite(factor).all()
        assert (factor >= 0.0).all()


# --- Small examples: a target that ends, one that exists -----------------------------------------


def toy_masses(snr_db, seen, death_term, engine="phd"):
    """Return filtered and smoothed masses of one target, detected or not scan by scan."""
    band = [snr_db - 0.01, snr_db + 0.01]
    model, method = single_target_model(
        {
            "target.snr_band_db": band,
            "particles_per_target": 400,
            "budget.least": 100,
            "engine": engine,
        }
    )
    rng = np.random.default_rng(1)
    start = gaussian_cloud(rng, 1500, [8e3, 0.0, 6e3, 0.0, 0.0], [100.0, 3.0, 100.0, 3.0, 0.0])
    radar = model.radars[0]
    hit = Detections(radar.measure(np.array([[8e3, 0.0, 6e3, 0.0, 0.0]])), None)
    scans = [hit if detected else no_detections() for detected in seen]
    scans = [s if len(s) else Detections(np.zeros((0, 2)), None) for s in scans]
    stored = forward(intensity(start, np.full(1500, 1.0 / 1500)), model, method, scans, rng)
    smoothed = backward(stored, model, method, DEATH_TERMS[death_term])
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
def test_bernoulli_corrector_and_term_have_no_bias_before_a_death(p_d):
    filtered, smoothed = toy_masses(SNR_OF_P_D[p_d], [1, 1, 1, 0, 0, 0], "bernoulli", "particles")
    np.testing.assert_allclose(filtered[:3], 1.0, atol=1e-6)
    # Bayes' rule for the existence of a target that was certain and is missed.
    alive = [1.0]
    for _ in range(3):
        predicted = 0.99 * alive[-1]
        alive.append(predicted * (1.0 - p_d) / (1.0 - predicted * p_d))
    np.testing.assert_allclose(filtered[3:], alive[1:], rtol=0.1, atol=1e-3)
    np.testing.assert_allclose(smoothed[:3], 1.0, atol=1e-3)
    assert all(np.diff(smoothed[2:]) < 0.0)


# --- One target that lives: the Rauch-Tung-Striebel smoother -----------------------------------


def kalman_smoother(mean, covariance, points, noises, transition_matrix, process):
    """Return filtered and smoothed means and covariances of a linear Gaussian model."""
    select = np.eye(4)[[0, 2]]
    filtered, predicted = [], []
    for index, (point, noise) in enumerate(zip(points, noises, strict=True)):
        if index:
            mean = transition_matrix @ mean
            covariance = transition_matrix @ covariance @ transition_matrix.T + process
        predicted.append((mean, covariance))
        gain = covariance @ select.T @ np.linalg.inv(select @ covariance @ select.T + noise)
        mean = mean + gain @ (point - select @ mean)
        covariance = covariance - gain @ select @ covariance
        filtered.append((mean, covariance))
    smoothed = [filtered[-1]]
    for index in range(len(points) - 2, -1, -1):
        mean, covariance = filtered[index]
        ahead_mean, ahead_covariance = predicted[index + 1]
        gain = covariance @ transition_matrix.T @ np.linalg.inv(ahead_covariance)
        mean = mean + gain @ (smoothed[-1][0] - ahead_mean)
        covariance = covariance + gain @ (smoothed[-1][1] - ahead_covariance) @ gain.T
        smoothed.append((mean, covariance))
    return filtered, smoothed[::-1]


RTS_SEEDS = 10


@pytest.fixture(scope="module")
def rts_comparison():
    """Return particle and Kalman moments of one run, filtered and smoothed.

    Ranges to 30 m and azimuths to 28 m at 10 km: the arc's sagitta is 0.04 m, so the problem is
    linear for the purpose, and there is one association: no clutter, no births.
    """
    scans, density = 5, 9.0
    model, method = single_target_model(
        {
            "radar.range_std": 30.0,
            "radar.azimuth_std_deg": 0.16,
            "cv.noise_density": density,
            "particles_per_target": 3000,
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
        start = intensity(cloud, np.full(3000, 1.0 / 3000))
        stored = forward(start, model, method, detections, rng)
        smoothed = backward(stored, model, method, bernoulli_death_term)
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


# --- The pass over a window -----------------------------------------------------------------------


def random_set(rng, count, components=2):
    """Return a set of random weights, each in one of its components."""
    weight = rng.uniform(0.05, 0.2, count)
    parts = np.zeros((count, components))
    parts[np.arange(count), np.arange(count) % components] = weight
    return intensity(rng.normal(size=(count, 5)), np.zeros(count), components=parts)


def random_link(rng, earlier, later):
    ratio = sparse.csr_array(rng.uniform(0.0, 0.3, (earlier, later)))
    return Transition(ratio, rng.uniform(0.8, 1.0, earlier), 0)


def test_backward_pass_is_a_step_from_each_set_to_the_one_before():
    rng = np.random.default_rng(0)
    sets = [random_set(rng, count) for count in (4, 3, 5)]
    links = [random_link(rng, 4, 3), random_link(rng, 3, 5)]
    window = [
        Entry(1, sets[0]),
        Entry(2, sets[1], (Source(1, None, 4),), links[0]),
        Entry(3, sets[2], (Source(2, None, 3),), links[1]),
    ]
    found = list(backward_pass(window, bernoulli_death_term))
    middle = step(sets[1], links[1], sets[2].weight, bernoulli_death_term)
    first = step(sets[0], links[0], middle.weight, bernoulli_death_term)
    for one, expected in zip(found, (sets[2], middle, first), strict=True):
        np.testing.assert_allclose(one.weight, expected.weight, rtol=1e-12)
    assert not np.allclose(found[2].weight, sets[0].weight, rtol=1e-3)


def test_backward_pass_messages_rows_of_several_sets_but_not_those_without_a_continuation():
    rng = np.random.default_rng(1)
    first, second, third = (random_set(rng, count, count) for count in (4, 3, 5))
    link = random_link(rng, 3, 5)  # of rows 1 and 3 of the first set and row 2 of the second
    window = [
        Entry(1, first),
        Entry(2, second),
        Entry(3, third, (Source(1, np.array([1, 3]), 2), Source(2, np.array([2]), 1)), link),
    ]
    later, *earlier = backward_pass(window, paper_death_term)
    np.testing.assert_array_equal(later.weight, third.weight)
    factor = link.ratio @ third.weight + 1.0 - link.survival
    expected = [second.weight * [1.0, 1.0, factor[2]], first.weight * [1, factor[0], 1, factor[1]]]
    for one, weight in zip(earlier, expected, strict=True):
        np.testing.assert_allclose(one.weight, weight, rtol=1e-12)
