"""Squared Mahalanobis distances of estimates from the truth."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray


def mahalanobis2(error: FloatArray, covariance: FloatArray | None) -> FloatArray:
    """Return the squared Mahalanobis distances of errors of position, metres, (P, 2); shape (P,).

    The covariances, m^2, (P, 2, 2), may be unknown. The distance is NaN without one that is finite
    and positive definite.
    """
    if covariance is None:
        return np.full(len(error), np.nan)
    (xx, xy), (_, yy) = covariance.transpose(1, 2, 0)
    x, y = error.T
    with np.errstate(over="ignore", invalid="ignore"):
        determinant = xx * yy - xy**2
        usable = (xx > 0.0) & (determinant > 0.0) & np.isfinite(determinant)
        square = (yy * x**2 - 2.0 * xy * x * y + xx * y**2) / np.where(usable, determinant, 1.0)
    return np.where(usable, square, np.nan)
