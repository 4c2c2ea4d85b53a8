"""Measurement and process noise by the likelihood of tracks' innovations.

A target mostly keeps its velocity and sometimes manoeuvres. This is an interacting multiple model
(IMM) filter with two nearly-constant-velocity modes of different acceleration density. Both
densities and the two standard deviations of the measurement maximise the likelihood of all
innovations of all tracks; its curvature at the maximum gives their uncertainty. The same with a
share of outliers tells whether the measurement noise has heavy tails.

References
----------
Blom and Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian switching
coefficients", IEEE Trans. AC 33(8), 1988; Mehra, "On the identification of variances and adaptive
Kalman filtering", IEEE Trans. AC 15(2), 1970.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.outliers import Outliers

from . import kinematics
from .plots import Plots, PlotSequences, pad_rows
from .tracks import GATE, NoiseModel, Tracks

# Transition probabilities [mode, mode at the next plot], and the probabilities of the modes at a
# track's first plot.
MODE_TRANSITION = np.array([[0.95, 0.05], [0.2, 0.8]])
INITIAL_MODE_PROBABILITY = np.array([0.8, 0.2])
# Prior probability that a track's plot is clutter, uniform in the gate; amplitudes refine it.
CLUTTER_PROBABILITY = 0.01
# Outliers are found if the log likelihood is larger with them by this much: strong evidence (Kass
# and Raftery, "Bayes factors", Journal of the American Statistical Association 90, 1995).
LEAST_EVIDENCE = 3.0
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
    outliers: bool = False  # True if the standard deviations are those of all but the outliers


class _Component(NamedTuple):
    """A component of the mixture that is the measurement noise of a track's plots."""

    share: float
    ratio: float  # Its variances relative to those of the first component


USUAL = (_Component(1.0, 1.0),)
WITH_OUTLIERS = (
    _Component(1.0 - Outliers.share, 1.0),
    _Component(Outliers.share, Outliers.ratio**2),
)


@dataclass(frozen=True)
class _Sequences(PlotSequences):
    """Tracks, and what is assumed of them."""

    log_ratio: FloatArray  # Log likelihood ratios of the amplitudes, (K, T)
    speed_std: float  # See `fit_noise`
    components: tuple[_Component, ...] = USUAL


def fit_noise(
    plots: Plots, tracks: Tracks, start: Noise, speed_std: float, log_ratio: FloatArray
) -> Noise:
    """Return the maximum likelihood estimate of the noise, given at least one track.

    The search begins at `start`. `speed_std` is the standard deviation of a new target's
    velocity along each axis, m/s; `log_ratio`, shape (N,), has the log likelihood ratio of each
    plot's amplitude, target to clutter.
    """
    sequences = _sequences(plots, tracks, log_ratio, speed_std)
    begin, bounds = _start(start)
    # The likelihood is flat far from its maximum: a grid search first finds a start near it.
    grid = begin + _GRID
    grid[:, :3] = np.maximum(grid[:, :3], [lowest for lowest, _ in bounds[:3]])
    begin = grid[int(np.argmax(_log_likelihood(sequences, grid)))]
    _, noise = _search(sequences, begin, bounds)
    return noise


def find_outliers(
    plots: Plots, tracks: Tracks, noise: Noise, speed_std: float, log_ratio: FloatArray
) -> Noise | None:
    """Return the noise if some plots are `Outliers`; None if this is not clearly more likely.

    `noise` is the estimate without them; for the other parameters see `fit_noise`.
    """
    usual = _sequences(plots, tracks, log_ratio, speed_std)
    begin, bounds = _start(noise)
    (without,) = _log_likelihood(usual, begin[None])
    likelihood, found = _search(replace(usual, components=WITH_OUTLIERS), begin, bounds)
    return found if likelihood - without > LEAST_EVIDENCE else None


def _start(noise: Noise) -> tuple[FloatArray, list[tuple[float, float]]]:
    """Return the start of a search at an estimate, and its bounds; see `_log_likelihood`."""
    ratio = np.log(noise.densities[1] / noise.densities[0])
    least = np.log([*LEAST_STD, np.finfo(float).tiny])
    begin = np.maximum(np.log([noise.range_std, noise.azimuth_std, noise.densities[0]]), least)
    reach = np.array([SEARCH_WIDTH, SEARCH_WIDTH, DENSITY_SEARCH_WIDTH])
    lowest = np.maximum(begin - reach, least)
    bounds = [*zip(lowest, begin + reach, strict=True), (LEAST_RATIO, DENSITY_SEARCH_WIDTH)]
    return np.append(begin, max(ratio, LEAST_RATIO)), bounds


