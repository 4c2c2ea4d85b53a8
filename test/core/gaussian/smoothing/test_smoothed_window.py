"""What a whole window says of each scan, against solutions that take all its scans at once."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import textbook
from lone import GIVEN, MEAN, STD, TWO_MOTIONS, lone, path, scan_at, started
from scipy.linalg import block_diag

from phd_jdtc_ros.core.gaussian.algebra import kalman
from phd_jdtc_ros.core.gaussian.smoothing import smoother

SECONDS = np.cumsum([6.0, 0.4, 11.0, 6.0, 25.0, 3.0, 7.0, 60.0])
EVEN = 6.0 * np.arange(1, 8)


@pytest.fixture(autouse=True)
def _all_iterations(monkeypatch):
    """Let every update take all its iterations, so that it can be compared to the last digit."""
    monkeypatch.setattr(kalman, "innovations", partial(kalman.innovations, converged=0.0))


def smoothed(engine):
    """Return the smoothed mixtures of an engine's window, oldest first."""
    return smoother.backward_pass(engine._window)[::-1]


def measured_at(config, seconds, turn_rate=0.0, seed=0):
    (radar,) = config.model.radars
    noise = np.random.default_rng(seed).standard_normal((len(seconds), 2))
    return radar.measure(path(seconds, turn_rate)) + noise * radar.noise_std


def least_squares(radar, seconds, measured, density):
    """Return the means and covariances of all states, given all plots: one system of equations.

    A residual for the start, one for each move between two scans, and one for each plot, divided
    by their deviations. The radar is so far away that its rays are parallel.
    """
    count, size = len(seconds), 4
    blocks, right = [], []

    def add(parts, value, covariance):
        row = np.zeros((len(value), size * (count + 1)))
        for index, matrix in parts.items():
            row[:, size * index : size * (index + 1)] = matrix
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        blocks.append(whiten @ row)
        right.append(whiten @ value)

    add({0: np.eye(4)}, MEAN[:4], np.diag(STD[:4] ** 2))
    moves = np.diff(np.append(0.0, seconds))
    for index, (dt, plot) in enumerate(zip(moves, measured, strict=True), start=1):
        move, noise = np.eye(4), np.zeros((4, 4))
        for axis in (0, 2):
            move[axis, axis + 1] = dt
            noise[axis : axis + 2, axis : axis + 2] = density * np.array(
                [[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]]
            )
        add({index - 1: -move, index: np.eye(4)}, np.zeros(4), noise)
        x, y = radar.position
        seen = np.zeros((2, 4))
        seen[0, 0] = seen[1, 2] = 1.0
        about = np.array([x + plot[0], y + plot[0] * plot[1]])
        add({index: seen}, about, np.diag([radar.range_std, plot[0] * radar.azimuth_std]) ** 2)
    matrix = np.concatenate(blocks)
    covariance = np.linalg.inv(matrix.T @ matrix)
    mean = covariance @ (matrix.T @ np.concatenate(right))
    parts = [slice(size * index, size * (index + 1)) for index in range(1, count + 1)]
    return [(mean[part], covariance[part, part]) for part in parts]


def test_smoothed_states_are_those_of_least_squares_over_all_scans():
    far = 2e8
    config = lone(
        {
            "lag": len(SECONDS),
            "radar.position": [-far, 0.0],
            "radar.yaw_deg": 0.0,
            "radar.max_range": 4e8,
            "radar.range_std": 150.0,
            "radar.azimuth_std_deg": float(np.degrees(100.0 / far)),
        }
    )
    (radar,) = config.model.radars
    measured = measured_at(config, SECONDS)
    engine = started(config)
    for second, plot in zip(SECONDS, measured, strict=True):
        engine.step(scan_at(second, plot))
    expected = least_squares(radar, SECONDS, measured, GIVEN["cv.noise_density"])
    found = smoothed(engine)
    assert len(found) == len(expected)
    for mixture, (mean, covariance) in zip(found, expected, strict=True):
        std = np.sqrt(np.diag(covariance))
        # At 8 km across, the rays of a radar so far away are off by 0.2 m, of 100 m.
        np.testing.assert_allclose((mixture.mean[0, 0, :4] - mean) / std, 0.0, atol=5e-3)
        scale = std[:, None] * std
        np.testing.assert_allclose(
            mixture.covariance[0, 0, :4, :4] / scale, covariance / scale, atol=1e-3
        )


def test_smoothed_classes_are_those_of_a_hidden_markov_chain_over_their_cells():
    names = ("weak", "strong")
    given = {
        "classes": list(names),
        "amplitude": "memory",
        "memory.jitter": 0.5,
        "radar.detection_probability": 0.0,
        "lag": len(EVEN),
    }
    for name, band in zip(names, ([5.0, 20.0], [15.0, 45.0]), strict=True):
        given[f"{name}.snr_band_db"] = band
        given[f"{name}.motions"], given[f"{name}.mode_transition"] = ["cv"], [1.0]
        given[f"{name}.survival_probability"] = 1.0
    config = lone(given)
    (radar,) = config.model.radars
    engine = started(config)
    dynamics = engine.forward.dynamics
    amplitudes = np.random.default_rng(3).uniform(4.0, 15.0, len(EVEN))
    begin = 0.5 * dynamics.cells.prior.ravel()  # As `started` has it
    forward, chain, likelihoods = [], block_diag(*dynamics.cells.transition(6.0)), []
    for index, second in enumerate(EVEN):
        place = radar.measure(path([second]))
        engine.step(scan_at(second, place, amplitudes[index : index + 1]))
        # The density of a Rayleigh envelope, times what is the same in all cells.
        power = np.exp(dynamics.cells.log_snr.ravel())
        likelihoods.append(np.exp(-0.5 * amplitudes[index] ** 2 / power) / power)
        prior = begin if not forward else forward[-1]
        forward.append(prior @ chain * likelihoods[-1])
    backward = [np.ones(len(begin))]
    for likelihood in likelihoods[:0:-1]:
        backward.insert(0, chain @ (likelihood * backward[0]))
    for mixture, before, after in zip(smoothed(engine), forward, backward, strict=True):
        expected = (before * after).reshape(len(names), -1).sum(axis=1)
        np.testing.assert_allclose(mixture.weight[0, 0], expected / expected.sum(), rtol=1e-7)


