"""Gaussians of targets that were missed near the largest range: they are probably beyond it."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from ...arrays import FloatArray
from ...compilation import Float3, compiled
from ...sensors.sensor import Sensor
from ..mixture import Mixture
from .gating import Expected

# Gaussians with a smaller part within the range, or beyond it, keep their moments.
LEAST_PART = 1e-3
# The standard normal distribution of minus this is less than `LEAST_PART`.
FAR_SIGMA = 3.1


@compiled
def _at_limit(max_range: float, measured: Float3, std: Float3) -> bool:
    """Return whether any Gaussian is at the sensor's largest range."""
    for row in range(len(measured)):
        for mode in range(measured.shape[1]):
            limit = (max_range - measured[row, mode, 0]) / std[row, mode, 0]
            if abs(limit) < FAR_SIGMA:
                return True
    return False


def after_miss(
    mixture: Mixture, expected: Expected, sensor: Sensor, detectable: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return the means and covariances after a miss, (H, R, D) and (H, R, D, D).

    Parameters
    ----------
    detectable : array of shape (H, R, C)
        Probability that each Gaussian is detected.

    Returns
    -------
    tuple or None
        None if no Gaussian is at the sensor's largest range.

    Notes
    -----
    With the part A within the range and its detection probability p, the density of the range d
    after a miss is proportional to N(d; m, s^2) (1 - p 1[d within]). Its mean and variance are
    matched; the other axes follow by their regression on the range.
    """
    if not _at_limit(sensor.max_range, expected.measured, expected.std):
        return None
    std = expected.std[..., 0]
    limit = (sensor.max_range - expected.measured[..., 0]) / std
    part = ndtr(limit)
    at = (part > LEAST_PART) & (part < 1.0 - LEAST_PART) & (mixture.mode_weight > 0.0)
    if not at.any():
        return None
    detected = np.average(detectable[at], axis=1, weights=mixture.weight[at])
    limit, part, std = limit[at], part[at], std[at]
    probability = np.minimum(detected / part, 1.0)
    density = np.exp(-0.5 * limit**2) / np.sqrt(2.0 * np.pi)
    # Moments of the range in standard deviations from its mean: over the part within, the mean is
    # minus the density at the limit, and the square the part less the limit times the density.
    missed = 1.0 - probability * part
    shift = probability * density / missed
    square = (1.0 - probability * (part - limit * density)) / missed
    position = list(sensor.space.position)
    sight = sensor.line_of_sight(mixture.mean[at][:, position])
    slope = np.einsum("nip,np->ni", mixture.covariance[at][:, :, position], sight) / std[:, None]
    mean, covariance = mixture.mean.copy(), mixture.covariance.copy()
    mean[at] += shift[:, None] * slope
    change = square - shift**2 - 1.0
    covariance[at] += change[:, None, None] * slope[:, :, None] * slope[:, None, :]
    return mean, covariance
