"""Detection probability and amplitude likelihood by class and signal-to-noise ratio."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray
from ...models import stationary
from ...sensors.report import Report
from ...sensors.sensor import Sensor
from ...state_space import StateSpace
from ...types import Coverage
from ..dynamics import Dynamics
from ..mixture import Mixture
from .gating import Expected

# Lower bound of the variance of an expected measurement, by whose root distances are divided.
LEAST_VARIANCE = 1e-12


def detection_probability(
    expected: Expected,
    sensor: Sensor,
    dynamics: Dynamics,
    remembered: tuple[FloatArray, FloatArray] | None = None,
) -> FloatArray:
    """Return p_D of a target with each Gaussian's density in a whole turn, (H, R, S).

    It is the mean over the density, so that a target near a limit of the field of view may be
    missed because it is outside.

    Parameters
    ----------
    remembered : tuple of two arrays of shape (H,), or None
        What the sensor's last look implies for each hypothesis, as in `Remembered`; None for p_D
        whatever that saw.
    """
    model, cells = dynamics.model, dynamics.cells
    flat = expected.measured.reshape(-1, expected.measured.shape[-1])
    std = _std(expected)
    seen = sensor.coverage_probability(flat, None, std)
    given = sensor.given_detection_probability(flat, std)
    if given is None:
        own = model.amplitudes.detection_probability(
            dynamics.mode_of_cell, cells.log_snr, sensor, model.modes
        )
        given = own[:, None].repeat(len(flat), axis=1)
    probability = sensor.learned_detection_probability(given, flat)
    if remembered is not None:
        looked, detected = (each.repeat(expected.measured.shape[1]) for each in remembered)
        probability = probability * (1.0 - looked) + detected
    seen_and_detected = np.empty((len(flat), len(cells)))
    np.multiply(seen, probability, out=seen_and_detected.T)
    return seen_and_detected.reshape(*expected.measured.shape[:2], len(cells))


def sector_probability(expected: Expected, sensor: Sensor, sector: Coverage) -> FloatArray:
    """Return the probability that a target of each Gaussian is measured in a sector, (H, R, 1)."""
    share = sensor.sector_probability(expected.measured.reshape(-1, 2), sector, _std(expected))
    return share.reshape(*expected.measured.shape[:2], 1)


def _std(expected: Expected) -> FloatArray:
    """Return the standard deviations of the expected measurements, (H R, Z)."""
    variance = np.diagonal(expected.covariance, axis1=-2, axis2=-1)
    variance = variance.reshape(-1, variance.shape[-1])
    std: FloatArray = np.sqrt(np.maximum(variance, LEAST_VARIANCE))
    return std


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
