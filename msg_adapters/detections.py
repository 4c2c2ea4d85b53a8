# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A radar's point cloud to and from `Detections`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.configuration.radar_input import RadarInput
from phd_jdtc_ros.core.sectors import sector_of
from phd_jdtc_ros.core.types import FULL_TURN, Detections

from . import ground_ranges, identities, plot_times, point_cloud, stamps
from .errors import RejectedMessageError, quoted
from .selection import Columns, Report, select

# Some drivers send levels as whole decibels.
NUMBERS = (*point_cloud.FLOATS, "i1", "u1", "i2", "u2", "i4", "u4")
# Single precision leaves two minutes of the time since the epoch.
DOUBLES = ("f8",)
# What a cloud may lack although the radar's configuration names its field.
OPTIONAL = (
    *("level", "time", "sector", "height", "code", "address", "kind", "range_std", "azimuth_std"),
    *("range_rate", "range_rate_std"),
)
# The layout of the clouds that are written where no radar's own is asked for.
OWN_LAYOUT = RadarInput(name="", topic="", frame="")


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
        elevation amplitude``, and those for the time, the sector, the height, the code, the
        address, the kind, the range rate and the deviations of each detection that it has. All are
        FLOAT32, but for the sector, the code and the address, UINT32, the kind, UINT8, and times
        since the epoch, FLOAT64.
        The elevation is 0; so is the height above the antenna if the detections have none.

    Raises
    ------
    ValueError
        If the radar has amplitudes or sectors and the detections have none.
    """
    distance, azimuth = detections.measurement.T
    slant, measured = ground_ranges.sent(detections, radar)
    zero = np.zeros(len(detections))
    columns = {
        "x": distance * np.cos(azimuth),
        "y": distance * np.sin(azimuth),
        "z": zero,
        radar.range_field: slant,
        radar.azimuth_field: sent_azimuth(measured, radar),
    }
    # A radar may call another field by the name that elevations have here.
    columns.setdefault(radar.elevation_field or "elevation", zero)
    if radar.amplitude_field:
        columns[radar.amplitude_field] = sent_level(detections, radar)
    columns.update(_sent_particulars(detections, stamp_ns, radar))
    wide = {radar.time_field} if radar.time_since_epoch else frozenset()
    return point_cloud.encode(stamp_ns, frame, columns, wide)


def _sent_particulars(
    detections: Detections, stamp_ns: int, radar: RadarInput
) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the columns of a radar that says more of its detections than where they are."""
    count = len(detections)
    if radar.time_field:
        time_s = np.zeros(count) if detections.time_s is None else detections.time_s
        yield radar.time_field, plot_times.sent(time_s, stamp_ns, radar)
    if radar.sector_field:
        if detections.coverage is None or not radar.sectors:
            raise ValueError("detections.coverage: None given, the cloud needs a sector")
        sector = sector_of(detections.coverage, radar.sectors, radar.compass)
        yield radar.sector_field, np.full(count, sector, dtype=np.uint32)
    if radar.height_field:
        yield radar.height_field, ground_ranges.sent_height(detections, radar)
    for name, identity in (
        (radar.code_field, detections.code),
        (radar.address_field, detections.address),
    ):
        if name:
            yield name, identities.sent(identity, count)
    if radar.kind_field:
        kind = np.zeros(count) if detections.kind is None else np.maximum(detections.kind, 0)
        yield radar.kind_field, kind.astype(np.uint8)
    own = detections.noise_std
    std = np.full((count, 2), np.nan) if own is None else own
    if radar.range_std_field:
        yield radar.range_std_field, std[:, 0]
    if radar.azimuth_std_field:
        degrees = radar.azimuth_in_degrees
        yield radar.azimuth_std_field, np.degrees(std[:, 1]) if degrees else std[:, 1]
    for name, known in (
        (radar.range_rate_field, detections.range_rate),
        (radar.range_rate_std_field, detections.range_rate_std),
    ):
        if name:
            yield name, np.full(count, np.nan) if known is None else known


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
        Range and azimuth (and elevation) are floats, as are times, heights, range rates and
        deviations; the amplitude, sector, code, address and kind may be whole numbers.
        Without a field that is none of a detection's coordinates, what it says is unknown; that is
        a doubt.
    radar : RadarInput
        Field names, units and conventions. Where it names an elevation or a height field, ranges
        are slant ranges.

    Raises
    ------
    RejectedMessageError
        ``frame`` if the cloud is in another frame than the radar's; see `stamps.of_header`
        and `point_cloud.decode`.
    """
    require_frame(cloud.header.frame_id, radar)
    named = _named(radar)
    there = set(point_cloud.field_names(cloud))
    missing = [what for what in OPTIONAL if what in named and named[what][0] not in there]
    wanted = dict(entry for what, entry in named.items() if what not in missing)
    # Converting a signalling NaN warns; the point is dropped, or the value unknown, like any NaN.
    with np.errstate(invalid="ignore"):
        columns = {
            name: column.astype(np.float64)
            for name, column in point_cloud.decode(cloud, wanted).items()
        }
    found = {what: columns[name] for what, (name, _) in named.items() if name in columns}
    report = select(stamps.of_header(cloud.header), radar, Columns(**found))
    lacking = Counter(f"{what}_missing" for what in missing if what != "level")
    return replace(report, doubts=report.doubts + lacking) if lacking else report


def _named(radar: RadarInput) -> dict[str, tuple[str, Sequence[str]]]:
    """Return the name and the allowed types of every field that a radar has, by its column."""
    floats = point_cloud.FLOATS
    fields: dict[str, tuple[str, Sequence[str]]] = {
        "distance": (radar.range_field, floats),
        "azimuth": (radar.azimuth_field, floats),
        "elevation": (radar.elevation_field, floats),
        "level": (radar.amplitude_field, NUMBERS),
        "time": (radar.time_field, DOUBLES if radar.time_since_epoch else floats),
        "sector": (radar.sector_field, NUMBERS),
        "height": (radar.height_field, floats),
        "code": (radar.code_field, NUMBERS),
        "address": (radar.address_field, NUMBERS),
        "kind": (radar.kind_field, NUMBERS),
        "range_std": (radar.range_std_field, floats),
        "azimuth_std": (radar.azimuth_std_field, floats),
        "range_rate": (radar.range_rate_field, floats),
        "range_rate_std": (radar.range_rate_std_field, floats),
    }
    return {what: entry for what, entry in fields.items() if entry[0]}


def require_frame(frame: str, radar: RadarInput) -> None:
    """Raise `RejectedMessageError` if a message is in another frame than its radar's."""
    if frame != radar.frame:
        raise RejectedMessageError("frame", f"frame_id {quoted(frame)}, must be {radar.frame!r}")
