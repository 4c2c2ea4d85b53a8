"""Distinct velocities for the copies of a particle born at a known place.

The first scan of such a target locates it but contains no information on its velocity. Resampling
then copies the particles at the right place, each with the velocity that it was born with, and few
of these velocities are about right. Given the position, the velocity still has its prior. So every
copy may draw a new one: the density is unchanged, and the next scans test several times as many
velocities.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...models.tracker_model import TrackerModel
from ...tracks import labels
from ...types import Scan
from ..particle_set import ParticleSet


def redraw_velocities(
    stored: ParticleSet, scan: Scan, model: TrackerModel, scan_index: int, rng: np.random.Generator
) -> ParticleSet:
    """Return a resampled set in which all copies of newborn particles have distinct velocities.

    It has a row for each copy of a particle of a birth term. The first copy keeps its velocity and
    turn rate, the others draw them from the term. If the scan, that of the last update, is
    informative on velocities, the set is unchanged.
    """
    newborn = (stored.parent < 0) & ~labels.born_at_detection(stored.row_label)
    newborn &= stored.multiplicity > 1
    if not newborn.any() or _is_informative_on_velocities(scan):
        return stored
    copies = np.where(newborn, stored.multiplicity, 1)
    row = np.repeat(np.arange(len(stored)), copies)
    copy_row = np.flatnonzero(np.append(False, row[1:] == row[:-1]))
    share = 1.0 / copies[row]
    term = stored.row_label[row[copy_row]] - labels.first_predicted(scan_index)
    state = stored.state[row]
    mean, std = (
        np.array([getattr(birth, name) for birth in model.births])[term] for name in ("mean", "std")
    )
    drawn = mean + std * rng.standard_normal(mean.shape)
    for index, motion in enumerate(model.modes.motions):
        rows = np.flatnonzero(stored.mode[row[copy_row]] == index)
        for axis in set(motion.support) - set(model.modes.space.position):
            state[copy_row[rows], axis] = drawn[rows, axis]
    multiplicity = np.where(newborn, 1, stored.multiplicity)[row]
    return replace(stored.scale(row, share), state=state, multiplicity=multiplicity)


def _is_informative_on_velocities(scan: Scan) -> bool:
    """Return whether a scan has range rates, or plots at other times than its stamp.

    The position at another time depends on the velocity too.
    """
    return any(
        detections is not None
        and (
            detections.range_rate is not None
            or (detections.time_s is not None and detections.time_s.any())
        )
        for detections in scan.detections
    )
