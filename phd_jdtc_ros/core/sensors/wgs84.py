"""The WGS84 ellipsoid: conversion of latitude, longitude and height to Cartesian and back.

Cartesian coordinates are earth-centred and earth-fixed, metres: x to latitude 0 and longitude 0, z
to the north pole.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray

# Semi-axes of WGS84, metres, and its flattening.
SEMI_MAJOR = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
SEMI_MINOR = SEMI_MAJOR * (1.0 - FLATTENING)
# Squares of the first and the second eccentricity.
E_SQUARE = FLATTENING * (2.0 - FLATTENING)
E_SECOND_SQUARE = E_SQUARE / (1.0 - E_SQUARE)
# Iterations of Bowring's formula: up to 50 km high the first is a micrometre off, and each further
# one leaves far less than a thousandth of the error.
PASSES = 2


def to_cartesian(
    latitude: npt.ArrayLike, longitude: npt.ArrayLike, height: npt.ArrayLike
) -> FloatArray:
    """Return Cartesian coordinates, metres, shape (..., 3).

    Latitudes and longitudes are in degrees, heights in metres above the ellipsoid, (...,).
    """
    north, east = np.radians(latitude), np.radians(longitude)
    across = normal_radius(np.asarray(latitude, dtype=float))
    above = np.asarray(height, dtype=float)
    from_axis = (across + above) * np.cos(north)
    return np.stack(
        np.broadcast_arrays(
            from_axis * np.cos(east),
            from_axis * np.sin(east),
            ((1.0 - E_SQUARE) * across + above) * np.sin(north),
        ),
        axis=-1,
    )


def to_geodetic(position: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return latitudes and longitudes, degrees, and heights above the ellipsoid, metres.

    The places, (..., 3), are Cartesian, and not near the centre of the earth.

    B. R. Bowring, "Transformation from spatial to geographical coordinates", Survey Review 23(181),
    1976.
    """
    x, y, z = position[..., 0], position[..., 1], position[..., 2]
    from_axis = np.hypot(x, y)
    # The reduced latitude belongs to the point on the circle around the ellipse.
    sin, cos = z * SEMI_MAJOR, from_axis * SEMI_MINOR
    for _ in range(PASSES):
        length = np.hypot(sin, cos)
        up = z + E_SECOND_SQUARE * SEMI_MINOR * (sin / length) ** 3
        out = from_axis - E_SQUARE * SEMI_MAJOR * (cos / length) ** 3
        sin, cos = up * SEMI_MINOR, out * SEMI_MAJOR
    north = np.arctan2(up, out)
    sin, cos = np.sin(north), np.cos(north)
    across = SEMI_MAJOR / np.sqrt(1.0 - E_SQUARE * sin**2)
    # The height is the component along the normal, which is defined at the poles too.
    height = from_axis * cos + z * sin - SEMI_MAJOR**2 / across
    return np.degrees(north), np.degrees(np.arctan2(y, x)), height


def east_north_up(latitude: float, longitude: float) -> FloatArray:
    """Return the unit vectors to the east, to the north and up as rows, shape (3, 3)."""
    north, east = math.radians(latitude), math.radians(longitude)
    sin, cos = math.sin(north), math.cos(north)
    return np.array(
        [
            [-math.sin(east), math.cos(east), 0.0],
            [-sin * math.cos(east), -sin * math.sin(east), cos],
            [cos * math.cos(east), cos * math.sin(east), sin],
        ]
    )


def normal_radius(latitude: FloatArray) -> FloatArray:
    """Return the radius of curvature in the prime vertical at latitudes in degrees, metres."""
    return SEMI_MAJOR / np.sqrt(1.0 - E_SQUARE * np.sin(np.radians(latitude)) ** 2)
