"""The two engines on the same scenes: they differ by the particles' random error."""

import inner
import numpy as np
from lone import scan_at

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.smc import extraction

REPEATS = 5
PARTICLES = 1_000
SCANS = 7
GIVEN = {
    "sensors": ["radar"],
    "classes": ["slow", "fast"],
    "motions": ["calm", "wild"],
    "births": ["south", "north"],
    "interval_s": 6.0,
    "amplitude": "band",
    "lag": 4,
    "confirm_probability": 0.2,
    "delete_probability": 0.2,
    "particles_per_target": PARTICLES,
    "budget.least": 500,
    "particles_per_birth": 16_384,
    "spawn.rate": 0.0,
    "slow.snr_band_db": [15.0, 30.0],
    "fast.snr_band_db": [10.0, 25.0],
    "calm.noise_density": 1.0,
    "wild.noise_density": 30.0,
    # Narrow enough for one linearisation to be right.
    "radar.range_std": 60.0,
    "radar.azimuth_std_deg": 0.4,
    "radar.clutter_rate": 30.0,
    "bounds.hypotheses": 100,
    "bounds.least_share": 1e-6,
    "bounds.merge_distance": 0.01,
    **{
        f"{name}.{key}": value
        for name in ("slow", "fast")
        for key, value in {
            "motions": ["calm" if name == "slow" else "wild"],
            "mode_transition": [1.0],
            "survival_probability": 0.98,
        }.items()
    },
    **{
        f"{name}.{key}": value
        for name, y, vy in (("south", 5e3, 20.0), ("north", 5.6e3, -20.0))
        for key, value in {
            "position": [5e3, y],
            "velocity": [60.0, vy],
            "rates": [0.05, 0.05],
            "position_std": 100.0,
            "velocity_std": 20.0,
        }.items()
    },
}


def configuration(engine, seed=0):
    return inner.resolve({**GIVEN, "engine": engine, "seed": seed})


def crossing(radar, seed):
    """Return scans of two targets that cross, with false and missed detections."""
    rng = np.random.default_rng(seed)
    scans = []
    for second in 6.0 * np.arange(1, SCANS + 1):
        since = second - 6.0
        targets = np.array(
            [
                [5e3 + 60.0 * since, 60.0, 5.0e3 + 10.0 * since, 10.0, 0.0],
                [5e3 + 60.0 * since, 60.0, 5.6e3 - 10.0 * since, -10.0, 0.0],
            ]
        )
        seen = radar.measure(targets) + rng.standard_normal((2, 2)) * radar.noise_std
        seen = seen[rng.random(2) < 0.85]
        false = np.column_stack([rng.uniform(5e3, 9e3, 6), rng.uniform(0.4, 1.0, 6)])
        amplitude = np.concatenate(
            [
                radar.threshold + 6.0 * rng.random(len(seen)),
                np.sqrt(radar.threshold**2 - 2.0 * np.log(rng.random(6))),
            ]
        )
        scans.append(scan_at(second, np.concatenate([seen, false]), amplitude))
    return scans


def estimates_of(engine, scans):
    steps = [engine.step(scan) for scan in scans]
    filtered = [found for step in steps for found in step.filtered]
    smoothed = [found for step in steps for found in step.smoothed]
    return [*filtered, *smoothed, *engine.flush()]


def figures(found):
    """Return existence, probability of the first class, and the state of each target."""
    order = np.argsort(found.track_id)
    columns = [found.weight, found.class_probability[:, 0], *found.state.T[:4]]
    return np.column_stack(columns)[order]


def deviations(found):
    order = np.argsort(found.track_id)
    return np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))[order, :4]


def slack_of(found):
    """Return what is no random error: linearised measurements and merged hypotheses."""
    return np.column_stack([np.full((len(found), 2), 0.01), 0.05 * deviations(found)])


def agree(ours, runs, slack):
    """Compare figures with their mean over runs that differ in the seed only."""
    error = 5.0 * np.std(runs, axis=0, ddof=1) / np.sqrt(len(runs))
    np.testing.assert_array_less(np.abs(ours - np.mean(runs, axis=0)), error + slack)


def test_engines_agree_on_targets_that_cross_within_the_random_error_of_particles(monkeypatch):
    # Particles state the uncertainty of their own small number too; Gaussians have none.
    monkeypatch.setattr(extraction, "PRIOR_PARTICLES", 0.0)
    config = configuration("gaussian")
    scans = crossing(config.model.radars[0], seed=3)
    ours = estimates_of(new_engine(config), scans)
    runs = [
        estimates_of(new_engine(configuration("particles", seed)), scans) for seed in range(REPEATS)
    ]
    assert len(ours) == 2 * SCANS
    compared = 0
    for index, found in enumerate(ours):
        others = [run[index] for run in runs]
        if any(len(other) != len(found) for other in others):
            # At the threshold chance decides.
            weight = np.concatenate([each.weight for each in (found, *others)])
            assert np.abs(weight - 0.2).min() < 0.03
            continue
        if not len(found):
            continue
        agree(figures(found), [figures(other) for other in others], slack=slack_of(found))
        spread = [deviations(other) for other in others]
        agree(deviations(found), spread, slack=0.05 * deviations(found))
        compared += len(found)
    assert compared >= 2 * SCANS
