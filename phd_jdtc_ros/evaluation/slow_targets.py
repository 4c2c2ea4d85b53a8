"""Targets that are too slow to be tracked by design, as ships at anchor, are not scored."""

from __future__ import annotations

import numpy as np

from .metrics import assign
from .scan_scores import PointSet


def without_slow(
    truth: PointSet, estimate: PointSet, least_speed: float, near: float
) -> tuple[PointSet, PointSet]:
    """Return targets and estimates of a stamp without the slow targets and the estimates of them.

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
