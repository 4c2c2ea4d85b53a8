"""A radar's site on the round earth: what it measures, to and from places in the world's plane.

::

    slant range, azimuth, height or elevation
      |  about the site, on the WGS84 ellipsoid
    latitude and longitude
      |  the world's plane, see `Plane`
    range and azimuth about the site's place in the plane

Rays are straight: the atmosphere, which bends them by about a quarter of the earth's curvature, has
no part in it. Where the height is known it does not matter, where only the elevation is it does.
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

# Farther than any radar measures, metres; what is farther is not computed.
FARTHEST = 2e6
# The first elevations leave 3 m at 400 km, and each step a hundred thousandth of that.
STEPS = 2
# Metres; the plane is not for sites farther from its origin, where lengths are 0.15 % too long.
MOST_FROM_ORIGIN = 500e3


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
    """Where a radar stands on the earth, and in the plane.

    Parameters
    ----------
    geodetic : tuple of three floats
        Latitude and longitude, degrees, and height of the antenna, metres.
    plane : Plane
    turned : float
        Direction of the sensor's x axis from true east, radians counter-clockwise.

    Notes
    -----
    All heights are above one surface, that of the ellipsoid. Heights above the sea, or of the
    standard atmosphere, are at most some hundred metres off; if they are for the site and for the
    targets alike, places are off by a ten-thousandth of that.
    """

    geodetic: tuple[float, float, float]
    plane: Plane
    turned: float = 0.0

    @cached_property
    def position(self) -> tuple[float, float]:
        """Its place in the plane, metres."""
        x, y = self.plane.to_plane(*self.geodetic[:2])
        return float(x), float(y)

    @cached_property
    def yaw(self) -> float:
        """Direction of the sensor's x axis in the plane, radians counter-clockwise."""
        return float(self.plane.convergence(*self.geodetic[:2])) + self.turned

    def elevation_of(
        self, distance: FloatArray, azimuth: FloatArray, height: FloatArray
    ) -> FloatArray:
        """Return the sines of the elevations at which targets are at heights.

        Parameters
        ----------
        distance : array of shape (N,)
            Slant ranges, metres; above 0 and at most `FARTHEST`.
        azimuth : array of shape (N,)
            Radians counter-clockwise from the sensor's x axis.
        height : array of shape (N,)
            Metres.

        Returns
        -------
        array of shape (N,)
            Beyond -1 and 1 if the target is higher or lower than it is far away.

        Notes
        -----
        Newton's steps with the derivative on a sphere; the first elevation is that on the sphere
        with the site's radius of curvature.
        """
        own, radius = self.geodetic[2], self._radius
        above = height - own
        centre = radius + own
        sine = (above * (2.0 * centre + above) - distance**2) / (2.0 * distance * centre)
        for _ in range(STEPS):
            held = np.clip(sine, -1.0, 1.0)
            reached = wgs84.to_geodetic(self._cartesian(distance, azimuth, held))[2]
            slope = distance * centre / (radius + reached)
            step = (height - reached) / slope
            # Beyond the zenith there is no such place; what is beyond stays beyond.
            sine = np.where(sine == held, held + step, sine)
        found: FloatArray = sine
        return found

    def to_ground(
        self, distance: FloatArray, azimuth: FloatArray, sine: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return ranges and azimuths in the plane of what is measured at elevations.

        Parameters
        ----------
        distance : array of shape (N,)
            Slant ranges, metres, from 0 to `FARTHEST`.
        azimuth : array of shape (N,)
            Radians counter-clockwise from the sensor's x axis.
        sine : array of shape (N,)
            Of the elevations, from -1 to 1.

        Returns
        -------
        distance, azimuth : arrays of shape (N,)
            About the site's place in the plane, from the sensor's x axis in it.
        """
        latitude, longitude, _ = wgs84.to_geodetic(self._cartesian(distance, azimuth, sine))
        x, y = self.plane.to_plane(latitude, longitude)
        east, north = x - self.position[0], y - self.position[1]
        return np.hypot(east, north), np.arctan2(north, east) - self.yaw

    def to_slant(
        self, distance: FloatArray, azimuth: FloatArray, height: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return slant ranges and azimuths of targets at places in the plane and at heights.

        Parameters
        ----------
        distance, azimuth : arrays of shape (N,)
            About the site's place in the plane, as `to_ground` returns them.
        height : array of shape (N,)
            Metres.

        Returns
        -------
        distance, azimuth : arrays of shape (N,)
            As the sensor measures them.
        """
        bearing = azimuth + self.yaw
        latitude, longitude = self.plane.to_geodetic(
            self.position[0] + distance * np.cos(bearing),
            self.position[1] + distance * np.sin(bearing),
        )
        line = wgs84.to_cartesian(latitude, longitude, height) - self._place
        east, north, _ = self._axes @ line.T
        return np.sqrt((line**2).sum(axis=1)), np.arctan2(north, east) - self.turned

    def _cartesian(self, distance: FloatArray, azimuth: FloatArray, sine: FloatArray) -> FloatArray:
        """Return where a ray ends, shape (N, 3)."""
        bearing = azimuth + self.turned
        level = distance * np.sqrt(1.0 - sine**2)
        local = np.stack(
            [level * np.cos(bearing), level * np.sin(bearing), distance * sine], axis=1
        )
        ends: FloatArray = self._place + local @ self._axes
        return ends

    @cached_property
    def _place(self) -> FloatArray:
        """Its Cartesian coordinates, shape (3,)."""
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
