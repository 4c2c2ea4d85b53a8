"""The truth at any time: samples, and what is interpolated between them."""

from __future__ import annotations

from bisect import bisect_left, insort

import numpy as np

from .limits import LONGEST_INTERPOLATION_S
from .scan_scores import PointSet


class TrueTracks:
    """Samples of the true targets, and the targets between two samples.

    Parameters
    ----------
    keep : int or None
        Number of the newest samples that are kept; None keeps all.

    Notes
    -----
    At the stamp of a sample the truth is that sample. Between two samples a target exists if it
    does in both. It moves by the cubic that has its positions and velocities at both (Hermite), or
    straight where the velocities are not known. Samples further apart than
    `LONGEST_INTERPOLATION_S` are not interpolated, nor are targets without labels.
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
        """Return the targets at a time; None if they are not known, or not yet."""
        if stamp_ns in self._samples:
            return self._samples[stamp_ns]
        after = bisect_left(self._stamps, stamp_ns)
        if not 0 < after < len(self._stamps):
            return None
        begin, end = self._stamps[after - 1], self._stamps[after]
        if end - begin > LONGEST_INTERPOLATION_S * 1e9:
            return None
        part = (stamp_ns - begin) / (end - begin)
        return between(self._samples[begin], self._samples[end], part, (end - begin) * 1e-9)


def between(first: PointSet, second: PointSet, part: float, interval_s: float) -> PointSet | None:
    """Return the targets that exist in two samples, at a time between these.

    Parameters
    ----------
    first, second : PointSet
    part : float
        Of the interval that is over, between 0 and 1.
    interval_s : float
        From the first to the second, seconds.

    Returns
    -------
    PointSet or None
        In the order of the first; None unless all targets have labels.
    """
    labelled = first.labelled(), second.labelled()
    if labelled[0] is None or labelled[1] is None:
        return None
    _, row, column = np.intersect1d(labelled[0].label, labelled[1].label, return_indices=True)
    order = np.argsort(row)
    begin, end = first.only(row[order]), second.only(column[order])
    rest = 1.0 - part
    position = rest * begin.position + part * end.position
    velocity = None
    if begin.velocity is not None and end.velocity is not None:
        # By how much the velocity at each end differs from that of the straight line.
        mean = (end.position - begin.position) / interval_s
        bends = rest * (begin.velocity - mean) - part * (end.velocity - mean)
        position = position + interval_s * part * rest * bends
        velocity = rest * begin.velocity + part * end.velocity
    return PointSet(position, begin.class_id, begin.track_id, velocity)
