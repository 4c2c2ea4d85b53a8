"""Reflected replies: they show a target's identity and height at another place.

A wall reflects a reply, or a radar errs by far more than its noise: the target is elsewhere, and
what it replies says nothing about where. Both sources of such a detection, the target itself and
its reflection, reply the same, so that no identity makes a place more credible than this bound.
"""

from __future__ import annotations

import numpy as np

from ...arrays import TINY, FloatArray, IntArray
from ...sensors.view import View

# Expected number of reflected replies of a target in a report.
RATE = 1e-3
# Smallest and largest distance of a reflected reply from its target, metres. Between these the
# logarithm of the distance is uniform, because detours have no typical length.
NEAREST, FARTHEST = 50.0, 1e5


def log_reflections(
    place: FloatArray, existence: FloatArray, column: IntArray, report: View
) -> FloatArray:
    """Return the log intensity of each edge's reflections, relative to uniform clutter, (E,).

    `place` and `existence` have the position and the existence probability of each edge's target,
    (E, 2) and (E,), and `column` its detection. Amplitudes and range rates of reflections are those
    of clutter.
    """
    sensor, measured = report.sensor, report.detections.measurement[column]
    distance = np.hypot(*(report.position[column] - place)[:, :2].T)
    area = 2.0 * np.pi * np.maximum(distance, NEAREST) ** 2 * np.log(FARTHEST / NEAREST)
    log_intensity = np.log(np.maximum(existence, TINY) * RATE / area)
    log_clutter = report.log_place_clutter(measured)
    ratio: FloatArray = log_intensity - sensor.log_jacobian(measured) - log_clutter
    return ratio
