"""A radar's site on the round earth: projection of its measurements to the world's plane and back.

::

    slant range, azimuth, height or elevation
      |  around the site, on the WGS84 ellipsoid
    latitude and longitude
      |  the world's plane, see `Plane`
    range and azimuth around the site's position in the plane

Rays are straight: the refraction of the atmosphere, about a quarter of the earth's curvature, is
neglected. It matters only if the elevation is given instead of the height.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from . import wgs84

# Largest slant range that is projected, metres; no radar measures a larger one.
MAX_SLANT_RANGE = 2e6
# Newton steps of the elevation: the first value is 3 m off at 400 km, and each step leaves a
# hundred thousandth of the error.
STEPS = 2
# Largest distance of a site from the plane's origin, metres: there lengths are 0.15 % too long.
MAX_SITE_DISTANCE = 500e3
# Smallest plausible noise of plots on the round earth, in range, metres, and azimuth, radians: what
# is measured within a recording lacks the errors of heights, and a lost track costs more than less
# smoothing.
LEAST_STD = (5.0, float(np.radians(0.01)))


class Plane(Protocol):
    """A conformal map of the earth about an origin, degrees to metres and back."""

    @property
    def origin(self) -> Sequence[float]:
        """Latitude and longitude of the plane's zero, degrees, height of the world's zero, m."""

    def to_plane(
        self, latitude: npt.ArrayLike, longitude: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Return x, to the east, and y, to the north, metres."""

    def to_geodetic(self, x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return latitudes and longitudes, degrees."""

    def convergence(self, latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> FloatArray:
        """Return the direction of true north, radians counter-clockwise from the y axis."""


@dataclass(frozen=True)
class Site:
    """Position and orientation of a radar on the earth, and in the plane.

    All heights are above the ellipsoid. Heights above the sea, or of the standard atmosphere,
    differ by at most some hundred metres; if site and targets use the same ones, positions are
    wrong by a ten-thousandth of the difference.
    """

    # Latitude and longitude, degrees, and height of the antenna, metres.
    geodetic: tuple[float, float, float]
    plane: Plane
    # Direction of the sensor's x axis from true east, radians counter-clockwise.
    yaw_from_east: float = 0.0

    @cached_property
    def position(self) -> tuple[float, float]:
        """Position in the plane, metres."""
        x, y = self.plane.to_plane(*self.geodetic[:2])
        return float(x), float(y)

    @cached_property
    def yaw(self) -> float:
        """Direction of the sensor's x axis in the plane, radians counter-clockwise."""
        return float(self.plane.convergence(*self.geodetic[:2])) + self.yaw_from_east

    def elevation_of(
        self, distance: FloatArray, azimuth: FloatArray, height: FloatArray
    ) -> FloatArray:
        """Return the sines of the elevations of targets at given heights, (N,).

        Slant ranges are metres, above 0 and at most `MAX_SLANT_RANGE`, and azimuths radians
        counter-clockwise from the sensor's x axis. The result is beyond -1 or 1 if the difference
        of heights exceeds the slant range.

        Newton's method with the derivative on the sphere with the site's radius of curvature; the
        first value is the elevation on this sphere.
        """
        site_height, radius = self.geodetic[2], self._radius
        above = height - site_height
        centre = radius + site_height
        sine = (above * (2.0 * centre + above) - distance**2) / (2.0 * distance * centre)
        for _ in range(STEPS):
            clipped = np.clip(sine, -1.0, 1.0)
            reached = wgs84.to_geodetic(self._cartesian(distance, azimuth, clipped))[2]
            slope = distance * centre / (radius + reached)
            step = (height - reached) / slope
            # Values beyond the zenith are impossible and stay beyond it.
            sine = np.where(sine == clipped, clipped + step, sine)
        return sine

    def to_ground(
        self, distance: FloatArray, azimuth: FloatArray, sine: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return ranges and azimuths in the plane of measurements with elevations, (N,).

        Slant ranges are metres, from 0 to `MAX_SLANT_RANGE`, azimuths radians counter-clockwise
        from the sensor's x axis, and elevations are given by their sines. The results are around
        the site's position in the plane, from the sensor's x axis in it.
        """
        latitude, longitude, _ = wgs84.to_geodetic(self._cartesian(distance, azimuth, sine))
        x, y = self.plane.to_plane(latitude, longitude)
        east, north = x - self.position[0], y - self.position[1]
        return np.hypot(east, north), np.arctan2(north, east) - self.yaw

    def to_slant(
        self, distance: FloatArray, azimuth: FloatArray, height: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return slant ranges and azimuths, as the sensor measures them, (N,).

        The targets are at positions around the site's position in the plane, as `to_ground` returns
        them, and at heights in metres.
        """
        bearing = azimuth + self.yaw
        latitude, longitude = self.plane.to_geodetic(
            self.position[0] + distance * np.cos(bearing),
            self.position[1] + distance * np.sin(bearing),
        )
        line = wgs84.to_cartesian(latitude, longitude, height) - self._place
        east, north, _ = self._axes @ line.T
        return np.sqrt((line**2).sum(axis=1)), np.arctan2(north, east) - self.yaw_from_east

    def _cartesian(self, distance: FloatArray, azimuth: FloatArray, sine: FloatArray) -> FloatArray:
        """Return the Cartesian end points of rays, shape (N, 3)."""
        bearing = azimuth + self.yaw_from_east
        level = distance * np.sqrt(1.0 - sine**2)
        local = np.stack(
            [level * np.cos(bearing), level * np.sin(bearing), distance * sine], axis=1
        )
        return self._place + local @ self._axes

    @cached_property
    def _place(self) -> FloatArray:
        """Cartesian coordinates of the site, shape (3,)."""
        return wgs84.to_cartesian(*self.geodetic)

    @cached_property
    def _axes(self) -> FloatArray:
        """East, north and up as rows, shape (3, 3)."""
        return wgs84.east_north_up(*self.geodetic[:2])

    @cached_property
    def _radius(self) -> float:
        """Gaussian radius of curvature, metres."""
        across = float(wgs84.normal_radius(np.asarray(self.geodetic[0])))
        return across**2 / wgs84.SEMI_MAJOR * float(np.sqrt(1.0 - wgs84.E_SQUARE))
