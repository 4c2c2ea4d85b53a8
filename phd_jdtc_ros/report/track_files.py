"""The tracks of a run as CSV, and as GeoJSON if their position on the earth is known."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from msg_adapters.targets import geo_json, geodetic, vertical
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import TRACK_STATES, Estimates

HEADER = (
    *("time", "number", "x", "y", "vx", "vy", "latitude", "longitude", "height", "speed", "course"),
    *("class", "state", "code", "address", "flight_level", "run"),
)
# Decimal places of the numbers, from `x` to `course`.
DIGITS = (2, 2, 2, 2, geo_json.DEGREE_DIGITS, geo_json.DEGREE_DIGITS, 1, 2, 2)


class Fix(NamedTuple):
    """One track at one time."""

    stamp_ns: int
    number: int
    x: float  # World frame, metres
    y: float
    vx: float  # World frame, metres per second
    vy: float
    latitude: float  # Degrees; NaN if the position of the world frame on the earth is unknown
    longitude: float
    height: float  # Metres; NaN if unknown
    speed: float  # Metres per second; NaN if unknown
    course: float  # Degrees from true north; NaN if unknown
    class_name: str
    state: str
    code: str  # Four octal digits; empty if unknown
    address: str  # Six hexadecimal digits; empty if unknown
    flight_level: str  # Hundreds of feet of the standard atmosphere; empty if unknown
    run: int  # Number of the run, from 1: a jump of the stamps begins another one
    # What self-reports say of it; None without receivers of them.
    said: Mapping[str, Any] | None = None


def fixes(
    runs: Sequence[Sequence[Estimates]], plane: Plane | None, class_names: Sequence[str]
) -> Iterator[Fix]:
    """Yield every labelled estimate of runs, each given by stamp, ordered by time and number."""
    for run, found in ((run, each) for run, part in enumerate(runs, 1) for each in part):
        places = _nowhere(found) if plane is None else geodetic.of(found, plane)
        names = vertical.identities(found)
        on_earth = (places.latitude, places.longitude, places.height, places.speed, places.course)
        numbers = np.column_stack((found.position, found.velocity, *on_earth)).tolist()
        for row in np.argsort(found.track_id, kind="stable").tolist():
            if not found.track_id[row]:
                continue
            class_name = class_names[int(found.class_id[row])]
            state = TRACK_STATES[int(found.track_state[row])]
            level = str(geo_json.level(places.height[row]).get("flight_level", ""))
            if found.space.vertical:
                level = ""  # The pressure is not known in space
            words, number = (class_name, state, *names[row], level), int(found.track_id[row])
            reports = found.reports
            said = None if reports is None else geo_json.said_of(reports, row, found.stamp_ns)
            yield Fix._make((found.stamp_ns, number, *numbers[row], *words, run, said))


def _nowhere(found: Estimates) -> geodetic.Places:
    """Return places with heights and speeds only: the frame's position on the earth is unknown."""
    unknown = np.full(len(found), np.nan)
    height, speed = found.known_attributes.height[:, 0], np.hypot(*found.velocity.T)
    return geodetic.Places(unknown, unknown, height, speed, unknown, convergence=unknown)


def to_csv(rows: Sequence[Fix]) -> str:
    """Return fixes as comma-separated values with a header; times are stamps in seconds."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    said = next((tuple(row.said) for row in rows if row.said is not None), ())
    writer.writerow((*HEADER, *said))
    for row in rows:
        told = row.said or {}
        writer.writerow(
            [
                _seconds(row.stamp_ns),
                row.number,
                *(_number(value, digits) for value, digits in zip(row[2:11], DIGITS, strict=True)),
                *row[11:17],
                *(told.get(name) for name in said),
            ]
        )
    return out.getvalue()


def to_geojson(rows: Sequence[Fix]) -> str:
    """Return fixes as GeoJSON: a line for each track of a run, or a point for one of one fix.

    Properties of a track are ``number``, ``run``, ``name``, the most frequent ``class``, ``code``
    and ``address`` if known, the last ``flight_level``, and ``times``, seconds, one per fix. The
    two positions added where a track crosses the antimeridian have no time.
    """
    tracks: dict[tuple[int, int], list[Fix]] = {}
    for row in rows:
        tracks.setdefault((row.number, row.run), []).append(row)
    return geo_json.text(geo_json.collection([_feature(tracks[key]) for key in sorted(tracks)]))


def _feature(rows: Sequence[Fix]) -> dict[str, Any]:
    latitude, longitude, height = (
        np.array([getattr(row, name) for row in rows])
        for name in ("latitude", "longitude", "height")
    )
    # RFC 7946 requires heights in all positions of a geometry or in none.
    if np.isnan(height).any():
        height = np.full(len(rows), np.nan)
    way = geo_json.positions(latitude, longitude, height)
    geometry = geo_json.line_of(way) if len(way) > 1 else {"type": "Point", "coordinates": way[0]}
    properties = {
        "number": rows[0].number,
        "run": rows[0].run,
        "name": f"{rows[0].number}",
        "class": _usual(row.class_name for row in rows),
        **(rows[-1].said or {}),
        "times": [row.stamp_ns / 1e9 for row in rows],
    }
    for name in ("code", "address"):
        known = [getattr(row, name) for row in rows if getattr(row, name)]
        if known:
            properties[name] = _usual(known)
    levels = [row.flight_level for row in rows if row.flight_level]
    if levels:
        properties["flight_level"] = int(levels[-1])
    return geo_json.feature(geometry, properties)


def _usual(values: Any) -> str:
    """Return the most frequent value, the first in case of a tie."""
    return str(Counter(values).most_common(1)[0][0])


def _number(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"


def _seconds(stamp_ns: int) -> str:
    return f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}"
