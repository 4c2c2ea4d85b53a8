"""What is computed of estimates and targets."""

import numpy as np
import pytest

from phd_jdtc_ros.evaluation.comparison import expected_speed


def test_the_speed_is_the_mean_of_speeds_whose_courses_differ():
    rng = np.random.default_rng(5)
    # The courses of a target at 200 m/s differ by 15 degrees.
    course = rng.normal(0.3, np.radians(15.0), 20000)
    velocities = 200.0 * np.column_stack([np.cos(course), np.sin(course)])
    mean, covariance = velocities.mean(axis=0)[None], np.cov(velocities.T)[None]
    assert expected_speed(mean, None)[0] == np.hypot(*mean[0]) < 195.0
    assert expected_speed(mean, covariance)[0] == pytest.approx(200.0, abs=0.5)
