import numpy as np
import pytest
import textbook
from lone import MEAN, STD, lone

from phd_jdtc_ros.core.gaussian.algebra import kalman

(RADAR,) = lone().model.radars


def priors(rng, count):
    mean = MEAN + rng.normal(0.0, 2.0, (count, 5)) * STD
    factor = rng.normal(0.0, 1.0, (count, 5, 5)) * STD[:, None]
    return mean, factor @ factor.swapaxes(1, 2)


def updated(mean, covariance, measurement, time_s=None, **more):
    noise = np.broadcast_to(RADAR.noise_std, measurement.shape).copy()
    found = kalman.innovations(mean, covariance, RADAR, measurement, noise, time_s, **more)
    return found, *kalman.update(mean, covariance, RADAR, found, time_s)


@pytest.mark.parametrize("timed", [False, True])
@pytest.mark.parametrize("iterations", [1, 5])
def test_updates_of_many_are_those_of_each_alone(timed, iterations):
    rng = np.random.default_rng(0)
    mean, covariance = priors(rng, 9)
    measurement = RADAR.measure(mean) + rng.normal(0.0, 1.0, (9, 2)) * RADAR.noise_std
    time_s = rng.uniform(-2.0, 2.0, 9) if timed else None
    found, later, spread = updated(
        mean, covariance, measurement, time_s, iterations=iterations, converged=0.0
    )
    for row in range(9):
        right, log_likelihood = textbook.update(
            textbook.Normal(mean[row], covariance[row]),
            RADAR,
            measurement[row],
            0.0 if time_s is None else time_s[row],
            iterations=iterations,
        )
        np.testing.assert_allclose(later[row], right.mean, rtol=1e-8, atol=1e-8)
        scale = np.sqrt(np.diag(right.covariance))
        np.testing.assert_allclose(
            spread[row] / scale / scale[:, None],
            right.covariance / scale / scale[:, None],
            atol=1e-7,
        )
        assert found.log_likelihood[row] == pytest.approx(log_likelihood, abs=1e-7)


def test_likelihood_of_a_narrow_prior_is_its_integral():
    # Narrow, so that the linearised measurement is nearly the true one.
    mean, covariance = MEAN[None], np.diag((0.2 * STD) ** 2)[None]
    measurement = RADAR.measure(mean) + np.array([200.0, 0.012])
    found, _, _ = updated(mean, covariance, measurement)
    rng = np.random.default_rng(1)
    states = mean + rng.standard_normal((400_000, 5)) * 0.2 * STD
    error = (measurement - RADAR.measure(states)) / RADAR.noise_std
    density = np.exp(-0.5 * (error**2).sum(axis=1)) / (2.0 * np.pi * RADAR.noise_std.prod())
    assert np.exp(found.log_likelihood[0]) == pytest.approx(density.mean(), rel=0.01)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_update_wraps_the_azimuth(side):
    cos, sin = np.cos(RADAR.yaw), np.sin(RADAR.yaw)
    behind = np.array(RADAR.position) - 8e3 * np.array([cos, sin])
    mean = np.array([[behind[0], 0.0, behind[1], 0.0, 0.0]])
    covariance = np.diag(STD**2)[None]
    measurement = np.array([[8e3, side * (np.pi - 0.004)]])
    _, later, _ = updated(mean, covariance, measurement)
    assert np.hypot(*(later[0, [0, 2]] - behind)) < 40.0


def test_floored_leaves_covariances_as_they_are_and_raises_others():
    rng = np.random.default_rng(3)
    _, sound = priors(rng, 3)
    sound[2, 4] = sound[2, :, 4] = 0.0
    same, count = kalman.floor_eigenvalues(sound)
    assert count == 0
    np.testing.assert_array_equal(same, sound)
    wrong = sound.copy()
    wrong[1] = np.diag([1e4, 900.0, 1e4, 900.0, 1e-6])
    wrong[1, 0, 2] = wrong[1, 2, 0] = 1.5e4
    found, count = kalman.floor_eigenvalues(wrong)
    assert count == 1
    np.testing.assert_array_equal(found[[0, 2]], sound[[0, 2]])
    assert np.linalg.eigvalsh(found[1]).min() > 0.0
    assert found[1, 0, 0] >= 1e4


def test_floored_eigenvalues_change_no_other_covariance_of_the_batch():
    nearly_singular = np.diag([1e4, 900.0, 1e4, 900.0, 1e-6])
    nearly_singular[0, 2] = nearly_singular[2, 0] = 1e4 * (1.0 - 1e-12)
    wrong = nearly_singular.copy()
    wrong[0, 2] = wrong[2, 0] = 1.5e4
    found, count = kalman.floor_eigenvalues(np.stack([nearly_singular, wrong]))
    assert count == 1
    np.testing.assert_array_equal(found[0], nearly_singular)


def test_pairs_of_gaussians_and_measurements_are_those_of_each_alone():
    rng = np.random.default_rng(5)
    mean, covariance = priors(rng, 3)
    measurement = RADAR.measure(mean[:2]) + rng.normal(0.0, 1.0, (2, 2)) * RADAR.noise_std
    gaussian, column = np.array([2, -1, 0, 2]), np.array([1, 0, 0, 0])
    paired = (gaussian, column)
    found = kalman.innovations(
        mean, covariance, RADAR, measurement, RADAR.noise_std, None, pairs=paired
    )
    some = gaussian >= 0
    noise = np.tile(RADAR.noise_std, (some.sum(), 1))
    rows = gaussian[some]
    alone = kalman.innovations(
        mean[rows], covariance[rows], RADAR, measurement[column[some]], noise
    )
    for part, expected in zip(found, alone, strict=True):
        np.testing.assert_array_equal(part[some], expected)
    assert found.log_likelihood[1] == -np.inf
    rows = np.array([0, 2, 2])
    later = kalman.update(mean, covariance, RADAR, found, None, (rows, np.array([1, -1, 3])))
    np.testing.assert_array_equal(later[0][:2], mean[rows[:2]])
    np.testing.assert_array_equal(later[1][:2], covariance[rows[:2]])
    last = kalman.Innovation(*(part[2:] for part in alone))
    right = kalman.update(mean[rows[2:]], covariance[rows[2:]], RADAR, last)
    for part, expected in zip(later, right, strict=True):
        np.testing.assert_array_equal(part[2:], expected)
