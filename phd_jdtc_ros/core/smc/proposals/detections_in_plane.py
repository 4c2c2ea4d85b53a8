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


class InPlane(NamedTuple):
    """The detections of a scan in the world frame."""

    position: FloatArray  # At the time of the detection, metres, (M, 2)
    covariance: FloatArray  # Square metres, (M, 2, 2)
    time_s: FloatArray  # Time relative to the scan's stamp, seconds, (M,)

    def take(self, rows: IntArray) -> InPlane:
        """Return the detections of these rows."""
        return InPlane(*(column[rows] for column in self))

    def sharper_than(self, std: float) -> InPlane:
        """Return the detections whose larger standard deviation is below `std`, metres."""
        return self.take(np.flatnonzero(np.linalg.eigvalsh(self.covariance)[:, 1] < std**2))


def scan_in_plane(scan: Scan, model: TrackerModel) -> InPlane:
    """Return the detections of all radars in a scan."""
    none = InPlane(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))
    reports = (report_in_plane(report) for report in model.reports(scan))
    return InPlane(*map(np.concatenate, zip(none, *reports, strict=True)))


def report_in_plane(report: Report) -> InPlane:
    """Return the detections of one report."""
    return InPlane(report.in_plane.position, report.in_plane.covariance, report.time_s)
