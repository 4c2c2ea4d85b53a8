"""Tracks as deltas of Signal K 1, one line of JSON each."""

from __future__ import annotations

import json
import math
import uuid
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import Estimates

from ..encoding import stamps
from ..targets import geodetic, vertical
from ..targets.tracks import rows_by_track
from . import cot


def deltas(
    found: Estimates,
    plane: Plane,
    types: Sequence[str],
    run: uuid.UUID,
    names: Mapping[int, str] = MappingProxyType({}),
) -> list[bytes]:
    """Encode each labelled estimate as a delta, by ascending track number.

    Targets in the air by their type in Cursor on Target are aircraft, all others vessels; the
    standard knows no further kinds of targets.
    """
    places, words = geodetic.of(found, plane), vertical.words(found, plane.origin[2])
    identities, time = vertical.identities(found), stamps.to_iso(found.stamp_ns)
    sent = []
    for track, row in rows_by_track(found):
        kind = cot.type_of(types, int(found.class_id[row]), any(identities[row]))
        group = "aircraft" if kind[4] == "A" else "vessels"
        position = {
            "latitude": round(float(places.latitude[row]), 7),
            "longitude": round(float(places.longitude[row]), 7),
        }
        if math.isfinite(places.height[row]):
            position["altitude"] = round(float(places.height[row]), 1)
        values: dict[str, Any] = {
            "": {"name": names.get(track) or f"{track} {words[row]}".rstrip()},
            "navigation.position": position,
            "navigation.speedOverGround": round(float(places.speed[row]), 2),
        }
        if math.isfinite(places.course[row]):
            values["navigation.courseOverGroundTrue"] = math.radians(places.course[row])
        # The standard wants identifiers that look random.
        own = uuid.UUID(bytes=uuid.uuid5(run, str(track)).bytes, version=4)
        update = {
            "source": {"label": "phd_jdtc_ros"},
            "timestamp": time,
            "values": [{"path": path, "value": value} for path, value in values.items()],
        }
        delta = {"context": f"{group}.urn:mrn:signalk:uuid:{own}", "updates": [update]}
        sent.append(json.dumps(delta, separators=(",", ":"), allow_nan=False).encode() + b"\r\n")
    return sent
