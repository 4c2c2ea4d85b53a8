"""Partition of targets by whether a scan's antennas may have swept them.

Targets that were not swept are neither predicted nor linked, so that the cost of a sector grows
with the targets in it. The swept area is the reported coverage, and every place of a detection.

A report without coverage swept the field of view of its sensor. Targets outside it wait for another
sensor, because a look that shows nothing about a target must not change it: each prediction mixes
its motion modes and each reduction merges its hypotheses once more, which is an approximation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import BoolArray, FloatArray
from ..gaussian.entries import UnsweptRows
from ..models.tracker_model import TrackerModel
from ..sensors import polar_geometry
from ..sensors.view import View
from ..targets.motion import noise_after
from ..tracks.reporting_rule import slowest_s

# Radius of a target's position density, in standard deviations; hardly any mass is outside.
SPREAD_SIGMA = 4.0

Reports = Sequence[View]


def partition_swept(
    unswept: list[UnsweptRows], reports: Reports, stamp_ns: int, model: TrackerModel
) -> tuple[list[UnsweptRows], list[UnsweptRows]]:
    """Return the rows of targets, oldest first, that a scan may have swept, and all other rows."""
    if not unswept or _covers_all_fields(reports, model):
        return unswept, []
    # A label that no antenna has swept for this long is predicted nevertheless.
    longest_s = 1.5 * slowest_s(model)
    space = model.modes.space
    extents = [rows.entry.extents for rows in unswept]
    sizes = [extent.label.size for extent in extents]
    age_s = (stamp_ns - np.array([rows.entry.stamp_ns for rows in unswept])) * 1e-9
    x = space.position[0]
    # Largest standard deviation that a motion adds, over both axes.
    variance = noise_after(age_s, model.modes.noise_factors[:, :, x, x])
    noise_std = np.sqrt(2.0 * variance.max(axis=1))
    dt, spread = np.array([age_s, noise_std]).repeat(sizes, axis=1)
    moments = np.concatenate([extent.moments for extent in extents])
    position = moments[:, :2] + dt[:, None] * moments[:, 2:4]
    # Radius of each target's position density.
    radius = SPREAD_SIGMA * (moments[:, 4] + dt * moments[:, 5] + spread)
    is_near = _in_sweep(position, radius, reports) | (dt >= longest_s)
    entries_near = set(np.arange(len(sizes)).repeat(sizes)[is_near].tolist())
    parts, begin = [], 0
    for index, (rows, extent, size) in enumerate(zip(unswept, extents, sizes, strict=True)):
        end = begin + size
        # Most entries have no row to test. An empty entry counts as swept.
        is_unswept = size > 0 and index not in entries_near
        parts += [(None, rows) if is_unswept else rows.split(is_near[begin:end][extent.target])]
        begin = end
    swept = [inside for inside, _ in parts if inside is not None]
    return swept, [outside for _, outside in parts if outside is not None]


def swept_births(reports: Reports, model: TrackerModel) -> list[int]:
    """Return the birth terms at places that an antenna may have swept in a scan."""
    if not model.births or _covers_all_fields(reports, model):
        return list(range(len(model.births)))
    axes = list(model.modes.space.position)
    position = np.array([term.mean[axes] for term in model.births])
    spread = np.array([np.hypot(*term.std[axes]) for term in model.births])
    return [int(k) for k in np.flatnonzero(_in_sweep(position, SPREAD_SIGMA * spread, reports))]


def _covers_all_fields(reports: Reports, model: TrackerModel) -> bool:
    whole_fields = {report.sensor.name for report in reports if report.detections.coverage is None}
    return len(whole_fields) == len(model.radars)


def _in_sweep(position: FloatArray, spread: FloatArray, reports: Reports) -> BoolArray:
    """Return a mask of the positions that an antenna comes within `spread` of, shape (T,)."""
    is_near = np.zeros(len(spread), dtype=bool)
    for report in reports:
        sensor = report.sensor
        place = polar_geometry.measure(position, sensor.position, sensor.yaw)
        is_near |= sensor.visibility.may_be_swept(
            place, spread, sensor.noise_std, report.detections
        )
    return is_near
