"""Converts radars, detections and states between this package and Stone Soup."""

from __future__ import annotations

import math
from collections.abc import Iterable
from datetime import datetime

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.state_space import VX, VY, X, Y
from phd_jdtc_ros.evaluation.comparison import PointSet

from .soup import Part, Soup

# Indices in our state of Stone Soup's state [x, vx, y, vy], and its own indices of positions and
# velocities.
STATE = [X, VX, Y, VY]
POSITION, VELOCITY = [0, 2], [1, 3]
# Arbitrary origin of Stone Soup's calendar times; only differences matter.
EPOCH = datetime(2000, 1, 1)


def measurement_model(soup: Soup, radar: RadarModel) -> Part:
    """Return Stone Soup's model of a radar: (bearing, range)."""
    return soup.CartesianToBearingRange(
        ndim_state=len(STATE),
        mapping=POSITION,
        noise_covar=np.diag([radar.azimuth_std**2, radar.range_std**2]),
        translation_offset=soup.StateVector(radar.position),
        rotation_offset=soup.StateVector([0.0, 0.0, radar.yaw]),
    )


def detection(soup: Soup, measurement: FloatArray, stamp: datetime, sensor: Part) -> Part:
    """Return Stone Soup's detection of a (range, azimuth)."""
    radius, azimuth = measurement
    return soup.Detection(
        soup.StateVector([soup.Bearing(azimuth), radius]), timestamp=stamp, measurement_model=sensor
    )


def clutter_density(radar: RadarModel) -> float:
    """Return the clutter density per radian and metre, slightly above 0 without clutter."""
    rate = max(radar.clutter_rate, 1e-9)
    return rate / (2.0 * math.pi * radar.visibility.clutter_range)


def point_set(states: Iterable[Part]) -> PointSet:
    """Return the positions of Stone Soup's states, with class 0."""
    rows = [np.asarray(state.state_vector, dtype=float)[POSITION, 0] for state in states]
    return PointSet(np.reshape(rows, (-1, 2)), np.zeros(len(rows), dtype=np.int64))
