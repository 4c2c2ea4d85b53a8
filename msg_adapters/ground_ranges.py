"""What a radar measures in space, to and from ranges and azimuths in the world's plane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.radar_input import RadarInput
from phd_jdtc_ros.core.arrays import FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.slant_range import LEAST, MAX_HEIGHT, Ground, over_ground, slant_of
from phd_jdtc_ros.core.types import Detections


def read(
    distance: FloatArray,
    azimuth: FloatArray,
    elevation: FloatArray | None,
    height: FloatArray | None,
    radar: RadarInput,
) -> Ground:
    """Return where points are over ground.

    A known height decides; where it is unknown, the elevation does, if there is one. What is not
    finite gives no sensible place, but no error either.

    Parameters
    ----------
    distance : array of shape (M,)
        Metres; slant ranges where there is an elevation, a height or a site.
    azimuth : array of shape (M,)
        Radians counter-clockwise from the sensor's x axis.
    elevation : array of shape (M,) or None
        Radians.
    height : array of shape (M,) or None
        Metres, as messages count heights; NaN where it is unknown.
    """
    finite = np.isfinite(distance) & np.isfinite(azimuth)
    if elevation is not None:
        finite &= np.isfinite(elevation)
        elevation = np.where(finite, elevation, 0.0)
    distance = np.where(finite, distance, 0.0)
    if radar.site is not None:
        angle = np.where(finite, azimuth, 0.0)
        found = over_ground(radar.site, radar.assumed_height, distance, angle, height, elevation)
    else:
        found = _flat(distance, azimuth, elevation, height, radar.height + radar.datum)
    return found._replace(possible=found.possible | ~finite | (distance < 0.0))


def _flat(
    distance: FloatArray,
    azimuth: FloatArray,
    elevation: FloatArray | None,
    height: FloatArray | None,
    antenna: float,
) -> Ground:
    """Return where points are over a plane: a height is a side of the triangle."""
    ground = distance if elevation is None else distance * np.cos(elevation)
    if height is None:
        return Ground(ground, azimuth, np.ones(len(ground), dtype=bool))
    known = np.isfinite(height)
    given = np.where(known, height, antenna)
    above = np.clip(given, -2.0 * MAX_HEIGHT, 2.0 * MAX_HEIGHT) - antenna
    with np.errstate(over="ignore"):  # an absurd range becomes infinite and is then dropped
        square = distance**2 - above**2
    possible = (square >= 0.0) & (np.abs(given) <= MAX_HEIGHT)
    side = np.copysign(np.sqrt(np.maximum(square, 0.0)), distance)
    return Ground(np.where(known, side, ground), azimuth, possible | ~known)


class Slant(NamedTuple):
    """What a radar measures, arrays of shape (M,).

    Parameters
    ----------
    distance, azimuth : array
        Metres, and radians counter-clockwise from the sensor's x axis.
    """

    distance: FloatArray
    azimuth: FloatArray


def sent(detections: Detections, radar: RadarInput) -> Slant:
    """Return ranges and azimuths as a radar measures them: what `read` undoes.

    Where a height is unknown, it is that which `read` supposes.
    """
    distance, azimuth = detections.measurement.T
    site, height = radar.site, detections.height
    if site is None:
        if not radar.height_field or height is None:
            return Slant(distance, azimuth)
        return Slant(np.hypot(distance, np.nan_to_num(height - radar.height)), azimuth)
    known = sent_height(detections, radar) if radar.height_field else np.full(len(distance), np.nan)
    return Slant(*slant_of(site, radar.assumed_height, distance, azimuth, known))


def sent_height(detections: Detections, radar: RadarInput) -> FloatArray:
    """Return heights as messages count them; those of the antenna if the detections have none."""
    above = detections.height
    counted: FloatArray = np.full(len(detections), radar.height) if above is None else above
    return counted + radar.datum


def sent_at_own_height(detections: Detections, radar: RadarInput) -> FloatArray:
    """Return ranges, azimuths and elevations of detections at the antenna's height, shape (M, 3).

    It is what a radar measures whose messages have elevations and no heights.
    """
    distance, azimuth = detections.measurement.T
    site = radar.site
    if site is None:
        return np.stack([distance, azimuth, np.zeros(len(distance))], axis=1)
    own = np.full(len(distance), site.geodetic[2])
    slant, measured = site.to_slant(distance, azimuth, own)
    sine = site.elevation_of(np.maximum(slant, LEAST), measured, own)
    return np.stack([slant, wrap_angle(measured), np.arcsin(np.clip(sine, -1.0, 1.0))], axis=1)
