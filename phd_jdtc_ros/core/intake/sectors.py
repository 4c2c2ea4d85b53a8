"""Parts of a revolution: the sectors that a radar reports, and slices of its reports.

A radar that reports n sectors to a revolution numbers them from 0 in the direction in which it
counts azimuths, from its azimuth zero on.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, wrap_angle
from ..types import FULL_TURN, UNKNOWN_COVERAGE, Coverage, Detections

# Fewest slices per revolution, and their usual length, seconds. Detections are predicted to their
# own times as if a target flew straight: in half a slice, a turn with 3 g departs by 8 m from that.
FEWEST_SLICES, SLICE_S = 3, 1.5
# Fewest slices of a moving radar, which has one pose in a slice: a boat that yaws at 5 degrees a
# second turns by 0.8 degrees in half a slice of a revolution of 2.5 s. Also for particles, which
# follow a turn better in small steps.
FEWEST_FINE = 8

Slice = tuple[int, Detections]


class UnstampedSlice(NamedTuple):
    """A slice whose stamp may still increase, and whose detections' times refer to the report."""

    middle_ns: int  # Middle of the time that the slice covers, nanoseconds
    detections: Detections
    coverage: Coverage | None  # None for the radar's whole field


class RadarReport(NamedTuple):
    """A radar's report, with its times in seconds."""

    stamp_ns: int
    detections: Detections
    stamp_s: float  # Stamp of the report
    timed: bool  # Whether detections have times of their own
    detection_s: FloatArray  # Times of the detections, (M,); empty if they have none of their own
    azimuth: FloatArray  # Azimuths of the detections, radians, (M,)

    @staticmethod
    def of(stamp_ns: int, detections: Detections) -> RadarReport:
        """Return a report with its times."""
        stamp_s, time_s = stamp_ns * 1e-9, detections.time_s
        detection_s = np.zeros(0) if time_s is None else stamp_s + time_s
        azimuth = detections.measurement[:, 1]
        return RadarReport(stamp_ns, detections, stamp_s, time_s is not None, detection_s, azimuth)


def slices_per_revolution(period_s: float, fine: bool = False) -> int:
    """Return the number of slices of a revolution this long; see `FEWEST_FINE` for `fine`."""
    return max(FEWEST_FINE if fine else FEWEST_SLICES, round(period_s / SLICE_S))


def cut(
    report: RadarReport,
    length_s: float,
    between_s: tuple[float, float],
    between: tuple[float, float],
) -> list[UnstampedSlice]:
    """Return the slices of a report of detections with times of their own, oldest first.

    `length_s` is about the time that a slice covers, `between_s` has the start and the end of the
    time that the report covers, and `between` the antenna's directions at these times, radians.
    """
    start_s, end_s = between_s
    count = round((end_s - start_s) / length_s)
    if count <= 1:
        offset_ns = round((0.5 * (start_s + end_s) - report.stamp_s) * 1e9)
        return [UnstampedSlice(report.stamp_ns + offset_ns, report.detections, arc(*between))]
    edges_s, edges = np.linspace(start_s, end_s, count + 1), np.linspace(*between, count + 1)
    offsets_ns = np.rint((0.5 * (edges_s[1:] + edges_s[:-1]) - report.stamp_s) * 1e9)
    index = np.searchsorted(edges_s[1:-1], report.detection_s, side="right")
    parts = [report.detections.take(np.flatnonzero(index == k)) for k in range(count)]
    return [
        UnstampedSlice(report.stamp_ns + int(offset_ns), part, arc(*ends))
        for offset_ns, part, ends in zip(offsets_ns, parts, pairwise(edges), strict=True)
    ]


def arc(start: float, end: float) -> Coverage:
    """Return the coverage between two azimuths, radians; unknown if it is too narrow."""
    width = min(abs(end - start), FULL_TURN)
    if width <= UNKNOWN_COVERAGE.width:
        return UNKNOWN_COVERAGE
    return Coverage(math.remainder(min(start, end), FULL_TURN), width)


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
