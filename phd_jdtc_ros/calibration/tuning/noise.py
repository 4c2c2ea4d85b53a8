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

import math
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from phd_jdtc_ros.calibration import comparison, innovations, kinematics
from phd_jdtc_ros.core.arrays import FloatArray, IntArray, read_only
from phd_jdtc_ros.core.factors.outliers import Outliers
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.position import PositionSensor

from .plots import Plots
from .tracks import GATE, NoiseModel, Tracks

# Prior probability that a track's plot is clutter, uniform in the gate; amplitudes refine it.
CLUTTER_PROBABILITY = 0.01
# Logarithmic distance of the search's bounds from its start: for the measurement noise, and for
# the spectral densities.
SEARCH_WIDTH, DENSITY_SEARCH_WIDTH = np.log(30.0), np.log(1e4)
# Step of the finite differences, and bounds of the logarithmic ratio of the second density to the
# first.
STEP, LEAST_RATIO, MOST_RATIO = 1e-3, np.log(4.0), np.log(1e9)


@dataclass(frozen=True)
class Noise(NoiseModel):
    """Maximum likelihood estimate of the noise."""

    log_std: FloatArray  # Standard errors of the logarithms of `range_std` and `azimuth_std`, (2,)
    plots: int  # Number of plots used
    outliers: bool = False  # True if the standard deviations are those of all but the outliers


# Shares of the components of the measurement noise, and their variances relative to the first.
USUAL = (1.0,), (1.0,)
WITH_OUTLIERS = (1.0 - Outliers.start, Outliers.start), (1.0, Outliers.ratio**2)


@dataclass(frozen=True)
class _Sequences:
    """The plots of T tracks, one track after the other, and what is assumed of them."""

    first: IntArray  # The first plot of each track, and the number of plots, (T + 1,)
    time_s: FloatArray  # Ascending in each track, seconds, (K,)
    measurement: FloatArray  # Ranges and azimuths, or places, (K, 2)
    pose: FloatArray  # Pose of the radar at each plot, (K, 3)
    log_ratio: FloatArray  # Log likelihood ratios of the amplitudes, (K,)
    speed_std: float  # See `fit_noise`
    places: bool  # See `Plots`
    components: tuple[tuple[float, ...], tuple[float, ...]] = USUAL


def fit_noise(
    plots: Plots, tracks: Tracks, start: Noise, speed_std: float, log_ratio: FloatArray
) -> Noise:
    """Return the maximum likelihood estimate of the noise, given at least one track.

    The search begins at `start`. `speed_std` is the standard deviation of a new target's
    velocity along each axis, m/s; `log_ratio`, shape (N,), has the log likelihood ratio of each
    plot's amplitude, target to clutter.
    """
    sequences = _sequences(plots, tracks, log_ratio, speed_std)
    begin, bounds = _start(start, plots.places)
    # The likelihood is flat far from its maximum: a grid search first finds a start near it.
    grid = begin + _GRID
    grid = np.clip(grid, *np.transpose(bounds))
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
    begin, bounds = _start(noise, plots.places)
    (without,) = _log_likelihood(usual, begin[None])
    likelihood, found = _search(replace(usual, components=WITH_OUTLIERS), begin, bounds)
    # Outliers are found if the log likelihood is larger with them by this much: strong evidence
    # (Kass and Raftery, "Bayes factors", Journal of the American Statistical Association 90, 1995).
    return found if likelihood - without > 3.0 else None


def agreeing(plots: Plots, tracks: Tracks, noise: Noise) -> Noise:
    """Return the noise, enlarged where plots show a larger one: third differences, or rounding.

    The acceleration of the likelihood's modes is white, so that it takes a steady turn for a
    smaller noise; differences are blind to a constant acceleration. The tracker warns by the same
    differences, and therefore accepts what was tuned.
    """
    gaps = [np.diff(plots.time_s[own]) for own in tracks.plots]
    longest = comparison.MAX_AGE_SCANS * float(np.median(np.concatenate(gaps)))
    whole = [own for own in tracks.plots if len(own) >= innovations.PLOTS]
    if not whole:
        return noise
    rows = np.concatenate(
        [sliding_window_view(own, innovations.PLOTS)[:: innovations.KEPT] for own in whole]
    )
    rows = rows[(np.diff(plots.time_s[rows], axis=1) <= longest).all(axis=1)]
    variance = np.square([noise.range_std, noise.azimuth_std])
    frame = plots.measurement, plots.pose, variance
    _, covariance = kinematics.initial_state(*frame, 1.0, plots.places)
    columns = [plots.position, covariance[:, (0, 0, 1), (0, 1, 1)], plots.measurement]
    paths = np.column_stack([plots.time_s, *columns])[rows]
    slope = kinematics.slope(plots.position[rows[:, -1]], plots.pose[rows[:, -1]], plots.places)
    ratio = innovations.least_ratio(innovations.squares_of_differences(paths, slope))
    rounding = [_step(column) / math.sqrt(12.0) for column in plots.measurement.T]
    std = np.maximum(ratio * np.sqrt(variance), [*least_std(plots.places)])
    std = np.maximum(std, rounding)
    return replace(noise, range_std=float(std[0]), azimuth_std=float(std[1]))


