"""Notices that a sensor reports its detections several times, a little apart.

Each target then has several tracks, unless `cluster_distance` merges its detections. Detections
that are equal in every field are used once, and need no merging.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..sensors.sensor import Sensor
from ..types import Detections

# Finding: many detections have another one of their report within their noise.
TWINS = "detections_twinned"
# Number of detections, in reports of two or more, after which they are judged, and the largest
# number of a report that is compared.
JUDGED, MOST = 200, 256
# Detections are twins if the difference of each component is smaller than its standard deviation.
# Others up to twice as far apart show how many are there by chance, or side by side.
REACH = 1.0
# The least number of twins, as a share of the detections, and in standard deviations from chance.
SHARE, SURE_SIGMA = 0.1, 4.0


@dataclass
class TwinCheck:
    """Counts pairs of detections of one sensor that are nearer than two targets would stay."""

    _detections: int = field(init=False, default=0)
    _near: int = field(init=False, default=0)
    _around: int = field(init=False, default=0)

    def add(self, found: Detections, sensor: Sensor) -> int:
        """Return the number of twins since the last judgement if they are many, otherwise 0.

        The detections of the report must not have been merged.
        """
        if len(found) < 2 or sensor.cluster_distance:
            return 0
        # Neighbours remain neighbours in a part that is cut out by the first component.
        part = np.argsort(found.measurement[:, 0], kind="stable")[:MOST]
        measured, std = found.measurement[part], sensor.noise_std_of(found)[part]
        one, other = np.triu_indices(len(part), 1)
        difference = np.abs(sensor.wrap(measured[one] - measured[other]))
        apart = (difference / np.hypot(std[one], std[other])).max(axis=1)
        self._detections += len(part)
        self._near += int(np.count_nonzero(apart < REACH))
        self._around += int(np.count_nonzero(apart < 2.0 * REACH))
        if self._detections < JUDGED:
            return 0
        # In two components the outer area is three times as large as the inner one.
        by_chance = (self._around - self._near) / 3.0
        pairs = self._near - by_chance
        many = 2.0 * pairs > SHARE * self._detections
        sure = pairs > SURE_SIGMA * np.sqrt(self._near + by_chance / 3.0)
        found_twins = min(round(2.0 * pairs), self._detections) if many and sure else 0
        self._detections = self._near = self._around = 0
        return found_twins
