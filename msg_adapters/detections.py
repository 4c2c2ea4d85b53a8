"""A radar's point cloud to and from `Detections`."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.core.config import RadarInput
from phd_jdtc_ros.core.radar import wrap_angle
from phd_jdtc_ros.core.types import Detections, FloatArray

from . import point_cloud, stamps
from .errors import RejectedMessageError

# 120 dB above the noise; no receiver reports more.
MAX_AMPLITUDE = 1e6


@dataclass(frozen=True)
class Report:
    """A decoded cloud.

    Parameters
    ----------
    stamp_ns : int
    detections : Detections
        `amplitude` is None where the cloud has no amplitude field.
    dropped : Counter
        Points left out, by reason: ``not_finite``, ``range``, ``amplitude``.
    """

    stamp_ns: int
    detections: Detections
    dropped: Counter[str]


def to_msg(detections: Detections, stamp_ns: int, frame: str) -> PointCloud2:
    """Return the cloud of a planar radar's detections.

    Fields are ``x y z range azimuth elevation amplitude``, FLOAT32, in the sensor's frame;
    elevation is 0.
    """
    distance, azimuth = detections.measurement.T
    amplitude = detections.amplitude
    if amplitude is None:
        raise ValueError("detections.amplitude: None given, the cloud needs amplitudes")
    zero = np.zeros(len(detections))
    return point_cloud.encode(
        stamp_ns,
        frame,
        {
            "x": distance * np.cos(azimuth),
            "y": distance * np.sin(azimuth),
            "z": zero,
            "range": distance,
            "azimuth": azimuth,
            "elevation": zero,
            "amplitude": amplitude,
        },
    )


def from_msg(cloud: PointCloud2, radar: RadarInput) -> Report:
    """Return the detections of a cloud, whatever its driver calls the fields.

    Parameters
    ----------
    cloud : PointCloud2
    radar : RadarInput
        Field names, units and conventions.

    Raises
    ------
    RejectedMessageError
        ``frame`` if the cloud is in another frame than the radar's, and see
        `point_cloud.decode`.
    """
    if cloud.header.frame_id != radar.frame:
        raise RejectedMessageError(
            "frame", f"frame_id {cloud.header.frame_id!r}, must be {radar.frame!r}"
        )
    wanted = [radar.range_field, radar.azimuth_field]
    has_amplitude = bool(radar.amplitude_field) and (
        radar.amplitude_field in point_cloud.field_names(cloud)
    )
    if has_amplitude:
        wanted.append(radar.amplitude_field)
    columns = point_cloud.decode(cloud, dict.fromkeys(wanted, point_cloud.FLOATS))
    distance = columns[radar.range_field].astype(np.float64)
    azimuth = columns[radar.azimuth_field].astype(np.float64)
    if radar.compass:
        azimuth = np.pi / 2.0 - azimuth
    amplitude = raw = np.zeros(len(distance))
    if has_amplitude:
        raw = columns[radar.amplitude_field].astype(np.float64)
        amplitude = _linear_amplitude(raw, radar)

    # An infinite level is no number either, though -inf dB would be an envelope of zero.
    finite = np.isfinite(distance) & np.isfinite(azimuth) & ~np.isnan(raw) & (raw != -np.inf)
    in_range = (distance >= 0.0) & (distance <= radar.max_range)
    possible = (amplitude >= 0.0) & (amplitude <= MAX_AMPLITUDE)
    kept = finite & in_range & possible
    dropped = Counter(
        {
            "not_finite": int(np.count_nonzero(~finite)),
            "range": int(np.count_nonzero(finite & ~in_range)),
            "amplitude": int(np.count_nonzero(finite & in_range & ~possible)),
        }
    )
    return Report(
        stamps.to_ns(cloud.header.stamp),
        Detections(
            np.stack([distance[kept], wrap_angle(azimuth[kept])], axis=1),
            amplitude[kept] if has_amplitude else None,
        ),
        +dropped,
    )


def _linear_amplitude(raw: FloatArray, radar: RadarInput) -> FloatArray:
    """Return the envelope in units of the noise's standard deviation a quadrature.

    An envelope a has the SNR a^2 / 2.
    """
    with np.errstate(over="ignore"):  # an absurd level becomes infinite and is dropped as such
        if radar.amplitude_in_db:
            from_db: FloatArray = np.sqrt(2.0 * 10.0 ** ((raw + radar.amplitude_offset_db) / 10.0))
            return from_db
        scaled: FloatArray = raw * 10.0 ** (radar.amplitude_offset_db / 20.0)
        return scaled
