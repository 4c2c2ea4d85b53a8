# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A radar's point cloud to and from `Detections`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.configuration.radar_input import RadarInput
from phd_jdtc_ros.core.models.radar import wrap_angle
from phd_jdtc_ros.core.types import Detections

from . import point_cloud, stamps
from .errors import RejectedMessageError, quoted

# 120 dB above the noise, more than any receiver reports.
MAX_AMPLITUDE = 1e6
FULL_TURN = 2.0 * np.pi
# A compass azimuth just below a whole turn may be rounded to a float above it.
A_TURN = FULL_TURN * (1.0 + 1e-6)
# Of more turns, single precision leaves an angle of 0.03 degrees at the best, and soon none at all.
MAX_TURNS = 1000.0
# Some drivers send levels as whole decibels.
NUMBERS = (*point_cloud.FLOATS, "i1", "u1", "i2", "u2", "i4", "u4")
BoolArray = npt.NDArray[np.bool_]
# The layout of the clouds that are written where no radar's own is asked for.
OWN_LAYOUT = RadarInput(name="", topic="", frame="")


@dataclass(frozen=True)
class Report:
    """A decoded cloud.

    Parameters
    ----------
    stamp_ns : int
    detections : Detections
        `amplitude` is None where the cloud has no amplitude field.
    dropped : Counter
        Points left out, by reason: ``not_finite``, ``range``, ``azimuth``, ``amplitude``.
    beyond_a_turn : int
        Detections kept whose azimuths are beyond 2 pi in radians, and so probably are degrees.
    """

    stamp_ns: int
    detections: Detections
    dropped: Counter[str]
    beyond_a_turn: int = 0


def to_msg(
    detections: Detections, stamp_ns: int, frame: str, radar: RadarInput = OWN_LAYOUT
) -> PointCloud2:
    """Return the cloud of a planar radar's detections, as that radar's driver would publish it.

    Parameters
    ----------
    detections : Detections
    stamp_ns : int
    frame : str
    radar : RadarInput
        Field names, units and conventions; by default those of the package.

    Returns
    -------
    PointCloud2
        Fields are ``x y z`` in the sensor's frame, then the radar's names for ``range azimuth
        elevation amplitude``, FLOAT32. The elevation is 0. There is no amplitude where the radar
        has none.

    Raises
    ------
    ValueError
        If the radar has amplitudes and the detections have none.
    """
    distance, azimuth = detections.measurement.T
    zero = np.zeros(len(detections))
    columns = {
        "x": distance * np.cos(azimuth),
        "y": distance * np.sin(azimuth),
        "z": zero,
        radar.range_field: distance,
        radar.azimuth_field: sent_azimuth(azimuth, radar),
    }
    # A radar may call another field by the name that elevations have here.
    columns.setdefault(radar.elevation_field or "elevation", zero)
    if radar.amplitude_field:
        columns[radar.amplitude_field] = sent_level(detections, radar)
    return point_cloud.encode(stamp_ns, frame, columns)


def sent_azimuth(azimuth: FloatArray, radar: RadarInput) -> FloatArray:
    """Return azimuths, radians from the sensor's x axis, as the radar reports them."""
    turned = np.mod(np.pi / 2.0 - azimuth, FULL_TURN) if radar.compass else azimuth
    return np.degrees(turned) if radar.azimuth_in_degrees else turned


def sent_level(detections: Detections, radar: RadarInput) -> FloatArray:
    """Return amplitudes as the radar reports them: the inverse of what `select` does.

    Raises
    ------
    ValueError
        If the detections have none.
    """
    if detections.amplitude is None:
        raise ValueError("detections.amplitude: None given, the cloud needs amplitudes")
    if radar.amplitude_in_db:
        with np.errstate(divide="ignore"):  # an envelope of zero is -inf dB
            snr_db = 10.0 * np.log10(detections.amplitude**2 / 2.0)
        level: FloatArray = snr_db - radar.amplitude_offset_db
        return level
    # Nothing is computed without an offset, so that the numbers stay what they are.
    scale = 10.0 ** (-radar.amplitude_offset_db / 20.0) if radar.amplitude_offset_db else 1.0
    return detections.amplitude * scale


def from_msg(cloud: PointCloud2, radar: RadarInput) -> Report:
    """Return the detections of a cloud; `radar` names its fields.

    Parameters
    ----------
    cloud : PointCloud2
        Range and azimuth (and elevation) are floats; the amplitude may be a whole number.
    radar : RadarInput
        Field names, units and conventions. Where it names an elevation field, ranges are slant
        ranges.

    Raises
    ------
    RejectedMessageError
        ``frame`` if the cloud is in another frame than the radar's; see `stamp_of` and
        `point_cloud.decode`.
    """
    require_frame(cloud.header.frame_id, radar)
    wanted: dict[str, Sequence[str]] = dict.fromkeys(
        (radar.range_field, radar.azimuth_field), point_cloud.FLOATS
    )
    if radar.elevation_field:
        wanted[radar.elevation_field] = point_cloud.FLOATS
    has_amplitude = bool(radar.amplitude_field) and (
        radar.amplitude_field in point_cloud.field_names(cloud)
    )
    if has_amplitude:
        wanted[radar.amplitude_field] = NUMBERS
    # Converting a signalling NaN warns; the point is dropped below like any other NaN.
    with np.errstate(invalid="ignore"):
        columns = {
            name: column.astype(np.float64)
            for name, column in point_cloud.decode(cloud, wanted).items()
        }
    return select(
        stamp_of(cloud.header),
        radar,
        distance=columns[radar.range_field],
        azimuth=columns[radar.azimuth_field],
        elevation=columns.get(radar.elevation_field),
        level=columns[radar.amplitude_field] if has_amplitude else None,
    )


