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
from phd_jdtc_ros.core.types import Detections

from .selection import (
    MAX_RANGE_RATE,
    MAX_SECONDS_OFF,
    RANGE_RATE_STDS,
    RANGE_STDS,
    Columns,
    Report,
    keep,
    kept_values,
    plausible_heights,
)

# A larger correlation makes a covariance singular in single precision.
MOST_CORRELATION = 0.9999
# No coordinate or range of a target is larger, metres.
MOST_METRES = 1e9
EVERYWHERE = Area.rectangle(-MOST_METRES, -MOST_METRES, MOST_METRES, MOST_METRES)
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
    passed: dict[str, BoolArray] = {
        "not_finite": finite,
        "area": own.area.probability(np.where(finite[:, None], place, 0.0)) > 0.0,
    }
    kept, dropped, common, common_counts = keep(stamp_ns, own, columns, passed, MAX_SECONDS_OFF)
    counts = Counter(common_counts)
    std, correlation, counts["deviations_unusable"] = _noise(columns, kept)
    velocity, bad_velocities = _pair(columns, ("vx", "vy"), kept, (-MAX_RANGE_RATE, MAX_RANGE_RATE))
    counts["velocities_unusable"] = bad_velocities
    speed_std, bad_stds = kept_values(columns, "velocity_std", kept, RANGE_RATE_STDS)
    counts["deviations_unusable"] += bad_stds
    rounded = (place[kept].astype(np.float32) == place[kept]).all(axis=1)
    # Coordinates from here on are rounded by single precision to 0.06 m or more, metres.
    far = np.abs(place[kept]).max(axis=1) >= 1e6
    counts["positions_far"] = int(np.count_nonzero(far & rounded))
    height, z = columns.get("height"), None
    if height is not None:
        height = height[kept] - own.datum
        counts["heights_unknown"] = int(np.count_nonzero(~np.isfinite(height)))
    z_std = None
    if own.height_prior is not None:
        height, z = None, height
        if z is None and "z" in columns:
            z = columns["z"][kept] + own.height
            z_std, bad_heights = kept_values(columns, "z_std", kept, RANGE_STDS)
            counts["deviations_unusable"] += bad_heights
    detections = Detections(
        place[kept],
        **common,
        noise_std=std,
        noise_correlation=correlation,
        velocity=velocity,
        velocity_std=None
        if velocity is None or speed_std is None
        else np.tile(speed_std[:, None], (1, 2)),
        height=height,
        z=None if z is None else plausible_heights(z),
        z_std=z_std,
    )
    return Report(stamp_ns, detections, dropped, +counts)


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


def _noise(columns: Columns, kept: BoolArray) -> tuple[FloatArray | None, FloatArray | None, int]:
    """Return deviations, (M, 2), and correlations, (M,), of the kept points, and the unusable ones.

    Both are NaN where the covariance is not positive definite, or not known.
    """
    std, bad = _pair(columns, ("x_std", "y_std"), kept, RANGE_STDS)
    if std is None or not np.isfinite(std).any():
        return None, None, bad
    bounds = (-MOST_CORRELATION, MOST_CORRELATION)
    correlation, indefinite = kept_values(columns, "correlation", kept, bounds)
    if correlation is not None:
        sent = columns["correlation"][kept]
        std[np.isnan(correlation) & ~np.isnan(sent)] = np.nan
        correlation[np.isnan(std[:, 0])] = np.nan
    return std, correlation, bad + indefinite
