"""The truth at any time: samples, what is interpolated between them, and what of it is scored."""

from __future__ import annotations

from bisect import bisect_left, insort

import numpy as np

from .comparison import PointSet
from .metrics import assign

# Between samples of the truth that are further apart than this, seconds, it is not interpolated.
LONGEST_INTERPOLATION_S = 10.0


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


def without_slow(
    truth: PointSet, estimate: PointSet, least_speed: float, near: float
) -> tuple[PointSet, PointSet]:
    """Return targets and estimates of a stamp without the slow targets and the estimates of them.

    Some trackers leave out what is slow by design, such as ships at anchor.

    Parameters
    ----------
    truth, estimate : PointSet
        All are kept if the velocities of the truth are not known.
    least_speed : float
        Slower targets are left out, metres per second.
    near : float
        Targets and estimates are paired by position, all at once, closer than this, metres.
    """
    if least_speed <= 0.0 or truth.velocity is None:
        return truth, estimate
    slow = np.hypot(*truth.velocity.T) < least_speed
    target, row = assign(truth.position, estimate.position, near)
    rest = np.setdiff1d(np.arange(len(estimate)), row[slow[target]])
    return truth.only(np.flatnonzero(~slow)), estimate.only(rest)
