"""Innovations whose measurement noise has heavy tails: a mixture of a usual and a larger noise."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import expit

from ...arrays import TINY, FloatArray, IntArray, frozen
from ...compilation import Float1, Float2, Int1, compiled
from ...sensors.gaussians import UNKNOWN_STD, HeavyTails
from .kalman import Innovation


def mix_noises(
    innovation: Innovation,
    outliers: HeavyTails,
    noise_std: FloatArray,
    correlation: FloatArray | None,
    column: IntArray,
) -> tuple[Innovation, FloatArray]:
    """Return the innovations of detections of which some are outliers.

    Return also the probability that each detection is an outlier if it is the Gaussian's, (P R,).

    Parameters
    ----------
    innovation : Innovation
        With the usual noise, (P R,).
    noise_std : array of shape (M, 2), or (M, 3) in space, where an elevation may be unknown
        Usual standard deviations of the detections' errors.
    correlation : array of shape (M,) or None
        See `Detections.noise_correlation`.
    column : int array of shape (P,)
        Detection of every R innovations.

    Notes
    -----
    With the shares c_k of both components, their innovation covariances S_k and the innovation v,
    the likelihood is l = sum c_k N(v; 0, S_k), and component k has the posterior probability
    q_k = c_k N(v; 0, S_k) / l. With w_k = S_k^-1 v, the mean of the posterior mixture is the prior
    mean plus P H' w, w = sum q_k w_k, and its covariance is
    P - P H' [sum q_k S_k^-1 - sum q_k (w_k - w)(w_k - w)'] H P. So w takes the place of the
    weighted innovation, and the bracket that of the inverse: a Gaussian stays a Gaussian.
    """
    if noise_std.shape[1] > 2:
        return _mix_in_space(innovation, outliers, noise_std, column)
    correlations = np.zeros(0) if correlation is None else correlation
    std, column = np.ascontiguousarray(noise_std), np.ascontiguousarray(column)
    tails = outliers.share, outliers.ratio
    mixed, outlier = _mix_noises(*tails, innovation, std, correlations, column)
    return frozen(mixed), outlier


def _mix_in_space(
    innovation: Innovation, outliers: HeavyTails, noise_std: FloatArray, column: IntArray
) -> tuple[Innovation, FloatArray]:
    """Return the results of `mix_noises` with three components, whose errors are independent."""
    jacobian, weighted, inverse, log_likelihood = innovation
    outlier, rows = np.zeros(len(weighted)), np.flatnonzero(log_likelihood > -np.inf)
    std = noise_std[column.repeat(len(weighted) // max(len(column), 1))[rows]]
    wider = np.where(std < UNKNOWN_STD, (outliers.ratio**2 - 1.0) * std**2, 0.0)
    usual, own = np.linalg.inv(inverse[rows]), weighted[rows]
    error = (usual @ own[..., None])[..., 0]
    wide = usual + wider[:, :, None] * np.eye(3)
    wide_inverse = np.linalg.inv(wide)
    wide_weighted = (wide_inverse @ error[..., None])[..., 0]
    # The log of the ratio of both densities.
    log_ratio = 0.5 * (np.linalg.slogdet(usual)[1] - np.linalg.slogdet(wide)[1])
    log_ratio += 0.5 * (error * (own - wide_weighted)).sum(axis=1)
    log_odds = log_ratio + math.log(outliers.share / (1.0 - outliers.share))
    outlier[rows] = q = expit(log_odds)
    share, apart = q[:, None], own - wide_weighted
    mixed_weighted, mixed_inverse = np.zeros_like(weighted), np.zeros_like(inverse)
    mixed_weighted[rows] = (1.0 - share) * own + share * wide_weighted
    spread = (share * (1.0 - share))[..., None] * apart[:, :, None] * apart[:, None]
    shares = share[..., None]
    mixed_inverse[rows] = (1.0 - shares) * inverse[rows] + shares * wide_inverse - spread
    mixed_log = log_likelihood.copy()
    mixed_log[rows] += math.log1p(-outliers.share) + np.logaddexp(0.0, log_odds)
    return frozen(Innovation(jacobian, mixed_weighted, mixed_inverse, mixed_log)), outlier


@compiled
def _mix_noises(
    share: float,
    ratio: float,
    innovation: Innovation,
    noise_std: Float2,
    correlation: Float1,
    column: Int1,
) -> tuple[Innovation, FloatArray]:
    """Return the mixed innovations and the probabilities of outliers."""
    jacobian, weighted, inverse, log_likelihood = innovation
    count = len(log_likelihood)
    mixed_weighted = np.zeros((count, 2))
    mixed_inverse = np.zeros((count, 2, 2))
    mixed_log = np.full(count, -np.inf)
    outlier = np.zeros(count)
    excess = ratio * ratio - 1.0
    for row in range(count):
        if log_likelihood[row] == -np.inf:
            continue
        i, k, n = inverse[row, 0, 0], inverse[row, 0, 1], inverse[row, 1, 1]
        u, v = weighted[row, 0], weighted[row, 1]
        determinant = max(i * n - k * k, TINY)
        a, b, d = n / determinant, -k / determinant, i / determinant
        along, across = a * u + b * v, b * u + d * v
        z = column[row * len(column) // count]
        std, cross = noise_std[z], 0.0
        if len(correlation) and not math.isnan(correlation[z]):
            cross = correlation[z] * std[0] * std[1]
        wide_a = a + excess * std[0] ** 2
        wide_b = b + excess * cross
        wide_d = d + excess * std[1] ** 2
        wide_determinant = max(wide_a * wide_d - wide_b * wide_b, TINY)
        wide_u = (wide_d * along - wide_b * across) / wide_determinant
        wide_v = (wide_a * across - wide_b * along) / wide_determinant
        square = along * wide_u + across * wide_v
        log_usual = log_likelihood[row] + math.log(1.0 - share)
        log_outlier = (
            -0.5 * (square + math.log(wide_determinant)) - math.log(2.0 * math.pi) + math.log(share)
        )
        largest = max(log_usual, log_outlier)
        mixed_log[row] = largest + math.log(
            math.exp(log_usual - largest) + math.exp(log_outlier - largest)
        )
        q = math.exp(log_outlier - mixed_log[row])
        outlier[row], p = q, 1.0 - q
        mixed_weighted[row, 0], mixed_weighted[row, 1] = p * u + q * wide_u, p * v + q * wide_v
        # The spread of two components is q (1 - q) times the square of their difference.
        east, north = u - wide_u, v - wide_v
        mixed_inverse[row, 0, 0] = p * i + q * wide_d / wide_determinant - p * q * east * east
        mixed_inverse[row, 1, 1] = p * n + q * wide_a / wide_determinant - p * q * north * north
        cross = p * k - q * wide_b / wide_determinant - p * q * east * north
        mixed_inverse[row, 0, 1] = mixed_inverse[row, 1, 0] = cross
    return Innovation(jacobian, mixed_weighted, mixed_inverse, mixed_log), outlier
