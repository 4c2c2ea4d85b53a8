# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulates every radar's detections of a scenario's targets, among clutter."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray
from ..models.radar import RadarModel, wrap_angle
from ..types import Detections, Scan, Truth
from .scenario import Scenario, truth_at


def detect(
    truth: Truth, snr: FloatArray, radar: RadarModel, rng: np.random.Generator
) -> tuple[Detections, IntArray]:
    """Return one radar's detections of `truth` among its clutter, in random order.

    Parameters
    ----------
    truth : Truth
        T targets.
    snr : array of shape (T,)
        Mean signal-to-noise ratio of each target, linear.
    radar : RadarModel
    rng : numpy.random.Generator

    Returns
    -------
    detections : Detections
        M of them.
    source : int array of shape (M,)
        The track_id of each detection's target; 0 for clutter.

    Notes
    -----
    Target envelopes are Rayleigh with sigma^2 = 1 + d, clutter envelopes with sigma^2 = 1; both
    are reported only above the radar's threshold. The clutter rate counts reported detections.
    """
    exact = radar.measure(truth.state)
    envelope = rng.rayleigh(np.sqrt(1.0 + snr))
    noisy = exact + rng.standard_normal(exact.shape) * radar.noise_std
    seen = (envelope > radar.threshold) & (exact[:, 0] <= radar.max_range)
    count = rng.poisson(radar.clutter_rate)
    clutter = np.stack(
        [
            rng.uniform(0.0, radar.clutter_max_range, count),
            rng.uniform(-np.pi, np.pi, count),
        ],
        axis=1,
    )
    # The square of a Rayleigh envelope is exponential, so this tail above tau is exact.
    tail = np.sqrt(radar.threshold**2 + 2.0 * rng.standard_exponential(count))
    measurement = np.concatenate([noisy[seen], clutter])
    measurement[:, 0] = np.abs(measurement[:, 0])
    measurement[:, 1] = wrap_angle(measurement[:, 1])
    order = rng.permutation(len(measurement))
    detections = Detections(
        measurement=measurement[order],
        amplitude=np.concatenate([envelope[seen], tail])[order],
    )
    source = np.concatenate([truth.track_id[seen], np.zeros(count, dtype=np.int64)])
    return detections, source[order]


def simulate(scenario: Scenario, seed: int) -> list[tuple[Truth, Scan]]:
    """Return the truth and the scan of every stamp; reproducible by the seed."""
    return [(truth, scan) for truth, scan, _ in simulate_with_sources(scenario, seed)]


def simulate_with_sources(
    scenario: Scenario, seed: int
) -> list[tuple[Truth, Scan, tuple[IntArray, ...]]]:
    """Return what `simulate` returns, with the source of each detection for every radar."""
    rng = np.random.default_rng(seed)
    snr_of = np.array([target.snr for target in scenario.targets])
    run = []
    for index in range(scenario.scans):
        truth = truth_at(scenario, index)
        reports = [
            detect(truth, snr_of[truth.track_id - 1], radar, rng) for radar in scenario.radars
        ]
        scan = Scan(truth.stamp_ns, tuple(detections for detections, _ in reports))
        run.append((truth, scan, tuple(source for _, source in reports)))
    return run
