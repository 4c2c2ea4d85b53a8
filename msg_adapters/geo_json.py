"""Tracks as GeoJSON, RFC 7946, and as ``foxglove_msgs/GeoJSON``, which Foxglove's map panel shows.

foxglove_msgs is not part of every ROS installation, so its class is passed in.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, TENTATIVE, UNKNOWN, Estimates

from . import geodetic, vertical
from .palette import class_colour
from .tracks import labelled

STATES = {TENTATIVE: "tentative", CONFIRMED: "confirmed", COASTING: "coasting"}
# Digits after the point: of degrees, a centimetre, and of metres.
DEGREE_DIGITS, METRE_DIGITS = 7, 1


def to_msg(
    estimates: Estimates,
    plane: Plane,
    class_names: Sequence[str],
    trails: Mapping[int, FloatArray],
    kind: Any,
) -> Any:
    """Return the message of one set of estimates; parameters but `kind` are those of `of_scan`."""
    return kind(geojson=text(of_scan(estimates, plane, class_names, trails)))


def of_scan(
    estimates: Estimates,
    plane: Plane,
    class_names: Sequence[str],
    trails: Mapping[int, FloatArray],
) -> dict[str, Any]:
    """Return a feature collection: a point for each labelled estimate, and a line where it was.

    Parameters
    ----------
    class_names : sequence of str
        By class id.
    trails : mapping of track number to array of shape (N, 3)
        Positions up to the present one: in the plane, and heights above its zero, metres. A line
        has heights if all are known, and not NaN.

    Notes
    -----
    ``name`` and ``style`` among the properties are what Foxglove shows. The name has the flight
    level and the code, or the address without one. ``code``, ``address`` and ``flight_level`` are
    there where they are known.
    """
    places = geodetic.of(estimates, plane)
    words = vertical.words(estimates, plane.origin[2])
    features = []
    for track, row in labelled(estimates):
        class_id = int(estimates.class_id[row])
        style = {"color": class_colour(class_id)}
        here = places.latitude[[row]], places.longitude[[row]], places.height[[row]]
        properties = {
            "name": f"{track} {words[row]}".rstrip(),
            "number": track,
            "class": class_names[class_id],
            "state": STATES[int(estimates.track_state[row])],
            "speed": rounded(places.speed[row], METRE_DIGITS),
            "course": rounded(places.course[row], METRE_DIGITS),
            "height": rounded(places.height[row], METRE_DIGITS),
            **identity(estimates, row),
            **level(places.height[row]),
            "style": style,
        }
        point = {"type": "Point", "coordinates": positions(*here)[0]}
        features.append(feature(point, properties))
        line = trails.get(track)
        if line is not None and len(line) > 1:
            north, east = plane.to_geodetic(line[:, 0], line[:, 1])
            # RFC 7946 has no position without a height among others with one.
            up = line[:, 2] + plane.origin[2]
            way = line_of(positions(north, east, up if np.isfinite(up).all() else up * np.nan))
            features.append(feature(way, {"name": f"{track}", "number": track, "style": style}))
    return collection(features)


def identity(estimates: Estimates, row: int) -> dict[str, str]:
    """Return the known ones of ``code``, octal digits, and ``address``, hexadecimal ones."""
    found = estimates.attributes
    if found is None:
        return {}
    code, address = int(found.code[row]), int(found.address[row])
    return {
        **({} if code == UNKNOWN else {"code": f"{code:04o}"}),
        **({} if address == UNKNOWN else {"address": f"{address:06X}"}),
    }


def level(height: float) -> dict[str, int]:
    """Return the property ``flight_level`` of a height of the earth's, metres, if it is known."""
    found = vertical.flight_level(height)
    return {} if found is None else {"flight_level": found}


def collection(features: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return a feature collection."""
    return {"type": "FeatureCollection", "features": list(features)}


def feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    """Return a feature."""
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def positions(latitude: FloatArray, longitude: FloatArray, height: FloatArray) -> list[list[float]]:
    """Return positions: longitude, latitude and, where it is known, height; in this order."""
    return [
        [
            round(east, DEGREE_DIGITS),
            round(north, DEGREE_DIGITS),
            *([] if math.isnan(up) else [round(up, METRE_DIGITS)]),
        ]
        for north, east, up in zip(
            latitude.tolist(), longitude.tolist(), height.tolist(), strict=True
        )
    ]


def line_of(way: Sequence[list[float]]) -> dict[str, Any]:
    """Return the line through positions, in parts where it crosses the antimeridian."""
    parts: list[list[list[float]]] = [[way[0]]]
    for before, after in itertools.pairwise(way):
        if abs(after[0] - before[0]) <= 180.0:
            parts[-1].append(after)
            continue
        border = math.copysign(180.0, before[0])
        # The way from the one side to the border, as a share of the way to the other side.
        share = (border - before[0]) / (after[0] + 2.0 * border - before[0])
        at = round(before[1] + share * (after[1] - before[1]), DEGREE_DIGITS)
        parts[-1].append([border, at])
        parts.append([[-border, at], after])
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}


def rounded(value: float, digits: int) -> float | None:
    """Return a number with so many digits after the point; None, null in JSON, for NaN."""
    return None if math.isnan(value) else round(float(value), digits)


def text(document: dict[str, Any]) -> str:
    """Return a document as compact JSON."""
    return json.dumps(document, separators=(",", ":"), allow_nan=False)