def _step(value: FloatArray) -> float:
    """Return the step that values are rounded to, if most of them repeat; otherwise 0."""
    steps = np.diff(np.unique(value))
    if not len(steps) or 2 * len(steps) > len(value):
        return 0.0
    whole = steps / steps.min()
    # Relative error of multiples of a rounding step, for numbers in single precision.
    return float(steps.min()) if (np.abs(whole - np.rint(whole)) < 1e-3 * whole).all() else 0.0


def least_std(places: bool) -> tuple[float, ...]:
    """Return the smallest standard deviations of a measurement, or of `places`."""
    return (PositionSensor if places else RadarModel).least_std


def _start(noise: Noise, places: bool) -> tuple[FloatArray, list[tuple[float, float]]]:
    """Return the start of a search at an estimate, and its bounds; see `_log_likelihood`."""
    ratio = np.log(noise.densities[1] / noise.densities[0])
    least = np.log([*least_std(places), np.finfo(float).tiny])
    begin = np.maximum(np.log([noise.range_std, noise.azimuth_std, noise.densities[0]]), least)
    reach = np.array([SEARCH_WIDTH, SEARCH_WIDTH, DENSITY_SEARCH_WIDTH])
    lowest = np.maximum(begin - reach, least)
    bounds = [*zip(lowest, begin + reach, strict=True), (LEAST_RATIO, MOST_RATIO)]
    return np.append(begin, max(ratio, LEAST_RATIO)), bounds


def _search(
    sequences: _Sequences, begin: FloatArray, bounds: list[tuple[float, float]]
) -> tuple[float, Noise]:
    """Return the largest log likelihood near a point, and the noise there."""
    # A live tracker needs it only where it finds positions, and starts the sooner without.
    from scipy.optimize import minimize

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
        plots=len(sequences.time_s),
        outliers=sequences.components is WITH_OUTLIERS,
    )


_AXES = np.eye(4)
_SCALES = np.log([0.2, 0.45, 1.0, 2.2, 5.0])
# Among targets at rest the ratio of the densities may be far larger than among those that move.
_GRID = np.array([*product(_SCALES, _SCALES, np.log([1e-3, 1.0, 30.0]), np.log([1.0, 1e3, 1e6]))])
_OPTIONS = {"maxiter": 100, "ftol": 1e-11}


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
    # Approximate number of plots used; a regular subset of the tracks is taken if there are more.
    chosen = ordered[:: max(1, round(len(tracks.claimed) / 1000))]
    rows = np.concatenate(chosen)
    return _Sequences(
        np.cumsum([0, *map(len, chosen)]),
        plots.time_s[rows],
        plots.measurement[rows],
        plots.pose[rows],
        log_ratio[rows],
        speed_std,
        plots.places,
    )


def _log_likelihood(sequences: _Sequences, points: FloatArray) -> FloatArray:
    """Return the log likelihood at points, shape (B,).

    A point, of `points` (B, 4), has the logarithms of the standard deviations of range and
    azimuth, of the lower density, and of the ratio of the higher density to it.
    """
    # Numba is loaded with the loops when they are needed.
    from .linking import Plots, Points, filter_tracks

    variance = np.exp(2.0 * points[:, :2])
    density = np.exp(np.stack([points[:, 2], points[:, 2] + points[:, 3]], axis=1))
    first = sequences.first[:-1]
    plots = sequences.measurement[first], sequences.pose[first]
    start = kinematics.initial_state(
        *plots, variance[:, None], sequences.speed_std, sequences.places
    )
    share, ratio = sequences.components
    log_share = np.log((1.0 - CLUTTER_PROBABILITY) * np.array(share))
    log_clutter = math.log(2.0 * CLUTTER_PROBABILITY / GATE**2) - sequences.log_ratio
    components = variance[:, None] * np.array(ratio)[:, None]
    at_points = Points(*map(read_only, (*start, components, density)))
    columns = sequences.time_s, sequences.measurement, sequences.pose, log_clutter
    time_s, measurement, pose, clutter = map(read_only, columns)
    first = read_only(sequences.first, np.int64)
    sequence_plots = Plots(first, time_s, measurement, pose, clutter, sequences.places)
    likelihood: FloatArray = filter_tracks(at_points, log_share, sequence_plots)
    return likelihood
