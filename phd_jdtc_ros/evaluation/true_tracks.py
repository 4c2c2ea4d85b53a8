"""The truth at any time: samples, interpolation between them, and removal of slow targets."""

from __future__ import annotations

from bisect import bisect_left, insort

import numpy as np

from .comparison import PointSet
from .metrics import assign

# Longest interval between samples over which the truth is interpolated, seconds.
LONGEST_INTERPOLATION_S = 10.0


class TrueTracks:
    """Samples of the true targets, the newest `keep` or all, and the targets between two samples.

    At the stamp of a sample the truth is that sample. A target exists between two samples if it
    exists in both. Its path is the cubic through both positions with both velocities (Hermite), or
    a straight line if velocities are unknown. There is no interpolation over more than
    `LONGEST_INTERPOLATION_S`, or of targets without labels.
    """

    def __init__(self, keep: int | None = None) -> None:
        self._keep = keep
        self._samples: dict[int, PointSet] = {}
        self._stamps: list[int] = []

    def add(self, stamp_ns: int, truth: PointSet) -> None:
        """Add a sample, or replace the one of its stamp; remove the oldest beyond `keep`."""
        if self._samples.pop(stamp_ns, None) is None:
            insort(self._stamps, stamp_ns)
        self._samples[stamp_ns] = truth
        while self._keep is not None and len(self._samples) > self._keep:
            oldest = next(iter(self._samples))
            del self._samples[oldest], self._stamps[bisect_left(self._stamps, oldest)]

    def __contains__(self, stamp_ns: int) -> bool:
        """Return whether there is a sample of this stamp."""
        return stamp_ns in self._samples

    def __len__(self) -> int:
        return len(self._samples)

    def at(self, stamp_ns: int) -> PointSet | None:
        """Return the targets at a time; None if unknown, or not yet known."""
        if stamp_ns in self._samples:
            return self._samples[stamp_ns]
        after = bisect_left(self._stamps, stamp_ns)
        if not 0 < after < len(self._stamps):
            return None
        begin, end = self._stamps[after - 1], self._stamps[after]
        if end - begin > LONGEST_INTERPOLATION_S * 1e9:
            return None
        part = (stamp_ns - begin) / (end - begin)
        return interpolate(self._samples[begin], self._samples[end], part, (end - begin) * 1e-9)


def interpolate(
    first: PointSet, second: PointSet, part: float, interval_s: float
) -> PointSet | None:
    """Return the targets that exist in two samples, at a time between the samples.

    `part`, between 0 and 1, is the elapsed share of the interval, which lasts `interval_s` seconds.
    The targets are in the order of the first sample; None unless all have labels.
    """
    labelled = first.with_labels(), second.with_labels()
    if labelled[0] is None or labelled[1] is None:
        return None
    _, row, column = np.intersect1d(labelled[0].label, labelled[1].label, return_indices=True)
    order = np.argsort(row)
    begin, end = first.only(row[order]), second.only(column[order])
    rest = 1.0 - part
    position = rest * begin.position + part * end.position
    velocity = None
    if begin.velocity is not None and end.velocity is not None:
        # The cubic corrects for the difference of each end's velocity from the mean velocity.
        mean = (end.position - begin.position) / interval_s
        bends = rest * (begin.velocity - mean) - part * (end.velocity - mean)
        position = position + interval_s * part * rest * bends
        velocity = rest * begin.velocity + part * end.velocity
    return PointSet(position, begin.class_id, begin.track_id, velocity)


def without_slow(
    truth: PointSet, estimate: PointSet, least_speed: float, near: float
) -> tuple[PointSet, PointSet]:
    """Return targets and estimates of a stamp without slow targets and their estimates.

    Some trackers leave out slow targets by design, such as ships at anchor. A target is slow below
    `least_speed`, m/s, and `near` is the largest distance of a target and its estimate in the
    assignment by position, metres. All are returned if the velocities of the truth are unknown.
    """
    if least_speed <= 0.0 or truth.velocity is None:
        return truth, estimate
    slow = np.hypot(*truth.velocity.T) < least_speed
    target, row = assign(truth.position, estimate.position, near)
    rest = np.setdiff1d(np.arange(len(estimate)), row[slow[target]])
    return truth.only(np.flatnonzero(~slow)), estimate.only(rest)
