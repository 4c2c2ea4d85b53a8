"""Detections as Gaussians in the plane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray


class PlanePlots(NamedTuple):
    """Detections as positions in the world frame, at their own times."""

    position: FloatArray  # Metres, (M, 2)
    axes: FloatArray  # Principal axes of the errors, unit vectors in columns, (M, 2, 2)
    std: FloatArray  # Standard deviations along these axes, metres, (M, 2)

    @property
    def root(self) -> FloatArray:
        """Square roots of the covariances, metres, shape (M, 2, 2)."""
        return self.axes * self.std[:, None, :]

    @property
    def covariance(self) -> FloatArray:
        """Covariances of the positions, square metres, shape (M, 2, 2)."""
        covariance = np.zeros_like(self.axes)
        for std, axis in zip(self.std.T, np.moveaxis(self.axes, 2, 0), strict=True):
            covariance += (std**2)[:, None, None] * axis[:, :, None] * axis[:, None, :]
        return covariance
