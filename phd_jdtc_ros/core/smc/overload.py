# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bound on the work of one update: with too many detections, the detection threshold is raised.

The cost of an update grows with the pairs of particles and detections within the gate. A report of
100,000 detections, as of a jammed radar, would have hundreds of millions of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import FloatArray
from ..models.radar import RadarModel
from ..types import Detections

# Candidate pairs of one update, of which about half are within the gate: 0.3 GB in all.
MOST_CANDIDATES = 1 << 22
# Of n times this, the fractional parts are spread evenly.
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def thinned(
    predicted: FloatArray, detections: Detections, radar: RadarModel
) -> tuple[Detections, RadarModel, float]:
    """Return as many of the detections as can be afforded, and the radar that reports no others.

    Parameters
    ----------
    predicted : array of shape (N, 2)
        The particles as the radar measures them.
    detections : Detections
        M of them.
    radar : RadarModel

    Returns
    -------
    detections : Detections
        All of them, unless their candidate pairs exceed `MOST_CANDIDATES`; then those with the
        largest amplitudes. Without amplitudes, and among equal ones, an even draw.
    radar : RadarModel
        With the threshold that the amplitudes now exceed, and the clutter above it.
    share : float
        Of the detections without amplitudes that were kept; 1 with amplitudes.
    """
    size = len(detections)
    if len(predicted) * size <= MOST_CANDIDATES:
        return detections, radar, 1.0
    candidates = radar.candidates(predicted, detections)
    if candidates <= MOST_CANDIDATES:
        return detections, radar, 1.0
    kept = max(int(size * (MOST_CANDIDATES / candidates)), 1)
    draw = np.arange(size) * GOLDEN % 1.0
    if detections.amplitude is None:
        rows = np.sort(np.argsort(draw, kind="stable")[:kept])
        return detections.take(rows), radar, kept / size
    rows = np.sort(np.lexsort((draw, -detections.amplitude))[:kept])
    amplitude = detections.amplitude[rows]
    threshold = max(float(amplitude.min()), radar.threshold)
    fewer = np.exp(-0.5 * (threshold**2 - radar.threshold**2))
    raised = replace(radar, threshold=threshold, clutter_rate=radar.clutter_rate * float(fewer))
    return Detections(detections.measurement[rows], amplitude), raised, 1.0
