"""Detection probability and amplitude likelihood by class and signal-to-noise ratio."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray, contiguous
from ...compilation import Float3, Int1, compiled
from ...models import stationary
from ...sensors.report import Report
from ...sensors.sensor import Sensor
from ...state_space import StateSpace
from ...types import Coverage
from ..algebra.kalman import TINY
from ..dynamics import Dynamics
from ..mixture import Mixture
from .gating import Expected

# Lower bound of the variance of an expected measurement, by whose root distances are divided.
LEAST_VARIANCE = 1e-12


class DetectionProbability(NamedTuple):
    """Probabilities of detection of H hypotheses."""

    by_class: FloatArray  # Probability of each Gaussian and class, (H, R, C)
    by_cell: FloatArray  # Probability of each cell of SNR as a factor on its class's, (H, C, S)


def detection_probability(
    expected: Expected,
    snr: FloatArray,
    sensor: Sensor,
    dynamics: Dynamics,
    remembered: tuple[FloatArray, FloatArray] | None = None,
) -> DetectionProbability:
    """Return the probability that a target is detected in a whole turn.

    It is the mean over each Gaussian's density, so that a target near a limit of the field of view
    may be missed because it is outside.

    Parameters
    ----------
    snr : array of shape (H, C, S)
        See `Mixture`.
    remembered : tuple of two arrays of shape (H,), or None
        What the sensor's last look implies for each hypothesis, as in `Remembered`; None for p_D
        whatever that saw.
    """
    log_snr, model, by_cell = dynamics.cells.log_snr, dynamics.model, np.ones(snr.shape)
    flat = expected.measured.reshape(-1, expected.measured.shape[-1])
    std = _std(expected)
    seen = sensor.coverage_probability(flat, None, std)
    given = sensor.given_detection_probability(flat, std)
    shape = *expected.measured.shape[:2], snr.shape[1]
    if given is None:
        own = model.amplitudes.detection_probability(
            dynamics.mode_of_cell, log_snr.ravel(), sensor, model.modes
        ).reshape(log_snr.shape)
        mean = np.einsum("hcs,cs->hc", snr, own)
        by_cell = own / np.maximum(mean, TINY)[..., None]
        given = mean.T.repeat(shape[1], axis=1)
    probability = sensor.learned_detection_probability(given, flat)
    if remembered is not None:
        looked, detected = (each.repeat(shape[1]) for each in remembered)
        probability = probability * (1.0 - looked) + detected
    seen_and_detected = np.empty((len(flat), shape[2]))
    np.multiply(seen, probability, out=seen_and_detected.T)
    return DetectionProbability(seen_and_detected.reshape(shape), by_cell)


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
    """Return log p_D g(a) of every detection and cell, shape (M, C, S)."""
    log_snr, count, model = dynamics.cells.log_snr, len(report), dynamics.model
    cell, detection = np.divmod(np.arange(log_snr.size * count), max(count, 1))
    likelihood = model.amplitudes.log_likelihood(
        dynamics.mode_of_cell, log_snr.ravel(), report, (cell, detection), model.modes
    )
    by_detection = likelihood.reshape(log_snr.size, count).T
    return np.ascontiguousarray(by_detection).reshape(count, *log_snr.shape)


def relative(
    log_likelihood: FloatArray, axis: int | tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return the largest log likelihoods over some axes, and the likelihoods relative to them."""
    largest = log_likelihood.max(axis=axis, keepdims=True)
    return largest, np.exp(log_likelihood - np.where(largest > -np.inf, largest, 0.0))


class Amplitudes(NamedTuple):
    """Likelihoods of the amplitudes of M detections."""

    largest: FloatArray  # The largest log p_D g(a) of all cells, (M,)
    # (M, C, S). p_D g(a) of each cell relative to the largest one; 0 where all are.
    relative: FloatArray

    @staticmethod
    def of(report: Report, dynamics: Dynamics) -> Amplitudes:
        """Return the likelihoods of a report's amplitudes."""
        largest, likelihood = relative(log_amplitude(report, dynamics), axis=(1, 2))
        return Amplitudes(largest.ravel(), likelihood)

    def by_class(self, snr: FloatArray, row: IntArray, column: IntArray) -> FloatArray:
        """Return the relative likelihood of pairs of hypothesis and detection by class, (P, C)."""
        return _by_class(*contiguous(snr, row, column, self.relative))


@compiled
def _by_class(snr: Float3, row: Int1, column: Int1, relative: Float3) -> FloatArray:
    """Return the results of `Amplitudes.by_class`."""
    classes, cells = snr.shape[1:]
    found = np.zeros((len(row), classes))
    for pair in range(len(row)):
        for class_id in range(classes):
            for cell in range(cells):
                likelihood = relative[column[pair], class_id, cell]
                found[pair, class_id] += snr[row[pair], class_id, cell] * likelihood
    return found


@compiled
def snr_after(
    snr: Float3,
    weight: Float3,
    detectable: Float3,
    by_cell: Float3,
    relative: Float3,
    source: Int1,
    column: Int1,
) -> FloatArray:
    """Return the probabilities of the cells of SNR after an update, by Bayes' rule, (K, C, S).

    Parameters
    ----------
    snr : array of shape (H, C, S)
        The probabilities before.
    weight, detectable : arrays of shape (H, R, C)
        Weights before, and probabilities of detection, of each Gaussian and class.
    by_cell : array of shape (H, C, S)
        See `DetectionProbability`.
    relative : array of shape (M, C, S)
        See `Amplitudes`.
    source, column : int arrays of shape (K,)
        Hypothesis before the update, and its detection; -1 for a missed detection.
    """
    classes, cells = snr.shape[1:]
    later = np.empty((len(source), classes, cells))
    for row in range(len(source)):
        one, z = source[row], column[row]
        for class_id in range(classes):
            mass, detected, total = 0.0, 0.0, 0.0
            for mode in range(weight.shape[1]):
                mass += weight[one, mode, class_id]
                detected += weight[one, mode, class_id] * detectable[one, mode, class_id]
            detected /= mass if mass > 0.0 else 1.0
            for cell in range(cells):
                if z < 0:
                    likelihood = max(1.0 - detected * by_cell[one, class_id, cell], 0.0)
                else:
                    likelihood = relative[z, class_id, cell]
                later[row, class_id, cell] = snr[one, class_id, cell] * likelihood
                total += later[row, class_id, cell]
            for cell in range(cells):
                if total > 0.0:
                    later[row, class_id, cell] /= total
                else:  # the class has no weight
                    later[row, class_id, cell] = snr[one, class_id, cell]
    return later


def slower(mixture: Mixture, bound: float, space: StateSpace) -> FloatArray:
    """Return the probability that each hypothesis is slower than a bound in m/s, (H,)."""
    axes = list(space.velocity)
    covariance = mixture.covariance[..., axes, :][..., axes]
    each = stationary.probability_slower(mixture.mean[..., axes], covariance, bound)
    weight = np.einsum("hrs->hr", mixture.weight)
    total = np.maximum(weight.sum(axis=1), np.finfo(float).tiny)
    probability: FloatArray = (weight * each).sum(axis=1) / total
    return probability
