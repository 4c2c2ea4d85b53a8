"""The plots of a radar with a site: from slant ranges to places in the plane, whatever is known.

And back, to read a plot of a missing or false height once more at the height of a target.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, wrap_angle
from .site import FARTHEST, Site

# Metres; nothing that a radar of this kind tracks flies higher.
MAX_HEIGHT = 30e3
# Metres; at the radar itself there is no elevation.
LEAST = 1e-3
# What is assumed of a height makes the elevation at most as large as this sine, 30 degrees.
MOST_ASSUMED = 0.5
# Each leaves less than a third of the error that a supposed height makes of the slant range.
SETTLING = 25
BoolArray = npt.NDArray[np.bool_]


class Ground(NamedTuple):
    """Where points are in the plane, arrays of shape (M,).

    Parameters
    ----------
    distance, azimuth : array
        Metres, and radians counter-clockwise from the sensor's x axis; about the radar.
    possible : bool array
        Whether the height is one that a target can have, and not beyond its range.
    """

    distance: FloatArray
    azimuth: FloatArray
    possible: BoolArray


def over_ground(
    site: Site,
    assumed: float,
    distance: FloatArray,
    azimuth: FloatArray,
    height: FloatArray | None = None,
    elevation: FloatArray | None = None,
) -> Ground:
    """Return where points are in the plane.

    Parameters
    ----------
    site : Site
    assumed : float
        See `supposed_height`.
    distance : array of shape (M,)
        Slant ranges, metres; those that are negative give negative ranges.
    azimuth : array of shape (M,)
        Radians counter-clockwise from the sensor's x axis.
    height : array of shape (M,) or None
        Metres, as those of the site; NaN where it is unknown.
    elevation : array of shape (M,) or None
        Radians; used where the height is unknown.
    """
    near = np.abs(distance) <= FARTHEST
    slant = np.where(near, np.maximum(np.abs(distance), LEAST), LEAST)
    known = np.zeros(len(slant), dtype=bool) if height is None else np.isfinite(height)
    supposed = supposed_height(site, assumed, slant)
    given = supposed if height is None else np.where(known, height, supposed)
    believed = np.abs(given) <= MAX_HEIGHT
    sine = site.elevation_of(slant, azimuth, np.where(believed, given, supposed))
    possible = ~known | ~near | (believed & (np.abs(sine) <= 1.0))
    sine = np.clip(sine, -1.0, 1.0)
    beyond = np.zeros(len(slant), dtype=bool)
    if elevation is not None:
        # Beyond the zenith, as in the plane, the ground range becomes negative.
        beyond = ~known & (np.cos(elevation) < 0.0)
        sine = np.where(known, sine, np.sin(elevation))
    ground, direction = site.to_ground(slant, azimuth, sine)
    ground = np.where(beyond, -ground, np.copysign(ground, distance))
    return Ground(np.where(near, ground, np.inf), direction, possible)


def supposed_height(site: Site, assumed: float, distance: FloatArray) -> FloatArray:
    """Return the heights that targets of unknown height are taken to have.

    Parameters
    ----------
    site : Site
    assumed : float
        Metres, but near the radar no higher than the elevation of 30 degrees; NaN for the site's
        own height.
    distance : array of shape (M,)
        Slant ranges, metres.
    """
    own = site.geodetic[2]
    if np.isnan(assumed):
        return np.full(len(distance), own)
    most = MOST_ASSUMED * distance
    supposed: FloatArray = own + np.clip(assumed - own, -most, most)
    return supposed


def slant_of(
    site: Site, assumed: float, distance: FloatArray, azimuth: FloatArray, height: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the slant ranges and azimuths that `over_ground` reads as places in the plane.

    Parameters
    ----------
    site : Site
    assumed : float
        See `supposed_height`.
    distance, azimuth : arrays of shape (M,)
        About the site's place in the plane, metres and radians.
    height : array of shape (M,)
        Metres, as those of the site; NaN where it was unknown.
    """
    known, slant = np.isfinite(height), distance
    for _ in range(SETTLING):
        # What is supposed depends on the slant range itself.
        given = np.where(known, height, supposed_height(site, assumed, slant))
        slant, measured = site.to_slant(distance, azimuth, given)
        if np.isnan(assumed) or known.all():
            break
    return slant, measured


@dataclass(frozen=True)
class HeightReading:
    """How the ranges of a radar whose plots have heights depend on these.

    Parameters
    ----------
    antenna : float
        Height of the antenna above the world's zero, metres.
    datum : float
        Height of the world's zero, as the site counts heights, metres.
    site : Site or None
        None for a plane: without a height the slant range is the range over ground.
    assumed : float
        See `supposed_height`.
    """

    antenna: float
    datum: float = 0.0
    site: Site | None = None
    assumed: float = np.nan

    def at(self, measurement: FloatArray, before: FloatArray, height: FloatArray) -> FloatArray:
        """Return plots that were read at their heights as they are read at others, (M, 2).

        Parameters
        ----------
        measurement : array of shape (M, 2)
            Ranges over ground, metres, and azimuths, radians.
        before : array of shape (M,)
            Their heights above the world's zero, metres; NaN where unknown.
        height : array of shape (M,)
            The others; NaN for none. What is higher than its slant range is read as if above the
            radar.
        """
        distance, azimuth = measurement.T
        if self.site is None:
            square = distance**2 + np.nan_to_num(before - self.antenna) ** 2
            square = square - np.nan_to_num(height - self.antenna) ** 2
            return np.stack([np.sqrt(np.maximum(square, 0.0)), azimuth], axis=1)
        slant = slant_of(self.site, self.assumed, distance, azimuth, before + self.datum)
        ground = over_ground(self.site, self.assumed, *slant, height + self.datum)
        return np.stack([ground.distance, wrap_angle(ground.azimuth)], axis=1)
