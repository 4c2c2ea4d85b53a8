"""The filter's equations against those of all plots, states and errors at once."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from phd_jdtc_ros.calibration.registration.common import Sequences
from phd_jdtc_ros.calibration.registration.filtering import (
    ANY_SPEED,
    ANYWHERE,
    KINDS,
    UNITS,
    Trajectories,
    filter_targets,
    smooth_targets,
)

DENSITY, STEPS, RADARS = 2.0, 12, 2
STD = np.array([[40.0, 1e-3], [70.0, 2e-3]])
PLACES = np.array([[0.0, 0.0], [30e3, -5e3]])


@pytest.fixture(scope="module")
def rows():
    """Return the plots of one target, of two radars in turn, with irregular times."""
    rng = np.random.default_rng(5)
    time_s = np.cumsum(rng.uniform(0.5, 3.0, STEPS))
    radar = np.arange(STEPS) % RADARS
    position = np.array([8e3, 12e3]) + time_s[:, None] * [150.0, -90.0]
    line = position - PLACES[radar]
    measured = np.stack([np.hypot(*line.T), np.arctan2(line[:, 1], line[:, 0])], axis=1)
    measured += STD[radar] * rng.standard_normal((STEPS, 2))
    pose = np.column_stack([PLACES[radar], np.zeros(STEPS)])
    return Sequences(
        np.ones((STEPS, 1), dtype=bool),
        time_s[:, None],
        measured[:, None],
        pose[:, None],
        radar[:, None],
        np.arange(STEPS)[:, None],
        position[:, None],
        STD[radar][:, None],
    )


@pytest.fixture(scope="module")
def course(rows):
    return Trajectories(rows.position, np.broadcast_to([150.0, -90.0], rows.position.shape))


def dense(rows, course):
    """Return the covariance of all plots, their derivatives by the errors, and their residuals."""
    time_s = rows.time_s[:, 0]
    step = np.subtract.outer(time_s, time_s)
    prior = np.diag([ANYWHERE**2] * 2 + [ANY_SPEED**2] * 2)
    states = np.zeros((STEPS, 4, STEPS, 4))
    for i in range(STEPS):
        for j in range(STEPS):
            first, last = sorted((i, j))
            since = time_s[first] - time_s[0]
            noise = np.zeros((4, 4))
            noise[:2, :2] = np.eye(2) * DENSITY * since**3 / 3
            noise[:2, 2:] = noise[2:, :2] = np.eye(2) * DENSITY * since**2 / 2
            noise[2:, 2:] = np.eye(2) * DENSITY * since

            def moved(dt):
                matrix = np.eye(4)
                matrix[:2, 2:] = np.eye(2) * dt
                return matrix

            own = moved(since) @ prior @ moved(since).T + noise
            ahead = moved(time_s[last] - time_s[first]) @ own
            states[i, :, j] = ahead if i >= j else ahead.T
    assert_allclose(step, -step.T)
    slope, seen = np.zeros((2 * STEPS, 4 * STEPS)), np.zeros((2 * STEPS, RADARS * len(KINDS)))
    residual = np.zeros(2 * STEPS)
    for k in range(STEPS):
        east, north = course.position[k, 0] - rows.pose[k, 0, :2]
        distance = np.hypot(east, north)
        own = np.array([[east, north], [-north / distance, east / distance]]) / distance
        slope[2 * k : 2 * k + 2, 4 * k : 4 * k + 2] = own
        columns = np.array([[1, distance, 0, 0], [0, 0, 1, 0]], dtype=float)
        columns[:, 3] = -own @ course.velocity[k, 0]
        at = len(KINDS) * rows.radar[k, 0]
        seen[2 * k : 2 * k + 2, at : at + len(KINDS)] = columns * UNITS
        residual[2 * k : 2 * k + 2] = rows.measurement[k, 0] - [distance, np.arctan2(north, east)]
    # The filter begins at the course's first position, at rest.
    start = np.zeros(4 * STEPS)
    start[0::4], start[1::4] = course.position[0, 0]
    where = course.position[:, 0].reshape(STEPS, 2)
    off = np.zeros(4 * STEPS)
    off[0::4], off[1::4] = where.T
    residual += slope @ (off - start)
    covariance = slope @ states.reshape(4 * STEPS, 4 * STEPS) @ slope.T
    covariance += np.diag(np.ravel(rows.noise_std[:, 0] ** 2))
    return covariance, seen, residual, states, slope, start


def test_information_and_score_are_those_of_all_plots_at_once(rows, course):
    found = filter_targets(rows, course, DENSITY, np.ones((STEPS, 1)), RADARS)
    covariance, seen, residual, *_ = dense(rows, course)
    inverse = np.linalg.inv(covariance)
    expected = seen.T @ inverse @ seen
    scale = np.sqrt(np.diag(expected))
    assert_allclose(found.information / np.outer(scale, scale),
                    expected / np.outer(scale, scale), atol=2e-4)  # fmt: skip
    assert_allclose(found.score[0] / scale, seen.T @ inverse @ residual / scale, atol=2e-3)


def test_the_smoothed_course_is_the_mean_given_all_plots_and_the_errors(rows, course):
    found = filter_targets(rows, course, DENSITY, np.ones((STEPS, 1)), RADARS)
    errors = np.array([0.3, 0.0, -0.5, 1.0, -0.2, 0.0, 0.4, -1.0])
    got = smooth_targets(rows, found, errors, DENSITY)
    covariance, seen, residual, states, slope, start = dense(rows, course)
    gain = states.reshape(4 * STEPS, 4 * STEPS) @ slope.T @ np.linalg.inv(covariance)
    expected = (start + gain @ (residual - seen @ errors)).reshape(STEPS, 4)
    assert_allclose(got.position[:, 0], expected[:, :2], atol=0.5)
    assert_allclose(got.velocity[:, 0], expected[:, 2:], atol=0.2)


def test_padding_plots_have_no_effect(rows, course):
    def doubled(column):
        return np.concatenate([column, np.repeat(column[-1:], 5, axis=0)])

    longer = Sequences(*(doubled(getattr(rows, name)) for name in Sequences.__dataclass_fields__))
    there = longer.valid.copy()
    there[STEPS:] = False
    padded = Sequences(there, *list(vars(longer).values())[1:])
    further = Trajectories(doubled(course.position), doubled(course.velocity))
    short = filter_targets(rows, course, DENSITY, np.ones((STEPS, 1)), RADARS)
    long = filter_targets(padded, further, DENSITY, np.ones((STEPS + 5, 1)), RADARS)
    assert_allclose(long.information, short.information)
    assert long.log_likelihood == pytest.approx(short.log_likelihood)
    one, other = (smooth_targets(*p, np.zeros(8), DENSITY) for p in ((rows, short), (padded, long)))
    assert_allclose(other.position[:STEPS], one.position, rtol=1e-9)
