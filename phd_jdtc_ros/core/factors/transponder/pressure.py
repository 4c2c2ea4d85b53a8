"""The difference between pressure altitudes and heights, learned from elevations.

Reported heights are pressure altitudes, and states have geometric heights. The difference of both
is the same for all targets, up to its deviation. A detection with both a height and an elevation
shows it, with the error of the height that follows from range and elevation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from ...arrays import FloatArray
from ...sensors.gaussians import UNKNOWN_STD
from ...sensors.sensor import Sensor
from ...sensors.spatial_radar import SpatialRadar
from ...sensors.view import View
from ...snapshot import MAX_STAMP_NS, MAX_STATE, floats, integers
from ..factor import Factor, Look


@dataclass(frozen=True, eq=False)
class Pressure(Factor):
    """Mean and deviation of the pressure altitude minus the height, metres.

    The factors of all sensors learn the same from each look. An error that the elevations of a
    radar have in common, such as that of its levelling, is learned with it.
    """

    NAME: ClassVar[str] = "pressure"
    SIZES: ClassVar[Mapping[str, int]] = {}
    # Spectral density with which the difference drifts, m^2/s: 8 m, or one hPa, in half an hour.
    DRIFT: ClassVar[float] = 0.035

    start: float  # Mean before any detection, metres
    start_std: float  # Standard deviation before any detection, metres
    # Difference of the mean from `start`, metres; its variance, square metres, negative if nothing
    # was learned; and the time of the last look, nanoseconds.
    learned: Annotated[float, floats("", -MAX_STATE, MAX_STATE)] = 0.0
    variance: Annotated[float, floats("", -1.0, MAX_STATE)] = -1.0
    stamp_ns: Annotated[int, integers("", 0, MAX_STAMP_NS)] = 0

    @property
    def mean(self) -> float:
        """Expected pressure altitude minus height, metres."""
        return self.start + self.learned

    @property
    def std(self) -> float:
        """Standard deviation of this difference, metres."""
        return self.start_std if self.variance < 0.0 else math.sqrt(self.variance)

    def expect(self, view: View) -> View:
        """Return the report with geometric heights in the place of pressure altitudes."""
        reported = view.sensor.reported_heights
        if reported is None or not reported.pressure or view.detections.z is None:
            return view
        heights = reported.of(view.detections)
        std = None if heights is None else np.hypot(heights.std, self.std)
        detections = view.detections.changed(z=view.detections.z - self.mean, z_std=std)
        return view.changed(detections=detections)

    def learn(self, look: Look) -> Pressure:
        """Learn from the detections with a height and an elevation."""
        view, radar = look.view, look.view.sensor
        reported, heights = radar.reported_heights, view.heights
        if heights is None or reported is None or not reported.pressure or not self.start_std:
            return self
        if not isinstance(radar, SpatialRadar):
            return self
        known = heights.is_known & (view.detection_std[:, 2] < UNKNOWN_STD)
        if not known.any():
            return self
        rows = known.nonzero()[0]
        found = radar.in_plane(view.detections.take(rows))
        variance = self._variance_at(view.stamp_ns)
        own = heights.take(rows)
        # The deviations of the heights have that of the difference, which is learned, in them.
        white = np.maximum(own.std**2 - self.std**2, reported.std**2)
        spread = found.covariance[:, 2, 2] + white
        own = own._replace(std=np.sqrt(spread))
        nothing = np.zeros(len(rows))
        error = own.height - found.position[:, 2]
        _, true = own._replace(height=error).compare(nothing, nothing + variance)
        return self._after(error, true / spread, variance, view.stamp_ns)

    def learn_from_others(self, look: Look) -> Pressure:
        """Learn from a look of another sensor, as from those of its own."""
        return self.learn(look)

    def _variance_at(self, stamp_ns: int) -> float:
        """Return the variance at a later time, square metres."""
        elapsed_s = max(stamp_ns - self.stamp_ns, 0) * 1e-9 if self.variance >= 0.0 else 0.0
        return min(self.std**2 + self.DRIFT * elapsed_s, self.start_std**2)

    def _after(
        self, error: FloatArray, weight: FloatArray, variance: float, stamp_ns: int
    ) -> Pressure:
        """Return the factor after errors of the mean with these inverse variances, (M,)."""
        updated = 1.0 / (1.0 / variance + float(weight.sum()))
        step = updated * float((weight * error).sum())
        return self.changed(learned=self.learned + step, variance=updated, stamp_ns=stamp_ns)

    @property
    def learns_figures(self) -> bool:
        """Whether `figures` has any, once something was learned."""
        return self.start_std > 0.0

    def figures(self, sensor: Sensor) -> dict[str, float]:
        """Return the difference and its standard deviation, metres."""
        if self.variance < 0.0:
            return {}
        return {"pressure_altitude_above_height": self.mean, "pressure_altitude_std": self.std}
