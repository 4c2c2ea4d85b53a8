"""Classes and amplitudes, and classes that move alike or not."""

from functools import partial

import numpy as np
import pytest
import textbook
from lone import MEAN, STD, UNREDUCED, lone, path, scan_at, started
from scenes import short_scenario, small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.algebra import kalman
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.targets.amplitude_density import of_classes
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.simulation.simulate import simulate

BANDS = {"weak": [5.0, 20.0], "strong": [20.0, 45.0]}
TWINS = ("first", "twin")
SECONDS = 6.0 * np.arange(1, 9)


def classes(given=None, names=("weak", "strong")):
    """Return a configuration of several classes, distinguished by amplitude."""
    table = {"classes": list(names), "radar.detection_probability": 0.0, "amplitude": "band"}
    for name in names:
        table[f"{name}.snr_band_db"] = BANDS[name]
        table[f"{name}.motions"] = ["cv"]
        table[f"{name}.mode_transition"] = [1.0]
        table[f"{name}.survival_probability"] = 1.0
    return lone({**table, "existence": [1e-9, 1e-9], **(given or {})})


@pytest.fixture
def all_iterations(monkeypatch):
    monkeypatch.setattr(kalman, "innovations", partial(kalman.innovations, converged=0.0))


def amplitudes(decibels, rng, count, threshold):
    """Return amplitudes of a target above a threshold."""
    power = 1.0 + 10.0 ** (decibels / 10.0)
    return np.sqrt(threshold**2 - 2.0 * power * np.log(rng.random(count)))


def class_probabilities(engine, observed, radar):
    """Return the filtered class probabilities after each amplitude, shape (K, C)."""
    found = []
    for second, amplitude, state in zip(SECONDS, observed, path(SECONDS), strict=True):
        scan = scan_at(second, radar.measure(state[None]), np.array([amplitude]))
        (estimates,) = engine.step(scan).filtered
        found.append(estimates.class_probability[0])
    return np.array(found)


@pytest.mark.parametrize("decibels", [15.0, 20.0, 30.0])
def test_band_weighs_classes_by_the_density_of_each_amplitude(decibels):
    config = classes()
    (radar,), modes = config.model.radars, config.model.modes
    observed = amplitudes(decibels, np.random.default_rng(0), len(SECONDS), radar.threshold)
    found = class_probabilities(started(config), observed, radar)
    report = View.of(radar, Detections(np.ones((len(observed), 2)), observed))
    log_density = np.cumsum(report.log_class_likelihood(modes.classes), axis=1).T
    expected = np.exp(log_density - log_density.max(axis=1, keepdims=True))
    expected /= expected.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


def test_missed_detections_speak_for_the_weaker_class():
    config = classes()
    (radar,), modes = config.model.radars, config.model.modes
    engine = started(config)
    missed = 1.0 - of_classes(radar.threshold, modes.classes)
    for count in range(1, 4):
        (found,) = engine.step(scan_at(6.0 * count, [])).filtered
        expected = missed**count / (missed**count).sum()
        np.testing.assert_allclose(found.class_probability[0], expected, rtol=1e-6)


def test_missed_detections_speak_for_the_cells_of_weak_targets():
    config = classes({"amplitude": "memory", "memory.jitter": 0.3})
    (radar,), engine = config.model.radars, started(config)
    cells = engine.forward.dynamics.cells
    chain = cells.transition(6.0)
    # Of an envelope whose power is that of noise and target.
    missed = -np.expm1(-0.5 * radar.threshold**2 * np.exp(-cells.log_snr))
    weight = 0.5 * cells.prior
    for count in range(1, 4):
        (found,) = engine.step(scan_at(6.0 * count, [])).filtered
        weight = np.einsum("cs,cst->ct", weight, chain) * missed
        weight /= weight.sum()
        np.testing.assert_allclose(found.class_probability[0], weight.sum(axis=1), rtol=1e-6)


