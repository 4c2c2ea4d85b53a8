"""Conversion between ground truth and point clouds."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.core.state_space import PLANAR, VX, VY, X, Y
from phd_jdtc_ros.core.types import Truth

from ..encoding import point_cloud, stamps


def to_msg(truth: Truth, frame: str) -> PointCloud2:
    """Encode the targets at one stamp: ``x y z vx vy vz track_id class_id``."""
    height = np.zeros((len(truth.state), 2)) if truth.height is None else truth.height
    return point_cloud.encode(
        truth.stamp_ns,
        frame,
        {
            "x": truth.state[:, X],
            "y": truth.state[:, Y],
            "z": height[:, 0],
            "vx": truth.state[:, VX],
            "vy": truth.state[:, VY],
            "vz": height[:, 1],
            "track_id": truth.track_id,
            "class_id": truth.class_id,
        },
    )


def from_msg(cloud: PointCloud2) -> Truth:
    """Decode the targets of a cloud.

    Raise `RejectedMessageError`; see `point_cloud.decode` and `stamps.of_header`.
    """
    floats = ("x", "y", "z", "vx", "vy", "vz")
    ids = ("track_id", "class_id")
    wanted = dict.fromkeys(floats, point_cloud.FLOATS) | dict.fromkeys(ids, point_cloud.UNSIGNED)
    columns = point_cloud.decode(cloud, wanted)
    point_cloud.require_finite(columns)
    state = np.zeros((len(columns["x"]), len(PLANAR)))
    for index, name in ((X, "x"), (VX, "vx"), (Y, "y"), (VY, "vy")):
        state[:, index] = columns[name]
    height = np.stack([columns["z"], columns["vz"]], axis=1).astype(np.float64)
    return Truth(
        stamp_ns=stamps.of_header(cloud.header),
        state=state,
        track_id=columns["track_id"].astype(np.int64),
        class_id=columns["class_id"].astype(np.int64),
        height=height if height.any() else None,
    )
