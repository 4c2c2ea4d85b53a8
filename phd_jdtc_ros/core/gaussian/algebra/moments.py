"""Moments of mixtures of Gaussians, many mixtures at once."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray, IntArray, contiguous
from ...compilation import Float1, Float2, Float3, Int1, compiled
from .blocks import SIZE, add_mean, add_spread


def merge_moments(
    share: FloatArray, mean: FloatArray, covariance: FloatArray, mixture: IntArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Return the means and covariances of mixtures.

    Parameters
    ----------
    share : array of shape (N,)
        Sums to one over the Gaussians of a mixture.
    mean : array of shape (N, D)
    covariance : array of shape (N, D, D)
    mixture : int array of shape (N,)
        That each Gaussian is of.
    count : int
        Number of mixtures, J.

    Returns
    -------
    mean : array of shape (J, D)
    covariance : array of shape (J, D, D)
    """
    return _merge_moments(count, *contiguous(share, mean, covariance, mixture))


@compiled
def _merge_moments(
    count: int, share: Float1, mean: Float2, covariance: Float3, mixture: Int1
) -> tuple[FloatArray, FloatArray]:
    centre, spread = np.zeros((count, SIZE)), np.zeros((count, SIZE, SIZE))
    for row in range(len(share)):
        add_mean(share[row], mean[row], centre[mixture[row]])
    for row in range(len(share)):
        at, around = centre[mixture[row]], spread[mixture[row]]
        add_spread(share[row], mean[row], covariance[row], at, around)
    return centre, spread
