"""Covariances of targets whose births, motions and measurements are drawn from the model."""

import numpy as np
import pytest
from lone import INTERVAL_S, TWO_MOTIONS, lone, scan_at, started

from phd_jdtc_ros.core.targets.motion import sample

TARGETS, SCANS, LAG = 225, 16, 5
STD = np.array([300.0, 30.0, 300.0, 30.0, 2e-3])
GIVEN = {
    **TWO_MOTIONS,
    "cv.noise_density": 0.2,
    "ct.noise_density": 1.0,
    "ct.turn_noise_density": 1e-4,
    "target.mode_transition": [0.95, 0.05, 0.1, 0.9],
    "radar.detection_probability": 0.95,
    "radar.range_std": 150.0,
    "radar.azimuth_std_deg": 0.05,
    "radar.max_range": 4e5,
    "radar.clutter_max_range": 4e5,
    "lag": LAG,
}
ALWAYS_TURNING = {"target.mode_transition": [0.0001, 0.9999, 0.0001, 0.9999]}


def paths(config, rng):
    """Return the states of targets far from each other at the start and at each scan, (K, T, D)."""
    modes = config.model.modes
    side = int(np.sqrt(TARGETS))
    start = np.zeros((TARGETS, 5))
    start[:, [0, 2]] = 25e3 * (np.indices((side, side)).reshape(2, -1).T - 0.5 * side) + 7e3
    mode = rng.integers(0, 2, TARGETS)
    state = start + STD * rng.standard_normal(start.shape)
    state[mode == 0, 4] = 0.0
    states = [state]
    for _ in range(SCANS):
        stays = rng.random(TARGETS) < modes.transition(INTERVAL_S)[mode, mode]
        mode = np.where(stays, mode, 1 - mode)
        later = np.empty_like(state)
        for index, motion in enumerate(modes.motions):
            own = mode == index
            later[own] = sample(motion, states[-1][own], INTERVAL_S, rng)
        states.append(later)
    return start, states


def outside(found, states):
    """Return which positions are outside of three standard deviations of their estimates."""
    scan = round((found.stamp_ns - 10**12) / (1e9 * INTERVAL_S))
    error = (found.state - states[scan][found.track_id - 1])[:, [0, 2]]
    covariance = found.covariance[:, [0, 2]][:, :, [0, 2]]
    square = np.einsum("ti,ti->t", error, np.linalg.solve(covariance, error[:, :, None])[..., 0])
    return square > 9.0


@pytest.mark.parametrize("given", [{}, ALWAYS_TURNING], ids=["both motions", "turning"])
def test_positions_of_drawn_targets_are_outside_three_sigma_in_two_of_a_hundred(given):
    rng = np.random.default_rng(21)
    config = lone({**GIVEN, **given})
    (radar,) = config.model.radars
    start, states = paths(config, rng)
    engine = started(config, *((0.999, one, STD) for one in start))
    filtered, smoothed = [], []
    for scan in range(1, SCANS + 1):
        exact = radar.measure(states[scan])
        plots = exact + radar.noise_std * rng.standard_normal(exact.shape)
        step = engine.step(scan_at(scan * INTERVAL_S, plots[rng.random(TARGETS) < 0.95]))
        filtered += step.filtered
        smoothed += step.smoothed
    for every in (filtered, smoothed):
        share = np.concatenate([outside(found, states) for found in every])
        assert len(share) > 0.9 * TARGETS * len(every)
        # It is 1.1 % for normal densities; mixtures of motions have longer tails.
        assert 0.002 < share.mean() < 0.02
