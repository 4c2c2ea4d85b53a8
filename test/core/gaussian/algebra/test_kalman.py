import numpy as np
import pytest
import textbook
from lone import MEAN, SIZE, STD, lone

from phd_jdtc_ros.core.compilation import of_size
from phd_jdtc_ros.core.gaussian.algebra import blocks, kalman
from phd_jdtc_ros.core.gaussian.algebra.curvature import move, new_moved
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import Measured, WeightedGaussians
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.core.targets.motion import ConstantVelocity, CoordinatedTurn

(RADAR,) = lone().model.radars
SCALE = np.array([80.0, 9.0, 120.0, 7.0, 0.002, 60.0, 3.0])
IN_SPACE = {"space": SPATIAL, "vertical_noise_density": 2.0}
MOTIONS = (
    ConstantVelocity(1.0, **IN_SPACE),
    CoordinatedTurn(1.0, 1e-4, **IN_SPACE),
    CoordinatedTurn(1.0, 1e-4, 12.0, **IN_SPACE),
)
CURVED_MEAN = np.array([4e3, 60.0, -2e3, 20.0, 0.02, 900.0, -4.0])
ROOT = np.diag([300.0, 12.0, 250.0, 9.0, 0.0, 80.0, 3.0])
ROOT[4] = [0.01, 0.03, -0.01, 0.02, 0.05, 0.0, 0.0]
ROOT[5] = [20.0, -10.0, 5.0, 30.0, 40.0, 80.0, 0.0]
ROOT[6] = [1.0, 0.5, -0.3, 0.2, -2.0, 0.4, 3.0]
COVARIANCE = ROOT @ ROOT.T
DT = 6.0


def priors(rng, count):
    mean = MEAN + rng.normal(0.0, 2.0, (count, SIZE)) * STD
    factor = rng.normal(0.0, 1.0, (count, SIZE, SIZE)) * STD[:, None]
    return mean, factor @ factor.swapaxes(1, 2)


def updated(mean, covariance, measurement, time_s=None, **more):
    noise = np.broadcast_to(RADAR.noise_std, measurement.shape).copy()
    gaussians, seen = (
        WeightedGaussians.of(mean, covariance),
        Measured(measurement, noise, None, time_s),
    )
    found = kalman.innovations(gaussians, RADAR, seen, **more)
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
    states = mean + rng.standard_normal((400_000, SIZE)) * 0.2 * STD
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


def covariance(rng, size, absent=()):
    """Return a random covariance of a state, zero on some axes."""
    root = rng.normal(size=(size, size)) * SCALE[:size, None]
    root[list(absent)] = 0.0
    return root @ root.T


@pytest.fixture(params=[SIZE, len(SPATIAL)], ids=["plane", "space"])
def size(request):
    return request.param


@pytest.mark.parametrize("absent", [(), (4,), (1, 3)], ids=["every axis", "no turn", "no speed"])
def test_factors_are_those_of_the_inverse_on_the_axes_with_variance(absent, size):
    rng = np.random.default_rng(0)
    matrix, factor = covariance(rng, size, absent), np.empty((size, size))
    used = np.delete(np.arange(size), absent)
    inverse = np.zeros((size, size))
    inverse[np.ix_(used, used)] = np.linalg.inv(matrix[np.ix_(used, used)])
    of_size(blocks.factorise, size)(matrix, factor)
    one, other = SCALE[:size] * rng.normal(size=(2, size))
    solved = np.array(of_size(blocks.solve, size)(factor, one))
    np.testing.assert_allclose(solved[:size], inverse @ one, rtol=1e-8)
    np.testing.assert_array_equal(solved[size:], 0.0)
    square = of_size(blocks.square_distance, size)(factor, one, other, np.empty(size))
    assert square == pytest.approx((one - other) @ inverse @ (one - other), rel=1e-8)
    sign, log_determinant = np.linalg.slogdet(matrix[np.ix_(used, used)])
    assert sign > 0.0
    found = of_size(blocks.log_determinant, size)(factor)
    assert found == pytest.approx(-log_determinant, rel=1e-9)


def test_axis_that_others_determine_is_left_out(size):
    # As x and vx are one, the inverse on the axes that the covariance spans leaves out the second.
    matrix, factor, vector = np.diag(SCALE[:size] ** 2), np.empty((size, size)), np.ones(size)
    matrix[0, 1] = matrix[1, 0] = SCALE[0] * SCALE[1]
    of_size(blocks.factorise, size)(matrix, factor)
    assert factor[1, 1] == 0.0
    vector[1] = 5.0
    solved = of_size(blocks.solve, size)(factor, vector)[:size]
    vector[1] = 0.0
    np.testing.assert_allclose(solved, vector / SCALE[:size] ** 2)


def moved_by(covariance, motion):
    """Return the mean, the covariance with the earlier state, and the covariance after a motion."""
    size = len(covariance)
    moved = of_size(new_moved, size)()
    transition = MOTIONS[motion].jacobian(np.zeros((1, len(SPATIAL))), DT)[0, :size, :size].copy()
    arc = MOTIONS[motion].arc(DT)
    of_size(move, size)(CURVED_MEAN[:size], covariance, transition, motion > 0, arc, moved)
    return moved.mean, moved.cross, moved.covariance


@pytest.mark.parametrize("motion", [1, 2])
def test_moved_gaussian_has_the_moments_of_drawn_states(motion, size):
    mean, cross, covariance = moved_by(COVARIANCE[:size, :size].copy(), motion)
    drawn = CURVED_MEAN + np.random.default_rng(4).standard_normal((10**6, len(SPATIAL))) @ ROOT.T
    later = MOTIONS[motion].mean(drawn, DT)[:, :size]
    std, std_later = np.sqrt(np.diag(COVARIANCE))[:size], np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((mean - later.mean(axis=0)) / std_later, 0.0, atol=4e-3)
    exact = np.cov(later.T) / (std_later[:, None] * std_later)
    np.testing.assert_allclose(covariance / (std_later[:, None] * std_later), exact, atol=6e-3)
    between = np.cov(drawn[:, :size].T, later.T)[:size, size:] / (std[:, None] * std_later)
    np.testing.assert_allclose(cross / (std[:, None] * std_later), between, atol=6e-3)
    # The linearisation at the mean differs from the drawn velocities.
    at_mean = MOTIONS[motion].jacobian(CURVED_MEAN[None], DT)[0]
    linear = np.diag(at_mean @ COVARIANCE @ at_mean.T)
    assert abs(linear[3] / later[:, 3].var() - 1.0) > 0.05


@pytest.mark.parametrize("motion", [0, 1, 2])
def test_motion_of_a_known_turn_rate_is_linear(motion, size):
    certain = COVARIANCE[:size, :size].copy()
    certain[4] = certain[:, 4] = 0.0
    mean, cross, covariance = moved_by(certain, motion)
    later = MOTIONS[motion].mean(CURVED_MEAN[None], DT)[0]
    np.testing.assert_allclose(mean, later[:size], atol=1e-9)
    exact = MOTIONS[motion].jacobian(CURVED_MEAN[None], DT)[0, :size, :size]
    np.testing.assert_allclose(cross, certain @ exact.T, atol=1e-6)
    np.testing.assert_allclose(covariance, exact @ certain @ exact.T, atol=1e-6)
