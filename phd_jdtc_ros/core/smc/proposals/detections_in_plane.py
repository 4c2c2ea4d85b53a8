"""Positions of a scan's detections in the world frame.

`proposal` and `detected_newborns` draw particles near them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray, IntArray
from ...models.tracker_model import TrackerModel
from ...sensors.report import Report
from ...types import Scan


@dataclass(frozen=True)
class Places:
    """The detections of a scan in the world frame."""

    position: FloatArray  # Position at the time of the detection, metres, (M, 2)
    covariance: FloatArray  # Square metres, (M, 2, 2)
    time_s: FloatArray  # Time relative to the scan's stamp, seconds, (M,)

    def __len__(self) -> int:
        return len(self.position)

    def take(self, rows: IntArray) -> Places:
        """Return the detections of these rows."""
        return Places(self.position[rows], self.covariance[rows], self.time_s[rows])

    def sharper_than(self, std: float) -> Places:
        """Return the detections whose larger standard deviation is below `std`, metres."""
        return self.take(np.flatnonzero(np.linalg.eigvalsh(self.covariance)[:, 1] < std**2))


def places(scan: Scan, model: TrackerModel) -> Places:
    """Return the places of the detections of all radars in a scan."""
    found = [places_of(report) for report in model.reports(scan)]
    return Places(
        np.concatenate([np.zeros((0, 2)), *(part.position for part in found)]),
        np.concatenate([np.zeros((0, 2, 2)), *(part.covariance for part in found)]),
        np.concatenate([np.zeros(0), *(part.time_s for part in found)]),
    )


def places_of(report: Report) -> Places:
    """Return the places of one report's detections."""
    return Places(report.in_plane.position, report.in_plane.covariance, report.time_s)
