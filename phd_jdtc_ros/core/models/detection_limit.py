"""A bound on the work of one update: with too many detections, the detection threshold is raised.

The cost of an update grows with the pairs of an engine's rows and detections within the gate. A
report of 100,000 detections, as of a jammed radar, would have hundreds of millions of them. So many
are clutter, whatever their amplitudes: taken for targets, those at the edge of the radars' range
would leave it, and no later scan could tell that they never were.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import FloatArray
from ..sensors.polar_radar import RadarModel
from ..types import Detections

# Candidate pairs of one update, of which about half are within the gate: 0.3 GB in all.
MOST_CANDIDATES = 1 << 22
# Detections of one update. Without rows to compare them with, each could be a newborn target.
MOST_DETECTIONS = 1 << 12
# Of n times this, the fractional parts are spread evenly.
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def thinned(
    predicted: FloatArray, targets: float, detections: Detections, radar: RadarModel
) -> tuple[Detections, RadarModel, float]:
    """Return as many of the detections as can be afforded, and the radar that reports no others.

    Parameters
    ----------
    predicted : array of shape (N, 2)
        The rows as the radar measures them: particles, or means of Gaussians.
    targets : float
        Expected number of targets that the rows stand for.
    detections : Detections
        M of them.
    radar : RadarModel

    Returns
    -------
    detections : Detections
        All of them, unless they exceed `MOST_DETECTIONS` or their candidate pairs
        `MOST_CANDIDATES`; then those with the largest amplitudes. Without amplitudes, and among
        equal ones, an even draw.
    radar : RadarModel
        With the threshold that the amplitudes now exceed, and with at least as much clutter as
        kept detections that are not of those targets.
    share : float
        Of the detections without amplitudes that were kept; 1 with amplitudes.
    """
    size = len(detections)
    if size <= MOST_DETECTIONS and len(predicted) * size <= MOST_CANDIDATES:
        return detections, radar, 1.0
    candidates = radar.candidates(predicted, detections)
    kept = min(MOST_DETECTIONS, int(size * min(MOST_CANDIDATES / max(candidates, 1), 1.0)))
    if kept >= size:
        return detections, radar, 1.0
    kept = max(kept, 1)
    draw = np.arange(size) * GOLDEN % 1.0
    if detections.amplitude is None:
        rows = np.sort(np.argsort(draw, kind="stable")[:kept])
        left = detections.take(rows)
        share = fewer = kept / size
        threshold = radar.threshold
    else:
        rows = np.sort(np.lexsort((draw, -detections.amplitude))[:kept])
        left = detections.take(rows)
        # Unknown amplitudes are NaN, which neither of these takes for the smallest.
        threshold = float(np.fmax(np.fmin.reduce(detections.amplitude[rows]), radar.threshold))
        fewer = float(np.exp(radar.clutter_amplitude.log_share(threshold, radar.threshold)))
        share = 1.0
    # A rate is that of a whole turn, of which the report may be a part.
    # Where nobody knows of which, it may be all.
    part = 1.0 if detections.coverage is None else detections.coverage.turns or 1.0
    rate = max(radar.clutter_rate * fewer, (kept - targets) / part)
    return left, replace(radar, threshold=threshold, clutter_rate=rate), share
