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
# The standard normal distribution of minus this is less than `LEAST_PART`.
FAR_SIGMA = 3.1
# Gaussians whose azimuths have a larger deviation keep their moments, radians: they are so near to
# the sensor that neither the azimuth nor the range is normal.
LARGEST_AZIMUTH_STD = 0.5


@compiled
def _at_limit(axis: int, limits: Float1, measured: Float3, std: Float3) -> bool:
    """Return whether any Gaussian is at a limit of a component of the measurement."""
    for row in range(len(measured)):
        for mode in range(measured.shape[1]):
            for limit in limits:
                apart = abs(limit - measured[row, mode, axis])
                if apart < FAR_SIGMA * std[row, mode, axis]:
                    return True
    return False


def _inside(limits: FloatArray, mean: FloatArray, std: FloatArray) -> FloatArray:
    """Return integrals of normal densities, (N,), over the intervals of `limits`, (I, 2).

    They are of 1, of the deviation from the mean, and of its square, (3, N), in standard
    deviations.
    """
    edges = (limits - mean[:, None, None]) / std[:, None, None]
    density = np.exp(-0.5 * edges**2) / np.sqrt(2.0 * np.pi)
    weighted = np.where(np.isfinite(edges), edges, 0.0) * density
    part, fall, more = (np.diff(each).sum(axis=(1, 2)) for each in (ndtr(edges), density, weighted))
    return np.stack([part, -fall, part - more])


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
        None if no Gaussian is at a limit of the sensor's coverage.

    Notes
    -----
    With the part A of a component d of the measurement within its limits, and the detection
    probability p there, the density of d after a miss is proportional to N(d; m, s^2) (1 - p
    1[d within]). Its mean and variance are matched; the other axes follow by their regression on
    d. A Gaussian at limits of both components is changed along the one that divides it more evenly.
    """
    limits, size = sensor.limits, mixture.mode_weight.size
    spread = expected.measured, expected.std
    if not any(_at_limit(axis, own.ravel(), *spread) for axis, own in enumerate(limits)):
        return None
    measured, std = (each.reshape(size, -1) for each in spread)
    columns = zip(limits, measured.T, std.T, strict=True)
    inside = np.stack([_inside(*column) for column in columns])
    divided = np.minimum(inside[:, 0], 1.0 - inside[:, 0])
    certain = (std[:, 1] < LARGEST_AZIMUTH_STD) & (mixture.mode_weight.ravel() > 0.0)
    at = np.flatnonzero((divided.max(axis=0) > LEAST_PART) & certain)
    if not len(at):
        return None
    axis = divided[:, at].argmax(axis=0)
    part, first, second = inside[axis, :, at].T
    weight, detectable = (each.reshape(size, -1)[at] for each in (mixture.weight, detectable))
    detected = np.average(detectable, axis=1, weights=weight)
    probability = np.minimum(detected / part, 1.0)
    missed = 1.0 - probability * part
    shift = -probability * first / missed
    change = (1.0 - probability * second) / missed - shift**2 - 1.0

    position, axes = list(sensor.space.position), mixture.mean.shape[-1]
    mean = mixture.mean.reshape(size, axes).copy()
    covariance = mixture.covariance.reshape(size, axes, axes).copy()
    gradient = sensor.linearise(mean[at][:, position])[1][np.arange(len(at)), axis]
    slope = np.einsum("nip,np->ni", covariance[at][:, :, position], gradient)
    slope /= std[at, axis, None]
    mean[at] += shift[:, None] * slope
    covariance[at] += change[:, None, None] * slope[:, :, None] * slope[:, None, :]
    return mean.reshape(mixture.mean.shape), covariance.reshape(mixture.covariance.shape)
