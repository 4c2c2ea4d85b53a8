"""The update of a Gaussian by a polar measurement against the exact posterior, by quadrature."""

import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.arrays import wrap_angle
from phd_jdtc_ros.core.gaussian.algebra import kalman

AT = [0, 2]  # x and y among the axes of a state
SCENES = 40


def quadrature(radar, centre, std, measured):
    """Return the exact posterior mean of a position whose prior has this deviation."""
    node = np.linspace(-6.0, 6.0, 401)
    x, y = np.meshgrid(centre[0] + std * node, centre[1] + std * node, indexing="ij")
    state = np.zeros((x.size, 5))
    state[:, AT] = np.column_stack([x.ravel(), y.ravel()])
    error = measured - radar.measure(state)
    error[:, 1] = wrap_angle(error[:, 1])
    square = ((error / radar.noise_std) ** 2).sum(axis=1)
    square += (((state[:, AT] - centre) / std) ** 2).sum(axis=1)
    weight = np.exp(-0.5 * (square - square.min()))
    return weight @ state[:, AT] / weight.sum()


def iterated(radar, centre, std, measured, iterations):
    mean, covariance = np.zeros((1, 5)), np.zeros((1, 5, 5))
    mean[0, AT] = centre
    covariance[0, AT, AT] = std**2
    found = kalman.iterated_update(
        *(mean, covariance, radar, measured[None], radar.noise_std[None]), iterations=iterations
    )
    return kalman.updated(mean, covariance, radar, found)[0][0, AT]


def with_sigma_points(radar, centre, std, measured):
    """Return the mean of an unscented Kalman filter with three sigmas to each side."""
    spread = np.sqrt(3.0) * std * np.vstack([np.zeros(2), np.eye(2), -np.eye(2)])
    share = np.array([1.0, 0.5, 0.5, 0.5, 0.5]) / 3.0
    state = np.zeros((5, 5))
    state[:, AT] = centre + spread
    seen = radar.measure(state)
    seen[:, 1] = seen[0, 1] + wrap_angle(seen[:, 1] - seen[0, 1])
    expected = share @ seen
    apart = seen - expected
    innovation = measured - expected
    innovation[1] = wrap_angle(innovation[1:])[0]
    total = (share[:, None] * apart).T @ apart + np.diag(radar.noise_std**2)
    return centre + (share[:, None] * spread).T @ apart @ np.linalg.solve(total, innovation)


@pytest.mark.parametrize(
    ("distance", "std", "most"),
    [(15e3, 200.0, 1.5), (5e3, 200.0, 6.0), (15e3, 1000.0, 7.0)],
    ids=["born at 15 km", "born at 5 km", "hardly known at 15 km"],
)
def test_iterations_are_nearer_to_the_posterior_than_one_step_and_than_sigma_points(
    distance, std, most
):
    # The default radars: 300 m and 1 degree.
    radar, rng = resolve({}).model.radars[1], np.random.default_rng(0)
    errors = []
    for _ in range(SCENES):
        truth = np.full(2, distance / np.sqrt(2.0))
        state = np.zeros((1, 5))
        state[0, AT] = truth
        centre = truth + std * rng.standard_normal(2)
        measured = radar.measure(state)[0] + radar.noise_std * rng.standard_normal(2)
        exact = quadrature(radar, centre, std, measured)
        means = [
            iterated(radar, centre, std, measured, kalman.ITERATIONS),
            iterated(radar, centre, std, measured, 1),
            with_sigma_points(radar, centre, std, measured),
        ]
        errors.append([np.hypot(*(mean - exact)) for mean in means])
    ours, one_step, sigma_points = np.sqrt(np.mean(np.square(errors), axis=0))
    print(f"iterated {ours:.1f} m, one step {one_step:.1f} m, sigma points {sigma_points:.1f} m")
    assert ours < most
    assert ours < 0.85 * min(one_step, sigma_points)
