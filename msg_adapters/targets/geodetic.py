"""Geodetic positions of estimates: latitude, longitude, height, and course from true north."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import Estimates

# Speed below which a target has no course, m/s.
LEAST_SPEED = 1e-3


class Places(NamedTuple):
    """Geodetic positions, arrays of shape (T,)."""

    latitude: FloatArray  # Degrees (WGS84)
    longitude: FloatArray  # Degrees (WGS84), from -180 to 180
    height: FloatArray  # Metres, above the same zero as the plane's origin; NaN if unknown
    # Speed over ground, m/s. It is the speed in the plane, which exceeds the true one by the
    # plane's scale, at most 0.15 % near the radars.
    speed: FloatArray
    course: FloatArray  # Degrees from true north, clockwise, from 0 to 360; NaN at rest
    # Direction of true north, radians counter-clockwise from the plane's y axis.
    convergence: FloatArray


def of(estimates: Estimates, plane: Plane) -> Places:
    """Return the geodetic positions of estimates."""
    (x, y), (east, north) = estimates.position.T, estimates.velocity.T
    latitude, longitude = plane.to_geodetic(x, y)
    convergence = plane.convergence(latitude, longitude)
    speed = np.hypot(east, north)
    course = np.degrees(np.arctan2(east, north) + convergence) % 360.0
    return Places(
        latitude,
        longitude,
        estimates.known_attributes.height[:, 0] + plane.origin[2],
        speed,
        np.where(speed < LEAST_SPEED, np.nan, course),
        convergence,
    )
