"""The Gaussian engine: the reference scene, the prediction, and lost targets that manoeuvre."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import textbook
from lone import MEAN, SIZE, STD, TWO_MOTIONS, lone, mixture_of
from scenes import short_scenario, small

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors.transponder.uniqueness import OutOfGate
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.extraction import extract, most_probable_motion
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.gaussian.new_targets import births, spawn
from phd_jdtc_ros.core.gaussian.prediction import AgedMixture, survivors
from phd_jdtc_ros.core.gaussian.reacquisition import (
    ACCELERATION,
    PROBABILITY,
    SPEEDING,
    TURN_RATE,
    with_reacquired,
)
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.smoothing.smoother import backward_pass
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.state_space import OMEGA
from phd_jdtc_ros.core.tracks import track_numbers
from phd_jdtc_ros.parameter_files import sections
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

PROFILE = resources.find(Path("config/surveillance.yaml"))
SCANS = [scan for _, scan in simulate(short_scenario(12), 5)]
BIRTHS = {"births": [], "detection_births.rates": [0.1, 0.1]}
SINCE_S = 4.0


def gaussian(given=None):
    return new_engine(small({"lag": 3, **(given or {})}))


@pytest.mark.parametrize("given", [{}, {"bounds.hypotheses": 1}, BIRTHS, {"spawn.rate": 0.1}])
def test_children_are_of_the_origin_of_their_parents_though_rows_go_between_radars(given):
    engine = gaussian(given)
    linked = dropped = 0
    for scan in SCANS:
        before = engine.forward.unswept
        sources = (
            np.concatenate([rows.row_label for rows in before]) if before else np.zeros(0, int)
        )
        engine.step(scan)
        entry = engine.forward.unswept[-1].entry
        if entry.link is None:
            continue
        ancestry = entry.link.ancestry
        survivors = ancestry.parent >= 0
        child, parent = ancestry.child[survivors], ancestry.parent[survivors]
        # Parents are the rows before the first radar, whatever was dropped since.
        np.testing.assert_array_equal(sources[parent], entry.stored.row_label[child])
        newborn = np.setdiff1d(np.arange(len(entry.stored)), child)
        assert not np.isin(entry.stored.row_label[newborn], sources).any()
        assert (np.diff(ancestry.child) >= 0).all()
        linked += len(child)
        dropped += len(np.setdiff1d(np.arange(len(sources)), parent))
    assert linked > 30
    assert dropped > 0


@pytest.mark.parametrize("bound", [1, 3, 8])
def test_bounds_hold_after_every_scan(bound):
    engine = gaussian({"bounds.hypotheses": bound, "bounds.most": 100, **BIRTHS})
    modes = len(engine.forward.dynamics.motions)
    for scan in SCANS:
        figures = engine.step(scan).figures
        stored = engine.forward.unswept[-1].entry.stored
        assert np.bincount(stored.sums.target).max() <= bound * modes
        assert len(stored) == figures["hypotheses"] <= 100
        assert stored.sums.existence.max() <= 1.0 + 1e-9
        assert stored.sums.existence.min() >= engine.forward.bounds.least_existence


def test_smoothed_existence_is_a_probability_and_hindsight_agrees_with_the_last_scan():
    engine = gaussian({"lag": 5})
    for scan in SCANS[:8]:
        engine.step(scan)
    smoothed = backward_pass(engine._window)
    for found, filtered in zip(
        smoothed[0].gaussians, engine._window[-1].stored.gaussians, strict=True
    ):
        np.testing.assert_array_equal(found, filtered)
    for mixture in smoothed:
        assert (mixture.weight >= 0.0).all()
        assert mixture.sums.existence.max() <= 1.0 + 1e-9
    # Who exists at the last scan existed before: nobody lives twice.
    last = smoothed[0]
    for earlier in smoothed[1:4]:
        shared, now, then = np.intersect1d(last.sums.label, earlier.sums.label, return_indices=True)
        assert len(shared) > 0
        assert (earlier.sums.existence[then] >= last.sums.existence[now] - 1e-6).all()


def test_class_mass_is_that_of_the_stored_mixture():
    engine = gaussian()
    for scan in SCANS[:5]:
        step = engine.step(scan)
    total = engine.forward.unswept[-1].entry.stored.sums.existence.sum()
    assert step.class_mass.sum() == pytest.approx(total, rel=1e-9)


def test_steps_are_the_same_in_every_run():
    one, other = gaussian(), gaussian({"seed": 7})
    for scan in SCANS:
        ours, theirs = one.step(scan), other.step(scan)
        np.testing.assert_array_equal(ours.filtered[0].state, theirs.filtered[0].state)


def dynamics_of(given=None):
    return Dynamics(small({**(given or {})}).model)


def test_dynamics_share_the_motions_of_classes_that_move_alike():
    shared, apart = dynamics_of(), dynamics_of({"class_1.survival_probability": 0.9})
    assert shared.mode_of.tolist() == [0, 1, 0, 1]
    assert apart.mode_of.tolist() == [0, 1, 2, 3]
    for dynamics in (shared, apart):
        motion, _ = dynamics.over(np.array([6.0, 17.0]))
        for survival, change in zip(motion.survival, motion.change, strict=True):
            left = np.bincount(dynamics.pairs.before, weights=change)
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
    first = track_numbers.first_predicted(5)
    assert found.row_label.tolist() == [first, first + 2]
    np.testing.assert_allclose(found.sums.existence, [0.01, 0.02])
    np.testing.assert_allclose(found.class_mass(), [0.015, 0.015])
    for row, term in enumerate((model.births[0], model.births[2])):
        for mode in range(2):
            inside = dynamics.supported[mode]
            variance = term.std**2 * inside
            np.testing.assert_array_equal(found.mean[row, mode], term.mean * inside)
            np.testing.assert_allclose(found.covariance[row, mode], np.diag(variance))


def test_survivors_lose_what_does_not_survive_and_keep_their_origins():
    config = lone({**TWO_MOTIONS, "target.survival_probability": 0.9})
    dynamics = Dynamics(config.model)
    parts = [mixture_of(dynamics, [(0.8, MEAN, STD), (0.3, MEAN, STD)])] * 2
    found, moves = survivors([AgedMixture(parts[0], 6.0), AgedMixture(parts[1], 12.0)], dynamics)
    np.testing.assert_allclose(found.sums.mass, [0.72, 0.27, 0.648, 0.243])
    assert found.row_label.tolist() == [0, 1, 0, 1]
    np.testing.assert_allclose(moves.survival[:, 0], [0.9, 0.9, 0.81, 0.81])
    np.testing.assert_allclose(found.mean[:, 0, 0], MEAN[0] + MEAN[1] * np.array([6, 6, 12, 12.0]))


@pytest.mark.parametrize("time_constant_s", [0.0, 40.0], ids=["walk", "returns"])
@pytest.mark.parametrize("motions", [[0], [1]], ids=["straight", "turning"])
def test_pair_of_modes_goes_back_by_the_step_of_rauch_tung_and_striebel(motions, time_constant_s):
    given = {**TWO_MOTIONS, "ct.turn_time_constant_s": time_constant_s}
    dynamics = Dynamics(lone(given).model)
    rng = np.random.default_rng(2)
    mixture = mixture_of(dynamics, [(0.8, MEAN, STD)])
    weight = np.zeros_like(mixture.weight)
    weight[:, motions] = 0.8
    root = rng.normal(size=(SIZE, SIZE)) * STD[:, None]
    supported = dynamics.supported[:, :, None] * dynamics.supported[:, None]
    mixture = replace(mixture, weight=weight, covariance=(root @ root.T * supported)[None])
    _, moves = survivors([AgedMixture(mixture, 6.0)], dynamics)
    before_of, after_of = moves.pairs
    assert (moves.place >= 0).sum() == 2
    for pair in np.flatnonzero(moves.place[0] >= 0):
        at, motion = moves.place[0, pair], dynamics.motions[after_of[pair]]
        mode = before_of[pair]
        covariance = mixture.covariance[0, mode].copy()
        # A turn that begins has a rate of the long run.
        if mode == 0 and after_of[pair] == 1:
            covariance[OMEGA, OMEGA] = time_constant_s / 2.0 * motion.turn_noise_density
        before = textbook.Normal(mixture.mean[0, mode], covariance)
        predicted, gain = textbook.predict(before, motion, 6.0)
        gain *= dynamics.supported[mode][:, None]  # The rate is no part of the state before
        scale = np.sqrt(np.maximum(np.diag(before.covariance), 1e-12))
        np.testing.assert_allclose(moves.mean[at], predicted.mean, atol=1e-12)
        np.testing.assert_allclose(
            moves.gain[at] / scale[:, None] * scale, gain / scale[:, None] * scale, atol=1e-6
        )
        right = mixture.covariance[0, mode] - gain @ predicted.covariance @ gain.T
        unit = scale[:, None] * scale
        np.testing.assert_allclose(moves.base[at] / unit, right / unit, atol=1e-6)


def test_spawned_targets_are_about_their_predicted_parents():
    dynamics = dynamics_of({"spawn.rate": 0.02})
    parents = mixture_of(dynamics, [(0.9, MEAN, STD), (1e-6, MEAN, STD)])
    found = spawn([AgedMixture(parents, 6.0)], dynamics, 3, 1e-4)
    assert len(found) == 1  # Of the second one, next to nothing could be spawned
    assert found.sums.existence[0] == pytest.approx(0.9 * 0.02)
    assert found.row_label[0] == track_numbers.first_predicted(3) + len(dynamics.model.births)
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
    np.testing.assert_allclose(found.state[0], MEAN * dynamics.supported[2, : len(MEAN)])


def test_an_unseen_target_is_reported_with_its_most_probable_motion():
    dynamics = Dynamics(lone(TWO_MOTIONS).model)
    straight = mixture_of(dynamics, [(0.5, MEAN, STD)])
    turned = mixture_of(dynamics, [(0.4, MEAN + np.array([0.0, -60.0, 5e3, 20.0, 0.0]), 3.0 * STD)])
    other = mixture_of(dynamics, [(0.9, -MEAN, STD)])
    whole = Mixture.concatenate([straight, turned, other])
    weight = np.array(whole.weight)
    weight[0, :, 0], weight[1, :, 0] = [0.45, 0.05], [0.1, 0.3]
    whole = whole.changed(row_label=np.array([0, 0, 1]), weight=weight)
    mean = extract(whole, dynamics, 7, 0, 0.5)
    found = most_probable_motion(mean, whole, np.array([True, True]), 4.0)
    np.testing.assert_allclose(found.state[0], whole.mean[0, 0, : len(MEAN)])
    np.testing.assert_array_equal(found.state[1], mean.state[1])
    np.testing.assert_array_equal(found.covariance[1], mean.covariance[1])
    # The covariance is that of the whole density about the state, not about its mean.
    away = mean.state[0] - found.state[0]
    assert np.hypot(away[0], away[2]) > 1e3
    np.testing.assert_allclose(
        found.covariance[0], mean.covariance[0] + np.outer(away, away), rtol=1e-9, atol=1e-6
    )


def test_extraction_of_nothing_is_nothing():
    dynamics = dynamics_of()
    found = extract(births([], dynamics, 0), dynamics, 7, 0, 0.5)
    assert len(found) == 0
    assert found.class_probability.shape == (0, 2)


def predicted():
    """Return two targets: one of two hypotheses, the second the more probable, and another."""
    model = lone(TWO_MOTIONS).model
    dynamics = Dynamics(model)
    one = mixture_of(dynamics, [(0.2, MEAN, STD)])
    more = mixture_of(dynamics, [(0.5, MEAN + 10.0, STD)])
    other = mixture_of(dynamics, [(0.9, MEAN - 500.0, STD)])
    whole = Mixture.concatenate([one, more, other])
    mixture = replace(whole, row_label=np.array([4, 4, 6]))
    return model, Branched(mixture, np.array([2, 1, 0]))


def lost(target, column, since_s):
    return OutOfGate(np.array(target), np.array(column), np.array(since_s))


def test_reacquired_hypothesis_is_one_of_the_most_probable_one():
    model, before = predicted()
    after = with_reacquired(before, lost([0], [3], [SINCE_S]), model)
    assert after.mixture.row_label.tolist() == [4, 4, 6, 4]
    assert after.parent.tolist() == [2, 1, 0, 1]
    np.testing.assert_array_equal(after.mixture.mean[3], before.mixture.mean[1])
    np.testing.assert_allclose(
        after.mixture.sums.existence, before.mixture.sums.existence, rtol=1e-12
    )
    np.testing.assert_allclose(after.mixture.sums.mass[3], PROBABILITY * 0.7, rtol=1e-12)
    after = with_reacquired(before, lost([0, 0], [0, 1], [SINCE_S, SINCE_S]), model)
    assert after.mixture.row_label.tolist() == [4, 4, 6, 4]


def test_stray_has_the_covariance_of_an_acceleration_by_its_speed():
    model, before = predicted()
    after = with_reacquired(before, lost([0], [0], [SINCE_S]), model)
    added = after.mixture.covariance[3] - before.mixture.covariance[1]
    speed = np.hypot(*before.mixture.mean[1, 0, [1, 3]])
    acceleration = min(ACCELERATION, SPEEDING + TURN_RATE * speed)
    shape = np.array([[SINCE_S**2 / 3.0, SINCE_S / 2.0], [SINCE_S / 2.0, 1.0]])
    expected = (acceleration * SINCE_S) ** 2 * shape
    for axes in ([0, 1], [2, 3]):
        np.testing.assert_allclose(added[:, axes][:, :, axes], [expected, expected], rtol=1e-9)
    np.testing.assert_array_equal(added[:, :2, 2:4], 0.0)
    # The straight motion has no turn rate, and the other one's is any.
    turn = model.detection_births.turn_rate_std**2
    np.testing.assert_allclose(added[:, 4, 4], [0.0, turn], rtol=1e-9)


def test_stray_that_was_long_unseen_is_no_faster_than_new_targets():
    model, before = predicted()
    after = with_reacquired(before, lost([1], [0], [600.0]), model)
    added = after.mixture.covariance[3] - before.mixture.covariance[2]
    speed = model.detection_births.velocity_std
    np.testing.assert_allclose(added[0, 1, 1], speed**2, rtol=1e-9)
    np.testing.assert_allclose(added[0, 0, 0], (600.0 * speed) ** 2 / 3.0, rtol=1e-9)


def test_few_targets_in_little_clutter_are_tracked_by_the_general_profile():
    # Sets of one hypothesis and of none, beside newborn ones.
    config = resolve(sections.read(PROFILE).values("/tracker"))
    for seed in range(12):
        clutter_rate = (0.05, 0.5, 2.0)[seed % 3]
        radars = [
            radar.changed(clutter_rate=clutter_rate)
            for radar in polar_radars(resolve({}).model.radars)
        ]
        scene = paper_scenario(radars)
        scene = replace(scene, scans=16, targets=scene.targets[: seed % 3])
        tracker, run = new_engine(config), simulate(scene, seed)
        for _, scan in run:
            (estimates,) = tracker.step(scan).filtered
            assert np.isfinite(estimates.state).all()
        assert len(estimates) == len(scene.targets)
        apart = np.linalg.norm(run[-1][0].position[:, None] - estimates.position, axis=2)
        assert (apart.min(axis=1, initial=1e9) < 500.0).all()
