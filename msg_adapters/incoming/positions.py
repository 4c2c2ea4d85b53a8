"""A position sensor's point cloud to and from `Detections`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.columns import sent_columns
from phd_jdtc_ros.columns.position_selection import AREA, select
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.parameters.position import PositionParameters
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Detections

from ..encoding import point_cloud, stamps
from .detections import Expected, read_columns, require_frame

EXPECTED = Expected(
    required=("x", "y"),
    optional=("z", "x_std", "y_std", "z_std", "correlation", "vx", "vy", "vz", *AREA),
)


def from_msg(cloud: PointCloud2, own: PositionParameters) -> Report:
    """Decode the detections of a cloud: x, y, and what else its fields have.

    Coordinates, deviations, correlations, velocities, times and heights are floats; amplitude,
    code, address and detection type may also be integers. A field that the configuration names and
    the cloud lacks is an anomaly. A cloud with neither points nor fields is a report without
    detections.

    Raise `RejectedMessageError`: ``frame`` if the cloud is in another frame than the sensor's;
    otherwise see `stamps.of_input` and `point_cloud.decode`.
    """
    require_frame(cloud.header.frame_id, own)
    fields = own.fields if own.height_prior else replace(own.fields, z="", z_std="", vz="")
    columns, missing = read_columns(cloud, fields, own.units.since_epoch, EXPECTED)
    report = select(stamps.of_input(cloud.header), own, columns)
    return replace(report, anomalies=report.anomalies + missing) if missing else report


def to_cdr(detections: Detections, stamp_ns: int, own: PositionParameters) -> bytes:
    """Serialise detections as the cloud that the sensor would publish.

    All fields are FLOAT32, except for code and address (UINT32), detection type (UINT8), and times
    since the epoch (FLOAT64). Fields of optional quantities that the detections lack are left out.

    Raise `ValueError` if the sensor has amplitudes and the detections do not.
    """
    count, columns = len(detections), _columns(detections)
    names = sent_columns.names_of(own.fields)
    for what in sent_columns.COMMON.keys() & names.keys():
        columns[what] = sent_columns.COMMON[what](detections, stamp_ns, own)
    if "height" in names:
        columns["height"] = sent_columns.fill(detections.height, count, np.nan) + own.datum
    for what, found in (("z", detections.z), ("z_std", detections.z_std)):
        if found is not None:
            columns[what] = found - own.height if what == "z" else found
    if detections.area is not None:
        columns |= {
            what: np.full(count, edge) for what, edge in zip(AREA, detections.area, strict=True)
        }
    sent = {name: columns[what] for what, name in names.items() if what in columns}
    wide = {own.fields.time} if own.units.since_epoch else frozenset()
    return point_cloud.to_cdr(stamp_ns, own.frame, sent, wide)


def _columns(detections: Detections) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of places, deviations and velocities that detections have."""
    pairs: Mapping[tuple[str, ...], FloatArray | None] = {
        ("x", "y"): detections.measurement,
        ("x_std", "y_std"): detections.noise_std,
        ("vx", "vy", "vz"): detections.velocity,
    }
    columns: dict[str, npt.NDArray[Any]] = {}
    for names, found in pairs.items():
        if found is not None:
            columns |= dict(zip(names, found.T, strict=False))
    if detections.noise_correlation is not None:
        columns["correlation"] = detections.noise_correlation
    if detections.velocity_std is not None:
        columns["velocity_std"] = detections.velocity_std[:, 0]
    return columns
