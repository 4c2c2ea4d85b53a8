"""The outline of a covariance ellipse."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

# Radius, in standard deviations, that contains 95 % of a two-dimensional Gaussian.
RADIUS_95 = float(np.sqrt(-2.0 * np.log(0.05)))


def outline(covariance: FloatArray, radius: float, points: int) -> FloatArray:
    """Return closed outlines centred on (0, 0), shape (..., 2, points).

    The radius is in standard deviations of the covariance, shape (..., 2, 2), of which a negative
    variance from rounding counts as zero. The last point equals the first.
    """
    variance, axes = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    spread = axes * (radius * np.sqrt(np.maximum(variance, 0.0)))[..., None, :]
    line: FloatArray = spread @ circle
    line[..., -1] = line[..., 0]
    return line
