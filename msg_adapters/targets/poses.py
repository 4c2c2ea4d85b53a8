"""The poses of one class's estimates, written as bytes because they may be many (see `cdr`)."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.state_space import VX, VY, X, Y
from phd_jdtc_ros.core.types import Estimates

from ..encoding import cdr
from . import vertical


def to_cdr(estimates: Estimates, class_id: int, frame: str) -> bytes:
    """Return a serialised ``geometry_msgs/PoseArray``; each pose faces along the velocity.

    Poses are at the estimates' heights, or in the map's plane if these are unknown.
    """
    mine = estimates.class_id == class_id
    rows = estimates.state[mine]
    half = 0.5 * np.arctan2(rows[:, VY], rows[:, VX])
    # Position x y z, orientation x y z w.
    pose = np.zeros((len(rows), 7))
    pose[:, 0], pose[:, 1] = rows[:, X], rows[:, Y]
    pose[:, 2] = vertical.states(estimates)[mine, 0]
    pose[:, 5], pose[:, 6] = np.sin(half), np.cos(half)
    writer = cdr.Writer()
    writer.header(estimates.stamp_ns, frame)
    writer.rows(pose)
    return writer.message()
