"""The update of Gaussians with a reported height, before that with the measurement.

A slant range is then linearised at the target's height. The update is linear: the height is that of
the target, with some noise, or it is garbled and shows nothing, and the mixture of both is one
Gaussian with its moments.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from ...arrays import BoolArray, FloatArray, IntArray
from ...sensors.gaussians import HeightPrior, Heights
from ...state_space import SPATIAL
from ..algebra import kalman
from ..mixture import Mixture
from .velocity import FurtherUpdate


def update_heights(
    mean: FloatArray,
    covariance: FloatArray,
    measured: Heights,
    time_s: FloatArray | None = None,
) -> FurtherUpdate:
    """Return Gaussians, (N, D) and (N, D, D), updated with one height each, if it is known.

    `time_s` has the times of the heights relative to the Gaussians' stamp, seconds, (N,).
    """
    z, vz = SPATIAL.vertical
    expected, cross = mean[:, z].copy(), covariance[:, :, z].copy()
    variance = cross[:, z].copy()
    if time_s is not None:
        expected += time_s * mean[:, vz]
        cross += time_s[:, None] * covariance[:, :, vz]
        variance = cross[:, z] + time_s * cross[:, vz]
    log_likelihood, true = measured.compare(expected, variance)
    total = variance + measured.std**2
    gain = cross / total[:, None]
    error = np.where(measured.is_known, measured.height - expected, 0.0)
    # The covariance of the mixture: that of its parts, and the square of their difference.
    reduction = true * (total - (1.0 - true) * error**2)
    updated = covariance - reduction[:, None, None] * gain[:, :, None] * gain[:, None, :]
    updated = kalman.symmetric(updated)
    axis = np.arange(mean.shape[1])
    least = kalman.LEAST_VARIANCE * covariance[:, axis, axis]
    updated[:, axis, axis] = np.maximum(updated[:, axis, axis], least)
    return FurtherUpdate(mean + (true * error)[:, None] * gain, updated, log_likelihood)


def coarse_heights(mixture: Mixture, row: IntArray, measured: Heights) -> FloatArray:
    """Return the log likelihood of the heights of P pairs at the predicted means, (P, R).

    The times of detections are ignored. `row` has the hypothesis of each pair.
    """
    z, _ = SPATIAL.vertical
    found, _ = measured.compare(mixture.mean[row][..., z], mixture.covariance[row][..., z, z])
    return found


# Gaussians whose mean is less than this many standard deviations above the floor are cut there.
NEAR_FLOOR = 1.0
# Gaussians with less of their mass above the floor keep their moments.
LEAST_ABOVE = 1e-3


def above_floor(mixture: Mixture, floor: float) -> Mixture:
    """Return hypotheses of targets above a floor of heights, metres.

    Slant ranges have a solution on either side of their antennas, of which one is below the ground.
    A Gaussian that reaches below the floor has the moments of its part above it. Its weight has the
    factor 2 P(z > floor), at most 1: the half of a target on the ground is not lost in each update.

    References
    ----------
    Simon, "Kalman filtering with state constraints", IET Control Theory & Applications 4(8), 2010,
    section 2.4.
    """
    z, _ = SPATIAL.vertical
    std = np.sqrt(np.maximum(mixture.covariance[..., z, z], 0.0))
    edge = (floor - mixture.mean[..., z]) / np.where(std > 0.0, std, 1.0)
    cut = (std > 0.0) & (edge > -NEAR_FLOOR)
    if not cut.any():
        return mixture
    rows, edge, std = np.nonzero(cut), edge[cut], std[cut]
    above = ndtr(-edge)
    weight, mean, covariance = (
        column.copy() for column in (mixture.weight, mixture.mean, mixture.covariance)
    )
    weight[rows] *= np.minimum(2.0 * above, 1.0)[:, None]
    known = above >= LEAST_ABOVE
    hazard = np.exp(-0.5 * edge**2) / np.sqrt(2.0 * np.pi) / np.where(known, above, 1.0)
    shift, kept = std * hazard, 1.0 + hazard * (edge - hazard)
    gain = covariance[rows][..., z] / (std**2)[:, None]
    mean[rows] += np.where(known, shift, 0.0)[:, None] * gain
    change = np.where(known, (kept - 1.0) * std**2, 0.0)[:, None, None]
    covariance[rows] += change * gain[:, :, None] * gain[:, None, :]
    return mixture.changed(weight=weight, mean=mean, covariance=covariance)


def without_unlikely(mixture: Mixture, outside: BoolArray, prior: HeightPrior) -> Mixture:
    """Return hypotheses without those that no sensor sees at heights where there are no targets.

    A miss at a limit of elevations moves a target beyond it. A track of false detections would
    coast there, under the ground or above all targets. `outside` tells which hypotheses are outside
    the coverage, (H,); the others, which a sensor may have measured, stay. The factors of a weight
    are those of `above_floor`, of the floor and of the top of the prior.
    """
    z, _ = SPATIAL.vertical
    std = np.sqrt(np.maximum(mixture.covariance[..., z, z], 0.0))
    height, scale = mixture.mean[..., z], np.where(std > 0.0, std, 1.0)
    factor = np.minimum(2.0 * ndtr((height - prior.floor) / scale), 1.0)
    factor *= np.minimum(2.0 * ndtr((prior.top - height) / scale), 1.0)
    factor = np.where(outside[:, None] & (std > 0.0), factor, 1.0)
    if (factor == 1.0).all():
        return mixture
    return mixture.changed(weight=mixture.weight * factor[:, :, None])
