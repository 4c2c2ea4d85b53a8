"""Conversion between a radar's measurements in space and ranges and azimuths in the world plane."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.core.arrays import FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.site import (
    MAX_HEIGHT,
    MAX_SLANT_RANGE,
    MIN_SLANT_RANGE,
    Ground,
    to_ground,
    to_slant,
)
from phd_jdtc_ros.core.sensors.spatial_radar import linearise
from phd_jdtc_ros.core.types import Detections


def unit_of(elevation: FloatArray) -> str:
    """Return the unit of elevations, as their values, (M,), show it: rad, deg or mrad."""
    size = np.abs(elevation[np.isfinite(elevation)])
    largest = float(np.quantile(size, 0.99)) if len(size) else 0.0
    return "mrad" if largest > 90.0 else "deg" if largest > 0.5 * np.pi else "rad"


def read(
    distance: FloatArray,
    azimuth: FloatArray,
    elevation: FloatArray | None,
    height: FloatArray | None,
    radar: RadarParameters,
) -> Ground:
    """Return the ranges and azimuths of points over ground.

    A known height determines the ground range, otherwise the elevation does, if there is one.
    Values that are not finite give implausible points, but no error. Distances are in metres, slant
    ranges if there is an elevation, a height or a site; angles in radians, azimuths
    counter-clockwise from the sensor's x axis; heights in metres as in messages, NaN if unknown.
    """
    if radar.site is None and elevation is None and height is None:
        return Ground(distance, azimuth, np.ones(len(distance), dtype=bool))
    finite = np.isfinite(distance) & np.isfinite(azimuth)
    if elevation is not None:
        finite &= np.isfinite(elevation)
        elevation = np.where(finite, elevation, 0.0)
    distance = np.where(finite, distance, 0.0)
    if radar.site is not None:
        plots = distance, np.where(finite, azimuth, 0.0), height, elevation
        found = to_ground(radar.site, radar.assumed_height, *plots)
    else:
        found = _flat(distance, azimuth, elevation, height, radar.height + radar.datum)
    return found._replace(possible=found.possible | ~finite | (distance < 0.0))


def in_space(
    distance: FloatArray, azimuth: FloatArray, elevation: FloatArray | None, radar: RadarParameters
) -> FloatArray:
    """Return measurements as the radar's model in space has them, (M, 3); NaN for no elevation.

    The model's earth is a sphere in the coordinates of the plane. With a site, points are projected
    to the plane exactly and are measured there; the difference hardly depends on the elevation, so
    that a point without one is corrected as if it were at 0. Rays bend toward the earth by a
    quarter of its curvature, by which elevations appear too large.
    """
    nothing = np.full(len(distance), np.nan)
    elevation = nothing if elevation is None else elevation
    if radar.site is None or radar.height_prior is None:
        return np.stack([distance, azimuth, elevation], axis=1)
    usable = np.isfinite(distance) & np.isfinite(azimuth) & (np.abs(distance) <= MAX_SLANT_RANGE)
    slant, direction = (np.where(usable, each, 0.0) for each in (distance, azimuth))
    slant = np.maximum(slant, MIN_SLANT_RANGE)
    # Bending of rays in the standard atmosphere: half of a quarter of the earth's curvature, per
    # metre.
    true = elevation - 0.125 * radar.curvature * slant
    known = np.isfinite(true)
    place = radar.site.to_world(slant, direction, np.sin(np.where(known, true, 0.0)))
    place[:, 2] -= radar.datum
    origin = np.array([*radar.site.position, radar.height])
    measured, _ = linearise(place, origin, radar.site.yaw, radar.curvature)
    measured[:, 2] = np.where(known, measured[:, 2], np.nan)
    return np.where(usable[:, None], measured, np.stack([distance, azimuth, elevation], axis=1))


def _flat(
    distance: FloatArray,
    azimuth: FloatArray,
    elevation: FloatArray | None,
    height: FloatArray | None,
    antenna: float,
) -> Ground:
    """Return points over a flat plane, where the height is a side of the triangle."""
    ground = distance if elevation is None else distance * np.cos(elevation)
    sine = np.full(len(ground), np.nan) if elevation is None else np.sin(elevation)
    if height is None:
        return Ground(ground, azimuth, np.ones(len(ground), dtype=bool), sine)
    known = np.isfinite(height)
    given = np.where(known, height, antenna)
    above = np.clip(given, -2.0 * MAX_HEIGHT, 2.0 * MAX_HEIGHT) - antenna
    with np.errstate(over="ignore"):  # An absurd range becomes infinite and is then dropped
        square = distance**2 - above**2
    possible = (square >= 0.0) & (np.abs(given) <= MAX_HEIGHT)
    side = np.copysign(np.sqrt(np.maximum(square, 0.0)), distance)
    sine = np.where(known, above / np.maximum(np.abs(distance), MIN_SLANT_RANGE), sine)
    return Ground(np.where(known, side, ground), azimuth, possible | ~known, sine)


def measure(detections: Detections, radar: RadarParameters) -> tuple[FloatArray, FloatArray]:
    """Return ranges and azimuths as the radar measures them, (M,): the inverse of `read`.

    Azimuths are in radians counter-clockwise from the sensor's x axis. An unknown height is
    replaced by the height that `read` assumes.
    """
    distance, azimuth = detections.measurement.T
    site, height = radar.site, detections.height
    if site is None:
        if not radar.fields.height or height is None:
            return distance, azimuth
        return np.hypot(distance, np.nan_to_num(height - radar.height)), azimuth
    unknown = np.full(len(distance), np.nan)
    known = message_height(detections, radar) if radar.fields.height else unknown
    return to_slant(site, radar.assumed_height, distance, azimuth, known)


def message_height(detections: Detections, radar: RadarParameters) -> FloatArray:
    """Return heights in the messages' convention; the antenna's if the detections have none."""
    above = detections.height if detections.z is None else detections.z
    counted: FloatArray = np.full(len(detections), radar.height) if above is None else above
    return counted + radar.datum


def measure_at_antenna_height(detections: Detections, radar: RadarParameters) -> FloatArray:
    """Return ranges, azimuths and elevations of detections at the antenna's height, shape (M, 3).

    Radars whose messages have elevations and no heights measure these.
    """
    distance, azimuth = detections.measurement.T
    site = radar.site
    if site is None:
        return np.stack([distance, azimuth, np.zeros(len(distance))], axis=1)
    own = np.full(len(distance), site.geodetic[2])
    slant, measured = site.to_slant(distance, azimuth, own)
    sine = site.elevation_of(np.maximum(slant, MIN_SLANT_RANGE), measured, own)
    return np.stack([slant, wrap_angle(measured), np.arcsin(np.clip(sine, -1.0, 1.0))], axis=1)
