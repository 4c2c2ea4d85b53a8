"""Slices of a report of a turning radar: the detections, the time and the azimuths of each."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
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
