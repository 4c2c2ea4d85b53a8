# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The plots of a radar with a site: from slant ranges to places in the plane, whatever is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .arrays import FloatArray
from .site import FARTHEST, Site

# Metres; nothing that a radar of this kind tracks flies higher.
MAX_HEIGHT = 30e3
# Metres; at the radar itself there is no elevation.
LEAST = 1e-3
# What is assumed of a height makes the elevation at most as large as this sine, 30 degrees.
MOST_ASSUMED = 0.5
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
