import numpy as np
import pytest
from scipy.stats import norm

from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.smc.proposals import proposal, range_rate_proposal
from phd_jdtc_ros.core.smc.proposals.detections_in_plane import PlaceRates, Places
from phd_jdtc_ros.core.targets.motion import ConstantVelocity, CoordinatedTurn

# A vehicle that passes at 60 m, ten scans a second; the radar is on a vehicle that drives east.
DT = 0.1
CV = ConstantVelocity(4.0)
CT = CoordinatedTurn(4.0, 0.02)
STATE = np.array([50.0, -14.0, 33.0, 6.0, 0.1])
RADAR = np.array([2.0, -1.0])
CARRIED = np.array([5.0, 0.0])
AMBIGUITY = 12.0
RATE_STD = 0.15


def true_rate(state, time_s=0.0):
    line = state[:, [0, 2]] + time_s * state[:, [1, 3]] - RADAR
    relative = state[:, [1, 3]] - CARRIED
    return (line * relative).sum(axis=1) / np.hypot(*line.T)


def seen(offset, rate, std=0.4, time_s=0.0, ambiguity=AMBIGUITY, rate_std=RATE_STD):
    """Return detections at offsets from the target without noise, and from its range rate."""
    offset, rate = np.atleast_2d(offset), np.atleast_1d(np.asarray(rate, dtype=float))
    mean = CV.mean(STATE[None], DT)
    place = mean[:, [0, 2]] + time_s * mean[:, [1, 3]] + offset
    count = len(offset)
    rates = PlaceRates(
        RangeRateModel(rate_std, ambiguity).wrapped(true_rate(mean, time_s) + rate),
        np.full(count, rate_std),
        np.full(count, ambiguity or np.inf),
        np.tile(RADAR, (count, 1)),
        np.tile(CARRIED, (count, 1)),
    )
    covariance = np.tile(std**2 * np.array([[1.0, 0.3], [0.3, 2.0]]), (count, 1, 1))
    return Places(place, covariance, np.full(count, time_s), rates)


def drawn(model, places, count=40_000, seed=0):
    rng = np.random.default_rng(seed)
    return range_rate_proposal.sample(model, np.tile(STATE, (count, 1)), DT, places, rng)


def likelihood(state, places, index=0):
    """Return that of the model itself: position, and range rate over its folds."""
    time_s, rates = places.time_s[index], places.rates
    error = places.position[index] - state[:, [0, 2]] - time_s * state[:, [1, 3]]
    inverse = np.linalg.inv(places.covariance[index])
    square = np.einsum("ni,ij,nj->n", error, inverse, error)
    error = rates.rate[index] - true_rate(state, time_s)
    apart = error - AMBIGUITY * np.round(error / AMBIGUITY)
    # All other folds are forty deviations farther out, at least.
    return np.exp(-0.5 * square) * norm.pdf(apart, 0.0, rates.std[index])


CASES = {
    "one detection": seen([0.3, -0.2], 0.5),
    "two of different range rates": seen([[0.3, -0.2], [-0.4, 0.1]], [0.6, -0.9]),
    "at a time of its own": seen([0.3, -0.2], 0.5, time_s=0.05),
    "one range rate is unknown": seen([[0.3, -0.2], [-0.4, 0.1]], [0.6, np.nan]),
    "a precise position": seen([0.03, -0.02], 0.5, std=0.05),
    "a fold that is hardly decided": seen([0.3, -0.2], 0.4, ambiguity=2.0),
}


