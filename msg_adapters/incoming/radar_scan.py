"""Conversion of ``radar_msgs/RadarScan`` to and from `Detections`.

radar_msgs is optional, and this module does not import it. A live tracker needs its message class,
but recorded bytes are read and written without it.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from phd_jdtc_ros.columns import ground_ranges, sent_columns
from phd_jdtc_ros.columns.selection import Report, select
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.parameters.sensor import Units
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Detections

from ..encoding import RejectedMessageError, cdr, stamps
from ..encoding.point_cloud import MAX_POINTS
from .detections import require_frame

TYPE_NAME = "radar_msgs/msg/RadarScan"
TYPE_HASH = "RIHS01_9d270e9c9d9e2509e93e7c688fd8a813d75e43a6a37ef982e63e24e80e535cdc"
_SEPARATOR = "=" * 80
# Definition as stored in bags, followed by the definitions of all contained types.
DEFINITION = f"""\
std_msgs/Header header
radar_msgs/RadarReturn[] returns
{_SEPARATOR}
MSG: radar_msgs/RadarReturn
float32 range
float32 azimuth
float32 elevation
float32 doppler_velocity
float32 amplitude
{_SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
# Fields of a RadarReturn: range, azimuth, elevation, doppler_velocity, amplitude, all float32.
RETURN_FIELDS = 5


def from_msg(scan: Any, radar: RadarParameters) -> Report:
    """Return the detections of a scan.

    This message has a fixed convention, in contrast to a point cloud: azimuths are
    counter-clockwise from the sensor's x axis, amplitudes are in dB, and there is an elevation (0
    for a planar radar). The radar's `amplitude_offset_db` converts amplitudes to SNRs. Amplitudes
    are ignored without a `fields.amplitude`, and Doppler velocities (m/s, positive for a receding
    target) without a `fields.range_rate`.

    Raise `RejectedMessageError`: ``frame`` if the scan is in another frame than the radar's;
    ``oversize`` above `point_cloud.MAX_POINTS` returns; ``schema`` if the stamp is invalid, see
    `stamps.of_input`.
    """
    _require_size(len(scan.returns))
    rows = [
        (r.range, r.azimuth, r.elevation, r.doppler_velocity, r.amplitude) for r in scan.returns
    ]
    returns = np.array(rows, dtype=np.float64).reshape(-1, RETURN_FIELDS)
    return _report(scan.header, returns, radar)


def from_cdr(data: bytes, radar: RadarParameters) -> Report:
    """Decode the detections of a serialised scan; parameters and errors as in `from_msg`.

    Raise `RejectedMessageError`: ``schema`` also if the bytes are not a scan.
    """
    try:
        order = "<" if data[1] & 1 else ">"
        sec, nanosec, length = struct.unpack_from(f"{order}iII", data, 4)
        frame = data[16 : 16 + length].rstrip(b"\0").decode()
        # Alignment is counted from the end of the encapsulation header of four bytes.
        start = 16 + length + -(12 + length) % 4
        (count,) = struct.unpack_from(f"{order}I", data, start)
        _require_size(count)
        values = np.frombuffer(data, f"{order}f4", count * RETURN_FIELDS, start + 4)
    except RejectedMessageError:
        raise
    except (struct.error, IndexError, ValueError) as error:
        raise RejectedMessageError("schema", f"not a {TYPE_NAME}: {error}") from error
    rows = values.reshape(count, RETURN_FIELDS).astype(np.float64)
    return _report(Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame), rows, radar)


def to_cdr(detections: Detections, stamp_ns: int, radar: RadarParameters) -> bytes:
    """Serialise a planar radar's detections as a scan.

    Elevations are 0, or for a radar with a site those of targets at the antenna's height. Doppler
    velocities are 0 without range rates, and amplitudes are 0 without a `fields.amplitude`.
    """
    returns = np.zeros((len(detections), RETURN_FIELDS), dtype="<f4")
    returns[:, :3] = ground_ranges.measure_at_antenna_height(detections, radar)
    if detections.range_rate is not None:
        returns[:, 3] = detections.range_rate
    if radar.fields.amplitude:
        returns[:, 4] = sent_columns.level(detections, _fixed_convention(radar))
    scan = cdr.Writer()
    scan.header(stamp_ns, radar.frame)
    scan.put("I", len(returns))
    return scan.message() + returns.tobytes()


def _fixed_convention(radar: RadarParameters) -> RadarParameters:
    """Return a radar's input with the units and conventions of the message."""
    return replace(radar, units=Units(amplitude="db"))


def _require_size(count: int) -> None:
    if count > MAX_POINTS:
        raise RejectedMessageError("oversize", f"{count} returns, at most {MAX_POINTS} are allowed")


def _report(header: Header, rows: FloatArray, radar: RadarParameters) -> Report:
    """Return the detections of rows of a return's fields, (M, 5)."""
    require_frame(header.frame_id, radar)
    columns = {"range": rows[:, 0], "azimuth": rows[:, 1], "elevation": rows[:, 2]}
    if radar.fields.amplitude:
        columns["amplitude"] = rows[:, 4]
    if radar.fields.range_rate:
        columns["range_rate"] = rows[:, 3]
    return select(stamps.of_input(header), _fixed_convention(radar), columns)
