"""Detections as the columns that a radar reports; independent of ROS."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.configuration.radar_parameters import RadarParameters
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.intake.sectors import sector_of
from phd_jdtc_ros.core.types import FULL_TURN, Detections

from . import ground_ranges, identities, plot_times


def names_of(radar: RadarParameters) -> dict[str, str]:
    """Return the radar's names of its columns, by their names in `Columns`."""
    names = {
        "distance": radar.fields.range,
        "azimuth": radar.fields.azimuth,
        "elevation": radar.fields.elevation,
        "level": radar.fields.amplitude,
        "time": radar.fields.time,
        "sector": radar.fields.sector,
        "height": radar.fields.height,
        "code": radar.fields.code,
        "address": radar.fields.address,
        "kind": radar.fields.kind,
        "range_std": radar.fields.range_std,
        "azimuth_std": radar.fields.azimuth_std,
        "range_rate": radar.fields.range_rate,
        "range_rate_std": radar.fields.range_rate_std,
    }
    return {what: name for what, name in names.items() if name}


def of(
    detections: Detections, stamp_ns: int, radar: RadarParameters
) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a planar radar's detections, under the radar's names.

    Parameters
    ----------
    stamp_ns : int
        Stamp of the report.
    radar : RadarParameters
        Names, units and conventions.

    Returns
    -------
    dict of name to array of shape (M,)
        There is always an elevation, which is 0.

    Raises
    ------
    ValueError
        If the radar has amplitudes or sectors and the detections do not.
    """
    slant, measured = ground_ranges.measure(detections, radar)
    columns = {radar.fields.range: slant, radar.fields.azimuth: azimuth(measured, radar)}
    # The radar may use the default name of elevations for another field.
    columns.setdefault(radar.fields.elevation or "elevation", np.zeros(len(detections)))
    if radar.fields.amplitude:
        columns[radar.fields.amplitude] = level(detections, radar)
    columns.update(_particulars(detections, stamp_ns, radar))
    return columns


def _particulars(
    detections: Detections, stamp_ns: int, radar: RadarParameters
) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the radar's optional columns besides range, azimuth and elevation."""
    count = len(detections)
    if radar.fields.time:
        time_s = np.zeros(count) if detections.time_s is None else detections.time_s
        yield radar.fields.time, plot_times.encode(time_s, stamp_ns, radar)
    if radar.fields.sector:
        if detections.coverage is None or not radar.sectors:
            raise ValueError("detections.coverage: None given, the cloud needs a sector")
        sector = sector_of(detections.coverage, radar.sectors, radar.compass)
        yield radar.fields.sector, np.full(count, sector, dtype=np.uint32)
    if radar.fields.height:
        yield radar.fields.height, ground_ranges.message_height(detections, radar)
    for name, identity in (
        (radar.fields.code, detections.code),
        (radar.fields.address, detections.address),
    ):
        if name:
            yield name, identities.encode(identity, count)
    if radar.fields.kind:
        kind = np.zeros(count) if detections.kind is None else np.maximum(detections.kind, 0)
        yield radar.fields.kind, kind.astype(np.uint8)
    own = detections.noise_std
    std = np.full((count, 2), np.nan) if own is None else own
    if radar.fields.range_std:
        yield radar.fields.range_std, std[:, 0]
    if radar.fields.azimuth_std:
        degrees = radar.azimuth_in_degrees
        yield radar.fields.azimuth_std, np.degrees(std[:, 1]) if degrees else std[:, 1]
    for name, known in (
        (radar.fields.range_rate, detections.range_rate),
        (radar.fields.range_rate_std, detections.range_rate_std),
    ):
        if name:
            yield name, np.full(count, np.nan) if known is None else known


def azimuth(angle: FloatArray, radar: RadarParameters) -> FloatArray:
    """Convert azimuths, radians from the sensor's x axis, to the radar's convention."""
    converted = np.mod(np.pi / 2.0 - angle, FULL_TURN) if radar.compass else angle
    return np.degrees(converted) if radar.azimuth_in_degrees else converted


def level(detections: Detections, radar: RadarParameters) -> FloatArray:
    """Convert amplitudes to the radar's convention: the inverse of `select`.

    Raises
    ------
    ValueError
        If the detections have no amplitudes.
    """
    if detections.amplitude is None:
        raise ValueError("detections.amplitude: None given, the cloud needs amplitudes")
    if radar.amplitude_in_db:
        with np.errstate(divide="ignore"):  # an envelope of zero is -inf dB
            snr_db = 10.0 * np.log10(detections.amplitude**2 / 2.0)
        level: FloatArray = snr_db - radar.amplitude_offset_db
        return level
    # Without an offset the numbers are not scaled, so that they remain exact.
    scale = 10.0 ** (-radar.amplitude_offset_db / 20.0) if radar.amplitude_offset_db else 1.0
    return detections.amplitude * scale
