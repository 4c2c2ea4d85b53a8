"""Tracks as ``sensor_msgs/NavSatFix``, for viewers with a map of the earth."""

from __future__ import annotations

import math

import numpy as np
from sensor_msgs.msg import NavSatFix, NavSatStatus

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import Estimates

from ..encoding import stamps
from . import geodetic, vertical
from .tracks import UNKNOWN_VARIANCE, child_frame, rows_by_track


def to_msgs(estimates: Estimates, plane: Plane) -> list[NavSatFix]:
    """Encode each labelled estimate as a message, by ascending track number.

    The frame is ``track_NUMBER``, as in odometry. The covariance has the axes true east, true north
    and up. An unknown height is NaN with the variance `UNKNOWN_VARIANCE`.
    """
    places, up = geodetic.of(estimates, plane), vertical.of(estimates)
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
