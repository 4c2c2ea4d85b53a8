"""Detection probability and amplitude likelihood by class and signal-to-noise ratio."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import TINY, FloatArray, frozen
from ...compilation import Float1, Float2, Float3, Int1, compiled
from ...sensors.of_gaussians.linearised import Expected
from ...sensors.view import View
from ...state_space import StateSpace
from ...targets import stationary
from ..dynamics import Dynamics
from ..mixture import Hypotheses, Mixture


class DetectionProbability(NamedTuple):
    """Probabilities of detection of H hypotheses."""

    by_class: Float3  # Probability of each Gaussian and class, (H, R, C)
    cell: Float2  # Probability in each cell of SNR, (C, S)
    # Mean of `cell` over each hypothesis's SNR, (H, C); `by_class` times cell / mean is the
    # probability given the cell.
    mean: Float2


def detection_probability(
    expected: Expected,
    snr: FloatArray,
    view: View,
    dynamics: Dynamics,
    prediction: tuple[FloatArray, FloatArray] | None = None,
) -> DetectionProbability:
    """Return the probability that a target is detected in a whole revolution.

    It is the mean over each Gaussian's density, so that a target near a limit of the field of view
    may be missed because it is outside.

    Parameters
    ----------
    snr : array of shape (H, C, S)
        See `Mixture`.
    prediction : tuple of two arrays of shape (H,), or None
        What the sensor's last look predicts for each hypothesis, as in `LookPrediction`; None for
        p_D whatever the last look saw.
    """
    classes, (count, modes, size) = snr.shape[1], expected.measured.shape
    flat, std = expected.measured.reshape(-1, size), expected.std.reshape(-1, size)
    sensor = view.sensor
    covered = sensor.visibility.probability_in_view(flat, std).reshape(count, modes, 1)
    by_gaussian = sensor.visibility.detection_probability(flat, std)
    if by_gaussian is None:
        cell = dynamics.cell_probability(sensor.threshold)
        mean = _mean_over_cells(snr, cell)
        configured = mean.T.repeat(modes, axis=1)
    else:
        cell, mean = np.ones(snr.shape[1:]), np.ones(snr.shape[:2])
        configured = by_gaussian[None]
    learned = view.detection_probability_at(configured, flat)
    probability = learned.T.reshape(count, modes, len(configured))
    if prediction is not None:
        looked, detected = (column[:, None, None] for column in prediction)
        probability = probability * (1.0 - looked) + detected
    by_class = np.empty((count, modes, classes))
    np.multiply(covered, probability, by_class)
    return frozen(DetectionProbability(by_class, cell, mean))


@compiled
def _mean_over_cells(snr: Float3, cell_value: Float2) -> FloatArray:
    """Return the mean of the cells' values over each hypothesis's SNR, (H, C)."""
    count, classes, cells = snr.shape
    mean = np.zeros((count, classes))
    for row in range(count):
        for class_id in range(classes):
            for cell in range(cells):
                mean[row, class_id] += snr[row, class_id, cell] * cell_value[class_id, cell]
    return mean


def log_amplitude(report: View, dynamics: Dynamics) -> FloatArray:
    """Return log p_D g(a) of every cell and detection, shape (C, S, M)."""
    model, log_snr = dynamics.model, dynamics.cells.log_snr
    by_cell = model.amplitudes.log_cell_likelihood(log_snr, report, model.modes)
    shape = *log_snr.shape, len(report)
    return by_cell if by_cell.shape == shape else np.broadcast_to(by_cell, shape)


class Amplitudes(NamedTuple):
    """Likelihoods of the amplitudes of M detections."""

    largest: Float1  # The largest log p_D g(a) of all cells, (M,)
    # Of each cell p_D g(a) relative to the largest one, (M, C, S); 0 where all are.
    relative: Float3

    @staticmethod
    def of(report: View, dynamics: Dynamics) -> Amplitudes:
        """Return the likelihoods of a report's amplitudes."""
        return frozen(_relative_to_largest(np.ascontiguousarray(log_amplitude(report, dynamics))))


@compiled
def _relative_to_largest(log_likelihood: Float3) -> Amplitudes:
    """Return what `Amplitudes` has, given log p_D g(a) of cells and detections, (C, S, M)."""
    classes, cells, count = log_likelihood.shape
    largest, relative = np.full(count, -np.inf), np.zeros((count, classes, cells))
    for class_id in range(classes):
        for cell in range(cells):
            for z in range(count):
                largest[z] = max(largest[z], log_likelihood[class_id, cell, z])
    for class_id in range(classes):
        for cell in range(cells):
            for z in range(count):
                if largest[z] > -np.inf:
                    excess = log_likelihood[class_id, cell, z] - largest[z]
                    relative[z, class_id, cell] = math.exp(excess)
    return Amplitudes(largest, relative)


@compiled
def snr_after(
    prior: Hypotheses,
    detection_probability: Float3,
    in_revolution: DetectionProbability,
    amplitudes: Amplitudes,
    prior_row: Int1,
    pair: Int1,
    column: Int1,
) -> FloatArray:
    """Return the probabilities of the cells of SNR after an update, by Bayes' rule, (K, C, S).

    Parameters
    ----------
    prior : Hypotheses
        Before the update.
    detection_probability : array of shape (H, R, C)
        Probability of detection in this report, of each Gaussian and class.
    in_revolution : DetectionProbability
        In a whole revolution.
    amplitudes : Amplitudes
    prior_row, pair : int arrays of shape (K,)
        Hypothesis before the update, and its pair; -1 for a missed detection.
    column : int array of shape (P,)
        Detection of each pair.
    """
    snr, weight, relative = prior.snr, prior.weight, amplitudes.relative
    cell_probability, mean_probability = in_revolution.cell, in_revolution.mean
    classes, cells = snr.shape[1:]
    posterior = np.empty((len(prior_row), classes, cells))
    for row in range(len(prior_row)):
        hypothesis, z = prior_row[row], column[pair[row]] if pair[row] >= 0 else -1
        for class_id in range(classes):
            mass, detected, total = 0.0, 0.0, 0.0
            for mode in range(weight.shape[1]):
                mass += weight[hypothesis, mode, class_id]
                detected += (
                    weight[hypothesis, mode, class_id]
                    * detection_probability[hypothesis, mode, class_id]
                )
            detected /= mass if mass > 0.0 else 1.0
            detected /= max(mean_probability[hypothesis, class_id], TINY)
            for cell in range(cells):
                if z < 0:
                    likelihood = max(1.0 - detected * cell_probability[class_id, cell], 0.0)
                else:
                    likelihood = relative[z, class_id, cell]
                posterior[row, class_id, cell] = snr[hypothesis, class_id, cell] * likelihood
                total += posterior[row, class_id, cell]
            for cell in range(cells):
                if total > 0.0:
                    posterior[row, class_id, cell] /= total
                else:  # The class has no weight.
                    posterior[row, class_id, cell] = snr[hypothesis, class_id, cell]
    return posterior


def slower(mixture: Mixture, bound: float, space: StateSpace) -> FloatArray:
    """Return the probability that each hypothesis is slower than a bound in m/s, (H,)."""
    axes = list(space.velocity)
    covariance = mixture.covariance[..., axes, :][..., axes]
    probability = stationary.probability_slower(mixture.mean[..., axes], covariance, bound)
    slow: FloatArray = (mixture.sums.mode_weight * probability).sum(axis=1)
    return slow / np.maximum(mixture.sums.mass, TINY)
