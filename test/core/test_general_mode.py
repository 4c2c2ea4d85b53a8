"""The PHD filter is one algorithm over any mode space: what must not matter does not matter."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import plain, short_scenario, small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.simulation.simulate import simulate
from phd_jdtc_ros.simulation.targets import TargetScript

SEEDS = 12
SCANS = 6


def scans_for(radars, snr):
    target = TargetScript(0, snr, (8e3, 6e3), (-30.0, 20.0), 0, SCANS - 1)
    scenario = replace(short_scenario(SCANS), targets=(target,), radars=radars)
    return [scan for _, scan in simulate(scenario, 2)]


def statistics(given, make, scans):
    """Return masses, moments and class shares of every seed, shape (seeds, figures)."""
    figures = []
    for seed in range(SEEDS):
        engine = new_engine(make({**given, "engine": "phd", "seed": seed}))
        steps = [engine.step(scan) for scan in scans]
        smoothed = [e for step in steps for e in step.smoothed] + list(engine.flush())
        last, middle = steps[-1].filtered[0], smoothed[2]
        assert len(last) == len(middle) == 1
        figures.append(
            [
                *steps[1].class_mass,
                *steps[-1].class_mass,
                *last.class_probability[0],
                *middle.class_probability[0],
                *last.state[0, :4],
                *middle.state[0, :4],
                last.covariance[0, 0, 0],
                middle.covariance[0, 0, 0],
                middle.weight[0],
            ]
        )
    return np.array(figures)


def assert_same_distribution(first, second):
    """Compare means by their Monte Carlo error over independent seeds.

    Five standard errors: some twenty figures are compared, each with an error that is itself
    known from twelve runs.
    """
    error = np.sqrt((first.var(axis=0, ddof=1) + second.var(axis=0, ddof=1)) / SEEDS)
    difference = np.abs(first.mean(axis=0) - second.mean(axis=0))
    assert (difference <= 5.0 * error + 1e-9).all()


BUDGET = {"particles": [400, 512], "lag": 2}
PLAIN = {**BUDGET, "radar.clutter_rate": 5.0}
TWINS = {
    "motions": ["cv", "twin"],
    "target.motions": ["cv", "twin"],
    "target.mode_transition": [0.8, 0.2, 0.2, 0.8],
}


@pytest.fixture(scope="module")
def one_mode():
    scans = scans_for(plain(PLAIN).model.radars, 1e4)
    return scans, statistics(PLAIN, plain, scans)


def test_splitting_a_mode_into_twins_changes_nothing_unless_they_are_unequal(one_mode):
    scans, expected = one_mode
    assert_same_distribution(statistics({**PLAIN, **TWINS}, plain, scans), expected)
    # The comparison has power: a second mode with other noise differs from a twin.
    given = {**PLAIN, **TWINS, "twin.noise_density": 300.0}
    with pytest.raises(AssertionError):
        assert_same_distribution(statistics(given, plain, scans), expected)


REFERENCE = {
    **BUDGET,
    "births": ["start"],
    "start.position": [8e3, 6e3],
    "start.rates": [0.006, 0.003],
    "class_1.survival_probability": 0.95,
}
PERMUTED = {
    **REFERENCE,
    "class_0.snr_band_db": [10.0, 30.0],
    "class_1.snr_band_db": [30.0, 50.0],
    "class_0.survival_probability": 0.95,
    "class_1.survival_probability": 0.99,
    "start.rates": [0.003, 0.006],
}


def test_permuting_the_classes_permutes_the_estimates():
    # An amplitude between the bands, so that both classes keep some mass.
    scans = scans_for(small(REFERENCE).model.radars, 10.0**2.9)
    straight = statistics(REFERENCE, small, scans)
    swapped = statistics(PERMUTED, small, scans)
    pairs = swapped[:, :8].reshape(SEEDS, 4, 2)[:, :, ::-1].reshape(SEEDS, 8)
    assert_same_distribution(np.concatenate([pairs, swapped[:, 8:]], axis=1), straight)
    # Both classes did take part.
    assert 0.01 < straight[:, 0].mean() / straight[:, :2].sum(axis=1).mean() < 0.99
