"""Moments of mixtures of Gaussians, many mixtures at once."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray
from ...compilation import Float1, Float2, Float3, Int1, compiled
from .blocks import SIZE, add_mean, add_spread


@compiled
def merge_moments(
    count: int, share: Float1, mean: Float2, covariance: Float3, mixture: Int1
) -> tuple[FloatArray, FloatArray]:
    """Return the means and covariances of mixtures, (J, D) and (J, D, D).

    Parameters
    ----------
    count : int
        Number of mixtures, J.
    share : array of shape (N,)
        Sums to one over the Gaussians of a mixture.
    mean, covariance : arrays of shape (N, D) and (N, D, D)
    mixture : int array of shape (N,)
        Mixture of each Gaussian.
    """
    centre, spread = np.zeros((count, SIZE)), np.zeros((count, SIZE, SIZE))
    for row in range(len(share)):
        add_mean(share[row], mean[row], centre[mixture[row]])
    for row in range(len(share)):
        at, around = centre[mixture[row]], spread[mixture[row]]
        add_spread(share[row], mean[row], covariance[row], at, around)
    return centre, spread
