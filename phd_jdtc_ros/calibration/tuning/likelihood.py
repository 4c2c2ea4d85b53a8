"""A compiled IMM filter that gives the likelihood of a noise, given tracks; see `noise`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.compilation import Float1, Float2, Float3, Float4, Int1, compiled, inner

from .linking import copy, innovate, predict, update

# Transition probabilities [mode, mode at the next plot], and the probabilities of the modes at a
# track's first plot.
MODE_TRANSITION = np.array([[0.95, 0.05], [0.2, 0.8]])
INITIAL_MODE_PROBABILITY = np.array([0.8, 0.2])
# Smallest likelihood, which has a logarithm.
TINY = float(np.finfo(float).tiny)


class Points(NamedTuple):
    """B points at which the likelihood is computed."""

    start_mean: Float3  # Mean of each track at its first plot, (B, T, 4)
    start_covariance: Float4  # (B, T, 4, 4)
    variance: Float3  # Variances of the components of the noise, (B, C, 2)
    density: Float2  # Spectral density of each mode's acceleration, (B, 2)


class Plots(NamedTuple):
    """K plots of T tracks."""

    first: Int1  # The first plot of each track, and K, (T + 1,)
    time_s: Float1  # (K,)
    measurement: Float2  # (K, 2)
    pose: Float2  # Of the radar, (K, 3)
    # Log density of clutter in the gate relative to the peak of a target's density with the usual
    # noise, (K,).
    log_clutter: Float1
    places: bool  # See `plots.Plots`


class _Scratch(NamedTuple):
    """Working arrays for one update."""

    parts: Float1  # Log weight of each component, and of clutter, (C + 1,)
    found: Float2  # Results of `linking.innovate` for each component, (C, 4)
    step: Float4  # (C, 2, 2, 4)


@inner
def _mix(
    mean: FloatArray,
    covariance: FloatArray,
    probability: FloatArray,
    mixed_mean: FloatArray,
    mixed_covariance: FloatArray,
    later: FloatArray,
) -> None:
    """Write the moment-matched Gaussian of each mode at the next plot, and its probability."""
    for mode in range(2):
        first = probability[0] * MODE_TRANSITION[0, mode]
        later[mode] = first + probability[1] * MODE_TRANSITION[1, mode]
        share = first / max(later[mode], TINY)
        for i in range(4):
            mixed_mean[mode, i] = share * mean[0, i] + (1.0 - share) * mean[1, i]
            for k in range(4):
                apart = (mean[0, i] - mean[1, i]) * (mean[0, k] - mean[1, k])
                mixed_covariance[mode, i, k] = (
                    share * covariance[0, i, k]
                    + (1.0 - share) * covariance[1, i, k]
                    + share * (1.0 - share) * apart
                )


@inner
def _update(
    plots: Plots,
    k: int,
    variance: FloatArray,
    log_share: FloatArray,
    scratch: _Scratch,
    mean: FloatArray,
    covariance: FloatArray,
) -> float:
    """Update a Gaussian with plot `k`, and return the log density of the measurement."""
    measured, pose, log_clutter = plots.measurement[k], plots.pose[k], plots.log_clutter[k]
    (parts, found, step), count = scratch, len(log_share)
    for c in range(count):
        found[c, 0], found[c, 1], found[c, 2], found[c, 3] = innovate(
            mean, covariance, measured, pose, variance[c], plots.places, step[c]
        )
        log_peak = -0.5 * math.log(4.0 * math.pi**2 * found[c, 3])
        if c == 0:
            parts[count] = log_peak + log_clutter
        parts[c] = log_peak + log_share[c] - 0.5 * found[c, 2]
    total, highest = 0.0, max(parts)
    for part in parts:
        total += math.exp(part - highest)
    log_density = highest + math.log(total)
    for c in range(count):
        probability = math.exp(parts[c] - log_density)
        update(probability, found[c], step[c], mean, covariance)
    return float(log_density)


@compiled
def filter_tracks(points: Points, log_share: Float1, plots: Plots) -> FloatArray:
    """Return the log likelihood at B points, by a filter of each track from its first plot.

    `log_share`, (C,), has the logarithms of the shares of the components of the noise.
    """
    start_mean, start_covariance, variance, density = points
    first, time_s = plots.first, plots.time_s
    total = np.zeros(len(variance))
    mean, mixed_mean = np.empty((2, 4)), np.empty((2, 4))
    covariance, mixed_covariance = np.empty((2, 4, 4)), np.empty((2, 4, 4))
    probability, joint, count = np.empty(2), np.empty(2), len(log_share)
    scratch = _Scratch(np.empty(count + 1), np.empty((count, 4)), np.empty((count, 2, 2, 4)))
    for point in range(len(variance)):
        for track in range(len(first) - 1):
            for mode in range(2):
                probability[mode] = INITIAL_MODE_PROBABILITY[mode]
                begin, spread = start_mean[point, track], start_covariance[point, track]
                copy(begin, spread, mean[mode], covariance[mode])
            for k in range(first[track] + 1, first[track + 1]):
                dt = time_s[k] - time_s[k - 1]
                _mix(mean, covariance, probability, mixed_mean, mixed_covariance, joint)
                mean, mixed_mean = mixed_mean, mean
                covariance, mixed_covariance = mixed_covariance, covariance
                for mode in range(2):
                    predict(mean[mode], covariance[mode], dt, density[point, mode])
                    joint[mode] *= math.exp(
                        _update(
                            plots,
                            k,
                            variance[point],
                            log_share,
                            scratch,
                            mean[mode],
                            covariance[mode],
                        )
                    )
                likelihood = joint[0] + joint[1]
                total[point] += math.log(max(likelihood, TINY))
                for mode in range(2):
                    probability[mode] = joint[mode] / max(likelihood, TINY)
    return total