def test_classes_with_one_and_two_motions_have_a_textbook_smoother_each():
    config = lone(
        {
            "lag": 4,
            "classes": ["plain", "agile"],
            "motions": ["calm", "cv", "ct"],
            "calm.noise_density": 0.3,
            "ct.model": "coordinated_turn",
            "ct.noise_density": 2.0,
            "ct.turn_noise_density": 1e-5,
            "plain.motions": ["calm"],
            "plain.mode_transition": [1.0],
            "plain.survival_probability": 1.0,
            "agile.motions": ["cv", "ct"],
            "agile.mode_transition": [0.9, 0.1, 0.25, 0.75],
            "agile.survival_probability": 1.0,
        }
    )
    (radar,), modes = config.model.radars, config.model.modes
    measured = measured_at(config, EVEN[:5], turn_rate=0.02)
    engine = started(config)
    steps = {}
    for index, one in enumerate(modes.classes):
        own = [modes.motions[mode] for mode in np.flatnonzero(modes.class_of == index)]
        parts = [textbook.initial(motion, MEAN, STD) for motion in own]
        steps[index] = own, [textbook.first_step(np.full(len(own), 1.0 / len(own)), parts)], one
    for second, plot in zip(EVEN, measured, strict=False):
        engine.step(scan_at(second, plot))
        for own, passed, one in steps.values():
            chain = one.mode_transition
            passed.append(textbook.imm(passed[-1], own, chain, 6.0, [(radar, plot, 0.0)]))
    found = smoothed(engine)
    first = 0
    for own, passed, _ in steps.values():
        last = first + len(own)
        smoothed_weight = found[-1].weight[0, first:last].sum()
        for index, mixture in enumerate(found, start=len(passed) - len(found)):
            probability, parts = textbook.imm_smoothed(passed[index:], own)
            weight = mixture.sums.mode_weight[0, first:last]
            # All that survives is of the class that it is of in the end.
            assert weight.sum() == pytest.approx(smoothed_weight, rel=1e-9)
            np.testing.assert_allclose(weight / weight.sum(), probability, rtol=1e-8)
            for mode, part in enumerate(parts, start=first):
                mean = part.mean
                np.testing.assert_allclose(mixture.mean[0, mode], mean, rtol=1e-8, atol=1e-9)
        first = last
    assert 0.01 < found[-1].weight[0, :1].sum() < 0.99  # Both classes matter


def test_target_that_was_dropped_has_died_or_never_was():
    existence, survival = 0.3, 0.9
    config = lone({"lag": 3, "target.survival_probability": survival, **TWO_MOTIONS})
    engine = started(config, (existence, MEAN, STD))
    engine.step(scan_at(6.0, []))
    (before,) = (entry.stored for entry in engine._window)
    engine.forward.bounds = replace(engine.forward.bounds, least_existence=0.9)
    engine.step(scan_at(12.0, []))
    earlier, later = smoothed(engine)
    assert len(later) == 0
    alive = before.sums.existence[0]
    expected = alive * (1.0 - survival) / (1.0 - alive * survival)
    np.testing.assert_allclose(earlier.sums.existence, expected, rtol=1e-12)
    np.testing.assert_allclose(earlier.mean, before.mean, rtol=1e-12)
    np.testing.assert_allclose(earlier.covariance, before.covariance, rtol=1e-12)


@pytest.mark.parametrize("motions", [{}, TWO_MOTIONS], ids=["one motion", "two motions"])
def test_merged_hypotheses_hand_all_their_weight_back(motions):
    config = lone(
        {
            "lag": 6,
            "radar.clutter_rate": 30.0,
            "radar.detection_probability": 0.8,
            "radar.clutter_max_range": 2e4,
            "bounds.merge_distance": 4.0,
            **motions,
        }
    )
    (radar,) = config.model.radars
    engine, rng, merged = started(config, (0.9, MEAN, STD)), np.random.default_rng(2), 0
    for second, state in zip(EVEN, path(EVEN), strict=True):
        plots = radar.measure(state[None]) + 2.0 * rng.standard_normal((4, 2)) * radar.noise_std
        engine.step(scan_at(second, plots))
        child = engine._window[-1].link.ancestry.child
        merged += len(child) - len(set(child.tolist()))
    assert merged > 10
    found = smoothed(engine)
    for mixture in found:
        # Nobody dies, so all is there from the start as it is in the end.
        np.testing.assert_allclose(mixture.sums.existence, found[-1].sums.existence, rtol=1e-9)
        assert (mixture.weight >= 0.0).all()
