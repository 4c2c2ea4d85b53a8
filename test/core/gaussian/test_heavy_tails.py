"""Radars with heavy-tailed noise, which the tests draw: Student's t with outliers."""

from dataclasses import replace

import numpy as np
import pytest
from reference import resolve

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.evaluation.metrics import ospa
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate
from studies.misspecified import heavy_tailed

RADARS = ("radar_1", "radar_2")
STD = np.array([300.0, np.radians(1.0)])
# Detections of the simulation are where the targets are.
EXACT = {
    f"{radar}.{name}": value
    for radar in RADARS
    for name, value in (("range_std", 1e-2), ("azimuth_std_deg", 1e-4))
}


def normal(rng, count):
    return rng.standard_normal((count, 2))


def run_of(seed, noise):
    """Return the truth and the scans of the paper's scenario with other noise."""
    rng, found = np.random.default_rng(seed), []
    for truth, scan in simulate(paper_scenario(resolve(EXACT).model.radars), seed):
        detections = []
        for each in scan.detections:
            measured = each.measurement + STD * noise(rng, len(each))
            measured[:, 0] = np.abs(measured[:, 0])
            measured[:, 1] = np.arctan2(np.sin(measured[:, 1]), np.cos(measured[:, 1]))
            detections.append(replace(each, measurement=measured))
        found.append((truth, replace(scan, detections=tuple(detections))))
    return found


def every_fifth_outlier(rng, count):
    """Return normal noise, (N, 2), of which one in five is five times as large."""
    return rng.standard_normal((count, 2)) * np.where(rng.random((count, 1)) < 0.2, 5.0, 1.0)


def mean_ospa(run, learn):
    """Return the mean OSPA distance, filtered and smoothed, metres."""
    given = {f"{radar}.learn": learn for radar in RADARS}
    engine = new_engine(resolve({**given}))
    truth = {targets.stamp_ns: targets.position for targets, _ in run}
    steps = [engine.step(scan) for _, scan in run]
    filtered = [each for step in steps for each in step.filtered]
    smoothed = [*(each for step in steps for each in step.smoothed), *engine.flush()]
    return np.array(
        [
            np.mean([ospa(truth[e.stamp_ns], e.position, 1000.0, 2.0).distance for e in found])
            for found in (filtered, smoothed)
        ]
    )


def distances(noise, runs):
    """Return the mean distances without and with outliers in the model, filtered and smoothed."""
    runs = [run_of(seed, noise) for seed in range(300, 300 + runs)]
    return [
        np.mean([mean_ospa(run, learn) for run in runs], axis=0) for learn in ([], ["outliers"])
    ]


def test_outliers_in_the_model_help_where_there_are_some():
    plain, tails = distances(heavy_tailed, runs=6)
    assert tails[0] < 0.93 * plain[0]
    assert tails[1] < plain[1]


def test_outliers_in_the_model_do_no_harm_where_there_are_none():
    # The difference of a run's smoothed distances has a standard deviation of 1.6 %.
    plain, tails = distances(normal, runs=10)
    assert (tails < 1.01 * plain).all()


def test_large_outliers_stay_in_the_gate_of_their_target():
    # The gate of the usual noise would lose two thirds of them, and every target at times.
    plain, tails = distances(every_fifth_outlier, runs=4)
    assert (tails < 0.6 * plain).all()


@pytest.mark.parametrize("start", [150, 300])
@pytest.mark.parametrize(("noise", "share"), [(normal, 0.0), (every_fifth_outlier, 0.2)])
def test_share_and_noise_are_learned_together(noise, share, start):
    given = {f"{radar}.learn": ["noise", "outliers"] for radar in RADARS}
    given |= {f"{radar}.range_std": start for radar in RADARS}
    given |= {f"{radar}.azimuth_std_deg": start / 300 for radar in RADARS}
    engine = new_engine(resolve({**given}))
    for repeat in range(4):
        scans = [scan for _, scan in run_of(320 + repeat, noise)]
        length_ns = scans[-1].stamp_ns - scans[0].stamp_ns + 6 * 10**9
        for scan in scans:
            step = engine.step(replace(scan, stamp_ns=scan.stamp_ns + repeat * length_ns))
    found = [
        (
            step.figures[f"{radar}.outlier_share"],
            step.figures[f"{radar}.range_noise_ratio"] * start / 300,
        )
        for radar in RADARS
    ]
    # Some 500 detections of a radar.
    assert np.mean(found, axis=0) == pytest.approx([share, 1.0], abs=0.05)


def every_twentieth_outlier(rng, count):
    """Return normal noise, (N, 2), of which one in twenty is three times as large."""
    return rng.standard_normal((count, 2)) * np.where(rng.random((count, 1)) < 0.05, 3.0, 1.0)


@pytest.mark.parametrize("noise", [normal, every_twentieth_outlier])
def test_noise_that_doubles_is_noticed_although_it_looks_like_outliers(noise):
    given = {f"{radar}.learn": ["noise", "outliers"] for radar in RADARS}
    for seed in range(340, 343):
        usual = run_of(seed, noise)
        doubled = run_of(seed, lambda rng, count: 2.0 * noise(rng, count))
        engine = new_engine(resolve({**given}))
        steps = [engine.step(scan) for _, scan in (*usual[:40], *doubled[40:65])]
        noisier = [
            {name.split(".")[0] for name in step.figures if name.endswith("_noisier")}
            for step in steps
        ]
        assert not set().union(*noisier[:40])
        assert set().union(*noisier[40:]) == set(RADARS)
