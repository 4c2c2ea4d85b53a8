# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which origins a scan touches: those that an antenna may have passed.

The others are neither predicted nor linked for it, so that a scan of a sector costs what the
antenna passed.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from .arrays import FloatArray
from .models.motion import MotionModel
from .models.radar import GATE_SIGMA, LEAST_RANGE, RadarModel
from .models.tracker_model import TrackerModel
from .models.visibility import within
from .sectors import arcs
from .types import FULL_TURN, Coverage, Scan
from .window import BoolArray, Current, Extents, LinkT, RowsT

# Of the position of an origin; farther out, next to none of its mass is.
SPREAD_SIGMA = 4.0
# An origin that no antenna has passed for this many turns is predicted all the same.
LONGEST_TURNS = 1.5
# Detections outside of what was covered that are nearer to each other are of one arc, rad.
NEIGHBOURS = 0.1


def parted(
    current: list[Current[RowsT, LinkT]], scan: Scan, model: TrackerModel, labelled: bool
) -> tuple[list[Current[RowsT, LinkT]], list[Current[RowsT, LinkT]]]:
    """Return the rows that a scan touches, and those that it does not.

    Parameters
    ----------
    current : list of Current
        Oldest first.
    scan : Scan
    model : TrackerModel
    labelled : bool
        Whether an origin is at most one target. Otherwise there are no origins to leave alone, and
        everything is touched.
    """
    sectors = passed(scan, model)
    if not labelled or sectors is None:
        return current, []
    longest_s = LONGEST_TURNS * max(
        (radar.rotation_s for radar in model.radars), default=model.modes.interval_s
    )
    age_s = [(scan.stamp_ns - rows.entry.stamp_ns) * 1e-9 for rows in current]
    extents = [rows.entry.extents(model.modes.space) for rows in current]
    near = _near(extents, age_s, sectors, model)
    touched, others, first = [], [], 0
    for rows, dt, extent in zip(current, age_s, extents, strict=True):
        near_here = near[first : first + len(extent.origin)]
        first += len(extent.origin)
        if dt >= longest_s or near_here.all():
            touched.append(rows)
        elif not near_here.any():
            others.append(rows)
        else:
            inside, outside = rows.parted(near_here[extent.row_origin])
            touched += [inside] if inside is not None else []
            others += [outside] if outside is not None else []
    return touched, others


def _near(
    extents: Sequence[Extents],
    age_s: Sequence[float],
    sectors: Sequence[tuple[RadarModel, Coverage]],
    model: TrackerModel,
) -> BoolArray:
    """Return whether an antenna may have passed each origin, one entry's after the other."""
    if not extents:
        return np.zeros(0, dtype=bool)
    sizes = [len(extent.origin) for extent in extents]
    dt = np.repeat(age_s, sizes)
    position = np.concatenate([extent.position for extent in extents])
    position += dt[:, None] * np.concatenate([extent.velocity for extent in extents])
    # The radius within which each target is.
    spread = np.concatenate([extent.position_std for extent in extents])
    spread += dt * np.concatenate([extent.velocity_std for extent in extents])
    spread += np.repeat([_noise_std(model, age) for age in age_s], sizes)
    near = np.zeros(len(dt), dtype=bool)
    for radar, coverage in sectors:
        near |= _passed(position, SPREAD_SIGMA * spread, radar, coverage)
    return near


def passed(scan: Scan, model: TrackerModel) -> list[tuple[RadarModel, Coverage]] | None:
    """Return what the antennas passed in a scan; None if it is no scan of sectors.

    An antenna has been wherever it has detected something, also outside of what it covered.
    """
    found: list[tuple[RadarModel, Coverage]] = []
    for radar, detections in model.reports(scan):
        coverage = detections.coverage
        if coverage is None:
            return None
        found.append((radar, coverage))
        azimuth = detections.measurement[:, 1]
        outside = azimuth[within(azimuth, coverage) == 0.0]
        found += [(radar, arc) for arc in arcs(outside, NEIGHBOURS)]
    return found or None


def births_passed(scan: Scan, model: TrackerModel) -> list[int]:
    """Return the birth terms at places that an antenna may have passed in a scan."""
    sectors = passed(scan, model)
    if sectors is None:
        return list(range(len(model.births)))
    place = list(model.modes.space.position)
    near = []
    for index, term in enumerate(model.births):
        spread = np.array([SPREAD_SIGMA * float(np.hypot(*term.std[place]))])
        if any(_passed(term.mean[place][None], spread, *sector)[0] for sector in sectors):
            near.append(index)
    return near


def _noise_std(model: TrackerModel, dt: float) -> float:
    """Return the standard deviation, along both axes, that the process noise adds in `dt`."""
    motions = dict.fromkeys(model.modes.motions)
    return float(np.sqrt(2.0 * max(_position_variance(motion, dt) for motion in motions)))


# Antennas turn evenly, so the same intervals come again and again.
@lru_cache(maxsize=1024)
def _position_variance(motion: MotionModel, dt: float) -> float:
    """Return the process noise of a position along an axis after `dt` seconds."""
    axis = motion.support.index(motion.space.position[0])
    return float(motion.noise_covariance(dt)[axis, axis])


def _passed(
    position: FloatArray, spread: FloatArray, radar: RadarModel, coverage: Coverage
) -> BoolArray:
    """Return whether the coverage comes within `spread` of each position, shape (T,)."""
    line = position - np.asarray(radar.position)
    distance = np.maximum(np.hypot(line[:, 0], line[:, 1]), LEAST_RANGE)
    margin = np.arcsin(np.minimum(spread / distance, 1.0)) + GATE_SIGMA * radar.azimuth_std
    azimuth = np.arctan2(line[:, 1], line[:, 0]) - radar.yaw
    offset = np.mod(azimuth - coverage.start + margin, FULL_TURN)
    near: BoolArray = (offset <= coverage.width + 2.0 * margin) | (spread >= distance)
    return near