def _search(
    sequences: _Sequences, begin: FloatArray, bounds: list[tuple[float, float]]
) -> tuple[float, Noise]:
    """Return the largest log likelihood near a point, and the noise there."""

    def cost(point: FloatArray) -> tuple[float, FloatArray]:
        around = np.concatenate([point[None], point + STEP * _AXES, point - STEP * _AXES])
        value = _log_likelihood(sequences, around)
        return -float(value[0]), -(value[1:5] - value[5:]) / (2.0 * STEP)

    best = minimize(cost, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=_OPTIONS)
    point = best.x
    return -float(best.fun), Noise(
        range_std=float(np.exp(point[0])),
        azimuth_std=float(np.exp(point[1])),
        densities=(float(np.exp(point[2])), float(np.exp(point[2] + point[3]))),
        log_std=_standard_errors(sequences, point),
        plots=int(sequences.valid.sum()),
        outliers=len(sequences.components) > 1,
    )


_AXES = np.eye(4)
_SCALES = np.log([0.2, 0.45, 1.0, 2.2, 5.0])
_GRID = np.array(
    [(a, b, c, 0.0) for a, b, c in product(_SCALES, _SCALES, np.log([1e-3, 1.0, 30.0]))]
)
_OPTIONS = {"maxiter": 30, "ftol": 1e-7}


def _standard_errors(sequences: _Sequences, point: FloatArray) -> FloatArray:
    """Return the standard errors of the first two logarithms from the curvature, shape (2,)."""
    step = 0.1
    pairs = [(i, j) for i in range(4) for j in range(i, 4)]
    signs = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    tried = np.array(
        [point + step * (a * _AXES[i] + b * _AXES[j]) for i, j in pairs for a, b in signs]
    )
    value = _log_likelihood(sequences, tried).reshape(len(pairs), 4)
    curvature = np.zeros((4, 4))
    for (i, j), (pp, pm, mp, mm) in zip(pairs, value, strict=True):
        curvature[i, j] = curvature[j, i] = -(pp - pm - mp + mm) / (4.0 * step**2)
    # A prior of a factor of e^3 bounds the parameters that the data do not determine.
    value, vector = np.linalg.eigh(curvature)
    positive = (vector * np.maximum(value, 0.0)) @ vector.T
    covariance = np.linalg.inv(positive + np.eye(4) / 9.0)
    errors: FloatArray = np.sqrt(np.diag(covariance)[:2])
    return errors


def _sequences(plots: Plots, tracks: Tracks, log_ratio: FloatArray, speed_std: float) -> _Sequences:
    """Return a regular selection of the tracks, sorted by length.

    Manoeuvring targets have short tracks, which must be represented too.
    """
    ordered = sorted(tracks.plots, key=len, reverse=True)
    rows, valid = pad_rows(ordered[:: max(1, round(len(tracks.claimed) / MOST_PLOTS))])
    return _Sequences(
        valid,
        plots.time_s[rows],
        plots.measurement[rows],
        plots.pose[rows],
        log_ratio[rows],
        speed_std,
    )


def _log_likelihood(sequences: _Sequences, points: FloatArray) -> FloatArray:
    """Return the log likelihood at points, shape (B,).

    A point, of `points` (B, 4), has the logarithms of the standard deviations of range and
    azimuth, of the lower density, and of the ratio of the higher density to it.
    """
    variance = np.exp(2.0 * points[:, :2])[:, None, None, :]
    density = np.exp(np.stack([points[:, 2], points[:, 2] + points[:, 3]], axis=1))[:, :, None]
    length, tracks = sequences.time_s.shape
    mean, covariance = kinematics.initial_state(
        sequences.measurement[0], sequences.pose[0], variance, sequences.speed_std
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
            np.log(2.0 * CLUTTER_PROBABILITY / GATE**2) - sequences.log_ratio[k],
            sequences.components,
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
    log_clutter: FloatArray,
    components: tuple[_Component, ...],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return updated Gaussians and the log density of the measurements, shape (B, 2, T).

    `log_clutter`, shape (T,), is the log density of clutter in the gate relative to the peak of a
    target's density with the usual noise.
    """
    found = [
        kinematics.innovation(mean, covariance, measured, pose, each.ratio * variance)
        for each in components
    ]
    log_peak = [-np.log(2.0 * np.pi) - 0.5 * np.log(each.determinant) for each in found]
    log_parts = [
        peak + np.log((1.0 - CLUTTER_PROBABILITY) * component.share) - 0.5 * each.distance2
        for component, each, peak in zip(components, found, log_peak, strict=True)
    ]
    log_density = np.logaddexp.reduce([*log_parts, log_peak[0] + log_clutter])
    for each, log_part in zip(found, log_parts, strict=True):
        probability, gain = np.exp(log_part - log_density), each.gain
        mean = mean + probability[..., None] * np.einsum("brtij,brtj->brti", gain, each.value)
        reduction = gain @ each.cross.swapaxes(-1, -2)
        covariance = covariance - probability[..., None, None] * reduction
    return mean, covariance, log_density
