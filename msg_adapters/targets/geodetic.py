"""Geodetic positions of estimates: latitude, longitude, height, and course from true north."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from sensor_msgs.msg import NavSatFix, NavSatStatus

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import Estimates

from ..encoding import stamps
from . import vertical
from .tracks import UNKNOWN_VARIANCE, child_frame, rows_by_track

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


def to_msgs(estimates: Estimates, plane: Plane) -> list[NavSatFix]:
    """Encode each labelled estimate as a message, by ascending track number.

    The frame is ``track_NUMBER``, as in odometry. The covariance has the axes true east, true north
    and up. An unknown height is NaN with the variance `UNKNOWN_VARIANCE`.
    """
    places, up = of(estimates, plane), vertical.of(estimates)
    variance = np.where(up.known, up.covariance[:, 0, 0], UNKNOWN_VARIANCE)
    return [
        NavSatFix(
            header=stamps.header(estimates.stamp_ns, child_frame(track)),
            # Viewers ignore messages without a fix.
            status=NavSatStatus(status=NavSatStatus.STATUS_FIX, service=0),
            latitude=float(places.latitude[row]),
            longitude=float(places.longitude[row]),
            altitude=float(places.height[row]),
            position_covariance=_covariance(
                estimates.position_covariance[row], float(places.convergence[row]), variance[row]
            ),
            position_covariance_type=NavSatFix.COVARIANCE_TYPE_KNOWN,
        )
        for track, row in rows_by_track(estimates)
    ]


def _covariance(planar: FloatArray, convergence: float, upward: float) -> FloatArray:
    """Rotate a planar covariance to east, north and up, shape (9,)."""
    cos, sin = math.cos(convergence), math.sin(convergence)
    turned = np.array([[cos, sin], [-sin, cos]])
    found = np.zeros((3, 3))
    found[:2, :2] = turned @ planar @ turned.T
    found[2, 2] = upward
    return found.ravel()
