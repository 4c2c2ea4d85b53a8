"""False detections behind targets: their density by enumeration, and runs with drawn echoes."""

import lone
import numpy as np
from reference import resolve
from runs import learned

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors import ClutterRate, Multipath
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections, Scan

RADAR = {
    "sensors": ["radar"],
    "births": [],
    "classes": ["boat"],
    "motions": ["straight"],
    "boat.motions": ["straight"],
    "boat.mode_transition": [1.0],
    "straight.model": "constant_velocity",
    "straight.noise_density": 0.1,
    "detection_births.rates": [0.02],
    "detection_births.std": [8.0],
    "spawn.rate": 0.0,
    "amplitude": "none",
    "interval_s": 2.0,
    "radar.fields.amplitude": "",
    "radar.range_std": 5.0,
    "radar.azimuth_std_deg": 1.0,
    "radar.max_range": 3000.0,
    "radar.clutter_max_range": 3000.0,
    "radar.detection_probability": 0.9,
}
RATE, REVOLUTIONS = 5.0, 60


def config_of(**given):
    return resolve({**RADAR, **{f"radar.{name}": value for name, value in given.items()}})


def expected_with(places, existence):
    """Return what multipath makes of a report, given targets at ranges and azimuths, (T, 2)."""
    config = config_of(clutter_rate=5.0)
    dynamics, (radar,) = Dynamics(config.model), config.model.radars
    place = radar.to_world(np.reshape(places, (-1, 2)))
    means = [[x, 0.0, y, 0.0, 0.0] for x, y in place]
    std = [10.0, 1.0, 10.0, 1.0, 0.0]
    targets = [(r, mean, std) for r, mean in zip(existence, means, strict=True)]
    mixture = lone.mixture_of(dynamics, targets) if targets else dynamics.nothing
    report = View.of(radar, Detections(np.zeros((0, 2)), None))
    steps = GaussianSteps(dynamics, config.bounds)
    prior = steps.prior(Branched(mixture, np.arange(len(mixture))), report)
    return Multipath().given(report, prior)


def test_density_is_that_of_each_target_at_its_azimuth_and_behind_it():
    targets, existence = np.array([[500.0, 0.5], [900.0, 3.1], [1500.0, 0.52]]), [0.9, 0.4, 0.7]
    measurement = np.array(
        [[499.0, 0.5], [540.0, 0.5], [540.0, 0.53], [950.0, -3.12], [2000.0, 0.51], [400.0, 1.0]]
    )
    expected = np.zeros(len(measurement))
    for row, (distance, azimuth) in enumerate(measurement):
        for (target, direction), exists in zip(targets, existence, strict=True):
            turned = (azimuth - direction + np.pi) % (2.0 * np.pi) - np.pi
            if distance > target + 6.0 * 5.0:
                share = np.exp(-((turned / np.radians(1.0)) ** 2) / 4.0)
                expected[row] += 100.0 * exists * share
    known = expected_with(targets, existence)
    np.testing.assert_allclose(np.exp(known.log_clutter_factor(measurement)), 1.0 + expected)
    assert expected[[1, 3, 4]].min() > 1.0
    assert expected[[0, 5]].max() == 0.0


def test_no_known_target_leaves_uniform_clutter():
    report = expected_with([], [])
    np.testing.assert_array_equal(report.log_clutter_factor(np.array([[100.0, 0.0]])), 0.0)
    for learn in ([], ["multipath"]):
        factors = config_of(learn=learn).model.factors["radar"]
        assert sum(isinstance(each, Multipath) for each in factors) == len(learn)


def run_of(seed, positions, echoes, wall_std=10.0):
    """Return scans of targets with echoes behind the first one, and the targets, by revolution.

    Parameters
    ----------
    positions : function
        Of the time in seconds; returns the targets' positions, (T, 2).
    echoes : float
        Expected number of echoes of the first target in a revolution.
    wall_std : float
        Standard deviation of their distances behind the target, metres.
    """
    rng, found = np.random.default_rng(seed), []
    for revolution in range(REVOLUTIONS):
        at = positions(2.0 * revolution)
        polar = np.stack([np.hypot(*at.T), np.arctan2(at[:, 1], at[:, 0])], axis=1)
        noise = np.array([5.0, np.radians(1.0)])
        seen = polar[rng.random(len(at)) < 0.9]
        seen = seen + noise * rng.standard_normal(seen.shape)
        # Echoes by way of a wall, whose distance behind the target changes slowly.
        count = rng.poisson(echoes)
        wall = 250.0 + 100.0 * np.sin(0.05 * revolution) + wall_std * rng.standard_normal(count)
        azimuth = polar[0, 1] + noise[1] * rng.standard_normal(count)
        behind = np.stack([polar[0, 0] + wall, azimuth], axis=1)
        uniform = rng.uniform([0.0, -np.pi], [3000.0, np.pi], (rng.poisson(RATE), 2))
        detections = Detections(np.concatenate([seen, behind, uniform]), None)
        found.append((at, Scan((revolution + 1) * 2_000_000_000, (detections,))))
    return found


def missed_and_false(run, learn):
    """Return missed targets and false estimates per revolution after twenty, filtered."""
    given = {"radar.clutter_rate": 5.0, "radar.learn": learn}
    tracker = new_engine(resolve({**RADAR, **given}))
    missed = false = 0
    for revolution, (at, scan) in enumerate(run):
        (estimates,) = tracker.step(scan).filtered
        if revolution < 20:
            continue
        near = np.linalg.norm(estimates.position[:, None] - at, axis=2) < 60.0
        missed += int((~near.any(axis=0)).sum())
        false += int((~near.any(axis=1)).sum())
    return np.array([missed, false]) / (REVOLUTIONS - 20)


def one_target(time_s):
    return np.array([[300.0 + 6.0 * time_s, 200.0 - 2.0 * time_s]])


def two_targets(time_s):
    """Return the positions of targets of which one is 400 m behind the other all the time."""
    first = one_target(time_s)
    return np.concatenate([first, first * (1.0 + 400.0 / np.hypot(*first[0]))])


def test_echoes_of_a_target_do_not_become_targets():
    runs = [run_of(seed, one_target, echoes=0.6) for seed in range(40, 44)]
    plain, known = (
        np.mean([missed_and_false(run, learn) for run in runs], axis=0)
        for learn in ([], ["multipath"])
    )
    assert plain[1] > 0.3
    assert known[1] < 0.4 * plain[1]
    assert known[0] <= plain[0] + 0.02


def test_target_behind_another_one_is_still_tracked():
    runs = [run_of(seed, two_targets, echoes=0.0) for seed in range(50, 54)]
    plain, known = (
        np.mean([missed_and_false(run, learn) for run in runs], axis=0)
        for learn in ([], ["multipath"])
    )
    assert known[0] <= plain[0] + 0.05


def test_learned_rate_does_not_count_echoes():
    rates = []
    for learn in (["clutter"], ["clutter", "multipath"]):
        tracker = new_engine(resolve({**RADAR, "radar.learn": learn}))
        for _, scan in run_of(60, one_target, echoes=4.0, wall_std=400.0):
            tracker.step(scan)
        rates.append(learned(tracker, ClutterRate)["radar"].rate)
    assert rates[0] > RATE + 1.0
    assert abs(rates[1] - RATE) < 1.0
