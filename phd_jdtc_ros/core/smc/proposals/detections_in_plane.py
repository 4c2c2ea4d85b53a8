"""Positions of a scan's detections in the world frame.

`proposal` and `detected_newborns` draw particles near them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...models.tracker_model import TrackerModel
from ...sensors.report import Report
from ...types import Scan


class Places(NamedTuple):
    """The detections of a scan in the world frame."""

    position: FloatArray  # At the time of the detection, metres, (M, 2)
    covariance: FloatArray  # Square metres, (M, 2, 2)
    time_s: FloatArray  # Time relative to the scan's stamp, seconds, (M,)

    def take(self, rows: IntArray) -> Places:
        """Return the detections of these rows."""
        return Places(*(column[rows] for column in self))

    def sharper_than(self, std: float) -> Places:
        """Return the detections whose larger standard deviation is below `std`, metres."""
        return self.take(np.flatnonzero(np.linalg.eigvalsh(self.covariance)[:, 1] < std**2))


def places(scan: Scan, model: TrackerModel) -> Places:
    """Return the places of the detections of all radars in a scan."""
    none = Places(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))
    found = (places_of(report) for report in model.reports(scan))
    return Places(*map(np.concatenate, zip(none, *found, strict=True)))


def places_of(report: Report) -> Places:
    """Return the places of one report's detections."""
    return Places(report.in_plane.position, report.in_plane.covariance, report.time_s)
