"""The radar that is supposed to stand beside a table of positions, which names no sensor.

The engine measures ranges and azimuths. Near a radar an error in x and y is normal in neither, and
a target that walks through the radar is lost; so it stands outside the area of the positions. There
a position's error is the same along both axes, because each detection has an azimuth error of its
own (`reports`), and clutter that is uniform in the area is nearly so in range and azimuth.

A radar that the user places is where its parameters say.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .tables import MOST_METRES, Columns, numbers

# Columns of positions, which replace ranges and azimuths.
POSITION = ("x", "y")
# Distance of the radar from the middle of the area, in half lengths of its longer side.
DISTANCE = 3.0
# Least half length of a side, metres: ranges are then well above `polar_geometry.MIN_RANGE`.
LEAST_HALF = 1.0
# The area is larger than that of the positions by this factor, for targets that come later.
MARGIN = 1.1
# Positions farther from the median than this many times the distance of MOST of them are no places
# of targets: fill values and errors.
FAR, MOST = 30.0, 0.9
# A radar with any of these parameters is a real one.
PLACED_BY = (
    *("position", "geodetic", "yaw_deg", "pose", "biases"),
    *("min_range", "fov_deg", "blind_sectors_deg", "clutter_max_range"),
)


class Area(NamedTuple):
    """A rectangle with sides along the axes of the world frame, metres."""

    x: float  # Of its middle
    y: float
    half_x: float  # Half the length of its sides
    half_y: float


def names(radars: Sequence[str], given: Mapping[str, Any], columns: Collection[str]) -> list[str]:
    """Return the radars that are supposed for a table with these columns.

    `given` has the user's parameters, by dotted name.
    """
    return [
        radar
        for radar in radars
        if {*POSITION} <= {*columns}
        and given.get(f"{radar}.fields.range", "range") not in columns
        and not any(f"{radar}.{name}" in given for name in PLACED_BY)
    ]


def area_of(columns: Columns) -> Area | None:
    """Return the area of positions, without those far from all others; None if there are none."""
    position = np.stack([numbers(columns, name) for name in POSITION], axis=1)
    possible = position[(np.abs(position) <= MOST_METRES).all(axis=1)]  # False for NaN
    if not len(possible):
        return None
    away = np.abs(possible - np.median(possible, axis=0)).max(axis=1)
    near = max(FAR * float(np.quantile(away, MOST, method="lower")), LEAST_HALF)
    low, high = (bound(possible[away <= near], axis=0) for bound in (np.min, np.max))
    middle, half = 0.5 * (low + high), np.maximum(MARGIN * 0.5 * (high - low), LEAST_HALF)
    # Values of two digits are read more easily in a parameter file.
    step = 10.0 ** (math.floor(math.log10(half.max())) - 1)
    return Area(*(step * np.rint(middle / step)).tolist(), *(step * np.ceil(half / step)).tolist())


def words(area: Area) -> str:
    """Return the words for the positions of an area, whose ranges and azimuths errors name."""
    return (
        f"x is from {area.x - area.half_x:.6g} to {area.x + area.half_x:.6g} m and y from "
        f"{area.y - area.half_y:.6g} to {area.y + area.half_y:.6g} m, and ranges and azimuths are "
        "those of a radar that is supposed beside them"
    )


def parameters(radar: str, area: Area, clutter_rate: Any) -> dict[str, Any]:
    """Return the parameters of the radar, by dotted name, that sees an area from the west.

    `clutter_rate` is the parameter for the area; a number is changed to the radar's, which counts
    clutter from range 0 on.
    """
    distance = DISTANCE * max(area.half_x, area.half_y)
    nearest = distance - area.half_x
    farthest = math.hypot(distance + area.half_x, area.half_y)
    side_deg = math.degrees(math.atan2(area.half_y, nearest))
    found = {
        "position": [area.x - distance, area.y],
        "min_range": nearest,
        "max_range": farthest,
        "clutter_max_range": farthest,
        "fov_deg": [-side_deg, side_deg],
    }
    if isinstance(clutter_rate, (int, float)):
        found["clutter_rate"] = clutter_rate * farthest / (farthest - nearest)
    return {f"{radar}.{name}": value for name, value in found.items()}
