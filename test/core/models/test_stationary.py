from dataclasses import replace

import numpy as np
import pytest
from scenes import small

from phd_jdtc_ros.core.clutter.grid import PolarGrid
from phd_jdtc_ros.core.clutter.map import ClutterMap
from phd_jdtc_ros.core.models import stationary

BOUND = 2.5


def velocities(mean, std):
    return np.atleast_2d(mean).astype(float), np.eye(2)[None] * std**2


def test_slower_velocities_are_as_probable_as_drawn():
    mean, covariance = velocities([2.0, -1.0], 1.5)
    drawn = mean + 1.5 * np.random.default_rng(0).standard_normal((200_000, 2))
    share = (np.hypot(*drawn.T) < BOUND).mean()
    assert stationary.probability_slower(mean, covariance, BOUND)[0] == pytest.approx(
        share, abs=0.005
    )
    mean, covariance = velocities([[1.0, 0.0], [4.0, 0.0], [1e4, 0.0]], 1e-9)
    np.testing.assert_allclose(
        stationary.probability_slower(mean, covariance, BOUND), [1.0, 0.0, 0.0], atol=1e-9
    )
    assert stationary.probability_slower(*velocities([0.0, 0.0], 1.0), 0.0) == 0.0


@pytest.mark.parametrize("velocity_std", [1.0, 5.0, 40.0])
def test_a_newborn_target_is_at_rest_with_even_odds(velocity_std):
    newborn = stationary.probability_slower(*velocities([0.0, 0.0], velocity_std), BOUND)
    even = stationary.at_even_odds(newborn, BOUND, velocity_std)
    np.testing.assert_allclose(even, 0.5, rtol=1e-9)


def test_odds_are_multiplied_by_the_same_factor():
    probability = np.array([0.0, 0.02, 0.3, 0.9, 1.0])
    even = stationary.at_even_odds(probability, BOUND, 5.0)
    assert even[0] == 0.0
    assert even[-1] == 1.0
    ratio = even[1:-1] / (1.0 - even[1:-1]) / (probability[1:-1] / (1.0 - probability[1:-1]))
    prior = 1.0 - np.exp(-0.5 * (BOUND / 5.0) ** 2)
    np.testing.assert_allclose(ratio, (1.0 - prior) / prior)


def test_where_newborn_targets_are_all_slower_or_all_faster_nothing_changes():
    probability = np.array([0.0, 0.3, 1.0])
    np.testing.assert_array_equal(stationary.at_even_odds(probability, 0.0, 5.0)[:1], [0.0])
    everything = stationary.at_even_odds(np.array([1.0]), 1e3, 1.0)
    np.testing.assert_array_equal(everything, [1.0])


def test_among_reflectors_rest_is_likelier_unless_the_velocity_is_measured():
    probability = np.array([0.0, 0.1, 0.5, 1.0])
    np.testing.assert_array_equal(
        stationary.among_reflectors(probability, np.zeros(4)), probability
    )
    among = stationary.among_reflectors(probability, np.full(4, 0.9))
    # The odds are ten times as large.
    np.testing.assert_allclose(among, [0.0, 10.0 / 19.0, 10.0 / 11.0, 1.0])


def test_a_target_at_rest_is_clutter_only_if_it_is_to_every_radar():
    plain = small().model.radars[0]
    mapped = replace(
        plain, clutter_map=ClutterMap(PolarGrid.of_noise(10.0, 0.01)), clutter_map_speed=3.0
    )
    slower = replace(mapped, clutter_map_speed=2.0)
    assert stationary.stationary_speed([mapped]) == 3.0
    assert stationary.stationary_speed([mapped, slower]) == 2.0
    assert stationary.stationary_speed([mapped, plain]) == 0.0
    assert stationary.stationary_speed([]) == 0.0
