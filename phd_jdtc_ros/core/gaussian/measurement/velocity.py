"""The update of Gaussians with a measured velocity, after the update with the position.

The noise of the velocity is independent of that of the position, so that the two updates may be
done in turn. Both are linear: the result is that of one update with all components.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray
from ...sensors.range_rate import Velocities
from ...state_space import SPATIAL
from ..algebra import kalman


class FurtherUpdate(NamedTuple):
    """Gaussians after a velocity or a height of each."""

    mean: FloatArray  # (N, D)
    covariance: FloatArray  # (N, D, D)
    log_likelihood: FloatArray  # Of the velocity or height alone, (N,); 0 without one


def update_velocities(
    mean: FloatArray, covariance: FloatArray, measured: Velocities
) -> FurtherUpdate:
    """Return Gaussians, (N, D) and (N, D, D), updated with one velocity each, if it is known."""
    axes, is_known = list(SPATIAL.motion[: measured.velocity.shape[1]]), measured.is_known
    error = np.where(is_known[:, None], measured.velocity - mean[:, axes], 0.0)
    cross = covariance[:, :, axes]
    total = cross[:, axes, :] + measured.noise
    gain = np.linalg.solve(total, cross.swapaxes(1, 2)).swapaxes(1, 2)
    gain[~is_known] = 0.0
    updated_covariance = kalman.symmetric(covariance - gain @ cross.swapaxes(1, 2))
    axis = np.arange(mean.shape[1])
    least = kalman.LEAST_VARIANCE * covariance[:, axis, axis]
    updated_covariance[:, axis, axis] = np.maximum(updated_covariance[:, axis, axis], least)
    log_density = np.where(is_known, measured.model.log_density(error, total), 0.0)
    return FurtherUpdate(mean + (gain @ error[..., None])[..., 0], updated_covariance, log_density)
