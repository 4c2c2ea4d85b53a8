"""The sectors of a revolution: their numbers and the azimuths that they cover.

A radar that reports n sectors to a revolution numbers them from 0 in the direction in which it
counts azimuths, from its azimuth zero on.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import FloatArray, wrap_angle
from ..types import FULL_TURN, Coverage


def coverage_of(sector: int, sectors: int, compass: bool) -> Coverage:
    """Return the azimuths of a sector, numbered from 0.

    With `compass` the radar counts azimuths clockwise from north, and not counter-clockwise from
    its x axis.
    """
    width = FULL_TURN / sectors
    start = math.pi / 2.0 - (sector + 1) * width if compass else sector * width
    return Coverage(math.remainder(start, FULL_TURN), width)


def sector_of(coverage: Coverage, sectors: int, compass: bool) -> int:
    """Return the number of the sector that contains the middle of a coverage."""
    middle = coverage.start + 0.5 * coverage.width
    counted = math.pi / 2.0 - middle if compass else middle
    return int(counted % FULL_TURN / FULL_TURN * sectors) % sectors


def is_sector(azimuth: FloatArray, sector: Coverage) -> bool:
    """Return whether detections can belong to a sector: half are in or near it, or they are few."""
    # Smallest number of detections that can refute a sector's number.
    if len(azimuth) < 3:
        return True
    half = 0.5 * sector.width
    residual = np.abs(wrap_angle(azimuth - sector.start - half))
    # A detection may lie outside its sector by half a sector, or by this margin in radians if it is
    # larger, because some come with the next report.
    near = int(np.count_nonzero(residual <= half + max(half, math.radians(20.0))))
    return 2 * near >= len(azimuth)


def smallest_arc(azimuth: FloatArray) -> tuple[float, float]:
    """Return the start and the width of the smallest arc that contains all azimuths, radians.

    There is at least one azimuth, (M,); the arc is counter-clockwise.
    """
    ordered = np.mod(azimuth, FULL_TURN)
    ordered.sort()
    gaps = np.concatenate([ordered[1:], ordered[:1] + FULL_TURN]) - ordered
    widest = int(gaps.argmax())
    return float(ordered[(widest + 1) % len(ordered)]), FULL_TURN - float(gaps[widest])
