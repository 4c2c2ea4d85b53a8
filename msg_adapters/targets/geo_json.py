"""Tracks as GeoJSON (RFC 7946), such as Foxglove's map panel shows."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import TRACK_STATES, Estimates, Reported
from phd_jdtc_ros.core.types.reports import ALARM

from . import geodetic, vertical
from .markers import class_colour
from .tracks import rows_by_track

# Decimal places of degrees (a centimetre) and of metres.
DEGREE_DIGITS, METRE_DIGITS = 7, 1


def of_scan(
    estimates: Estimates, plane: Plane, class_names: Sequence[str], trails: Mapping[int, FloatArray]
) -> dict[str, Any]:
    """Return a feature collection with a point per labelled estimate and a line of its trail.

    `trails` has, by track number, the positions up to the present one: x, y and height above the
    plane's zero, metres, shape (N, 3). A line has heights if none of them is NaN.

    Foxglove shows the properties ``name`` and ``style``. The name contains the flight level, or in
    space the height, and the code, or the address if the code is unknown. ``code``, ``address`` and
    ``flight_level`` are present if known. With receivers of self-reports the properties of
    `said_of` follow, and dark targets and doubtful sources have colours of their own.
    """
    places = geodetic.of(estimates, plane)
    words, names = vertical.words(estimates, plane.origin[2]), vertical.identities(estimates)
    features = []
    for track, row in rows_by_track(estimates):
        class_id = int(estimates.class_id[row])
        reports, colour, said = estimates.reports, class_colour(class_id), {}
        if reports is not None:
            colour = _colour_of(reports, row, colour)
            said = said_of(reports, row, estimates.stamp_ns)
        style = {"color": colour}
        here = places.latitude[[row]], places.longitude[[row]], places.height[[row]]
        identity = zip(("code", "address"), names[row], strict=True)
        properties = {
            "name": f"{track} {words[row]}".rstrip(),
            "number": track,
            "class": class_names[class_id],
            "state": TRACK_STATES[int(estimates.track_state[row])],
            "speed": round_number(places.speed[row], METRE_DIGITS),
            "course": round_number(places.course[row], METRE_DIGITS),
            "height": round_number(places.height[row], METRE_DIGITS),
            **{key: text for key, text in identity if text},
            **({} if estimates.space.vertical else level(places.height[row])),
            **said,
            "style": style,
        }
        point = {"type": "Point", "coordinates": positions(*here)[0]}
        features.append(feature(point, properties))
        line = trails.get(track)
        if line is not None and len(line) > 1:
            north, east = plane.to_geodetic(line[:, 0], line[:, 1])
            # In RFC 7946 either all positions of a line have a height, or none.
            up = line[:, 2] + plane.origin[2]
            way = line_of(positions(north, east, up if np.isfinite(up).all() else up * np.nan))
            features.append(feature(way, {"name": f"{track}", "number": track, "style": style}))
    return collection(features)


def said_of(reports: Reported, row: int, stamp_ns: int) -> dict[str, Any]:
    """Return what is said of one estimate as properties; unknown numbers are None."""
    value = {"owned": reports.owned, "dark": reports.dark, "silent": reports.silent}
    value["doubtful"] = reports.doubtful
    known = {name: float(column[row]) for name, column in value.items()}
    return {
        "source": reports.source_text(row),
        **{name: None if np.isnan(each) else round(each, 4) for name, each in known.items()},
        "alone": bool(reports.alone[row]),
        "reason": reports.reason_text(row, stamp_ns),
    }


def _colour_of(reports: Reported, row: int, usual: str) -> str:
    """Return the colour of an estimate: that of dark targets or doubtful sources, or the usual."""
    if reports.dark[row] > ALARM:
        return "#000000"
    return "#ff00ff" if reports.doubtful[row] > ALARM else usual


def level(height: float) -> dict[str, int]:
    """Return ``flight_level`` of a height above the earth's zero, metres; empty if unknown."""
    found = vertical.flight_level(height)
    return {} if found is None else {"flight_level": found}


def collection(features: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return features as a FeatureCollection of RFC 7946."""
    return {"type": "FeatureCollection", "features": list(features)}


def feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    """Return a geometry and its properties as a Feature of RFC 7946."""
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def positions(latitude: FloatArray, longitude: FloatArray, height: FloatArray) -> list[list[float]]:
    """Return positions as longitude, latitude and, if known, height, in this order."""
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
    """Return the line through positions, split where it crosses the antimeridian."""
    parts: list[list[list[float]]] = [[way[0]]]
    for before, after in itertools.pairwise(way):
        if abs(after[0] - before[0]) <= 180.0:
            parts[-1].append(after)
            continue
        border = math.copysign(180.0, before[0])
        # Share of the segment that lies before the antimeridian.
        share = (border - before[0]) / (after[0] + 2.0 * border - before[0])
        at = round(before[1] + share * (after[1] - before[1]), DEGREE_DIGITS)
        parts[-1].append([border, at])
        parts.append([[-border, at], after])
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}


def round_number(value: float, digits: int) -> float | None:
    """Return a number with the given decimal places; None, null in JSON, for NaN."""
    return None if math.isnan(value) else round(float(value), digits)


def text(document: dict[str, Any]) -> str:
    """Return a document as compact JSON."""
    return json.dumps(document, separators=(",", ":"), allow_nan=False)
