"""Notices that a sensor reports its detections several times, a little apart.

Each target then has several tracks, unless `cluster_distance` merges its detections. Detections
that are equal in every field are used once, and need no merging.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from ..sensors.sensor import Sensor
from ..types import Detections

# Finding: many detections have another one of their report within their noise.
TWINS = "detections_twinned"
# Number of detections, in reports of two or more, after which they are judged, and of those that
# are not compared after a judgement without twins, which takes time.
JUDGED, PASSED = 200, 2000
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
    _to_pass: int = field(init=False, default=0)

    def add(self, found: Detections, sensor: Sensor) -> int:
        """Return the number of twins since the last judgement if they are many, otherwise 0.

        The detections of the report must not have been merged.
        """
        if len(found) < 2 or sensor.cluster_distance:
            return 0
        if self._to_pass > 0:
            self._to_pass -= len(found)
            return 0
        # A difference has twice the variance of one detection.
        std = np.sqrt(2.0) * np.median(sensor.noise_std_of(found), axis=0)
        tree = cKDTree(found.measurement / std)
        reach = [REACH, 2.0 * REACH]
        near, around = (tree.count_neighbors(tree, reach, p=np.inf) - len(found)) // 2
        self._detections += len(found)
        self._near += int(near)
        self._around += int(around)
        if self._detections < JUDGED:
            return 0
        # In two components the outer area is three times as large as the inner one.
        by_chance = (self._around - self._near) / 3.0
        pairs = self._near - by_chance
        many = 2.0 * pairs > SHARE * self._detections
        sure = pairs > SURE_SIGMA * np.sqrt(self._near + by_chance / 3.0)
        found_twins = min(round(2.0 * pairs), self._detections) if many and sure else 0
        self._to_pass = 0 if found_twins else PASSED
        self._detections = self._near = self._around = 0
        return found_twins
