"""Gaussians of targets that were missed at a limit of the coverage: they are probably outside."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from ...arrays import FloatArray
from ...compilation import Float1, Float3, compiled
from ...sensors.sensor import Sensor
from ..mixture import Mixture
from .gating import Expected

# Gaussians with a smaller part within the limits, or beyond them, keep their moments.
LEAST_PART = 1e-3
# A limit farther away, in standard deviations, cuts off less than `LEAST_PART` of a Gaussian.
FAR_SIGMA = 3.1


@compiled
def _is_at_limit(axis: int, limits: Float1, measured: Float3, std: Float3) -> bool:
    """Return whether any Gaussian is at a limit of a component of the measurement."""
    for row in range(len(measured)):
        for mode in range(measured.shape[1]):
            for limit in limits:
                distance = abs(limit - measured[row, mode, axis])
                if distance < FAR_SIGMA * std[row, mode, axis]:
                    return True
    return False


def _partial_moments_within(limits: FloatArray, mean: FloatArray, std: FloatArray) -> FloatArray:
    """Return integrals of normal densities, (N,), over the intervals of `limits`, (I, 2).

    They are of 1, of the deviation from the mean, and of its square, (3, N), in standard
    deviations.
    """
    edges = (limits - mean[:, None, None]) / std[:, None, None]
    density = np.exp(-0.5 * edges**2) / np.sqrt(2.0 * np.pi)
    weighted = np.where(np.isfinite(edges), edges, 0.0) * density
    mass, density_change, weighted_change = (
        np.diff(values).sum(axis=(1, 2)) for values in (ndtr(edges), density, weighted)
    )
    return np.stack([mass, -density_change, mass - weighted_change])


def after_miss(
    mixture: Mixture, expected: Expected, sensor: Sensor, detection_probability: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return the means and covariances after a miss, (H, R, D) and (H, R, D, D).

    Parameters
    ----------
    detection_probability : array of shape (H, R, C)
        Probability that each Gaussian is detected.

    Returns
    -------
    tuple or None
        None if no Gaussian is at a limit of the sensor's coverage.

    Notes
    -----
    With the part A of a component d of the measurement within its limits, and the detection
    probability p there, the density of d after a miss is proportional to N(d; m, s^2) (1 - p
    1[d within]). Its mean and variance are matched; the other axes follow by their regression on
    d. A Gaussian at limits of both components is changed along the one that divides it more evenly.
    """
    limits, size = sensor.limits, mixture.mode_weight.size
    gaussians = expected.measured, expected.std
    limited = [axis for axis, intervals in enumerate(limits) if len(intervals)]
    if not any(_is_at_limit(axis, limits[axis].ravel(), *gaussians) for axis in limited):
        return None
    measured, std = (part.reshape(size, -1) for part in gaussians)
    columns = ((limits[axis], measured[:, axis], std[:, axis]) for axis in limited)
    partial_moments = np.stack([_partial_moments_within(*column) for column in columns])
    smaller_part = np.minimum(partial_moments[:, 0], 1.0 - partial_moments[:, 0])
    usable = sensor.is_nearly_normal(std) & (mixture.mode_weight.ravel() > 0.0)
    rows = np.flatnonzero((smaller_part.max(axis=0) > LEAST_PART) & usable)
    if not len(rows):
        return None
    divided = smaller_part[:, rows].argmax(axis=0)
    axis, (mass_inside, first, second) = (
        np.take(limited, divided),
        partial_moments[divided, :, rows].T,
    )
    weight, detection_probability = (
        part.reshape(size, -1)[rows] for part in (mixture.weight, detection_probability)
    )
    detected = np.average(detection_probability, axis=1, weights=weight)
    probability = np.minimum(detected / mass_inside, 1.0)
    missed = 1.0 - probability * mass_inside
    shift = -probability * first / missed
    variance_change = (1.0 - probability * second) / missed - shift**2 - 1.0

    position, axes = list(sensor.space.position), mixture.mean.shape[-1]
    mean = mixture.mean.reshape(size, axes).copy()
    covariance = mixture.covariance.reshape(size, axes, axes).copy()
    gradient = sensor.linearise(mean[rows][:, position])[1][np.arange(len(rows)), axis]
    slope = np.einsum("nip,np->ni", covariance[rows][:, :, position], gradient)
    slope /= std[rows, axis, None]
    mean[rows] += shift[:, None] * slope
    covariance[rows] += variance_change[:, None, None] * slope[:, :, None] * slope[:, None, :]
    return mean.reshape(mixture.mean.shape), covariance.reshape(mixture.covariance.shape)
