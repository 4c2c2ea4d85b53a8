"""Gates in range and azimuth around points, found by k-d trees.

Measurements are (range, azimuth), metres and radians.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import FloatArray, IntArray, wrap_angle
from ..types import FULL_TURN, Detections

# Radius of the gates in standard deviations; there the likelihood is 1e-8 of its peak.
DETECTION_GATE_SIGMA = 6.0


def gated_pairs(
    predicted: FloatArray, detections: Detections, noise_std: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the (point, detection) pairs within the gate and their log likelihood, (P,).

    It is log N(z; predicted, R), azimuth wrapped. Predictions, (N, 2), are at the scan's stamp, and
    the times of detections are ignored. `noise_std` are the standard deviations of each detection,
    (M, 2).
    """
    widest = noise_std.max(axis=0) if len(noise_std) else np.ones(2)
    trees = _tree(predicted, widest), _tree(detections.measurement, widest)
    found = trees[0].sparse_distance_matrix(trees[1], DETECTION_GATE_SIGMA, output_type="ndarray")
    order = np.argsort(found["i"] * len(detections) + found["j"])
    row, column = found["i"][order], found["j"][order]
    error = detections.measurement[column] - predicted[row]
    error[:, 1] = wrap_angle(error[:, 1])
    square = ((error / noise_std[column]) ** 2).sum(axis=1)
    inside = np.flatnonzero(square <= DETECTION_GATE_SIGMA**2)
    row, column = row[inside], column[inside]
    log_norm = -np.log(2.0 * np.pi * noise_std.prod(axis=1))
    return row, column, log_norm[column] - 0.5 * square[inside]


def candidate_count(predicted: FloatArray, detections: Detections, noise_std: FloatArray) -> int:
    """Return about how many pairs are near each other both in range and in azimuth.

    Of many points an even part is compared, which shows enough.
    """
    step, scale = max(len(predicted) // 512, 1), DETECTION_GATE_SIGMA * noise_std
    trees = _tree(predicted[::step], scale), _tree(detections.measurement, scale)
    return step * int(trees[0].count_neighbors(trees[1], 1.0, p=np.inf))


def _tree(measured: FloatArray, scale: FloatArray) -> Any:
    """Return the tree of measurements in units of a scale; azimuths have a period."""
    # Most trackers need none, and the import takes a tenth of the start.
    from scipy.spatial import cKDTree

    columns = measured[:, 0], np.mod(measured[:, 1], FULL_TURN)
    period = [0.0, np.nextafter(FULL_TURN / scale[1], np.inf)]
    return cKDTree(np.stack(columns, axis=1) / scale, balanced_tree=False, boxsize=period)
