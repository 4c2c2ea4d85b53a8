"""Measurement and process noise by the likelihood of tracks' innovations.

A target mostly keeps its velocity and sometimes manoeuvres. This is an interacting multiple model
(IMM) filter with two nearly-constant-velocity modes of different acceleration density. Both
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

from phd_jdtc_ros.core.arrays import FloatArray

from . import kinematics
from .plots import Plots, PlotSequences, pad_rows
from .tracks import GATE, NoiseModel, Tracks

# Transition probabilities [mode, mode at the next plot], and the probabilities of the modes at a
# track's first plot.
MODE_TRANSITION = np.array([[0.95, 0.05], [0.2, 0.8]])
INITIAL_MODE_PROBABILITY = np.array([0.8, 0.2])
# Prior probability that a track's plot is clutter, uniform in the gate; amplitudes refine it.
OUTLIER_PROBABILITY = 0.01
# Approximate number of plots used; a regular subset of the tracks is taken if there are more.
MOST_PLOTS = 1000
# Logarithmic distance of the search's bounds from its start: for the measurement noise, and for
# the spectral densities.
SEARCH_WIDTH, DENSITY_SEARCH_WIDTH = np.log(30.0), np.log(1e4)
# Smallest standard deviations, m and rad: only synthetic plots are more accurate.
LEAST_STD = (0.01, 1e-5)
# Step of the finite differences, and least logarithmic ratio of the second density to the first.
STEP, LEAST_RATIO = 0.02, np.log(4.0)


@dataclass(frozen=True)
class Noise(NoiseModel):
    """Maximum likelihood estimate of the noise."""

    log_std: FloatArray  # Standard errors of the logarithms of `range_std` and `azimuth_std`, (2,)
    plots: int  # Number of plots used


@dataclass(frozen=True)
class _Sequences(PlotSequences):
    """Tracks with the log likelihood ratios of their amplitudes, shape (K, T)."""

    log_ratio: FloatArray


def fit_noise(
    plots: Plots, tracks: Tracks, start: Noise, speed_std: float, log_ratio: FloatArray
) -> Noise:
    """Return the maximum likelihood estimate of the noise, given at least one track.

    The search begins at `start`. `speed_std` is the standard deviation of a new target's
    velocity along each axis, m/s; `log_ratio`, shape (N,), has the log likelihood ratio of each
    plot's amplitude, target to clutter.
    """
    sequences = _sequences(plots, tracks, log_ratio)
    ratio = np.log(start.densities[1] / start.densities[0])
    least = np.log([*LEAST_STD, np.finfo(float).tiny])
    begin = np.maximum(np.log([start.range_std, start.azimuth_std, start.densities[0]]), least)
    begin = np.append(begin, max(ratio, LEAST_RATIO))
    reach = np.array([SEARCH_WIDTH, SEARCH_WIDTH, DENSITY_SEARCH_WIDTH])
    lowest = np.maximum(begin[:3] - reach, least)
    bounds = [*zip(lowest, begin[:3] + reach, strict=True), (LEAST_RATIO, DENSITY_SEARCH_WIDTH)]

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
        plots=int(sequences.valid.sum()),
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
    value, vector = np.linalg.eigh(curvature)
    positive = (vector * np.maximum(value, 0.0)) @ vector.T
    covariance = np.linalg.inv(positive + np.eye(4) / 9.0)
    errors: FloatArray = np.sqrt(np.diag(covariance)[:2])
    return errors


def _sequences(plots: Plots, tracks: Tracks, log_ratio: FloatArray) -> _Sequences:
    """Return a regular selection of the tracks, sorted by length.

    Manoeuvring targets have short tracks, which must be represented too.
    """
    ordered = sorted(tracks.plots, key=len, reverse=True)
    rows, valid = pad_rows(ordered[:: max(1, round(len(tracks.claimed) / MOST_PLOTS))])
    return _Sequences(
        valid, plots.time_s[rows], plots.measurement[rows], plots.pose[rows], log_ratio[rows]
    )


def _log_likelihood(sequences: _Sequences, points: FloatArray, speed_std: float) -> FloatArray:
    """Return the log likelihood at points, shape (B,).

    A point, of `points` (B, 4), has the logarithms of the standard deviations of range and
    azimuth, of the lower density, and of the ratio of the higher density to it; `speed_std` as
    in `fit_noise`.
    """
    variance = np.exp(2.0 * points[:, :2])[:, None, None, :]
    density = np.exp(np.stack([points[:, 2], points[:, 2] + points[:, 3]], axis=1))[:, :, None]
    length, tracks = sequences.time_s.shape
    mean, covariance = kinematics.initial_state(
        sequences.measurement[0], sequences.pose[0], variance, speed_std
    )
    mean = np.repeat(mean, 2, axis=1)
    covariance = np.repeat(covariance, 2, axis=1)
    probability = np.tile(INITIAL_MODE_PROBABILITY[None, :, None], (len(points), 1, tracks))
    total = np.zeros(len(points))
    for k in range(1, length):
        dt = sequences.time_s[k] - sequences.time_s[k - 1]
        mixed, probability = _mix(mean, covariance, probability)
        predicted = kinematics.predict(
            *mixed, dt + np.zeros_like(probability), density + 0.0 * probability
        )
        mean, covariance, log_density = _update(
            *predicted,
            sequences.measurement[k],
            sequences.pose[k],
            variance,
            np.log(2.0 * OUTLIER_PROBABILITY / GATE**2) - sequences.log_ratio[k],
        )
        joint = probability * np.exp(log_density)
        likelihood = np.einsum("brt->bt", joint)
        log_likelihood = np.log(np.maximum(likelihood, np.finfo(float).tiny))
        total += (log_likelihood * sequences.valid[k]).sum(axis=1)
        probability = joint / np.maximum(likelihood, 1e-300)[:, None]
    return total


def _mix(
    mean: FloatArray, covariance: FloatArray, probability: FloatArray
) -> tuple[tuple[FloatArray, FloatArray], FloatArray]:
    """Return the moment-matched Gaussian of each mode at the next plot, (B, 2, T, ...)."""
    joint = probability[:, :, None, :] * MODE_TRANSITION[None, :, :, None]
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
    found = kinematics.innovation(mean, covariance, measured, pose, variance)
    log_norm = -np.log(2.0 * np.pi) - 0.5 * np.log(found.determinant)
    log_inlier = np.log1p(-OUTLIER_PROBABILITY) - 0.5 * found.distance2
    log_density = log_norm + np.logaddexp(log_inlier, log_outlier)
    inlier_probability = np.exp(log_inlier - (log_density - log_norm))
    gain = found.gain
    step = np.einsum("brtij,brtj->brti", gain, found.value)
    reduction = gain @ found.cross.swapaxes(-1, -2)
    return (
        mean + inlier_probability[..., None] * step,
        covariance - inlier_probability[..., None, None] * reduction,
        log_density,
    )
