"""Detections as the columns that a radar reports; independent of ROS."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.configuration.radar_input import RadarInput
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.intake.sectors import sector_of
from phd_jdtc_ros.core.types import FULL_TURN, Detections

from . import ground_ranges, identities, plot_times


def names_of(radar: RadarInput) -> dict[str, str]:
    """Return the radar's names of its columns, by their names in `Columns`."""
    names = {
        "distance": radar.range_field,
        "azimuth": radar.azimuth_field,
        "elevation": radar.elevation_field,
        "level": radar.amplitude_field,
        "time": radar.time_field,
        "sector": radar.sector_field,
        "height": radar.height_field,
        "code": radar.code_field,
        "address": radar.address_field,
        "kind": radar.kind_field,
        "range_std": radar.range_std_field,
        "azimuth_std": radar.azimuth_std_field,
        "range_rate": radar.range_rate_field,
        "range_rate_std": radar.range_rate_std_field,
    }
    return {what: name for what, name in names.items() if name}


def of(detections: Detections, stamp_ns: int, radar: RadarInput) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a planar radar's detections, under the radar's names.

    Parameters
    ----------
    stamp_ns : int
        Stamp of the report.
    radar : RadarInput
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
    columns = {radar.range_field: slant, radar.azimuth_field: azimuth(measured, radar)}
    # The radar may use the default name of elevations for another field.
    columns.setdefault(radar.elevation_field or "elevation", np.zeros(len(detections)))
    if radar.amplitude_field:
        columns[radar.amplitude_field] = level(detections, radar)
    columns.update(_particulars(detections, stamp_ns, radar))
    return columns


def _particulars(
    detections: Detections, stamp_ns: int, radar: RadarInput
) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the radar's optional columns besides range, azimuth and elevation."""
    count = len(detections)
    if radar.time_field:
        time_s = np.zeros(count) if detections.time_s is None else detections.time_s
        yield radar.time_field, plot_times.encode(time_s, stamp_ns, radar)
    if radar.sector_field:
        if detections.coverage is None or not radar.sectors:
            raise ValueError("detections.coverage: None given, the cloud needs a sector")
        sector = sector_of(detections.coverage, radar.sectors, radar.compass)
        yield radar.sector_field, np.full(count, sector, dtype=np.uint32)
    if radar.height_field:
        yield radar.height_field, ground_ranges.message_height(detections, radar)
    for name, identity in (
        (radar.code_field, detections.code),
        (radar.address_field, detections.address),
    ):
        if name:
            yield name, identities.encode(identity, count)
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


def azimuth(angle: FloatArray, radar: RadarInput) -> FloatArray:
    """Convert azimuths, radians from the sensor's x axis, to the radar's convention."""
    converted = np.mod(np.pi / 2.0 - angle, FULL_TURN) if radar.compass else angle
    return np.degrees(converted) if radar.azimuth_in_degrees else converted


def level(detections: Detections, radar: RadarInput) -> FloatArray:
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
