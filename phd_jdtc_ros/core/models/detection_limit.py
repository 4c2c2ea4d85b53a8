"""A bound on the work of one update: with too many detections, the detection threshold is raised.

The cost of an update grows with the pairs of an engine's rows and detections within the gate. A
report of 100,000 detections, as of a jammed radar, would have hundreds of millions of them. So many
are clutter, whatever their amplitudes: taken for targets, those at the edge of the radars' range
would leave it, and no later scan could tell that they never were.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..sensors.report import Report

# Candidate pairs of one update, of which about half are within the gate: 0.3 GB in all.
MOST_CANDIDATES = 1 << 22
# Detections of one update. Without rows to compare them with, each could be a newborn target.
MOST_DETECTIONS = 1 << 12
# Of n times this, the fractional parts are spread evenly.
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def limited(report: Report, predicted: FloatArray, targets: float) -> Report:
    """Return a report of as many detections as can be afforded, by a sensor that has no others.

    Parameters
    ----------
    report : Report
        Of M detections.
    predicted : array of shape (N, Z)
        The rows as the sensor measures them: particles, or means of Gaussians.
    targets : float
        Expected number of targets that the rows stand for.

    Returns
    -------
    Report
        The same, unless the detections exceed `MOST_DETECTIONS` or their candidate pairs
        `MOST_CANDIDATES`. Otherwise it has the detections with the largest amplitudes; without
        amplitudes, and among equal ones, an even draw. The sensor's threshold is what their
        amplitudes exceed, and its clutter rate at least the number of those that are not of the
        targets.
    """
    detections, sensor, size = report.detections, report.sensor, len(report)
    if size <= MOST_DETECTIONS and len(predicted) * size <= MOST_CANDIDATES:
        return report
    candidates = sensor.candidates(predicted, detections)
    kept = min(MOST_DETECTIONS, int(size * min(MOST_CANDIDATES / max(candidates, 1), 1.0)))
    if kept >= size:
        return report
    kept = max(kept, 1)
    draw = np.arange(size) * GOLDEN % 1.0
    if detections.amplitude is None:
        rows = np.sort(np.argsort(draw, kind="stable")[:kept])
        left = detections.take(rows)
        share = fewer = kept / size
        threshold = sensor.threshold
    else:
        rows = np.sort(np.lexsort((draw, -detections.amplitude))[:kept])
        left = detections.take(rows)
        # Unknown amplitudes are NaN, which neither of these takes for the smallest.
        threshold = float(np.fmax(np.fmin.reduce(detections.amplitude[rows]), sensor.threshold))
        fewer = float(np.exp(sensor.clutter_amplitude.log_share(threshold, sensor.threshold)))
        share = 1.0
    # A rate is that of a whole turn, of which the report may be a part.
    # Where nobody knows of which, it may be all.
    part = 1.0 if detections.coverage is None else detections.coverage.turns or 1.0
    rate = max(sensor.clutter_rate * fewer, (kept - targets) / part)
    return Report(sensor.limited(threshold, rate), left, share, complete=False)
