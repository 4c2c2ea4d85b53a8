"""Measurement and process noise by the likelihood of tracks' innovations.

A target keeps its velocity for most of the time and manoeuvres for some: two motions with white
accelerations of different densities, mixed as in an interacting multiple model filter. Both
densities and the two standard deviations of the measurement maximise the likelihood of all
innovations of all tracks; its curvature at the maximum gives their uncertainty.

References
----------
Blom and Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian switching
coefficients", IEEE Trans. AC 33(8), 1988; Mehra, "On the identification of variances and adaptive
Kalman filtering", IEEE Trans. AC 15(2), 1970.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import minimize

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from . import kinematics
from .plots import Plots
from .tracks import GATE, Deviations, Tracks

# Transition probabilities [motion, motion at the next plot].
SWITCH = np.array([[0.95, 0.05], [0.2, 0.8]])
FIRST = np.array([0.8, 0.2])
# Prior probability that a track's plot is clutter, uniform in the gate; amplitudes refine it.
WRONG = 0.01
# Approximate number of plots used; a regular subset of the tracks is taken if there are more.
MOST_PLOTS = 1000
# Logarithmic distance of the search's bounds from its start: for the measurement noise, and for
# the spectral densities.
FAR, FAR_DENSITY = np.log(30.0), np.log(1e4)
# Smallest standard deviations, m and rad: only synthetic plots are more accurate.
LEAST_STD = (0.01, 1e-5)
# Step of the finite differences, and least logarithmic ratio of the second density to the first.
STEP, LEAST_RATIO = 0.02, np.log(4.0)


@dataclass(frozen=True)
class Noise(Deviations):
    """Maximum likelihood estimate of the noise.

    Parameters
    ----------
    range_std, azimuth_std, densities
        See `Deviations`.
    log_std : array of shape (2,)
        Standard errors of the logarithms of `range_std` and `azimuth_std`.
    plots : int
        Number of plots used.
    """

    log_std: FloatArray
    plots: int


@dataclass(frozen=True)
class _Sequences:
    """Tracks as T rows of K plots; shorter tracks are padded."""

    time_s: FloatArray
    measurement: FloatArray
    pose: FloatArray
    there: FloatArray
    log_ratio: FloatArray


def fit_noise(
    plots: Plots, tracks: Tracks, start: Noise, speed_std: float, log_ratio: FloatArray
) -> Noise:
    """Return the maximum likelihood estimate of the noise.

    Parameters
    ----------
    tracks : Tracks
        At least one.
    start : Noise
        Initial value of the search.
    speed_std : float
        Standard deviation of a new target's velocity along each axis, metres per second.
    log_ratio : array of shape (N,)
        Log likelihood ratio of each plot's amplitude, target to clutter.
    """
    sequences = _sequences(plots, tracks, log_ratio)
    ratio = np.log(start.densities[1] / start.densities[0])
    least = np.log([*LEAST_STD, np.finfo(float).tiny])
    begin = np.maximum(np.log([start.range_std, start.azimuth_std, start.densities[0]]), least)
    begin = np.append(begin, max(ratio, LEAST_RATIO))
    reach = np.array([FAR, FAR, FAR_DENSITY])
    lowest = np.maximum(begin[:3] - reach, least)
    bounds = [*zip(lowest, begin[:3] + reach, strict=True), (LEAST_RATIO, FAR_DENSITY)]

    def cost(point: FloatArray) -> tuple[float, FloatArray]:
        around = np.concatenate([point[None], point + STEP * _AXES, point - STEP * _AXES])
        value = _log_likelihood(sequences, around, speed_std)
        return -float(value[0]), -(value[1:5] - value[5:]) / (2.0 * STEP)

    # The likelihood is flat far from its maximum: a grid search first finds a start near it.
    grid = begin + _GRID
    grid[:, :3] = np.maximum(grid[:, :3], lowest)
    begin = grid[int(np.argmax(_log_likelihood(sequences, grid, speed_std)))]
    best = minimize(cost, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=_OPTIONS)
    point = best.x
    densities = float(np.exp(point[2])), float(np.exp(point[2] + point[3]))
    return Noise(
        range_std=float(np.exp(point[0])),
        azimuth_std=float(np.exp(point[1])),
        densities=densities,
        log_std=_standard_errors(sequences, point, speed_std),
        plots=int(sequences.there.sum()),
    )


_AXES = np.eye(4)
_SCALES = np.log([0.2, 0.45, 1.0, 2.2, 5.0])
_GRID = np.array(
    [(a, b, c, 0.0) for a, b, c in product(_SCALES, _SCALES, np.log([1e-3, 1.0, 30.0]))]
)
_OPTIONS = {"maxiter": 30, "ftol": 1e-7}


def _standard_errors(sequences: _Sequences, point: FloatArray, speed_std: float) -> FloatArray:
    """Return the standard errors of the first two logarithms from the curvature, shape (2,)."""
    step = 0.1
    pairs = [(i, j) for i in range(4) for j in range(i, 4)]
    signs = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    tried = np.array(
        [point + step * (a * _AXES[i] + b * _AXES[j]) for i, j in pairs for a, b in signs]
    )
    value = _log_likelihood(sequences, tried, speed_std).reshape(len(pairs), 4)
    curvature = np.zeros((4, 4))
    for (i, j), (pp, pm, mp, mm) in zip(pairs, value, strict=True):
        curvature[i, j] = curvature[j, i] = -(pp - pm - mp + mm) / (4.0 * step**2)
    # A prior of a factor of e^3 bounds the parameters that the data do not determine.
    covariance = np.linalg.inv(_positive(curvature) + np.eye(4) / 9.0)
    deviations: FloatArray = np.sqrt(np.diag(covariance)[:2])
    return deviations


def _positive(matrix: FloatArray) -> FloatArray:
    """Return a symmetric matrix with its negative eigenvalues set to 0."""
    value, vector = np.linalg.eigh(matrix)
    kept: FloatArray = (vector * np.maximum(value, 0.0)) @ vector.T
    return kept


def _sequences(plots: Plots, tracks: Tracks, log_ratio: FloatArray) -> _Sequences:
    """Return long and short tracks as rows; tracks of manoeuvring targets are short."""
    ordered = sorted(tracks.plots, key=len, reverse=True)
    chosen: list[IntArray] = ordered[:: max(1, round(len(tracks.claimed) / MOST_PLOTS))]
    longest = max(map(len, chosen))
    rows = np.array([np.append(own, np.full(longest - len(own), own[-1])) for own in chosen])
    there = np.arange(longest) < np.array([[len(own)] for own in chosen])
    return _Sequences(
        time_s=plots.time_s[rows],
        measurement=plots.measurement[rows],
        pose=plots.pose[rows],
        there=there.astype(np.float64),
        log_ratio=log_ratio[rows],
    )


def _log_likelihood(sequences: _Sequences, points: FloatArray, speed_std: float) -> FloatArray:
    """Return the log likelihood at points, shape (B,).

    Parameters
    ----------
    points : array of shape (B, 4)
        Logarithms of the standard deviations of range and azimuth, of the lower density, and of the
        ratio of the higher density to it.
    speed_std : float
        Standard deviation of a new target's velocity along each axis, metres per second.
    """
    variance = np.exp(2.0 * points[:, :2])[:, None, None, :]
    density = np.exp(np.stack([points[:, 2], points[:, 2] + points[:, 3]], axis=1))[:, :, None]
    tracks, length = sequences.time_s.shape
    first, pose = sequences.measurement[:, 0], sequences.pose[:, 0]
    mean, covariance = kinematics.initial_state(
        first,
        pose,
        variance[..., 0] * np.ones(tracks),
        variance[..., 1] * np.ones(tracks),
        speed_std,
    )
    mean = np.repeat(mean, 2, axis=1)
    covariance = np.repeat(covariance, 2, axis=1)
    weight = np.tile(FIRST[None, :, None], (len(points), 1, tracks))
    total = np.zeros(len(points))
    for k in range(1, length):
        there = sequences.there[:, k]
        dt = sequences.time_s[:, k] - sequences.time_s[:, k - 1]
        mixed, weight = _mix(mean, covariance, weight)
        grown = kinematics.predict(*mixed, dt + np.zeros_like(weight), density + 0.0 * weight)
        mean, covariance, log_density = _update(
            *grown,
            sequences.measurement[:, k],
            sequences.pose[:, k],
            variance,
            np.log(2.0 * WRONG / GATE**2) - sequences.log_ratio[:, k],
        )
        likelihood = np.einsum("brt->bt", weight * np.exp(log_density))
        total += (np.log(np.maximum(likelihood, np.finfo(float).tiny)) * there).sum(axis=1)
        weight = weight * np.exp(log_density) / np.maximum(likelihood, 1e-300)[:, None]
    return total


def _mix(
    mean: FloatArray, covariance: FloatArray, weight: FloatArray
) -> tuple[tuple[FloatArray, FloatArray], FloatArray]:
    """Return the moment-matched Gaussian of each motion at the next plot, (B, 2, T, ...)."""
    joint = weight[:, :, None, :] * SWITCH[None, :, :, None]
    later = joint.sum(axis=1)
    share = joint / np.maximum(later, 1e-300)[:, None]
    centre = np.einsum("bijt,bitd->bjtd", share, mean)
    spread = np.einsum("bijt,bitde->bjtde", share, covariance)
    off = mean[:, :, None] - centre[:, None]
    spread += np.einsum("bijt,bijtd,bijte->bjtde", share, off, off)
    return (centre, spread), later


def _update(
    mean: FloatArray,
    covariance: FloatArray,
    measured: FloatArray,
    pose: FloatArray,
    variance: FloatArray,
    log_outlier: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return updated Gaussians and the log density of the measurements, shape (B, 2, T).

    `log_outlier`, shape (T,), is the log density of clutter in the gate relative to the peak of a
    target's density.
    """
    expected, jacobian = kinematics.linearise(
        mean[..., :2], np.broadcast_to(pose, (*mean.shape[:-1], 3))
    )
    error = kinematics.innovation(np.broadcast_to(measured, expected.shape).copy(), expected)
    cross = covariance[..., :, :2] @ jacobian.swapaxes(-1, -2)
    spread = jacobian @ cross[..., :2, :]
    spread[..., 0, 0] += variance[..., 0]
    spread[..., 1, 1] += variance[..., 1]
    inverted, determinant = kinematics.inverse(spread)
    scaled = np.einsum("brtij,brtj->brti", inverted, error)
    square = (scaled * error).sum(axis=-1)
    log_norm = -np.log(2.0 * np.pi) - 0.5 * np.log(determinant)
    log_density = log_norm + np.logaddexp(np.log1p(-WRONG) - 0.5 * square, log_outlier)
    right = np.exp(np.log1p(-WRONG) - 0.5 * square - (log_density - log_norm))
    gain = cross @ inverted
    mean = mean + right[..., None] * np.einsum("brtij,brtj->brti", gain, error)
    covariance = covariance - right[..., None, None] * (gain @ cross.swapaxes(-1, -2))
    return mean, covariance, log_density
