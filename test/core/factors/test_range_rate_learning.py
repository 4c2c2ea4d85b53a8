"""Noise of range rates that an engine learns of a Doppler radar that is set wrongly.

The tests draw targets from the motion model and their detections from the radar's.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from lone import lone, scan_at

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.evaluation.metrics import ospa

TARGETS, SCANS = 5, 50
SEEDS = range(6)
DENSITY, STD = 0.05, 0.5
SCENE = {
    "interval_s": 1.0,
    "lag": 0,
    "detection_births.rates": [0.05],
    "detection_births.std": [12.0, 2e-3],
    "cv.noise_density": DENSITY,
    "radar.position": [0.0, 0.0],
    "radar.yaw_deg": 0.0,
    "radar.range_std": 10.0,
    "radar.azimuth_std_deg": 0.5,
    "radar.max_range": 3e3,
    "radar.clutter_max_range": 3e3,
    "radar.clutter_rate": 3.0,
    "radar.detection_probability": 0.9,
    "radar.fields.range_rate": "range_rate",
    "radar.range_rate_ambiguity": 40.0,
}
RATIO = "radar.range_rate_noise_ratio"
AUTO = "learned"


def config_of(std, **given):
    """Return the configuration of a tracker with this noise of range rates, or that learns it."""
    learn = {"radar.learn": ["noise"], "radar.range_rate_std": STD}
    return lone({**SCENE, **(learn if std == AUTO else {"radar.range_rate_std": std}), **given})


def run_of(seed, std, scans=SCANS, **given):
    """Return the states of the targets and the scans of a radar with this noise."""
    rng, (radar,) = np.random.default_rng(seed), config_of(std).model.radars
    state = np.zeros((TARGETS, 5))
    angle = np.arange(TARGETS) * 2.0 * np.pi / TARGETS
    state[:, [0, 2]] = 1e3 * np.column_stack([np.cos(angle), np.sin(angle)])
    state[:, [1, 3]] = rng.normal(0.0, 8.0, (TARGETS, 2))
    of_step = np.linalg.cholesky(DENSITY * np.array([[1.0 / 3.0, 0.5], [0.5, 1.0]]))
    truth, found = [], []
    for number in range(1, scans + 1):
        state[:, [0, 2]] += state[:, [1, 3]]
        for place in (0, 2):
            state[:, place : place + 2] += rng.standard_normal((TARGETS, 2)) @ of_step.T
        seen = rng.random(TARGETS) < 0.9
        measured = radar.measure(state) + rng.standard_normal((TARGETS, 2)) * radar.noise_std
        rate = radar.range_rate_of(state) + std * rng.standard_normal(TARGETS)
        false = rng.poisson(3.0)
        place = np.column_stack([rng.uniform(0.0, 3e3, false), rng.uniform(-np.pi, np.pi, false)])
        rates = np.concatenate([rate[seen], rng.uniform(-20.0, 20.0, false)])
        truth.append(state.copy())
        found.append(
            scan_at(
                float(number),
                np.concatenate([measured[seen], place]),
                range_rate=radar.range_rate.wrap(rates),
                **{name: np.full(len(rates), value) for name, value in given.items()},
            )
        )
    return truth, found


def figures(config, scans):
    engine = new_engine(config)
    return [engine.step(scan) for scan in scans][-1].figures


@cache
def tracked(seed, factor, std):
    """Return the last figures of a tracker with the noise `std`, and mean OSPA distances, (2,).

    The distances are of positions and velocities in the second half; the radar's noise is `factor`
    times `STD`.
    """
    (truth, scans), engine, found = run_of(seed, factor * STD), new_engine(config_of(std)), []
    for state, scan in zip(truth, scans, strict=True):
        step = engine.step(scan)
        (own,) = step.filtered
        place = ospa(state[:, [0, 2]], own.position, 100.0, 2.0).distance
        found.append([place, ospa(state[:, [1, 3]], own.velocity, 10.0, 2.0).distance])
    return step.figures, np.mean(found[SCANS // 2 :], axis=0)


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_noise_is_found_within_its_deviation(factor):
    found = [tracked(seed, factor, AUTO)[0] for seed in SEEDS]
    normal = [(each[RATIO] - factor) / each[f"{RATIO}_std"] for each in found]
    assert np.sqrt(np.mean(np.square(normal))) < 1.6
    assert np.mean([each[RATIO] for each in found]) == pytest.approx(factor, rel=0.1)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_tracker_that_learns_comes_near_one_with_the_true_noise(factor):
    of_true, of_learned, of_wrong = (
        np.mean([tracked(seed, factor, std)[1] for seed in SEEDS], axis=0)
        for std in (factor * STD, AUTO, STD)
    )
    assert (of_learned < 1.1 * of_true).all()
    assert (of_learned < of_wrong).all()


@pytest.mark.parametrize(
    ("ambiguity", "given"),
    [
        pytest.param(0.0, {"range_rate_std": STD}, id="of their own"),
        pytest.param(10.0 * STD, {}, id="of any fold"),
    ],
)
def test_range_rates_teach_nothing(ambiguity, given):
    parameters = {"radar.range_rate_ambiguity": ambiguity}
    config = config_of(AUTO, **parameters)
    _, scans = run_of(1, 2.0 * STD, scans=12, **given)
    (radar,) = config.model.radars
    scans = [
        replace(
            scan,
            detections=tuple(
                replace(each, range_rate=radar.range_rate.wrap(each.range_rate))
                for each in scan.detections
            ),
        )
        for scan in scans
    ]
    assert figures(config, scans)[RATIO] == 1.0
