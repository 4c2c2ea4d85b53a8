"""Association likelihoods of targets and of the other sources of detections."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import BoolArray, Float1, FloatArray, Int1, sum_by

# Lower bound of the probability of a missed detection, by which odds are divided.
LEAST_MISSED = 1e-6


class Claims(NamedTuple):
    """Association likelihoods of N rows of targets, and of all other sources, for M detections."""

    row: Int1  # Row of each pair within the gate, (P,)
    column: Int1  # Detection of each pair, (P,)
    mass: Float1  # Of each pair p_D L_z w, divided by a scale of its detection, (P,)
    other: Float1  # Intensity of clutter and undetected targets, divided by the same scale, (M,)
    detection_probability: Float1  # Of each row, (N,); 0 beyond the radar's range

    def share_of(self, rows: BoolArray | FloatArray) -> FloatArray:
        """Return the share of some rows, (N,), in the likelihoods of each detection, (M,).

        `rows` is a mask, or the probability that each row counts.
        """
        size = len(self.other)
        total = sum_by(self.column, self.mass, size)
        row_sum = sum_by(self.column, self.mass * rows.take(self.row), size)
        share: FloatArray = row_sum / np.where(total > 0.0, total, 1.0)
        return share


def undetected(existence: FloatArray, missed: FloatArray) -> FloatArray:
    """Return the existence probabilities of targets after a missed detection.

    `existence`, (T,), has the prior ones, and `missed`, (T,), the probabilities that each target
    exists and is not detected.
    """
    return missed / np.maximum(1.0 - existence + missed, LEAST_MISSED)