@pytest.mark.parametrize("model", [CV, CT], ids=["cv", "ct"])
@pytest.mark.parametrize("case", CASES)
def test_sample_leaves_the_predicted_density_as_it_was(model, case):
    state, factor = drawn(model, CASES[case])
    support = list(model.support)
    mean, noise = model.mean(STATE[None], DT)[0, support], model.noise_covariance(DT)
    assert factor.std() > 0.1
    assert factor.max() <= 1.0 / proposal.BLIND_SHARE
    assert factor.mean() == pytest.approx(1.0, abs=0.02)
    scale = np.sqrt(np.diag(noise))
    offset = (state[:, support] - mean) / scale
    np.testing.assert_allclose((factor[:, None] * offset).mean(axis=0), 0.0, atol=0.04)
    np.testing.assert_allclose(
        (factor[:, None] * offset).T @ offset / len(offset),
        noise / np.outer(scale, scale),
        atol=0.06,
    )


@pytest.mark.parametrize(
    "places",
    [seen([0.5, -0.4], 0.9), seen([0.5, -0.4], 0.9, time_s=-0.05), seen([0.5, -0.4], AMBIGUITY)],
    ids=["at the stamp", "before the stamp", "a fold away"],
)
def test_sample_has_the_evidence_and_the_posterior_of_blind_draws(places):
    # The reference draws blindly, ten times as many particles.
    plain = proposal.motion.sample(CT, np.tile(STATE, (400_000, 1)), DT, np.random.default_rng(1))
    expected = likelihood(plain, places)
    state, factor = drawn(CT, places)
    weight = factor * likelihood(state, places)
    assert weight.mean() == pytest.approx(expected.mean(), rel=0.02)
    spread = np.sqrt(np.diag(CT.noise_covariance(DT)))
    posterior = [np.average(x, axis=0, weights=w) for x, w in ((plain, expected), (state, weight))]
    np.testing.assert_allclose((posterior[1] - posterior[0]) / spread, 0.0, atol=0.03)
    velocity = [
        np.cov((x[:, [1, 3]] / spread[[1, 3]]).T, aweights=w)
        for x, w in ((plain, expected), (state, weight))
    ]
    np.testing.assert_allclose(velocity[1], velocity[0], atol=0.05)


def test_sample_keeps_most_particles_with_a_precise_range_rate():
    places = seen([0.0, 0.0], 1.2, rate_std=0.05)
    without = Places(places.position, places.covariance, places.time_s)
    effective = {}
    for name, by in (("positions", without), ("range rates", places)):
        state, factor = drawn(CT, by, 2000)
        weight = factor * likelihood(state, places)
        effective[name] = weight.sum() ** 2 / (weight**2).sum() / len(weight)
    assert effective["positions"] < 0.1
    assert effective["range rates"] > 0.5


@pytest.mark.parametrize("std", [0.005, 0.4], ids=["precise positions", "no precise position"])
@pytest.mark.parametrize("rated", [True, False], ids=["broad range rates", "none"])
def test_sample_without_precise_range_rates_is_that_of_positions(std, rated):
    places = seen([0.01, 0.01], 0.1, std, rate_std=5.0)
    plain = Places(places.position, places.covariance, places.time_s)
    found = drawn(CV, places if rated else plain, 200)
    states = np.tile(STATE, (200, 1))
    expected = proposal.sample(CV, states, DT, plain, np.random.default_rng(0))
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(found[1], expected[1])


def test_sample_is_not_guided_by_detections_far_away():
    state, factor = drawn(CV, seen([20.0, 20.0], 0.0), 500)
    assert (factor == 1.0).all()
    assert np.abs(state[:, 1] - STATE[1]).max() < 5.0 * np.sqrt(CV.noise_covariance(DT)[1, 1])


def test_sample_finds_the_particles_near_a_detection_wherever_they_are_in_the_set():
    states = np.tile(STATE, (1000, 1))
    # Two targets in blocks, and strays among the second one's particles.
    states[300:, 0] += 100.0
    strays = np.arange(305, 1000, 50)
    states[strays, 0] -= 100.0
    _, factor = range_rate_proposal.sample(
        CV, states, DT, seen([0.1, 0.1], 0.8), np.random.default_rng(0)
    )
    near = np.isin(np.arange(1000), [*range(300), *strays])
    assert (factor[~near] == 1.0).all()
    assert (factor[near] != 1.0).mean() > 0.95
