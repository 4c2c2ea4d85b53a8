"""The noise of a simulated radar's ranges and azimuths."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel


def with_noise(exact: FloatArray, radar: RadarModel, rng: np.random.Generator) -> FloatArray:
    """Return true ranges and azimuths with the radar's noise, metres and radians; shape (N, 2)."""
    std = np.tile(radar.noise_std, (len(exact), 1))
    std[:, 0] = np.hypot(std[:, 0], radar.range_growth * exact[:, 0])
    return polar(exact + rng.standard_normal(exact.shape) * std)


def polar(measurement: FloatArray) -> FloatArray:
    """Return measurements with ranges that are not negative and azimuths in (-pi, pi]."""
    return np.stack([np.abs(measurement[:, 0]), wrap_angle(measurement[:, 1])], axis=1)
