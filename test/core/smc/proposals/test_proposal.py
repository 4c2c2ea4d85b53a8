import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from phd_jdtc_ros.core.smc.proposals import proposal
from phd_jdtc_ros.core.smc.proposals.detections_in_plane import InPlane
from phd_jdtc_ros.core.targets.motion import ConstantVelocity, CoordinatedTurn

DT = 4.0
CV = ConstantVelocity(100.0)
STATE = np.array([0.0, 200.0, 1000.0, 0.0, 0.0])
SPREAD = float(np.sqrt(CV.noise_covariance(DT)[0, 0]))


def seen(position, std=10.0, time_s=0.0):
    position = np.atleast_2d(position)
    count = len(position)
    return InPlane(position, np.tile(std**2 * np.eye(2), (count, 1, 1)), np.full(count, time_s))


def drawn(model, places, count=40_000, seed=0):
    rng = np.random.default_rng(seed)
    return proposal.sample(model, np.tile(STATE, (count, 1)), DT, places, rng)


@pytest.mark.parametrize("model", [CV, CoordinatedTurn(100.0, 1e-4)])
@pytest.mark.parametrize(
    "position",
    [[[850.0, 1030.0]], [[700.0, 1100.0], [900.0, 900.0]]],
    ids=["one detection", "two detections"],
)
def test_sample_leaves_the_predicted_density_as_it_was(model, position):
    state, factor = drawn(model, seen(position))
    support = list(model.support)
    mean = model.mean(STATE[None], DT)[0, support]
    noise = model.noise_covariance(DT)
    assert factor.mean() == pytest.approx(1.0, abs=0.02)
    scale = np.sqrt(np.diag(noise))
    offset = (state[:, support] - mean) / scale
    np.testing.assert_allclose((factor[:, None] * offset).mean(axis=0), 0.0, atol=0.05)
    correlation = noise / np.outer(scale, scale)
    np.testing.assert_allclose(
        (factor[:, None] * offset).T @ offset / len(offset), correlation, atol=0.05
    )


def test_sample_explains_detections_and_estimates_their_evidence():
    place = np.array([800.0 + 2.0 * SPREAD, 1000.0])
    effective = {}
    for name, places in (("blind", seen(np.zeros((0, 2)))), ("guided", seen(place, 2.0))):
        state, factor = drawn(CV, places, 1000)
        weight = factor * np.exp(-0.5 * ((state[:, [0, 2]] - place) ** 2).sum(axis=1) / 2.0**2)
        effective[name] = weight.sum() ** 2 / (weight**2).sum()
    assert effective["blind"] < 5.0
    assert effective["guided"] > 200.0
    place = np.array([800.0 + SPREAD, 1000.0 - SPREAD])
    state, factor = drawn(CV, seen(place))
    likelihood = norm.pdf(state[:, [0, 2]], place, 10.0).prod(axis=1)
    covariance = (SPREAD**2 + 10.0**2) * np.eye(2)
    expected = multivariate_normal([800.0, 1000.0], covariance).pdf(place)
    assert (factor * likelihood).mean() == pytest.approx(expected, rel=0.02)


def test_sample_follows_the_detection_to_its_own_time():
    # Seen half a second after the stamp, the target was 100 m farther back at the stamp.
    state, factor = drawn(CV, seen([900.0, 1000.0], 2.0, time_s=0.5))
    pulled = np.abs(state[:, 0] + 0.5 * state[:, 1] - 900.0) < 6.0
    assert pulled.mean() > 0.6
    assert factor.mean() == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    "places",
    [seen(np.zeros((0, 2))), seen([800.0, 1000.0], 10.0 * SPREAD)],
    ids=["no detection", "a detection that is not precise"],
)
def test_sample_without_precise_detections_is_that_of_the_motion(places):
    state, factor = drawn(CV, places, 50)
    rng = np.random.default_rng(0)
    expected = proposal.motion.sample(CV, np.tile(STATE, (50, 1)), DT, rng)
    np.testing.assert_array_equal(state, expected)
    assert (factor == 1.0).all()


def test_weights_have_a_bound_and_far_detections_no_effect():
    state, factor = drawn(CV, seen([9e3, 9e3]), 50)
    assert (factor == 1.0).all()
    assert np.abs(state[:, 0] - 800.0).max() < 5.0 * SPREAD
    _, factor = drawn(CV, seen([[850.0, 1030.0], [800.0, 1000.0]], 1.0))
    assert factor.max() <= 1.0 / proposal.BLIND_SHARE
