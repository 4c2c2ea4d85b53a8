"""Zones from GeoJSON, with every fault by its name."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.models.zones import KINDS, Zone
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.quoting import short

from .schema import ConfigError

# Largest size of a file, and number of its corners: a coast of this many is computed in 0.2 s.
MOST_BYTES, MOST_CORNERS = 2**24, 100_000


def read(path: str, plane: Plane | None) -> tuple[Zone, ...]:
    """Return the zones of a file, or none without one; raise `ConfigError` with every fault."""
    if not path:
        return ()
    if plane is None:
        raise ConfigError(f"zones: {path} given, needs world_origin")
    if find_spec("shapely") is None:
        raise ConfigError(f"zones: {path} given, needs shapely (pip install shapely)")
    try:
        file = Path(os.path.expanduser(path))
        if file.stat().st_size > MOST_BYTES:
            raise ConfigError(f"zones: {path} has more than {MOST_BYTES >> 20} MB")
        document = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"zones: {path} given, {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"zones: {path} is no JSON: {short(str(error))}") from error
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list):
        raise ConfigError(f"zones: {path} is no FeatureCollection of GeoJSON")
    found, faults = [], []
    for index, feature in enumerate(features):
        try:
            found.append(_zone(feature, index, plane))
        except (ValueError, TypeError, LookupError, AttributeError) as error:
            name = _name(feature, index)
            reason = str(error) if type(error) is ValueError else "is no polygon of GeoJSON"
            faults.append(f"zones: {path}: {short(name)}: {short(reason)}")
    if sum(len(zone.sides) for zone in found) > MOST_CORNERS:
        faults.append(f"zones: {path} has more than {MOST_CORNERS} corners")
    if faults:
        raise ConfigError(*faults)
    return tuple(found)


def _name(feature: Any, index: int) -> str:
    given = feature.get("properties") if isinstance(feature, dict) else None
    name = given.get("name") if isinstance(given, dict) else None
    return name if isinstance(name, str) and name else f"zone {index + 1}"


def _zone(feature: Any, index: int, plane: Plane) -> Zone:
    """Return a feature as a zone; raise `ValueError` with its fault, or another error."""
    from shapely import Polygon, is_valid, is_valid_reason  # Needed with zones only

    properties, geometry = feature["properties"] or {}, feature["geometry"]
    kind = properties.get("kind", KINDS[0])
    if kind not in KINDS:
        raise ValueError(f"kind {kind!r} given, must be one of {', '.join(KINDS)}")
    if geometry["type"] not in ("Polygon", "MultiPolygon"):
        raise ValueError(f"{geometry['type']} given, must be a Polygon or a MultiPolygon")
    several = geometry["type"] == "MultiPolygon"
    sides = []
    for polygon in geometry["coordinates"] if several else [geometry["coordinates"]]:
        rings = [_ring(ring, plane) for ring in polygon]
        # In the plane there are neither poles nor a date line.
        shape = Polygon(rings[0], rings[1:])
        if not is_valid(shape) or not shape.area > 0.0:
            raise ValueError(f"{_where(is_valid_reason(shape), plane)}, must not cross itself")
        sides += [np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings]
    return Zone(_name(feature, index), kind, np.concatenate(sides))


def _where(reason: str, plane: Plane) -> str:
    """Return shapely's reason with latitude and longitude in the place of x and y."""
    text, bracket, place = reason.partition("[")
    if not bracket:
        return "has no area"
    latitude, longitude = plane.to_geodetic(*map(float, place.rstrip("]").split()))
    return f"{text.lower()} at latitude {float(latitude):.5f}, longitude {float(longitude):.5f}"


def _ring(given: Sequence[Sequence[float]], plane: Plane) -> FloatArray:
    """Return a closed ring in the plane, metres, (S + 1, 2), without equal corners in a row."""
    # Places beyond this distance of the origin are too distorted, metres.
    farthest = 2e6
    corners = np.array([[float(corner[0]), float(corner[1])] for corner in given])
    if len(corners) < 4 or not np.isfinite(corners).all():
        raise ValueError(
            f"a ring of {len(corners)} corners given, must have at least 4 finite ones"
        )
    if (np.abs(corners) > (540.0, 90.0)).any():
        raise ValueError("longitude and latitude given, must be within 540 and 90 degrees")
    if (corners[0] != corners[-1]).any():
        raise ValueError("a ring given that is not closed")
    longitude, latitude = np.array(list(_parts(corners))).T
    x, y = plane.to_plane(latitude, longitude)
    ring = np.stack([x, y], axis=1)
    if not np.isfinite(ring).all() or np.hypot(x, y).max() > farthest:
        raise ValueError(f"a corner given farther than {farthest / 1e3:.0f} km from world_origin")
    return _without_spurs(ring)


def _without_spurs(ring: FloatArray) -> FloatArray:
    """Return a closed ring without repeated corners, and without ways to a place and back.

    A polygon around a pole goes up a meridian to the pole and down again, because the edge of a map
    of latitudes and longitudes is there.
    """
    kept: list[FloatArray] = []
    for corner in ring:
        if kept and _same(corner, kept[-1]):
            continue
        if len(kept) > 1 and _same(corner, kept[-2]):
            kept.pop()
        else:
            kept.append(corner)
    while len(kept) > 4 and _same(kept[1], kept[-2]):
        kept = kept[1:-1]
    if len(kept) < 4:
        raise ValueError("a ring given that has no area")
    return np.array([*kept[:-1], kept[0]])


def _same(one: FloatArray, other: FloatArray) -> bool:
    # Places within this distance are the same one, metres: PROJ keeps longitudes off 180 degrees.
    return bool(np.abs(one - other).max() < 0.01)


def _parts(corners: FloatArray) -> Iterator[tuple[float, float]]:
    """Yield the longitudes and latitudes of corners, and of places between them.

    A side goes the shorter way around the earth, so that one may cross the date line.
    """
    for (longitude, latitude), (next_longitude, next_latitude) in pairwise(corners):
        east = (next_longitude - longitude + 180.0) % 360.0 - 180.0
        # Longest part of a side, degrees: sides are straight in latitude and longitude, and not in
        # the plane, from which a part of this length differs by at most 20 m up to 80 degrees of
        # latitude.
        count = max(1, math.ceil(max(abs(east), abs(next_latitude - latitude)) / 0.1))
        for share in np.arange(count) / count:
            yield longitude + share * east, latitude + share * (next_latitude - latitude)
    yield corners[-1][0], corners[-1][1]
