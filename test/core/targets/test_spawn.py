from dataclasses import replace

import numpy as np
import pytest
from scenes import intensity, predict, small

from phd_jdtc_ros.configuration.engines import particle_filter
from phd_jdtc_ros.core.smc.correction import POISSON
from phd_jdtc_ros.core.state_space import OMEGA

CONFIG = small({"spawning.particles_per_target": 20_000})
FILTER = particle_filter(CONFIG)
MODEL = replace(CONFIG.model, births=())


def spawned_from(state, mode, dt=6.0, corrector=FILTER.corrector):
    phd = intensity([state], [1.0], mode=np.array([mode]), row_label=np.array([7]))
    rng = np.random.default_rng(0)
    predicted = predict(phd, MODEL, corrector, FILTER.budget, dt, 1, rng)
    return phd, predicted, np.arange(len(predicted)) > 0  # the first row survives


@pytest.mark.parametrize("mode", [0, 3])
def test_spawn_is_gaussian_about_the_predicted_parent(mode):
    state = [1000.0, 60.0, -500.0, -20.0, 0.05]
    phd, predicted, spawned = spawned_from(state, mode)
    for target, motion in enumerate(MODEL.modes.motions):
        support = list(motion.support)
        chosen = spawned & (predicted.mode == target)
        offset = predicted.state[chosen] - motion.mean(phd.state, 6.0)
        scaled = offset[:, support] / MODEL.spawn.std[support]
        count = chosen.sum()
        assert count > 500
        assert (np.abs(scaled.mean(axis=0)) < 4.5 / np.sqrt(count)).all()
        assert (np.abs(scaled.std(axis=0) - 1.0) < 4.5 / np.sqrt(2.0 * count)).all()
        if OMEGA not in support:
            np.testing.assert_array_equal(predicted.state[chosen, OMEGA], 0.0)


def test_spawn_draws_class_and_mode_of_the_parent_row():
    _, predicted, spawned = spawned_from([0.0, 10.0, 0.0, 0.0, 0.0], 0)
    share = np.bincount(predicted.mode[spawned], minlength=4) / spawned.sum()
    # Class matrix all 0.5 times mode row (0.9, 0.1).
    expected = np.array([0.45, 0.05, 0.45, 0.05])
    np.testing.assert_allclose(MODEL.spawn.transition[0], expected)
    error = 4.5 * np.sqrt(expected * (1.0 - expected) / spawned.sum())
    assert (np.abs(share - expected) < error).all()


@pytest.mark.parametrize("dt", [3.0, 6.0])
def test_spawn_mass_follows_the_interval(dt):
    _, predicted, spawned = spawned_from([0.0, 10.0, 0.0, 0.0, 0.0], 0, dt)
    assert predicted.weight[spawned].sum() == pytest.approx(0.01 * dt / 6.0)
    np.testing.assert_array_equal(predicted.parent, 0)


def test_spawn_inherits_the_origin_in_the_phd_filter():
    _, predicted, _ = spawned_from([0.0, 10.0, 0.0, 0.0, 0.0], 0, corrector=POISSON)
    np.testing.assert_array_equal(predicted.row_label, 7)


def test_spawn_founds_an_origin_a_parent_where_origins_are_targets():
    phd = intensity(np.zeros((3, 5)), np.ones(3), row_label=np.array([7, 9, 9]))
    model = replace(MODEL, births=CONFIG.model.births)
    rng = np.random.default_rng(0)
    predicted = predict(phd, model, FILTER.corrector, FILTER.budget, 6.0, 5, rng)
    spawned = (predicted.parent >= 0) & (np.arange(len(predicted)) >= 3)
    own = predicted.row_label[spawned]
    named = {(phd.row_label[p], o) for p, o in zip(predicted.parent[spawned], own, strict=True)}
    assert len(named) == 2
    assert not set(own) & set(predicted.row_label[~spawned])
