"""Moments of mixtures of Gaussians, many mixtures at once."""

from __future__ import annotations

import numpy as np

from ... import backend
from ...arrays import FloatArray, IntArray


def match_moments(
    share: FloatArray, mean: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the means and covariances of mixtures with the same number of Gaussians.

    Parameters
    ----------
    share : array of shape (N, J, K)
        Share of Gaussian k in mixture j; sums to one over k.
    mean : array of shape (N, K, D)
    covariance : array of shape (N, K, D, D)

    Returns
    -------
    mean : array of shape (N, J, D)
    covariance : array of shape (N, J, D, D)
    """
    if loops := backend.compiled("gaussian.algebra"):
        found: tuple[FloatArray, FloatArray] = loops.match_moments(
            *(np.ascontiguousarray(part) for part in (share, mean, covariance))
        )
        return found
    count, parts, size = mean.shape
    centre = share @ mean
    apart = mean[:, None] - centre[:, :, None]
    within = share @ covariance.reshape(count, parts, size * size)
    between = (apart * share[..., None]).swapaxes(-1, -2) @ apart
    return centre, within.reshape(*centre.shape, size) + between


def merge_moments(
    share: FloatArray, mean: FloatArray, covariance: FloatArray, first: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the means and covariances of mixtures of consecutive rows.

    Parameters
    ----------
    share : array of shape (N, R)
        Sums to one over the rows of a mixture, for each of R columns.
    mean : array of shape (N, R, D)
    covariance : array of shape (N, R, D, D)
    first : int array of shape (J,)
        The first row of each mixture, ascending from 0.

    Returns
    -------
    mean : array of shape (J, R, D)
    covariance : array of shape (J, R, D, D)
    """
    if len(first) == len(mean):
        return mean, covariance
    if loops := backend.compiled("gaussian.algebra"):
        found: tuple[FloatArray, FloatArray] = loops.merge_moments(
            *(np.ascontiguousarray(part) for part in (share, mean, covariance)), first
        )
        return found
    centre = np.add.reduceat(share[..., None] * mean, first)
    size = np.diff(np.append(first, len(mean)))
    apart = mean - centre.repeat(size, axis=0)
    spread = apart[..., None] * apart[..., None, :]
    spread += covariance
    spread *= share[..., None, None]
    return centre, np.add.reduceat(spread, first)
