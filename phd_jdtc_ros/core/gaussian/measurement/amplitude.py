"""Detection probability and amplitude likelihood by class and signal-to-noise ratio."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray
from ...models import stationary
from ...sensors.report import Report
from ...state_space import StateSpace
from ..dynamics import Dynamics
from ..mixture import Mixture
from .gating import Expected


def detection_probability(expected: Expected, report: Report, dynamics: Dynamics) -> FloatArray:
    """Return the detection probability of a target with each Gaussian's density, (H, R, S)."""
    model, cells, sensor = dynamics.model, dynamics.cells, report.sensor
    flat = expected.measured.reshape(-1, expected.measured.shape[-1])
    cell = np.arange(len(flat) * len(cells)) % len(cells)
    azimuth_std = None
    if sensor.polar:
        azimuth_std = np.sqrt(expected.covariance[..., 1, 1].ravel() + sensor.noise_std[1] ** 2)
    seen = sensor.coverage_probability(flat, report.detections.coverage, azimuth_std)
    probability = model.amplitudes.detection_probability(
        dynamics.mode_of_cell[cell],
        cells.log_snr[cell],
        flat.repeat(len(cells), axis=0),
        sensor,
        model.modes,
    )
    seen_and_detected: FloatArray = seen[:, None] * probability.reshape(-1, len(cells))
    return seen_and_detected.reshape(*expected.measured.shape[:2], len(cells))


def log_amplitude(report: Report, dynamics: Dynamics) -> FloatArray:
    """Return log p_D g(a) of every cell and detection, shape (S, M)."""
    cells, count = len(dynamics.cells), len(report)
    cell, detection = np.divmod(np.arange(cells * count), max(count, 1))
    likelihood = dynamics.model.amplitudes.log_likelihood(
        dynamics.mode_of_cell,
        dynamics.cells.log_snr,
        report,
        (cell, detection),
        dynamics.model.modes,
    )
    return likelihood.reshape(cells, count)


def slower(mixture: Mixture, bound: float, space: StateSpace) -> FloatArray:
    """Return the probability that each hypothesis is slower than a bound in m/s, (H,)."""
    axes = list(space.velocity)
    covariance = mixture.covariance[..., axes, :][..., axes]
    each = stationary.probability_slower(mixture.mean[..., axes], covariance, bound)
    weight = np.einsum("hrs->hr", mixture.weight)
    total = np.maximum(weight.sum(axis=1), np.finfo(float).tiny)
    probability: FloatArray = (weight * each).sum(axis=1) / total
    return probability
