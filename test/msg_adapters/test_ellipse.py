import numpy as np
import pytest
from numpy.testing import assert_allclose

from msg_adapters.ellipse import RADIUS_95, outline


def test_outline_is_closed_and_at_its_radius():
    covariance = np.array([[9.0, 2.0], [2.0, 4.0]])
    line = outline(covariance, 2.5, 33)
    distance = np.sqrt(np.einsum("in,ij,jn->n", line, np.linalg.inv(covariance), line))
    assert line.shape == (2, 33)
    assert_allclose(line[:, 0], line[:, -1])
    assert_allclose(distance, 2.5)


def test_outline_takes_many_at_once():
    covariance = np.array([[[9.0, 2.0], [2.0, 4.0]], [[1.0, 0.0], [0.0, 16.0]]])
    lines = outline(covariance, 2.5, 33)
    assert lines.shape == (2, 2, 33)
    for line, one in zip(lines, covariance, strict=True):
        assert_allclose(line, outline(one, 2.5, 33))


def test_outline_takes_a_negative_variance_for_none():
    line = outline(np.diag([4.0, -1.0]), 1.0, 9)
    assert_allclose(line[1], 0.0, atol=1e-12)
    assert np.abs(line[0]).max() == pytest.approx(2.0)


def test_radius_95_holds_95_per_cent():
    points = np.random.default_rng(0).standard_normal((200_000, 2))
    inside = np.hypot(*points.T) < RADIUS_95
    assert inside.mean() == pytest.approx(0.95, abs=0.002)
