from dataclasses import replace

import numpy as np
import pytest
import textbook
from lone import MEAN, STD, TWO_MOTIONS, lone, mixture_of
from scenes import small

from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.extraction import extract
from phd_jdtc_ros.core.gaussian.prediction import AgedMixture, births, spawn, survivors
from phd_jdtc_ros.core.tracks import labels


def dynamics_of(given=None):
    return Dynamics(small({"engine": "gaussian", **(given or {})}).model)


def test_dynamics_share_the_motions_of_classes_that_move_alike():
    shared, apart = dynamics_of(), dynamics_of({"class_1.survival_probability": 0.9})
    assert shared.mode_of.tolist() == [0, 1, 0, 1]
    assert apart.mode_of.tolist() == [0, 1, 2, 3]
    for dynamics in (shared, apart):
        intervals = dynamics.over(np.array([6.0, 17.0]))
        for survival, change in zip(intervals.survival, intervals.change, strict=True):
            left = np.bincount(dynamics.pairs[0], weights=change)
            np.testing.assert_allclose(left, survival)
        np.testing.assert_allclose(dynamics.spread.sum(axis=(1, 2)), 1.0)
        np.testing.assert_allclose(dynamics.birth_weight.sum(axis=(1, 2)), 1.0)
        for mode, motion in enumerate(dynamics.motions):
            assert np.flatnonzero(dynamics.supported[mode]).tolist() == list(motion.support)


@pytest.mark.parametrize("amplitude", ["band", "memory"])
def test_births_are_the_terms_in_every_mode_with_their_rates(amplitude):
    dynamics = dynamics_of({"amplitude": amplitude})
    model = dynamics.model
    found = births([(0, 6.0), (2, 12.0)], dynamics, 5)
    first = labels.first_predicted(5)
    assert found.row_label.tolist() == [first, first + 2]
    np.testing.assert_allclose(found.existence, [0.01, 0.02])
    np.testing.assert_allclose(
        found.class_mass(model.modes.class_of, len(model.modes.classes)), [0.015, 0.015]
    )
    for row, term in enumerate((model.births[0], model.births[2])):
        for mode in range(2):
            inside = dynamics.supported[mode]
            np.testing.assert_array_equal(found.mean[row, mode], term.mean * inside)
            np.testing.assert_allclose(found.covariance[row, mode], np.diag(term.std**2 * inside))


def test_survivors_lose_what_does_not_survive_and_keep_their_origins():
    config = lone({**TWO_MOTIONS, "target.survival_probability": 0.9})
    dynamics = Dynamics(config.model)
    parts = [mixture_of(dynamics, [(0.8, MEAN, STD), (0.3, MEAN, STD)])] * 2
    found, moves = survivors([AgedMixture(parts[0], 6.0), AgedMixture(parts[1], 12.0)], dynamics)
    np.testing.assert_allclose(found.mass, [0.72, 0.27, 0.648, 0.243])
    assert found.row_label.tolist() == [0, 1, 0, 1]
    np.testing.assert_allclose(moves.survival[:, 0], [0.9, 0.9, 0.81, 0.81])
    np.testing.assert_allclose(found.mean[:, 0, 0], MEAN[0] + MEAN[1] * np.array([6, 6, 12, 12.0]))


@pytest.mark.parametrize("motions", [[0], [1]], ids=["straight", "turning"])
def test_pair_of_modes_goes_back_by_the_step_of_rauch_tung_and_striebel(motions):
    dynamics = Dynamics(lone(TWO_MOTIONS).model)
    rng = np.random.default_rng(2)
    mixture = mixture_of(dynamics, [(0.8, MEAN, STD)])
    weight = np.zeros_like(mixture.weight)
    weight[:, motions] = 0.8
    root = rng.normal(size=(5, 5)) * STD[:, None]
    supported = dynamics.supported[:, :, None] * dynamics.supported[:, None]
    mixture = replace(mixture, weight=weight, covariance=(root @ root.T * supported)[None])
    _, moves = survivors([AgedMixture(mixture, 6.0)], dynamics)
    of, to = moves.pairs
    assert (moves.place >= 0).sum() == 2
    for pair in np.flatnonzero(moves.place[0] >= 0):
        at, motion = moves.place[0, pair], dynamics.motions[to[pair]]
        before = textbook.Normal(mixture.mean[0, of[pair]], mixture.covariance[0, of[pair]])
        predicted, gain = textbook.predict(before, motion, 6.0)
        scale = np.sqrt(np.maximum(np.diag(before.covariance), 1e-12))
        np.testing.assert_allclose(moves.mean[at], predicted.mean, atol=1e-12)
        np.testing.assert_allclose(
            moves.gain[at] / scale[:, None] * scale, gain / scale[:, None] * scale, atol=1e-6
        )
        right = before.covariance - gain @ predicted.covariance @ gain.T
        unit = scale[:, None] * scale
        np.testing.assert_allclose(moves.base[at] / unit, right / unit, atol=1e-6)


def test_spawned_targets_are_about_their_predicted_parents():
    dynamics = dynamics_of({"spawn.rate": 0.02})
    parents = mixture_of(dynamics, [(0.9, MEAN, STD), (1e-6, MEAN, STD)])
    found = spawn([AgedMixture(parents, 6.0)], dynamics, 3, 1e-4)
    assert len(found) == 1  # of the second one, next to nothing could be spawned
    assert found.existence[0] == pytest.approx(0.9 * 0.02)
    assert found.row_label[0] == labels.first_predicted(3) + len(dynamics.model.births)
    np.testing.assert_allclose(found.mean[0, :, 0], MEAN[0] + 6.0 * MEAN[1], atol=1.0)
    std = np.sqrt(STD[0] ** 2 + (6.0 * STD[1]) ** 2 + dynamics.model.spawn.std[0] ** 2)
    assert np.sqrt(found.covariance[0, 0, 0, 0]) == pytest.approx(std, rel=1e-6)


def test_extraction_reports_the_majority_class_of_targets_above_the_threshold():
    dynamics = dynamics_of({"class_1.survival_probability": 0.9, "amplitude": "band"})
    mixture = mixture_of(dynamics, [(0.9, MEAN, STD), (0.3, MEAN, STD), (0.7, -MEAN, STD)])
    weight = np.array(mixture.weight)
    weight[0] *= 0.0
    weight[0, [0, 1], 0], weight[0, 2, 1] = [0.1, 0.2], 0.6
    mean = np.array(mixture.mean)
    mean[0, :2, 0] += 1e3
    changed = mixture.changed(weight=weight, mean=mean)
    found = extract(changed, dynamics, 7, 2, 0.5)
    assert found.track_id.tolist() == [1, 3]
    assert (found.stamp_ns, found.lag) == (7, 2)
    np.testing.assert_allclose(found.weight, [0.9, 0.7])
    np.testing.assert_allclose(found.class_probability[0], [1 / 3, 2 / 3])
    assert found.class_id[0] == 1
    # Only the class's own motions count, one of which has no weight.
    np.testing.assert_allclose(found.state[0], MEAN * dynamics.supported[2])


def test_extraction_of_nothing_is_nothing():
    dynamics = dynamics_of()
    found = extract(births([], dynamics, 0), dynamics, 7, 0, 0.5)
    assert len(found) == 0
    assert found.class_probability.shape == (0, 2)
