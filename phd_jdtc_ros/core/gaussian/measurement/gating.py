"""Gating: the detections in the gate of each hypothesis, and their approximate likelihoods."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ... import backend
from ...arrays import FloatArray, IntArray
from ...sensors.gaussians import GatedGaussians
from ...sensors.report import Report
from ...sensors.sensor import Sensor
from ..mixture import Mixture

# Radius of the gate in standard deviations of the innovation; a target's detection falls outside
# with a probability of 4e-6.
GATE_SIGMA = 5.0


class Expected(NamedTuple):
    """Expected measurement of each Gaussian.

    Parameters
    ----------
    measured : array of shape (H, R, Z)
    covariance : array of shape (H, R, Z, Z)
        Covariance of the expected measurement, without the sensor's noise.
    """

    measured: FloatArray
    covariance: FloatArray

    @staticmethod
    def of(mixture: Mixture, sensor: Sensor) -> Expected:
        """Return the measurements that a sensor is expected to make of a mixture's Gaussians."""
        place = list(sensor.space.position)
        measured, jacobian = sensor.linearise(mixture.mean[..., place])
        position = mixture.covariance[..., place, :][..., place]
        return Expected(measured, jacobian @ position @ jacobian.swapaxes(-1, -2))


def gate_pairs(
    mixture: Mixture, expected: Expected, report: Report
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the pairs of a hypothesis and a detection in the gate of one of its Gaussians.

    Returns
    -------
    row, column : int arrays of shape (P,)
    log_likelihood : array of shape (P, R)
        Log likelihood with the measurement linearised at the mean; -inf outside a Gaussian's gate.
    """
    sensor, detections, alive = report.sensor, report.detections, mixture.mode_weight > 0.0
    speed = np.abs(mixture.mean[..., list(sensor.space.velocity)]).sum(axis=-1)
    gaussians = GatedGaussians(*expected, speed, alive, GATE_SIGMA)
    row, column, surrounded = sensor.gated_boxes(gaussians, detections)
    rate, times = None, detections.time_s
    if times is not None:
        rate = sensor.measurement_rate(mixture.mean.reshape(-1, mixture.mean.shape[2]))
        rate = rate.reshape(expected.measured.shape)
    loops = backend.compiled("gaussian.algebra")
    if loops is not None and sensor.polar:
        measured = np.ascontiguousarray(expected.measured)
        found: tuple[IntArray, IntArray, FloatArray] = loops.gate_pairs(
            *(row, column, measured, np.zeros_like(measured) if rate is None else rate),
            *(np.ascontiguousarray(expected.covariance), detections.measurement),
            *(np.ascontiguousarray(report.detection_std), report.time_s),
            *(alive, surrounded, GATE_SIGMA),
        )
        return found
    error = detections.measurement[column][:, None] - expected.measured[row]
    if rate is not None and times is not None:
        error -= rate[row] * times[column][:, None, None]
    along, across = np.moveaxis(sensor.wrap(error), -1, 0)
    spread, std = expected.covariance[row], report.detection_std[column][:, None]
    a, b = spread[..., 0, 0] + std[..., 0] ** 2, spread[..., 0, 1]
    c = spread[..., 1, 1] + std[..., 1] ** 2
    determinant = np.maximum(a * c - b * b, np.finfo(float).tiny)
    square = (c * along**2 - 2.0 * b * along * across + a * across**2) / determinant
    near = ((square <= GATE_SIGMA**2) & alive[row]) | surrounded[row]
    log_likelihood = -0.5 * (square + np.log(determinant)) - np.log(2.0 * np.pi)
    pairs = np.flatnonzero(near.any(axis=1))
    rough = np.where(near[pairs], log_likelihood[pairs], -np.inf)
    return row[pairs], column[pairs], rough
