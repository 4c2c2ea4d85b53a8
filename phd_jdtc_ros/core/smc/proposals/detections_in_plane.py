"""Where a scan's detections are in the world.

The proposals of `proposal` and `detected_newborns` draw near them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray, IntArray
from ...models.tracker_model import TrackerModel
from ...sensors.polar_radar import LEAST_RANGE, RadarModel
from ...types import Detections, Scan


@dataclass(frozen=True)
class Places:
    """The detections of a scan in the world.

    Parameters
    ----------
    position : array of shape (M, 2)
        At the time of the detection, metres.
    covariance : array of shape (M, 2, 2)
        Square metres.
    time_s : array of shape (M,)
        Relative to the scan's stamp, seconds.
    """

    position: FloatArray
    covariance: FloatArray
    time_s: FloatArray

    def __len__(self) -> int:
        return len(self.position)

    def take(self, rows: IntArray) -> Places:
        """Return those of these rows."""
        return Places(self.position[rows], self.covariance[rows], self.time_s[rows])

    def sharper_than(self, std: float) -> Places:
        """Return the detections whose larger deviation is below `std`, metres."""
        return self.take(np.flatnonzero(np.linalg.eigvalsh(self.covariance)[:, 1] < std**2))


def places(scan: Scan, model: TrackerModel) -> Places:
    """Return where a scan's detections are, of all radars."""
    found = [places_of(detections, radar) for radar, detections in model.reports(scan)]
    return Places(
        np.concatenate([np.zeros((0, 2)), *(part.position for part in found)]),
        np.concatenate([np.zeros((0, 2, 2)), *(part.covariance for part in found)]),
        np.concatenate([np.zeros(0), *(part.time_s for part in found)]),
    )


def places_of(detections: Detections, radar: RadarModel) -> Places:
    """Return where one radar's detections are."""
    own = radar.detection_noise(detections)
    std = np.tile(radar.noise_std, (len(detections), 1)) if own is None else own
    distance, azimuth = detections.measurement.T
    bearing = azimuth + radar.yaw
    along = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    sides = (std[:, 0], std[:, 1] * np.maximum(distance, LEAST_RANGE))
    covariance = np.zeros((len(detections), 2, 2))
    for side, axis in zip(sides, (along, across), strict=True):
        covariance += (side**2)[:, None, None] * axis[:, :, None] * axis[:, None, :]
    time_s = np.zeros(len(detections)) if detections.time_s is None else detections.time_s
    return Places(radar.to_world(detections.measurement), covariance, time_s)
