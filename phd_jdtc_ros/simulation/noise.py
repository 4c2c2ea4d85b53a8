"""Measurements of a simulated radar, and the noise of its ranges and azimuths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel


class Observation(NamedTuple):
    """A radar's measurements of targets or reflectors."""

    # Range and azimuth with noise, metres and radians, (N, 2); ranges are not negative, azimuths
    # are in (-pi, pi].
    measurement: FloatArray
    amplitude: FloatArray  # Envelopes, (N,)
    seen: BoolArray  # True where the radar detects the target, (N,)

    @property
    def detected(self) -> tuple[FloatArray, FloatArray]:
        """Measurements and amplitudes of what is detected."""
        return self.measurement[self.seen], self.amplitude[self.seen]


def with_noise(exact: FloatArray, radar: RadarModel, rng: np.random.Generator) -> FloatArray:
    """Return true ranges and azimuths with the radar's noise, metres and radians; shape (N, 2)."""
    return polar(exact + rng.standard_normal(exact.shape) * radar.noise_std)


def polar(measurement: FloatArray) -> FloatArray:
    """Return measurements with ranges that are not negative and azimuths in (-pi, pi]."""
    return np.stack([np.abs(measurement[:, 0]), wrap_angle(measurement[:, 1])], axis=1)
