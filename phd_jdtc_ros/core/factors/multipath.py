"""False detections behind targets: echoes that reach the radar by way of a target and a wall."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..arrays import FloatArray, wrap_angle, zeros_field
from ..sensors.point_gate import DETECTION_GATE_SIGMA
from ..sensors.polar_radar import polar_radars
from ..sensors.view import View
from .factor import Factor, Targets


@dataclass(frozen=True, eq=False)
class Multipath(Factor):
    """False detections at the azimuths of targets and at larger ranges; nothing is learned of them.

    A wave that a target has scattered, and that a wall, a quay or the radar's own platform reflects
    before it returns, has the azimuth of the target and a longer path (multiple and indirect
    echoes).
    """

    # Density of false detections behind a target, at its azimuth, relative to the uniform density.
    # The most accurate order of magnitude for a radar in a harbour.
    FACTOR: ClassVar[float] = 100.0
    # Variance of the difference of the echo's and the target's azimuth, relative to the variance of
    # a measured azimuth.
    OF_AZIMUTHS: ClassVar[float] = 2.0

    # Expected range and azimuth of each target, metres and radians, (T, 2).
    measured: FloatArray = zeros_field(0, 2)
    # Existence probability of each target, (T,).
    existence: FloatArray = zeros_field(0)

    def given(self, view: View, targets: Targets) -> View:
        """Return the report with the echoes behind its targets."""
        echoes = Multipath(targets.measured_by_target, targets.existence)
        return view.changed(local_clutter=(*view.local_clutter, echoes))

    def log_factor(self, log_factor: FloatArray, measurement: FloatArray, view: View) -> FloatArray:
        """Return the log ratio of clutter to the uniform one; see `view.LocalClutter`."""
        (radar,) = polar_radars([view.sensor])
        gate = DETECTION_GATE_SIGMA * radar.range_std
        density = self.density(measurement, radar.azimuth_std, gate)
        return np.log(np.exp(log_factor) + density / view.clutter_ratio(measurement))

    def density(
        self, measurement: FloatArray, azimuth_std: float, least_detour: float
    ) -> FloatArray:
        """Return the density of echoes relative to that of uniform false detections, (M,).

        The measurements, (M, 2), are ranges in metres and azimuths in radians. Detections closer
        behind a target than `least_detour`, in metres, are its own.
        """
        difference = measurement[:, None] - self.measured
        behind = difference[..., 0] > least_detour
        square = (wrap_angle(difference[..., 1]) / azimuth_std) ** 2 / self.OF_AZIMUTHS
        density: FloatArray = self.FACTOR * (behind * np.exp(-0.5 * square)) @ self.existence
        return density
