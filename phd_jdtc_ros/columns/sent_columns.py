"""Detections as the columns that a radar reports; independent of ROS."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.configuration.parameters.position import PositionParameters
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.parameters.sensor import Fields
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.intake.sectors import sector_of
from phd_jdtc_ros.core.types import FULL_TURN, Detections

from . import ground_ranges, identities

# This is defined here, because `stamps` imports ROS.
NS_PER_S = 1_000_000_000
Sent: TypeAlias = "RadarParameters | PositionParameters"


def names_of(fields: Fields) -> dict[str, str]:
    """Return a sensor's names of its columns by quantity."""
    return {quantity: name for quantity, name in vars(fields).items() if name}


def of(
    detections: Detections, stamp_ns: int, radar: RadarParameters
) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a radar's detections, under the radar's names.

    There is always an elevation, which is 0 in the plane; `stamp_ns` is the report's.

    Raise `ValueError` if the radar has amplitudes or sectors and the detections do not.
    """
    elevation = np.zeros(len(detections))
    if radar.height_prior is None:
        slant, measured = ground_ranges.measure(detections, radar)
    else:
        slant, measured, elevation = detections.measurement.T
    columns = {radar.fields.range: slant, radar.fields.azimuth: azimuth(measured, radar)}
    # The radar may use the default name of elevations for another field.
    zero, unit = radar.units.elevation_scale
    columns.setdefault(radar.fields.elevation or "elevation", (elevation - zero) / unit)
    for quantity, name in names_of(radar.fields).items():
        if quantity in _COLUMNS:
            columns[name] = _COLUMNS[quantity](detections, stamp_ns, radar)
    return columns


def _sector(detections: Detections, _: int, radar: RadarParameters) -> npt.NDArray[Any]:
    if detections.coverage is None or not radar.sectors:
        raise ValueError("detections.coverage: None given, the cloud needs a sector")
    sector = sector_of(detections.coverage, radar.sectors, radar.units.compass)
    return np.full(len(detections), sector, dtype=np.uint32)


def _azimuth_std(detections: Detections, _: int, radar: RadarParameters) -> FloatArray:
    std = _noise_std(detections)[:, 1]
    return np.degrees(std) if radar.units.in_degrees else std


def _noise_std(detections: Detections) -> FloatArray:
    own = detections.noise_std
    return np.full(detections.measurement.shape, np.nan) if own is None else own


def fill(column: npt.NDArray[Any] | None, count: int, unknown: float) -> npt.NDArray[Any]:
    """Return an optional column of `count` detections, filled with `unknown` if it is None."""
    return np.full(count, unknown) if column is None else column


# The optional columns by quantity, of detections, the report's stamp and a sensor of any kind.
COMMON: Mapping[str, Callable[[Detections, int, Sent], npt.NDArray[Any]]] = {
    "amplitude": lambda own, _, sensor: level(own, sensor),
    "time": lambda own, stamp_ns, sensor: sent_time(
        fill(own.time_s, len(own), 0.0), stamp_ns, sensor
    ),
    "code": lambda own, _, __: identities.encode(own.code, len(own)),
    "address": lambda own, _, __: identities.encode(own.address, len(own)),
    "detection_type": lambda own, _, __: np.maximum(
        fill(own.detection_type, len(own), 0.0), 0
    ).astype(np.uint8),
}
# A radar has the common columns and these.
_COLUMNS: Mapping[str, Callable[[Detections, int, RadarParameters], npt.NDArray[Any]]] = {
    **COMMON,
    "sector": _sector,
    "height": lambda own, _, radar: ground_ranges.message_height(own, radar),
    "range_std": lambda own, _, __: _noise_std(own)[:, 0],
    "azimuth_std": _azimuth_std,
    "elevation_std": lambda own, _, radar: (
        _noise_std(own)[:, 2] / abs(radar.units.elevation_scale[1])
    ),
    "range_rate": lambda own, _, __: fill(own.range_rate, len(own), np.nan),
    "range_rate_std": lambda own, _, __: fill(own.range_rate_std, len(own), np.nan),
}


def relative_time(sent: FloatArray, stamp_ns: int, radar: Sent) -> FloatArray:
    """Convert times from the radar's convention to seconds from the stamp.

    Times since the epoch keep the resolution of doubles, 0.24 us today.
    """
    if not radar.units.since_epoch:
        return sent * radar.units.time_s
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    # Whole seconds are exact in every unit, as is the difference of two close doubles.
    since_second = (sent - float(seconds) * _per_second(radar)) * radar.units.time_s
    return since_second - nanoseconds * 1e-9


def sent_time(time_s: FloatArray, stamp_ns: int, radar: Sent) -> FloatArray:
    """Convert seconds from the stamp to the radar's convention: the inverse of `relative_time`."""
    per_second = _per_second(radar)
    if not radar.units.since_epoch:
        return time_s * per_second
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    return (time_s + nanoseconds * 1e-9) * per_second + float(seconds) * per_second


def _per_second(radar: Sent) -> float:
    return float(round(1.0 / radar.units.time_s))


def azimuth(angle: FloatArray, radar: RadarParameters) -> FloatArray:
    """Convert azimuths, radians from the sensor's x axis, to the radar's convention."""
    converted = np.mod(np.pi / 2.0 - angle, FULL_TURN) if radar.units.compass else angle
    return np.degrees(converted) if radar.units.in_degrees else converted


def level(detections: Detections, radar: Sent) -> FloatArray:
    """Convert amplitudes to the sensor's convention: the inverse of `select`.

    Raise `ValueError` if the detections have no amplitudes.
    """
    if detections.amplitude is None:
        raise ValueError("detections.amplitude: None given, the cloud needs amplitudes")
    if radar.units.in_db:
        with np.errstate(divide="ignore"):  # An envelope of zero is -inf dB
            snr_db = 10.0 * np.log10(detections.amplitude**2 / 2.0)
        level: FloatArray = snr_db - radar.amplitude_offset_db
        return level
    # Without an offset the numbers are not scaled, so that they remain exact.
    scale = 10.0 ** (-radar.amplitude_offset_db / 20.0) if radar.amplitude_offset_db else 1.0
    return detections.amplitude * scale
