"""The filters against dense Gaussians."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.reports.filters import Link, State, link_back, observe, predict

NOISE = 0.5


def _motion(dt, size):
    motion, noise = np.eye(size), np.zeros((size, size))
    for axis in (0, 1):
        motion[axis, axis + 2] = dt
        block = np.ix_([axis, axis + 2], [axis, axis + 2])
        noise[block] = NOISE * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return motion, noise


def _state(rng, size):
    root = rng.normal(size=(size, size))
    return State(rng.normal(size=size) * 10.0, root @ root.T + np.eye(size))


def _copy(state):
    return State(*(column.copy() for column in state))


def test_predict_and_observe_equal_the_textbook():
    rng = np.random.default_rng(1)
    state = _state(rng, 6)
    motion, noise = _motion(3.0, 6)
    mean, covariance = motion @ state.mean, motion @ state.covariance @ motion.T + noise
    predict(state, 3.0, NOISE)
    np.testing.assert_allclose(state.mean, mean)
    np.testing.assert_allclose(state.covariance, covariance)
    matrix, measured, spread = rng.normal(size=(4, 6)), rng.normal(size=4), 2.0 * np.eye(4)
    total = matrix @ covariance @ matrix.T + spread
    error = measured - matrix @ mean
    gain = covariance @ matrix.T @ np.linalg.inv(total)
    log_likelihood, square = observe(state, measured.copy(), matrix.copy(), spread.copy(), 4)
    np.testing.assert_allclose(square, error @ np.linalg.solve(total, error))
    np.testing.assert_allclose(
        log_likelihood, -0.5 * (square + np.linalg.slogdet(2.0 * np.pi * total)[1])
    )
    np.testing.assert_allclose(state.mean, mean + gain @ error)
    np.testing.assert_allclose(state.covariance, covariance - gain @ total @ gain.T, atol=1e-9)


def test_links_over_several_predictions_smooth_as_one_joint_gaussian():
    rng, size, steps = np.random.default_rng(2), 6, (1.0, 0.4, 2.5)
    state = _state(rng, size)
    first = _copy(state)
    link = Link(np.zeros(size), np.eye(size), np.zeros((size, size)))
    # The joint Gaussian of the states at all times, of which those after each step are observed.
    mean, joint = first.mean.copy(), first.covariance.copy()
    matrix, spread = np.eye(size)[:2].copy(), 4.0 * np.eye(2)
    for dt in steps:
        before = _copy(state)
        predict(state, dt, NOISE)
        link_back(before, _copy(state), dt, link)
        measured = rng.normal(size=2) * 10.0
        observe(state, measured.copy(), matrix.copy(), spread.copy(), 2)
        motion, noise = _motion(dt, size)
        last, cross = slice(len(mean) - size, len(mean)), joint[:, len(mean) - size :]
        mean = np.concatenate([mean, motion @ mean[last]])
        joint = np.block(
            [
                [joint, cross @ motion.T],
                [motion @ cross.T, motion @ joint[last, last] @ motion.T + noise],
            ]
        )
        seen = np.zeros((2, len(mean)))
        seen[:, len(mean) - size : len(mean) - size + 2] = np.eye(2)
        gain = joint @ seen.T @ np.linalg.inv(seen @ joint @ seen.T + spread)
        mean = mean + gain @ (measured - seen @ mean)
        joint = joint - gain @ seen @ joint
    smoothed = link.shift + link.gain @ state.mean
    covariance = link.rest + link.gain @ state.covariance @ link.gain.T
    np.testing.assert_allclose(smoothed, mean[:size], atol=1e-7)
    np.testing.assert_allclose(covariance, joint[:size, :size], atol=1e-7)
