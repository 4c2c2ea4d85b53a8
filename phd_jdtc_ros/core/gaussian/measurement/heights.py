"""The update of Gaussians with a reported height, before that with the measurement.

A slant range is then linearised at the target's height. The update is linear: the height is that of
the target, with some noise, or it is garbled and shows nothing, and the mixture of both is one
Gaussian with its moments.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...sensors.gaussians import Heights
from ...state_space import SPATIAL
from ..algebra import kalman
from ..mixture import Mixture


class HeightUpdate(NamedTuple):
    """Gaussians after their heights."""

    mean: FloatArray  # (N, D)
    covariance: FloatArray  # (N, D, D)
    log_likelihood: FloatArray  # See `Heights.compare`, (N,)


def update_heights(
    mean: FloatArray,
    covariance: FloatArray,
    measured: Heights,
    time_s: FloatArray | None = None,
) -> HeightUpdate:
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
    return HeightUpdate(mean + (true * error)[:, None] * gain, updated, log_likelihood)


def coarse_heights(mixture: Mixture, row: IntArray, measured: Heights) -> FloatArray:
    """Return the log likelihood of the heights of P pairs at the predicted means, (P, R).

    The times of detections are ignored. `row` has the hypothesis of each pair.
    """
    z, _ = SPATIAL.vertical
    found, _ = measured.compare(mixture.mean[row][..., z], mixture.covariance[row][..., z, z])
    return found
