"""A report for the update: a sensor at its pose, its detections, and values computed from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arrays import FloatArray, IntArray
from ..types import Detections
from .gaussians import PlanePlots
from .range_rate import Rates
from .sensor import Sensor


@dataclass(frozen=True)
class Report:
    """Detections of one sensor, with the sensor at its pose; computed columns are cached.

    Parameters
    ----------
    sensor : Sensor
        At its pose, with its learned clutter.
    detections : Detections
        M detections; a report without detections is valid.
    share : float
        Share of the detections that `detection_limit` has kept, if they have no amplitudes.
    complete : bool
        Whether the report has all detections of the sensor.
    """

    sensor: Sensor
    detections: Detections
    share: float = 1.0
    complete: bool = True

    def __len__(self) -> int:
        return len(self.detections)

    def take(self, rows: IntArray) -> Report:
        """Return the report of these detections alone."""
        return replace(self, detections=self.detections.take(rows))

    def project_as(self, detections: Detections) -> Report:
        """Return the report with other projections of its detections."""
        return self if detections is self.detections else replace(self, detections=detections)

    @cached_property
    def detection_std(self) -> FloatArray:
        """Standard deviations of each detection, shape (M, Z)."""
        return self.sensor.noise_std_of(self.detections)

    @property
    def sensors_own_std(self) -> FloatArray:
        """Standard deviations that the sensor has and not the detection, (M, Z); NaN for others."""
        own, std = self.detections.noise_std, self.detection_std
        return std if own is None else np.where(np.isfinite(own), np.nan, std)

    @cached_property
    def in_plane(self) -> PlanePlots:
        """The detections in the world frame, at their own times."""
        return self.sensor.in_plane(self.detections)

    @cached_property
    def time_s(self) -> FloatArray:
        """Time of each detection relative to the stamp, seconds, shape (M,)."""
        times = self.detections.time_s
        return np.zeros(len(self)) if times is None else times

    @cached_property
    def range_rates(self) -> Rates | None:
        """Range rates of the detections; None without usable ones."""
        return self.sensor.rates_of(self.detections)

    @cached_property
    def log_clutter(self) -> FloatArray:
        """Log intensity of false detections at each detection, shape (M,)."""
        return self.sensor.log_clutter_intensity(self.detections)
