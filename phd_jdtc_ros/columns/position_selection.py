"""Selects the valid positions among a message's points, in the core's units."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TypeVar

import numpy as np

from phd_jdtc_ros.configuration.parameters.position import PositionParameters
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray
from phd_jdtc_ros.core.sensors.position import Area
from phd_jdtc_ros.core.sensors.range_rate import VelocityModel
from phd_jdtc_ros.core.types import Detections

from .selection import (
    MAX_RANGE_RATE,
    MAX_SECONDS_OFF,
    PADDING,
    RANGE_RATE_STDS,
    RANGE_STDS,
    Columns,
    Report,
    keep,
    kept_values,
    plausible_heights,
)

# No coordinate or range of a target is larger, metres.
MOST_METRES = 1e9
EVERYWHERE = Area.rectangle(-MOST_METRES, -MOST_METRES, MOST_METRES, MOST_METRES)
# Columns of the area that a message covers: least x and y, and largest x and y.
AREA = ("area_x_min", "area_y_min", "area_x_max", "area_y_max")
S = TypeVar("S")


def unlimited(sensor: S) -> S:
    """Return a sensor's input that also has detections beyond its largest range, or its area."""
    if isinstance(sensor, PositionParameters):
        return replace(sensor, area=EVERYWHERE)
    return replace(sensor, max_range=MOST_METRES) if isinstance(sensor, RadarParameters) else sensor


def select(stamp_ns: int, own: PositionParameters, columns: Columns) -> Report:
    """Return the valid detections of a message in the core's units, and count the other points.

    NaN marks an unknown amplitude, height, velocity, standard deviation or correlation; its point
    is kept. A covariance that is not positive definite is unknown.
    """
    place = np.column_stack([columns["x"], columns["y"]])
    # Largest number in single precision, as the estimates are published.
    finite: BoolArray = np.logical_and.reduce(
        np.abs(place) <= float(np.finfo(np.float32).max), axis=1
    )
    edges, bad_areas = _edges(columns)
    area = own.area if edges is None or own.area is EVERYWHERE else Area.rectangle(*edges)
    passed: dict[str, BoolArray] = {
        PADDING: ~_blank(columns["x"], columns["y"]),
        "not_finite": finite,
        "area": area.probability(np.where(finite[:, None], place, 0.0)) > 0.0,
    }
    kept, dropped, common, common_counts = keep(stamp_ns, own, columns, passed, MAX_SECONDS_OFF)
    counts = Counter({**common_counts, "areas_unusable": bad_areas})
    std, correlation, counts["deviations_unusable"] = _noise(columns, kept)
    velocity, velocity_std, bad_velocities = _velocity(own, columns, kept)
    counts.update(bad_velocities)
    rounded = (place[kept].astype(np.float32) == place[kept]).all(axis=1)
    # Coordinates from here on are rounded by single precision to 0.06 m or more, metres.
    far = np.abs(place[kept]).max(axis=1) >= 1e6
    counts["positions_far"] = int(np.count_nonzero(far & rounded))
    height, z, z_std = columns.get("height"), None, None
    if height is not None:
        height = height[kept] - own.datum
    if own.height_prior is not None:
        height, z = None, height
        if z is None and "z" in columns:
            z = columns["z"][kept] + own.height
            z_std, bad_heights = kept_values(columns, "z_std", kept, RANGE_STDS)
            counts["deviations_unusable"] += bad_heights
        if z is not None:
            z, counts["heights_unusable"] = plausible_heights(z)
    if (known := height if z is None else z) is not None:
        unknown = int(np.count_nonzero(~np.isfinite(known)))
        counts["heights_unknown"] = unknown - counts["heights_unusable"]
    detections = Detections(
        place[kept],
        **common,
        noise_std=std,
        noise_correlation=correlation,
        velocity=velocity,
        velocity_std=velocity_std,
        height=height,
        z=z,
        z_std=z_std,
        area=edges,
    )
    return Report(stamp_ns, detections, dropped, +counts)


