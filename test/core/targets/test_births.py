import sys
from dataclasses import replace
from subprocess import run

import numpy as np
import pytest
from scenes import small
from scipy.stats import norm, qmc

from phd_jdtc_ros.core.state_space import OMEGA
from phd_jdtc_ros.core.targets import birth
from phd_jdtc_ros.core.targets.birth import AXES, BITS, sobol_points

BIRTH_MODEL = small({"start_1.std": [200.0, 40.0, 2e-3], "start_1.velocity": [10.0, -5.0]}).model
TERM = BIRTH_MODEL.births[0]
DIMENSIONS = range(1, len(AXES) + 1)


def test_sample_has_the_moments_of_the_term():
    count = 4096
    state, mode = birth.sample(TERM, BIRTH_MODEL.modes, count, np.random.default_rng(0))
    turning = mode % 2 == 1
    scaled = (state - TERM.mean) / TERM.std
    # Quasi-random points are far better than independent ones, whose errors these are.
    assert (np.abs(scaled[:, :4].mean(axis=0)) < 3.0 / np.sqrt(count)).all()
    np.testing.assert_allclose(scaled[:, :4].std(axis=0), 1.0, atol=3.0 / np.sqrt(2 * count))
    np.testing.assert_allclose(scaled[turning, OMEGA].std(), 1.0, atol=3.0 / np.sqrt(count))
    np.testing.assert_array_equal(state[~turning, OMEGA], 0.0)


def test_sample_shares_modes_by_their_rates():
    term = replace(TERM, rate=np.array([0.001, 0.0, 0.002, 0.005]))
    _, mode = birth.sample(term, BIRTH_MODEL.modes, 1024, np.random.default_rng(0))
    # One coordinate of a Sobol set of 1024 points is stratified to a point.
    np.testing.assert_allclose(np.bincount(mode, minlength=4), [128, 0, 256, 640], atol=1)


def test_sample_is_unbiased_over_its_random_shift():
    # Two points only, so the shift alone must make the mean right.
    rng = np.random.default_rng(3)
    trials = 3000
    mean = np.array(
        [birth.sample(TERM, BIRTH_MODEL.modes, 2, rng)[0][:, 0].mean() for _ in range(trials)]
    )
    assert abs(mean.mean() - TERM.mean[0]) < 4.5 * mean.std() / np.sqrt(trials)


def dense_intensity(terms, modes, state, mode):
    total = np.zeros(len(state))
    for term in terms:
        for q in range(len(state)):
            support = list(modes.motions[mode[q]].support)
            density = norm.pdf(state[q, support], term.mean[support], term.std[support])
            total[q] += term.rate[mode[q]] * density.prod()
    return total


def test_intensity_is_a_sum_of_gaussians_over_each_born_mode():
    rng = np.random.default_rng(1)
    samples = [birth.sample(term, BIRTH_MODEL.modes, 32, rng) for term in BIRTH_MODEL.births]
    state, mode = (np.concatenate(part) for part in zip(*samples, strict=True))
    found = birth.intensity(BIRTH_MODEL.births, BIRTH_MODEL.modes, state, mode)
    # Starts 2 and 3 are 2.5 sigma apart, so that terms add; the gate at 8 sigma costs 1e-14.
    expected = dense_intensity(BIRTH_MODEL.births, BIRTH_MODEL.modes, state, mode)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    term = replace(TERM, rate=np.array([0.0, 0.0, 0.1, 0.1]))
    state = np.repeat(TERM.mean[None], 4, axis=0)
    found = birth.intensity((term,), BIRTH_MODEL.modes, state, np.arange(4))
    np.testing.assert_array_equal(found > 0.0, [False, False, True, True])


def test_intensity_disregards_the_axes_that_a_mode_lacks():
    mean = TERM.mean.copy()
    mean[OMEGA] = 100.0 * TERM.std[OMEGA]
    term = replace(TERM, mean=mean)
    state, mode = birth.sample(term, BIRTH_MODEL.modes, 64, np.random.default_rng(0))
    found = birth.intensity((term,), BIRTH_MODEL.modes, state, mode)
    expected = dense_intensity((term,), BIRTH_MODEL.modes, state, mode)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("dimension", range(5))
def test_intensity_vanishes_far_from_every_term(dimension):
    state = TERM.mean[None].copy()
    state[0, dimension] += 9.0 * TERM.std[dimension]
    assert birth.intensity((TERM,), BIRTH_MODEL.modes, state, np.array([1]))[0] == 0.0


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("count", [1, 2, 64, 1 << 14])
def test_sobol_points_are_those_of_scipy(dimension, count):
    expected = qmc.Sobol(dimension, scramble=False, bits=BITS).random(count)
    np.testing.assert_array_equal(sobol_points(dimension, count), expected)


@pytest.mark.parametrize("count", [12, 0, 2 ** (BITS + 1)])
def test_sobol_points_refuse_a_count_that_is_no_power_of_two(count):
    with pytest.raises(ValueError, match=f"count: {count} given, must be"):
        sobol_points(2, count)


def test_sobol_points_are_kept_and_cannot_be_changed():
    points = sobol_points(3, 64)
    assert sobol_points(3, 64) is points
    with pytest.raises(ValueError, match="read-only"):
        points[0] = np.nan


@pytest.mark.parametrize("dimension", [0, len(AXES) + 1])
def test_sobol_points_refuse_a_dimension_without_directions(dimension):
    with pytest.raises(ValueError, match=f"dimension: {dimension} given, must be from 1"):
        sobol_points(dimension, 2)


def test_engines_start_without_the_statistics_of_scipy():
    code = (
        "import sys; from phd_jdtc_ros.configuration import build, engines;"
        "[engines.new_engine(build.resolve({'engine': name})) for name in ('gaussian', 'phd')];"
        "sys.exit('scipy.stats' in sys.modules)"
    )
    assert run([sys.executable, "-c", code], check=False).returncode == 0
