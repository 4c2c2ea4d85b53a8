"""Measurements of Gaussians by sensors that are not polar, through `Sensor.linearise` alone.

Those of range and azimuth are compiled, see `kalman` and `measurement.gating`.
"""

from __future__ import annotations

import math

import numpy as np

from ...arrays import FloatArray, IntArray
from ...sensors.gaussians import noise_covariance
from ...sensors.report import Report
from ...sensors.sensor import Sensor

# Number of candidate pairs of Gaussians and detections that are gated at a time.
AT_ONCE = 1 << 16


def expected(
    mean: FloatArray, covariance: FloatArray, sensor: Sensor
) -> tuple[FloatArray, FloatArray]:
    """Return the expected measurements of Gaussians, (..., Z), and their covariances, (..., Z, Z).

    Parameters
    ----------
    mean, covariance : arrays of shape (..., D) and (..., D, D)
    """
    position = list(sensor.space.position)
    measured, jacobian = sensor.linearise(mean[..., position])
    spread = jacobian @ covariance[..., position, :][..., position] @ jacobian.swapaxes(-1, -2)
    return measured, spread


def gate_pairs(
    weight: FloatArray,
    mean: FloatArray,
    measured: FloatArray,
    covariance: FloatArray,
    report: Report,
    gate_sigma: float,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the results of `measurement.gating.gate_pairs`.

    Parameters
    ----------
    weight : array of shape (H, R)
        Gaussians without weight have no gate.
    mean : array of shape (H, R, D)
    measured, covariance : arrays of shapes (H, R, Z) and (H, R, Z, Z)
        Expected measurements with their covariances.
    gate_sigma : float
        Radius of the gate in standard deviations of the innovation.
    """
    sensor, size, modes = report.sensor, measured.shape[-1], weight.shape[1]
    reachable = sensor.reachable(measured.reshape(-1, size)).reshape(measured.shape)
    rate = sensor.measurement_rate(mean.reshape(-1, mean.shape[2])).reshape(measured.shape)
    noise = sensor.noise_covariance_of(report.detections)
    row = [np.zeros(0, np.int64)]
    column = [np.zeros(0, np.int64)]
    log_likelihood = [np.zeros((0, modes))]
    step = max(AT_ONCE // max(modes * len(report), 1), 1)
    for begin in range(0, len(weight), step):
        block = slice(begin, begin + step)
        error = report.detections.measurement - reachable[block, :, None]
        error = sensor.wrap(error - rate[block, :, None] * report.time_s[:, None])
        square, log_density = _normal_density(error, covariance[block, :, None] + noise)
        inside = (square <= gate_sigma**2) & (weight[block] > 0.0)[..., None]
        log_density = np.where(inside, log_density, -np.inf).swapaxes(1, 2)
        gated_row, gated_column = np.nonzero(inside.any(axis=1))
        row.append(begin + gated_row)
        column.append(gated_column)
        log_likelihood.append(log_density[gated_row, gated_column])
    return np.concatenate(row), np.concatenate(column), np.concatenate(log_likelihood)


def innovations(
    mean: FloatArray,
    covariance: FloatArray,
    sensor: Sensor,
    measurement: FloatArray,
    noise_std: FloatArray,
    correlation: FloatArray | None,
    time_s: FloatArray,
    iterations: int,
    converged: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the columns of `kalman.Innovation`, for positions instead of measurements.

    The parameters are those of `kalman.innovations`, for N pairs, each with its own noise. A
    step has converged if it moves the measurement by less than a share `converged` of its standard
    deviation.

    Notes
    -----
    With the measurement's Jacobian J, the innovation's covariance S and the innovation v, an update
    adds P J' S^-1 v to a state and takes P J' S^-1 J P from its covariance. So v is replaced by
    J' S^-1 v, the inverse of S by J' S^-1 J, and the Jacobian by the identity.
    """
    count, axes = len(mean), list(sensor.space.position)
    with_time = np.zeros((count, 2, mean.shape[1]))
    with_time[:, [0, 1], axes] = 1.0
    with_time[:, [0, 1], list(sensor.space.velocity)] = time_s[:, None]
    prior = (with_time @ mean[..., None])[..., 0]
    spread = with_time @ covariance @ with_time.swapaxes(1, 2)
    weighted, inverse, log_likelihood = (
        np.zeros((count, 2)),
        np.zeros((count, 2, 2)),
        np.zeros(count),
    )
    position, rows = prior.copy(), np.arange(count)
    noise = noise_covariance(noise_std, correlation)
    for _ in range(iterations):
        predicted, jacobian = sensor.linearise(position[rows])
        transposed = jacobian.swapaxes(1, 2)
        shift = (jacobian @ (position[rows] - prior[rows])[..., None])[..., 0]
        error = sensor.wrap(measurement[rows] - predicted) + shift
        total = jacobian @ spread[rows] @ transposed + noise[rows]
        weighted[rows] = (transposed @ np.linalg.solve(total, error[..., None]))[..., 0]
        inverse[rows] = transposed @ np.linalg.solve(total, jacobian)
        log_likelihood[rows] = _normal_density(error, total)[1]
        updated = prior[rows] + (spread[rows] @ weighted[rows][..., None])[..., 0]
        step = (jacobian @ (updated - position[rows])[..., None])[..., 0]
        position[rows] = updated
        rows = rows[(np.abs(step) >= converged * noise_std[rows]).any(axis=1)]
    return np.broadcast_to(np.eye(2), inverse.shape), weighted, inverse, log_likelihood


def _normal_density(error: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the square Mahalanobis distances and log normal densities of errors, (...)."""
    solved = np.linalg.solve(covariance, error[..., None])[..., 0]
    square = (error * solved).sum(axis=-1)
    constant = error.shape[-1] * math.log(2.0 * math.pi)
    return square, -0.5 * (square + np.linalg.slogdet(covariance)[1] + constant)