def _blank(x: FloatArray, y: FloatArray) -> BoolArray:
    """Return which points have no place: both coordinates are NaN, or 0 in several points.

    One target may be at (0, 0), and a driver fills the other places of its list with zeros.
    """
    zeros: BoolArray = (x == 0.0) & (y == 0.0)
    blank: BoolArray = np.isnan(x) & np.isnan(y)
    return blank | zeros if np.count_nonzero(zeros) > 1 else blank


def _edges(columns: Columns) -> tuple[tuple[float, float, float, float] | None, int]:
    """Return `AREA` of a message, None without one, and 1 if it is no area, else 0."""
    if not columns.keys() >= {*AREA} or not len(columns["x"]):
        return None, 0
    sides = np.stack([columns[what] for what in AREA])
    x_min, y_min, x_max, y_max = sides[:, 0].tolist()
    if np.isnan(sides).all():
        return None, 0
    usable = (sides == sides[:, :1]).all() and np.abs(sides).max() <= MOST_METRES
    if not (usable and x_max > x_min and y_max > y_min):
        return None, 1
    return (x_min, y_min, x_max, y_max), 0


def _pair(
    columns: Columns, names: tuple[str, str], kept: BoolArray, bounds: tuple[float, float]
) -> tuple[FloatArray | None, int]:
    """Return two quantities of the kept points, (M, 2), both NaN if one is unknown; None without.

    The other result is the number of points with one beyond the bounds.
    """
    if not columns.keys() >= {*names}:
        return None, 0
    sides = np.column_stack([columns[name][kept] for name in names])
    inside = (sides >= bounds[0]) & (sides <= bounds[1])  # False for NaN
    usable: BoolArray = np.logical_and.reduce(inside, axis=1)
    unknown: BoolArray = np.logical_or.reduce(np.isnan(sides), axis=1)
    bad = int(np.count_nonzero(~usable & ~unknown))
    return np.where(usable[:, None], sides, np.nan), bad


def _velocity(
    own: PositionParameters, columns: Columns, kept: BoolArray
) -> tuple[FloatArray | None, FloatArray | None, dict[str, int]]:
    """Return the velocities of the kept points, their deviations, and the numbers of unusable ones.

    Velocities are (M, 2), and (M, 3) with a climb rate in space; one that is unknown is 0, with
    `VelocityModel.UNKNOWN_STD`.
    """
    bounds = -MAX_RANGE_RATE, MAX_RANGE_RATE
    velocity, bad = _pair(columns, ("vx", "vy"), kept, bounds)
    std, bad_stds = kept_values(columns, "velocity_std", kept, RANGE_RATE_STDS)
    if velocity is None:
        return None, None, {"deviations_unusable": bad_stds}
    stds = [np.full(len(velocity), np.nan) if std is None else std] * 2
    climb, bad_climbs = kept_values(columns, "vz", kept, bounds)
    if climb is not None and own.height_prior is not None:
        velocity = np.column_stack([velocity, np.nan_to_num(climb)])
        stds.append(np.where(np.isnan(climb), VelocityModel.UNKNOWN_STD, stds[0]))
        bad += bad_climbs
    counts = {"velocities_unusable": bad, "deviations_unusable": bad_stds}
    return velocity, np.column_stack(stds), counts


def _noise(columns: Columns, kept: BoolArray) -> tuple[FloatArray | None, FloatArray | None, int]:
    """Return deviations, (M, 2), and correlations, (M,), of the kept points, and the unusable ones.

    Both are NaN where the covariance is not positive definite, or not known.
    """
    # A larger correlation makes a covariance singular in single precision.
    most_correlation = 0.9999
    std, bad = _pair(columns, ("x_std", "y_std"), kept, RANGE_STDS)
    if std is None or not np.isfinite(std).any():
        return None, None, bad
    bounds = (-most_correlation, most_correlation)
    correlation, indefinite = kept_values(columns, "correlation", kept, bounds)
    if correlation is not None:
        sent = columns["correlation"][kept]
        std[np.isnan(correlation) & ~np.isnan(sent)] = np.nan
        correlation[np.isnan(std[:, 0])] = np.nan
    return std, correlation, bad + indefinite
