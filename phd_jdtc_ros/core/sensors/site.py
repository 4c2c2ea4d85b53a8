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
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from ..arrays import BoolArray, FloatArray, wrap_angle
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

    @property
    def curvature(self) -> float:
        """One over the radius of the sphere that touches the earth at the antenna, 1/m."""
        return 1.0 / (self._radius + self.geodetic[2])

    def to_world(self, distance: FloatArray, azimuth: FloatArray, sine: FloatArray) -> FloatArray:
        """Return the places in the plane, and the heights, of measurements, metres, (N, 3).

        For the parameters see `to_ground`; heights are counted as the site's.
        """
        latitude, longitude, height = wgs84.to_geodetic(self._cartesian(distance, azimuth, sine))
        x, y = self.plane.to_plane(latitude, longitude)
        return np.stack([x, y, height], axis=1)

    @cached_property
    def _radius(self) -> float:
        """Gaussian radius of curvature, metres."""
        across = float(wgs84.normal_radius(np.asarray(self.geodetic[0])))
        return across**2 / wgs84.SEMI_MAJOR * float(np.sqrt(1.0 - wgs84.E_SQUARE))


# Largest plausible height of a target, metres.
MAX_HEIGHT = 30e3
# Smallest slant range, metres: the elevation is undefined at the radar itself.
MIN_SLANT_RANGE = 1e-3


class Ground(NamedTuple):
    """Positions in the plane, arrays of shape (M,)."""

    distance: FloatArray  # Distance from the radar, metres
    azimuth: FloatArray  # Radians counter-clockwise from the sensor's x axis
    possible: BoolArray  # Whether the height is plausible and within the slant range
    sine: FloatArray | None = None  # Of the elevation; NaN where unknown, None if all are level


def to_ground(
    site: Site,
    assumed: float | None,
    distance: FloatArray,
    azimuth: FloatArray,
    height: FloatArray | None = None,
    elevation: FloatArray | None = None,
) -> Ground:
    """Return the positions of plots in the plane.

    Parameters
    ----------
    assumed : float or None
        See `assumed_height`.
    distance : array of shape (M,)
        Slant ranges, metres; negative ones give negative ground ranges.
    azimuth : array of shape (M,)
        Radians counter-clockwise from the sensor's x axis.
    height : array of shape (M,) or None
        Metres above the same surface as the site's height; NaN if unknown.
    elevation : array of shape (M,) or None
        Radians; used for plots without a height.
    """
    in_range = np.abs(distance) <= MAX_SLANT_RANGE
    slant = np.where(in_range, np.maximum(np.abs(distance), MIN_SLANT_RANGE), MIN_SLANT_RANGE)
    has_height = np.zeros(len(slant), dtype=bool) if height is None else np.isfinite(height)
    default = assumed_height(site, assumed, slant)
    used_height = default if height is None else np.where(has_height, height, default)
    plausible = np.abs(used_height) <= MAX_HEIGHT
    sine = site.elevation_of(slant, azimuth, np.where(plausible, used_height, default))
    possible = ~has_height | ~in_range | (plausible & (np.abs(sine) <= 1.0))
    sine = np.clip(sine, -1.0, 1.0)
    is_beyond = np.zeros(len(slant), dtype=bool)
    if elevation is not None:
        # Elevations beyond the zenith give negative ground ranges, as in the plane.
        is_beyond = ~has_height & (np.cos(elevation) < 0.0)
        sine = np.where(has_height, sine, np.sin(elevation))
    ground, direction = site.to_ground(slant, azimuth, sine)
    ground = np.where(is_beyond, -ground, np.copysign(ground, distance))
    known = has_height if elevation is None else np.ones_like(has_height)
    sine = np.where(known, sine, np.nan)
    return Ground(np.where(in_range, ground, np.inf), direction, possible, sine)


def assumed_height(site: Site, assumed: float | None, distance: FloatArray) -> FloatArray:
    """Return the assumed heights of targets without a measured height, (M,).

    `assumed` is the height that the radar assumes, metres, or None for the height of the site. It
    is limited to an elevation of 30 degrees near the radar. `distance` has slant ranges.
    """
    site_height = site.geodetic[2]
    if assumed is None:
        return np.full(len(distance), site_height)
    # Largest sine of the elevation at an assumed height: 30 degrees.
    max_assumed_sine = 0.5
    most = max_assumed_sine * distance
    limited: FloatArray = site_height + np.clip(assumed - site_height, -most, most)
    return limited


def to_slant(
    site: Site, assumed: float | None, distance: FloatArray, azimuth: FloatArray, height: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the slant ranges and azimuths that `to_ground` projects to positions.

    The positions are relative to the site, metres and radians. The heights are in metres above the
    same surface as the site's height; NaN if they were unknown.
    """
    has_height, slant = np.isfinite(height), distance
    # Largest number of iterations of the inverse projection; each leaves less than a third of the
    # error.
    most_iterations = 25
    for _ in range(most_iterations):
        # The assumed height depends on the slant range itself.
        used_height = np.where(has_height, height, assumed_height(site, assumed, slant))
        slant, measured = site.to_slant(distance, azimuth, used_height)
        if assumed is None or has_height.all():
            break
    return slant, measured


@dataclass(frozen=True)
class HeightProjection:
    """Projection of a radar's plots to the plane, given their heights."""

    antenna: float  # Height of the antenna above the world's zero, metres
    datum: float = 0.0  # Height of the world's zero above the site's reference surface, metres
    # Site on the round earth; None for a flat one, where a slant range without a height is the
    # ground range.
    site: Site | None = None
    assumed: float | None = None  # See `assumed_height`

    def at(self, measurement: FloatArray, before: FloatArray, height: FloatArray) -> FloatArray:
        """Return plots projected at other heights than before, (M, 2).

        `measurement` has ground ranges and azimuths, (M, 2), that were projected at the heights
        `before`; `height` has the new ones. Heights are above the world's zero, metres, (M,); NaN
        if unknown. A plot whose height exceeds its slant range is projected to the radar's own
        position.
        """
        distance, azimuth = measurement.T
        if self.site is None:
            square = distance**2 + np.nan_to_num(before - self.antenna) ** 2
            square = square - np.nan_to_num(height - self.antenna) ** 2
            return np.stack([np.sqrt(np.maximum(square, 0.0)), azimuth], axis=1)
        slant = to_slant(self.site, self.assumed, distance, azimuth, before + self.datum)
        ground = to_ground(self.site, self.assumed, *slant, height + self.datum)
        return np.stack([ground.distance, wrap_angle(ground.azimuth)], axis=1)