def stamp_of(header: Header) -> int:
    """Return a header's stamp in nanoseconds.

    Raises
    ------
    RejectedMessageError
        ``schema`` if it is before 1970 or its nanoseconds are a second or more.
    """
    sec, nanosec = header.stamp.sec, header.stamp.nanosec
    if sec < 0 or nanosec >= stamps.NS_PER_S:
        raise RejectedMessageError(
            "schema", f"stamp {sec} s {nanosec} ns, must be from 0 s and below {stamps.NS_PER_S} ns"
        )
    return stamps.to_ns(header.stamp)


def require_frame(frame: str, radar: RadarInput) -> None:
    """Raise `RejectedMessageError` if a message is in another frame than its radar's."""
    if frame != radar.frame:
        raise RejectedMessageError("frame", f"frame_id {quoted(frame)}, must be {radar.frame!r}")


def select(
    stamp_ns: int,
    radar: RadarInput,
    *,
    distance: FloatArray,
    azimuth: FloatArray,
    elevation: FloatArray | None,
    level: FloatArray | None,
) -> Report:
    """Return the valid detections among points, in the core's units, and count the others.

    Parameters
    ----------
    stamp_ns : int
    radar : RadarInput
        Units, conventions and the maximum range.
    distance : ndarray of shape (M,)
        Metres; slant ranges where there are elevations.
    azimuth : ndarray of shape (M,)
        As the radar reports them.
    elevation : ndarray of shape (M,) or None
        Radians above the sensor's plane.
    level : ndarray of shape (M,) or None
        Amplitudes as the radar reports them.
    """
    if radar.azimuth_in_degrees:
        azimuth = np.radians(azimuth)
    turns = np.abs(azimuth)
    if radar.compass:
        azimuth = np.pi / 2.0 - azimuth
    angle = np.zeros(len(distance)) if elevation is None else elevation
    raw = np.zeros(len(distance)) if level is None else level
    amplitude = raw if level is None else _linear_amplitude(raw, radar)

    # A level of -inf dB would give a valid envelope of zero; it is dropped as not finite.
    finite = np.isfinite(distance) & np.isfinite(azimuth) & np.isfinite(angle)
    finite &= ~np.isnan(raw) & (raw != -np.inf)
    ground_range = np.where(finite, distance, 0.0) * np.cos(np.where(finite, angle, 0.0))
    # An elevation beyond the zenith is not valid, and makes the ground range negative.
    in_range = (distance >= 0.0) & (ground_range >= 0.0) & (ground_range <= radar.max_range)
    possible = (amplitude >= 0.0) & (amplitude <= MAX_AMPLITUDE)

    kept, dropped = _sorted_out(
        {
            "not_finite": finite,
            "range": in_range,
            "azimuth": turns <= MAX_TURNS * FULL_TURN,
            "amplitude": possible,
        }
    )
    measurement = np.stack([ground_range[kept], wrap_angle(azimuth[kept])], axis=1)
    found = Detections(measurement, None if level is None else amplitude[kept])
    beyond = 0 if radar.azimuth_in_degrees else int(np.count_nonzero(turns[kept] > A_TURN))
    return Report(stamp_ns, found, dropped, beyond)


def _sorted_out(passed: Mapping[str, BoolArray]) -> tuple[BoolArray, Counter[str]]:
    """Return which points pass every test, and per test how many points fail it first."""
    dropped: Counter[str] = Counter()
    kept = np.ones(len(next(iter(passed.values()))), dtype=bool)
    for reason, passes in passed.items():
        dropped[reason] = int(np.count_nonzero(kept & ~passes))
        kept = kept & passes
    return kept, +dropped


def _linear_amplitude(raw: FloatArray, radar: RadarInput) -> FloatArray:
    """Return the envelope in units of the noise's standard deviation per quadrature.

    An envelope a has the SNR a^2 / 2.
    """
    with np.errstate(over="ignore"):  # an absurd level becomes infinite and is then dropped
        if radar.amplitude_in_db:
            from_db: FloatArray = np.sqrt(2.0 * 10.0 ** ((raw + radar.amplitude_offset_db) / 10.0))
            return from_db
        scaled: FloatArray = raw * 10.0 ** (radar.amplitude_offset_db / 20.0)
        return scaled
