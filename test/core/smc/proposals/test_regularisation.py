from dataclasses import replace

import numpy as np
import pytest
from scenes import intensity
from sweep import configuration

from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.smc.proposals.regularisation import BANDWIDTH, YOUNG_SCANS, regularised
from phd_jdtc_ros.core.tracks.labels import first_detected

BASE = configuration().model
(RADAR,) = BASE.radars
NOW = 40
COVARIANCE = np.array(
    [[4.0, 1.0, 0.5, 0.0], [1.0, 2.0, 0.0, 0.3], [0.5, 0.0, 1.0, -0.4], [0.0, 0.3, -0.4, 3.0]]
)
MEAN = np.array([300.0, -8.0, 40.0, 5.0])
AXES = [0, 1, 2, 3]


def target(age, count=20_000, seed=0, shift=0.0):
    """Return particles of unequal weight; those of odd rows have another velocity along x."""
    rng = np.random.default_rng(seed)
    state = np.zeros((count, 5))
    state[:, AXES] = MEAN + rng.standard_normal((count, 4)) @ np.linalg.cholesky(COVARIANCE).T
    state[1::2, 1] += shift
    state[:, 4] = rng.standard_normal(count)
    weight = rng.uniform(0.5, 1.5, count)
    particles = intensity(
        state,
        np.zeros(count),
        mode=np.arange(count) % 2,
        origin=np.full(count, first_detected(NOW - age)),
        components=(0.8 * weight / weight.sum())[:, None],
    )
    return replace(particles, parent=np.arange(count))


def moved(particles, radar=RADAR, seed=1):
    return regularised(particles, [radar], BASE.modes, NOW, np.random.default_rng(seed))


def moments(particles, rows=slice(None)):
    state, weight = particles.state[rows][:, AXES], particles.weight[rows]
    return np.average(state, axis=0, weights=weight), np.cov(state.T, aweights=weight)


def test_regularised_particles_have_the_mean_and_the_covariance_as_before():
    before = target(3)
    after = moved(before)

    scale = np.sqrt(np.diag(COVARIANCE))
    (mean, covariance), (expected_mean, expected) = moments(after), moments(before)
    np.testing.assert_allclose((mean - expected_mean) / scale, 0.0, atol=0.015)
    np.testing.assert_allclose(
        covariance / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.04
    )
    offset = after.state[:, AXES] - before.state[:, AXES]
    # sqrt(1 - h^2) of the offset is left, and h of a new one comes.
    expected_offset = np.hypot(BANDWIDTH, 1.0 - np.sqrt(1.0 - BANDWIDTH**2)) * scale
    np.testing.assert_allclose(offset.std(axis=0), expected_offset, rtol=0.03)


def test_regularised_particles_keep_all_but_position_and_velocity():
    before = target(3)
    after = moved(before)

    for name in ("mode", "origin", "parent", "multiplicity", "weight"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    np.testing.assert_array_equal(after.state[:, 4], before.state[:, 4])


@pytest.mark.parametrize(
    ("age", "moves"), [(0, False), (1, True), (YOUNG_SCANS - 1, True), (YOUNG_SCANS, False)]
)
def test_regularised_are_only_young_targets_that_are_not_newborn(age, moves):
    before = target(age, 200)
    assert (moved(before).state[:, :4] != before.state[:, :4]).any() == moves


def test_regularised_copies_move_with_the_particle_that_they_are_of():
    # What resampling has left: forty distinct particles, ten times each.
    before = replace(target(3, 40), multiplicity=np.full(40, 10))
    runs = [moments(moved(before, seed=seed))[0] for seed in range(200)]

    mean, covariance = moments(before)
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((np.mean(runs, axis=0) - mean) / scale, 0.0, atol=0.02)
    # The mean is as uncertain as that of so few draws.
    expected = BANDWIDTH * scale / np.sqrt(40)
    np.testing.assert_allclose(np.std(runs, axis=0), expected, rtol=0.25)


@pytest.mark.parametrize("targets", [1, 2])
def test_regularised_targets_and_folds_do_not_mix(targets):
    # Half of the particles have a range rate that is a fold lower; the radar is far off along x.
    radar = replace(RADAR, position=(-1e6, 0.0), range_rate=RangeRateModel(0.2, 40.0))
    before = target(3, 4000, shift=-40.0)
    if targets == 2:
        origin = before.origin + np.arange(4000) // 2 % 2
        before = replace(before, origin=origin, state=before.state + 100.0 * (origin % 2)[:, None])
    after = moved(before, radar)

    for first in range(2 * targets):
        rows = np.arange(first, 4000, 2 * targets)
        (mean, covariance), (expected_mean, expected) = (
            moments(each, rows) for each in (after, before)
        )
        np.testing.assert_allclose(mean, expected_mean, atol=0.15)
        np.testing.assert_allclose(covariance, expected, atol=0.5)