def fine_grid(config, observed, jitter, size=1500):
    """Return the class probabilities of a target whose SNR is on a fine grid, shape (K, C)."""
    modes = config.model.modes
    grids, weights, kernels = [], [], []
    for model in modes.classes:
        low, high = np.log1p(model.snr_band)
        width = (high - low) / size
        centre = low + width * (np.arange(size) + 0.5)
        grids.append(centre)
        weights.append(np.full(size, 0.5 / size))
        kernel = np.zeros((size, size))
        for mirrored in (centre, 2.0 * low - centre, 2.0 * high - centre):
            kernel += np.exp(-0.5 * ((mirrored[None] - centre[:, None]) / jitter) ** 2)
        kernels.append(kernel / kernel.sum(axis=1, keepdims=True))
    found = []
    for amplitude in observed:
        for index, centre in enumerate(grids):
            weight = weights[index] @ kernels[index]
            weights[index] = weight * np.exp(-centre - 0.5 * amplitude**2 * np.exp(-centre))
        total = sum(weight.sum() for weight in weights)
        weights = [weight / total for weight in weights]
        found.append([weight.sum() for weight in weights])
    return np.array(found)


@pytest.mark.parametrize("decibels", [17.0, 20.0, 22.0])
@pytest.mark.parametrize("jitter", [0.1, 0.5])
def test_memory_is_as_accurate_as_a_fine_grid(decibels, jitter):
    config = classes({"amplitude": "memory", "memory.jitter": jitter})
    (radar,) = config.model.radars
    observed = amplitudes(decibels, np.random.default_rng(1), len(SECONDS), radar.threshold)
    found = class_probabilities(started(config), observed, radar)
    # Eleven cells are not a fine grid; the band alone is off by 0.09 to 0.55.
    np.testing.assert_allclose(found, fine_grid(config, observed, jitter), atol=0.012)


def test_amplitudes_that_are_ignored_change_nothing():
    config = classes({"amplitude": "none", "radar.detection_probability": 0.9})
    (radar,) = config.model.radars
    loud, soft = (
        class_probabilities(started(config), np.full(len(SECONDS), level), radar)
        for level in (4.0, 100.0)
    )
    np.testing.assert_array_equal(loud, soft)
    np.testing.assert_allclose(loud, 0.5, rtol=1e-9)


@pytest.mark.parametrize("level", [np.nan, 1e-12, 1e8])
@pytest.mark.parametrize("amplitude", ["band", "memory"])
def test_amplitudes_that_are_unknown_or_extreme_leave_a_distribution(amplitude, level):
    config = classes({"amplitude": amplitude})
    (radar,) = config.model.radars
    found = class_probabilities(started(config), np.full(len(SECONDS), level), radar)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, rtol=1e-9)
    assert (found >= 0.0).all()


@pytest.mark.usefixtures("all_iterations")
def test_classes_of_different_motion_are_weighed_by_what_they_foresaw():
    given = {
        "amplitude": "none",
        "radar.detection_probability": 0.99,
        "motions": ["calm", "wild"],
        "calm.noise_density": 0.5,
        "wild.noise_density": 300.0,
        "weak.motions": ["calm"],
        "strong.motions": ["wild"],
    }
    config = classes(given)
    (radar,), modes = config.model.radars, config.model.modes
    assert len(Dynamics(config.model).motions) == 2
    engine = started(config)
    now = [textbook.initial(motion, MEAN, STD) for motion in modes.motions]
    log_weight, rng = np.zeros(2), np.random.default_rng(2)
    for second, state in zip(SECONDS, path(SECONDS, 0.01), strict=True):
        measured = radar.measure(state[None]) + rng.standard_normal((1, 2)) * radar.noise_std
        (found,) = engine.step(scan_at(second, measured)).filtered
        for index, motion in enumerate(modes.motions):
            later, _ = textbook.predict(now[index], motion, 6.0)
            now[index], evidence = textbook.update(later, radar, measured[0])
            log_weight[index] += evidence
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        np.testing.assert_allclose(found.class_probability[0], weight, rtol=1e-7)
        best = now[int(weight.argmax())]
        np.testing.assert_allclose(found.state[0], best.mean, rtol=1e-8, atol=1e-9)
    assert 0.001 < weight[0] < 0.999


def test_class_of_which_targets_live_longer_gains_while_nothing_is_seen():
    config = classes(
        {
            "amplitude": "none",
            "radar.detection_probability": 0.5,
            "weak.survival_probability": 0.6,
            "strong.survival_probability": 0.95,
        }
    )
    assert len(Dynamics(config.model).motions) == 2
    engine = started(config, (0.8, MEAN, STD))
    mass = np.array([0.4, 0.4])
    for count in range(1, 4):
        (found,) = engine.step(scan_at(6.0 * count, [])).filtered
        mass = mass * [0.6, 0.95]
        mass = 0.5 * mass / (1.0 - 0.5 * mass.sum())
        assert found.weight[0] == pytest.approx(mass.sum(), rel=1e-9)
        np.testing.assert_allclose(found.class_probability[0], mass / mass.sum(), rtol=1e-9)


