"""Gates in range and azimuth around points, the particles.

The module has pure functions of arrays; measurements are (range, azimuth), metres and radians.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray, wrap_angle
from ..pair_search.gating import cell_lists, count_near, near_detections
from ..types import Detections

# Radius of the gates in standard deviations; there the likelihood is 1e-8 of its peak.
DETECTION_GATE_SIGMA = 6.0


def gated_pairs(
    predicted: FloatArray,
    detections: Detections,
    noise_std: FloatArray,
    own_std: FloatArray | None,
    rate: FloatArray | None = None,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the (particle, detection) pairs within the gate and their log likelihood, (P,).

    It is log N(z; predicted, R), azimuth wrapped, at the time of the detection. Predictions, (N,
    2), are at the scan's stamp; `rate`, (N, 2), is their time derivative, required for detections
    with their own times. `noise_std` are the standard deviations of the radar, and `own_std` those
    of each detection, (M, 2); None for the radar's.

    The cost grows with the number of pairs found and not with N x M; see `pair_search.gating`. A
    particle's measurement is extrapolated to the time of a detection by its rate, to first order.
    At 250 m/s and 5 km the error is 0.1 m after 0.125 s.
    """
    std, shift = own_std, detections.time_s if len(predicted) else None
    if std is None and shift is None:
        log_norm = -np.log(2.0 * np.pi * noise_std[0] * noise_std[1])
        particle, detection, square = _near_pairs(predicted, detections, noise_std)
        return particle, detection, log_norm - 0.5 * square
    if std is None:
        std = np.tile(noise_std, (len(detections), 1))
    widest = std.max(axis=0, initial=0.0) if len(std) else noise_std
    if shift is not None and rate is not None and len(shift):
        fastest = np.abs(rate).max(axis=0) * np.abs(shift).max()
        # An ellipse larger by this margin contains every shifted gate.
        widest = widest + 1.5 * fastest / DETECTION_GATE_SIGMA
    particle, detection, _ = _near_pairs(predicted, detections, widest)
    error = detections.measurement[detection] - predicted[particle]
    if shift is not None and rate is not None:
        error -= rate[particle] * shift[detection, None]
    error[:, 1] = wrap_angle(error[:, 1])
    square = ((error / std[detection]) ** 2).sum(axis=1)
    inside = np.flatnonzero(square <= DETECTION_GATE_SIGMA**2)
    log_norm_of = -np.log(2.0 * np.pi * std.prod(axis=1))
    inside_detection = detection[inside]
    return particle[inside], inside_detection, log_norm_of[inside_detection] - 0.5 * square[inside]


def candidate_count(predicted: FloatArray, detections: Detections, noise_std: FloatArray) -> int:
    """Return the number of candidate pairs of `gated_pairs`; about twice the pairs in the gate."""
    return count_near(_wrap_azimuths(detections), *_gates(noise_std), predicted)


def _near_pairs(
    predicted: FloatArray, detections: Detections, std: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the pairs within the gate of these deviations; see `gating.near_detections`."""
    gates = _gates(std)
    lists = cell_lists(_wrap_azimuths(detections), *gates)
    return near_detections(lists, predicted, std, DETECTION_GATE_SIGMA, gates[1])


def _gates(std: FloatArray) -> tuple[float, float]:
    """Return the half widths of the gate, metres and radians."""
    return DETECTION_GATE_SIGMA * float(std[0]), min(DETECTION_GATE_SIGMA * float(std[1]), np.pi)


def _wrap_azimuths(detections: Detections) -> FloatArray:
    """Return the measurements with azimuths in (-pi, pi]."""
    measured: FloatArray = detections.measurement.copy()
    measured[:, 1] = wrap_angle(measured[:, 1])
    return measured
