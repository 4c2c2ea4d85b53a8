"""Tracks as messages of SAPIENT, BSI Flex 335 version 2.0.

A connection begins with a registration; then come a status report and a detection report for each
track with every set of estimates. A message is preceded by its length, four bytes, the lowest
first.
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Sequence
from typing import Any

from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.tracks.manual import Manual
from phd_jdtc_ros.core.types import Estimates

from ..encoding import stamps
from ..targets import geodetic, vertical
from ..targets.tracks import rows_by_track


def _ulid(time_ms: int, unique: uuid.UUID) -> str:
    # The digits of a ULID, which has 48 bits of a time, milliseconds, and 80 bits that are unique.
    digits = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
    number = time_ms << 80 | unique.int & (1 << 80) - 1
    return "".join(digits[number >> shift & 31] for shift in range(125, -5, -5))


def _message(stamp_ns: int, run: uuid.UUID, **content: Any) -> bytes:
    """Return a message of the node of a tracker's run, with its length."""
    from sapient_msg.bsi_flex_335_v2_0.sapient_message_pb2 import SapientMessage

    message = SapientMessage(node_id=str(run), **content)
    message.timestamp.seconds, message.timestamp.nanos = divmod(stamp_ns, stamps.NS_PER_S)
    data: bytes = message.SerializeToString()
    return len(data).to_bytes(4, "little") + data


def registration(
    stamp_ns: int, run: uuid.UUID, class_names: Sequence[str], interval_s: float
) -> bytes:
    """Return the message with which a connection begins; status reports come every `interval_s`."""
    version = "BSI Flex 335 v2.0"
    seconds = {"units": "TIME_UNITS_SECONDS"}
    place = {
        "location_units": "LOCATION_COORDINATE_SYSTEM_LAT_LNG_DEG_M",
        "location_datum": "LOCATION_DATUM_WGS84_E",
    }
    classes = {
        "confidence_definition": "CONFIDENCE_DEFINITION_MULTI_CLASS",
        "class_definition": [{"type": name} for name in class_names],
    }
    velocity = {
        "enu_velocity_units": {"east_north_rate_units": "SPEED_UNITS_MS"},
        "location_datum": "LOCATION_DATUM_WGS84_E",
    }
    region = {"region_type": ["REGION_TYPE_AREA_OF_INTEREST"], "region_area": [place]}
    mode = {
        "mode_name": "tracking",
        "mode_type": "MODE_TYPE_PERMANENT",
        "settle_time": {**seconds, "value": 0.0},
        "tracking_type": "TRACKING_TYPE_TRACK",
        "detection_definition": [
            {
                "location_type": place,
                "velocity_type": velocity,
                "detection_class_definition": [classes],
            }
        ],
        "task": {"concurrent_tasks": 0, "region_definition": region},
    }
    content = {
        "node_definition": [{"node_type": "NODE_TYPE_FUSION_NODE"}],
        "icd_version": version,
        "name": "phd_jdtc_ros",
        "capabilities": [{"category": "tracker", "type": "classification"}],
        "status_definition": {"status_interval": {**seconds, "value": interval_s}},
        "mode_definition": [mode],
        "config_data": [{"manufacturer": "phd_jdtc_ros", "model": "tracker"}],
    }
    return _message(stamp_ns, run, registration=content)


def reports(
    found: Estimates, plane: Plane, class_names: Sequence[str], run: uuid.UUID, manual: Manual
) -> list[bytes]:
    """Return a status report, and a detection report for each labelled estimate."""
    stamp_ns, time_ms = found.stamp_ns, found.stamp_ns // 10**6
    status = {
        "report_id": _ulid(time_ms, uuid.uuid5(run, f"status {stamp_ns}")),
        "system": "SYSTEM_OK",
        "info": "INFO_UNCHANGED",
        "mode": "tracking",
    }
    sent = [_message(stamp_ns, run, status_report=status)]
    places, up, identities = (
        geodetic.of(found, plane),
        vertical.of(found),
        vertical.identities(found),
    )
    for track, row in rows_by_track(found):
        report: dict[str, Any] = {
            "report_id": _ulid(time_ms, uuid.uuid5(run, f"{track} {stamp_ns}")),
            # An object keeps its identifier, so that its time is that of nothing.
            "object_id": _ulid(0, uuid.uuid5(run, str(track))),
            "detection_confidence": min(float(found.existence[row]), 1.0),
            "classification": [
                {"type": name, "confidence": float(share)}
                for name, share in zip(class_names, found.class_probability[row], strict=True)
            ],
            "id": manual.names.get(track) or next(filter(None, identities[row]), str(track)),
        }
        # Errors are along east and north; in degrees, as the coordinates are.
        variance = found.position_covariance[row].diagonal()
        latitude = float(places.latitude[row])
        metres = math.radians(6_371_000.0)
        shrunk = max(math.cos(math.radians(latitude)), 1e-6)
        location = {
            "x": float(places.longitude[row]),
            "y": latitude,
            "x_error": math.sqrt(variance[0]) / (metres * shrunk),
            "y_error": math.sqrt(variance[1]) / metres,
            "coordinate_system": "LOCATION_COORDINATE_SYSTEM_LAT_LNG_DEG_M",
            "datum": "LOCATION_DATUM_WGS84_E",
        }
        if up.known[row]:
            location["z"] = float(places.height[row])
            location["z_error"] = math.sqrt(up.covariance[row, 0, 0])
        if math.isfinite(places.course[row]):
            course, speed = math.radians(places.course[row]), float(places.speed[row])
            report["enu_velocity"] = {
                "east_rate": speed * math.sin(course),
                "north_rate": speed * math.cos(course),
            }
        sent.append(_message(stamp_ns, run, detection_report={**report, "location": location}))
    return sent
