"""The recent looks of all sensors, which may have detected targets that are still unknown.

A target that is unknown to a report appeared since the sensor's previous report, or was missed by
it. Other sensors may have looked in between. Those that do not cover the place, such as a lidar
with a tenth of a radar's range, must not make births there less probable.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..sensors.sensor import Sensor
from ..sensors.view import View
from ..snapshot import MAX_INDEX, MAX_STAMP_NS, MAX_STATE, floats, integers
from ..types import FULL_TURN, Coverage, Detections, Pose

# Number of looks that are kept: two sensors that look some thirty times as often as another one.
MOST = 64


class RecentLooks(NamedTuple):
    """The latest looks of all sensors, in the order of their stamps."""

    stamp_ns: Annotated[IntArray, integers("K", 0, MAX_STAMP_NS)]
    sensor: Annotated[IntArray, integers("K", 0, MAX_INDEX)]  # Index of the sensor
    # Position of the sensor in the world, metres, its yaw, radians, height, pitch and roll, (K, 6).
    pose: Annotated[FloatArray, floats("KP", -MAX_STATE, MAX_STATE)]
    # First azimuth and extent of its coverage, radians, (K, 2); 0 and 0 for the field of view.
    coverage: Annotated[FloatArray, floats("KC", -MAX_STATE, FULL_TURN)]
    # Share of the sensor's detections that were used, (K,).
    share: Annotated[FloatArray, floats("K", 0.0, 1.0)]
    # Its own area, see `Detections.area`, (K, 4); zeros for the sensor's.
    area: Annotated[FloatArray, floats("KA", -MAX_STATE, MAX_STATE)]

    @staticmethod
    def of_none() -> RecentLooks:
        """Return no looks."""
        none = np.zeros(0, dtype=np.int64)
        places = np.zeros((0, 6)), np.zeros((0, 2))
        return RecentLooks(none, none, *places, np.zeros(0), np.zeros((0, 4)))

    def after(self, view: View, sensor: int) -> RecentLooks:
        """Return the looks after a report of the sensor with this index."""
        site, sector = view.sensor, view.detections.coverage
        edges = (0.0, 0.0) if sector is None else (sector.start, sector.width)
        pose = site.pose
        place = (*pose.position, pose.yaw, pose.height, *pose.tilt)
        look = view.stamp_ns, sensor, place, edges, view.share, view.detections.area or (0.0,) * 4
        return RecentLooks._make(
            np.concatenate([column[-MOST + 1 :], [value]])
            for column, value in zip(self, look, strict=True)
        )

    def since_last(self, view: View, sensor: int) -> tuple[int, IntArray] | None:
        """Return the row of the sensor's previous look, and those of later ones before a report.

        None if the previous look is not among the recent ones.
        """
        count = np.searchsorted(self.stamp_ns, view.stamp_ns)
        looks = np.flatnonzero(self.sensor[:count] == sensor)
        if not len(looks):
            return None
        last = int(looks[-1])
        return last, np.flatnonzero(self.stamp_ns[:count] > self.stamp_ns[last])

    def view(self, row: int, sensor: Sensor) -> View:
        """Return a look as a report of its sensor without detections."""
        x, y, yaw, height, pitch, roll = self.pose[row].tolist()
        pose = Pose((x, y), yaw, height=height, tilt=(pitch, roll))
        start, width = self.coverage[row].tolist()
        sector = Coverage(start, width) if width else None
        least_x, least_y, *largest = self.area[row].tolist()
        area = (least_x, least_y, largest[0], largest[1]) if largest[0] > least_x else None
        detections = Detections(np.zeros((0, 2)), None, coverage=sector, area=area)
        stamp_ns, share = int(self.stamp_ns[row]), float(self.share[row])
        return View.of(sensor.at(pose), detections, stamp_ns, share)
