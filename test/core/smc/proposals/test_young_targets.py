"""Whether young targets with range rates are as uncertain as the engine of particles says."""

import numpy as np
from lone import lone, scan_at

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.evaluation.accumulators.mahalanobis import mahalanobis2

DT = 0.1
ROAD = {
    "engine": "particles",
    "interval_s": DT,
    "births": [],
    "detection_births.rates": [0.1],
    "detection_births.velocity_std": 12.0,
    "detection_births.particles": 256,
    "particles_per_target": 500,
    "cv.noise_density": 1.0,
    "lag": 0,
    "radar.position": [0.0, 0.0],
    "radar.yaw_deg": 0.0,
    "radar.range_std": 0.3,
    "radar.azimuth_std_deg": 0.5,
    "radar.max_range": 200.0,
    "radar.clutter_max_range": 200.0,
    "radar.clutter_rate": 1.0,
    "radar.detection_probability": 0.95,
    "radar.fields.range_rate": "range_rate",
    "radar.range_rate_std": 0.15,
    "radar.range_rate_ambiguity": 40.0,
}
TARGETS, SCANS, RUNS = 12, 13, 6


def scene(seed, radar):
    """Return the true states and the scan of each time: cars far apart, each detected always."""
    rng = np.random.default_rng([7, seed])
    angle = 2.0 * np.pi * np.arange(TARGETS) / TARGETS - 3.0
    state = np.zeros((TARGETS, 5))
    distance = rng.uniform(30.0, 150.0, TARGETS)
    state[:, [0, 2]] = distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # About half of the velocity's prior: how its tails are followed is another matter.
    state[:, [1, 3]] = 7.0 * rng.standard_normal((TARGETS, 2))
    found = []
    for number in range(1, SCANS + 1):
        state = state.copy()
        state[:, [0, 2]] += DT * state[:, [1, 3]]
        seen = radar.measure(state) + rng.standard_normal((TARGETS, 2)) * radar.noise_std
        rate = radar.range_rate_of(state) + 0.15 * rng.standard_normal(TARGETS)
        scan = scan_at(DT * number, seen, range_rate=radar.range_rate.wrapped(rate))
        found.append((state, scan))
    return found


def squares(seed):
    """Return the squared Mahalanobis distances of all estimates from the third scan on."""
    config = lone({**ROAD, "seed": seed})
    tracker = new_engine(config)
    found = []
    for number, (truth, scan) in enumerate(scene(seed, config.model.radars[0])):
        (estimates,) = tracker.step(scan).filtered
        place = truth[:, [0, 2]]
        nearest = np.hypot(*(estimates.position[:, None] - place).transpose(2, 0, 1)).argmin(axis=1)
        axes = list(estimates.space.position)
        covariance = estimates.covariance[:, axes][:, :, axes]
        if number >= 2:
            found.append(mahalanobis2(estimates.position - place[nearest], covariance))
    return np.concatenate(found)


def test_young_targets_with_range_rates_are_as_uncertain_as_their_covariances_say():
    square = np.concatenate([squares(seed) for seed in range(RUNS)])

    assert len(square) > 0.95 * TARGETS * (SCANS - 2) * RUNS
    # Right covariances have 1 and 1.1 %. Particles that are not regularised have 3.6 and 14 %.
    assert 0.7 < 0.5 * square.mean() < 2.0
    assert (square > 9.0).mean() < 0.08


def test_the_smoother_knows_whom_regularised_particles_come_from():
    config = lone({**ROAD, "lag": 3})
    tracker = new_engine(config)
    steps = [tracker.step(scan) for _, scan in scene(0, config.model.radars[0])]
    # From where they were moved to, a quarter of them is beyond the reach of any transition.
    assert sum(step.figures["particles"] for step in steps) > 20_000
    assert sum(step.figures["orphans"] for step in steps) == 0
