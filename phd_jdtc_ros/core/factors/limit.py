"""Bounds the work of one update: with too many detections, the detection threshold is raised.

The cost of an update grows with the pairs of an engine's rows and detections within the gate. A
report of 100,000 detections, for example of a jammed radar, would have hundreds of millions of
pairs. Detections in such numbers are clutter, whatever their amplitudes, unless known targets and
the configured clutter explain them. If they initiated tracks, those at the edge of the coverage
would leave it, and no later scan could delete them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import GOLDEN_RATIO, FloatArray
from ..sensors.view import View
from .factor import Factor, Targets

# Largest number of candidate pairs of one update, about half of them within the gate: 0.3 GB.
MAX_CANDIDATES = 1 << 22
# Largest number of detections of one update: each one can become a newborn target. 5000 targets and
# their clutter have 7500.
MAX_DETECTIONS = 1 << 16
# Largest number of detections that nothing explains.
MAX_UNEXPLAINED = 1 << 12


@dataclass(frozen=True)
class Limit(Factor):
    """The number of detections that one update can use."""

    def given(self, view: View, targets: Targets) -> View:
        """Return a report within the limits; see `limit_detections`."""
        size = len(view.detections.measurement)
        if size <= MAX_UNEXPLAINED and len(targets.measured) * size <= MAX_CANDIDATES:
            return view
        return limit_detections(view, targets.measured, targets.mass)


def limit_detections(report: View, predicted: FloatArray, mass: FloatArray) -> View:
    """Return a report within the limits, with a sensor that reports only these detections.

    It is the same report if it has at most `MAX_DETECTIONS` detections, or `MAX_UNEXPLAINED` if
    there are more than the targets and the clutter explain, and `MAX_CANDIDATES` candidate pairs
    with the predicted measurements, (N, Z). Otherwise it has the detections with the largest
    amplitudes; among equal ones, or without amplitudes, an even draw. The sensor's threshold is
    raised accordingly, and its clutter rate is at least the number of detections beyond the
    expected number of targets, which is the sum of `mass`.
    """
    detections, sensor, size = report.detections, report.sensor, len(report)
    if size <= MAX_UNEXPLAINED and len(predicted) * size <= MAX_CANDIDATES:
        return report
    # The rate is per whole revolution, of which the report may cover a part; an unknown part counts
    # as the whole revolution.
    revolution_share = report.part_of_revolution or 1.0
    targets = float(mass.sum())
    # Number of standard deviations of a Poisson number by which a report may have more than
    # expected.
    explained_sigma = 5.0
    explained = targets + report.clutter_rate * revolution_share + explained_sigma * np.sqrt(size)
    most = MAX_DETECTIONS if size <= explained else MAX_UNEXPLAINED
    if size <= most and len(predicted) * size <= MAX_CANDIDATES:
        return report
    candidates = sensor.of_gaussians.candidate_count(predicted, detections)
    count = min(most, int(size * min(MAX_CANDIDATES / max(candidates, 1), 1.0)))
    if count >= size:
        return report
    count = max(count, 1)
    # Even over the order of the report, and the same in every run.
    draw = np.arange(size) * GOLDEN_RATIO % 1.0
    if detections.amplitude is None:
        rows = np.sort(np.argsort(draw, kind="stable")[:count])
        selected = detections.take(rows)
        share = clutter_share = count / size
        threshold = sensor.threshold
    else:
        rows = np.sort(np.lexsort((draw, -detections.amplitude))[:count])
        selected = detections.take(rows)
        # Unknown amplitudes are NaN, which neither function returns as the smallest.
        threshold = float(np.fmax(np.fmin.reduce(detections.amplitude[rows]), sensor.threshold))
        law = report.clutter_amplitude
        clutter_share = float(np.exp(law.log_share(threshold, sensor.threshold)))
        share = 1.0
    # What no target explains is clutter, however little of it is configured.
    rate = max(report.clutter_rate * clutter_share, (count - targets) / revolution_share)
    return report.changed(
        sensor=sensor.changed(threshold=threshold),
        clutter_rate=rate,
        detections=selected,
        share=share,
        complete=False,
    )
