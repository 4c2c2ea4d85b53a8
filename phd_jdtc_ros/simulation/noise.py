"""Measurements of a simulated radar, and the noise of its ranges and azimuths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel


class Observation(NamedTuple):
    """A radar's measurements of targets or reflectors."""

    # With noise, metres and radians, (N, Z); ranges are not negative, azimuths are in (-pi, pi].
    measurement: FloatArray
    amplitude: FloatArray  # Envelopes, (N,)
    seen: BoolArray  # True where the radar detects the target, (N,)

    @property
    def detected(self) -> tuple[FloatArray, FloatArray]:
        """Measurements and amplitudes of what is detected."""
        return self.measurement[self.seen], self.amplitude[self.seen]


def with_noise(exact: FloatArray, radar: RadarModel, rng: np.random.Generator) -> FloatArray:
    """Return true measurements with the radar's noise, metres and radians; shape (N, Z).

    A radar without elevations has none to add noise to: they stay, and are not sent.
    """
    std = radar.noise_std.copy()
    std[2:][std[2:] >= UNKNOWN_STD] = 0.0
    return polar(exact + rng.standard_normal(exact.shape) * std)


def polar(measurement: FloatArray) -> FloatArray:
    """Return measurements with ranges that are not negative and azimuths in (-pi, pi]."""
    distance, azimuth = np.abs(measurement[:, 0]), wrap_angle(measurement[:, 1])
    return np.column_stack([distance, azimuth, measurement[:, 2:]])