def run(engine, scans):
    filtered = [found for scan in scans for found in engine.step(scan).filtered]
    return filtered, engine.flush()


@pytest.mark.parametrize("amplitude", ["band", "memory", "none"])
def test_splitting_a_class_into_two_identical_ones_changes_nothing(amplitude):
    scans = [scan for _, scan in simulate(short_scenario(8), 1)]
    given = {
        "lag": 3,
        "amplitude": amplitude,
        "spawn.rate": 0.0,
        "existence": [0.1, 0.1],
    }
    one = small(given)
    bands = {f"{name}.snr_band_db": one.values["class_1.snr_band_db"] for name in TWINS}
    modes = {
        f"{n}.mode_transition": one.values["class_0.mode_transition"] for n in ("class_0", *TWINS)
    }
    halves = {f"start_{k}.rates": [0.005, 0.0025, 0.0025] for k in (1, 2, 3, 4)}
    two = small(
        {
            **given,
            **bands,
            **modes,
            **halves,
            "classes": ["class_0", *TWINS],
            "class_0.snr_band_db": one.values["class_0.snr_band_db"],
        }
    )
    (filtered, smoothed), (others, split) = run(new_engine(one), scans), run(new_engine(two), scans)
    assert sum(map(len, filtered)) > 10
    for ours, theirs in zip([*filtered, *smoothed], [*others, *split], strict=True):
        np.testing.assert_array_equal(ours.track_id, theirs.track_id)
        np.testing.assert_allclose(ours.weight, theirs.weight, rtol=1e-6)
        merged = np.column_stack(
            [theirs.class_probability[:, 0], theirs.class_probability[:, 1:].sum(axis=1)]
        )
        np.testing.assert_allclose(ours.class_probability, merged, atol=1e-6)
        # The majority may be another one: the state is that of the majority's class.
        same = (ours.class_id > 0) == (theirs.class_id > 0)
        assert same.mean() > 0.6
        np.testing.assert_allclose(ours.state[same], theirs.state[same], rtol=1e-6, atol=1e-6)


def test_classes_that_move_alike_share_their_gaussians_and_it_makes_no_difference():
    scans = [scan for _, scan in simulate(short_scenario(8), 2)]
    given = {
        "amplitude": "band",
        "lag": 3,
        "existence": [0.1, 0.1],
        **UNREDUCED,
    }
    given["bounds.hypotheses"] = 60
    shared = small({**given, "class_1.survival_probability": 0.99})
    # A difference that nobody can see keeps the engine from sharing.
    apart = small({**given, "class_1.survival_probability": 0.99 * (1.0 - 1e-13)})
    assert len(Dynamics(shared.model).motions) == 2
    assert len(Dynamics(apart.model).motions) == 4
    (filtered, smoothed), (others, rest) = (
        run(new_engine(shared), scans),
        run(new_engine(apart), scans),
    )
    assert sum(map(len, filtered)) > 10
    for ours, theirs in zip([*filtered, *smoothed], [*others, *rest], strict=True):
        np.testing.assert_array_equal(ours.track_id, theirs.track_id)
        np.testing.assert_allclose(ours.weight, theirs.weight, rtol=1e-3)
        np.testing.assert_allclose(ours.class_probability, theirs.class_probability, atol=1e-3)
        np.testing.assert_allclose(ours.position, theirs.position, atol=1.0)


def test_classes_may_have_different_numbers_of_motions():
    config = classes(
        {
            "motions": ["cv", "ct"],
            "ct.model": "coordinated_turn",
            "weak.motions": ["cv", "ct"],
            "weak.mode_transition": [0.9, 0.1, 0.1, 0.9],
        }
    )
    (radar,), dynamics = config.model.radars, Dynamics(config.model)
    assert dynamics.mode_of.tolist() == [0, 1, 2]
    observed = np.full(len(SECONDS), 30.0)
    found = class_probabilities(started(config), observed, radar)
    # The band decides, and the motion says little of a target that flies straight on.
    assert (np.diff(found[:, 1]) > 0.0).all()
