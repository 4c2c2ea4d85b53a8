"""Projects slant ranges to the plane, with a measured height, an elevation or an assumed height.

With the inverse projection, a plot whose height is missing or false can be projected again at the
height of a target.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, wrap_angle
from .site import MAX_SLANT_RANGE, Site

# Largest plausible height of a target, metres.
MAX_HEIGHT = 30e3
# Smallest slant range, metres: the elevation is undefined at the radar itself.
MIN_SLANT_RANGE = 1e-3
# Largest sine of the elevation at an assumed height: 30 degrees.
MAX_ASSUMED_SINE = 0.5
# Largest number of iterations of the inverse projection; each leaves less than a third of the
# error.
MOST_ITERATIONS = 25


class Ground(NamedTuple):
    """Positions in the plane, arrays of shape (M,)."""

    distance: FloatArray  # Distance from the radar, metres
    azimuth: FloatArray  # Radians counter-clockwise from the sensor's x axis
    possible: BoolArray  # Whether the height is plausible and within the slant range


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
    return Ground(np.where(in_range, ground, np.inf), direction, possible)


def assumed_height(site: Site, assumed: float | None, distance: FloatArray) -> FloatArray:
    """Return the assumed heights of targets without a measured height, (M,).

    `assumed` is the height that the radar assumes, metres, or None for the height of the site. It
    is limited to an elevation of 30 degrees near the radar. `distance` has slant ranges.
    """
    site_height = site.geodetic[2]
    if assumed is None:
        return np.full(len(distance), site_height)
    most = MAX_ASSUMED_SINE * distance
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
    for _ in range(MOST_ITERATIONS):
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
