"""The area that a sensor of positions covers, found from the places of its detections.

It is a rectangle with sides along the axes, or a polygon around the convex hull of the places if
these are clearly more likely as uniform in it: a lidar that reaches equally far in all directions
detects nothing in the corners of a rectangle, and a camera sees a sector.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from phd_jdtc_ros.configuration.parameters.place_forms import AREA
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.position import Area

# Least half of the length and of the width of the area, metres.
LEAST_HALF = 1.0
# Places farther from the median than this many times the distance of MOST of them are errors.
FAR, MOST = 30.0, 0.9
# Places in the same cell, with sides of this share of the extent, count once: successive detections
# of a target are near each other, and those of one that rests are at one place.
CELL = 0.02
# A polygon is at least this share as wide as long: a street is not all that a sensor sees.
THIN = 0.1
# Most places that are corners of the hull, as a share, where it shows the area.
FEW = 0.1
# Most corners of a polygon: around a circle, 16 are off by 2 % of its radius at most.
MOST_CORNERS = 16
# A configured area is kept if it contains what was found but for this share of its half length.
EDGE = 0.1


def area_of(place: FloatArray) -> tuple[float, ...]:
    """Return the parameter `area` that contains places, (N, 2), from at least one.

    Fill values and errors, far from all other places, are left out.

    Notes
    -----
    The marginal likelihood of n places with uniform density is proportional to size^-n n^-p with p
    parameters, two for each corner of a polygon and four of a rectangle: an edge is known to 1 / n.
    Of n places v are outermost, so that a further one is outside with a probability of about v / n,
    and the rectangle is larger than that of the places by (n + 1) / (n + 1 - v). A polygon is not,
    and needs so many that few are outside: where a sensor does not see, the tracks of others end by
    its supposed misses.

    References
    ----------
    Efron, "The convex hull of a random set of points", Biometrika 52, 1965; Baldin and Reiss,
    "Unbiased estimation of the volume of a convex body", Stochastic Processes and their
    Applications 126(12), 2016.
    """
    away = np.abs(place - np.median(place, axis=0)).max(axis=1)
    near = place[away <= max(FAR * float(np.quantile(away, MOST, method="lower")), LEAST_HALF)]
    low, high = near.min(axis=0), near.max(axis=0)
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), LEAST_HALF)
    widest = float(half.max())
    count = len(np.unique(np.floor((near - low) / (2.0 * CELL * widest)), axis=0))

    def cost(size: float, parameters: int) -> float:
        return count * math.log(size) + parameters * math.log(count)

    enclosing = [*_enclosing(near)]
    enough = enclosing and len(enclosing[0]) <= FEW * count
    polygons = [each for each in enclosing if enough and len(each) <= MOST_CORNERS]
    polygons = [each for each in polygons if _half_width(each) >= max(THIN * widest, LEAST_HALF)]
    of_polygons = [cost(Area(each).size, each.size) for each in polygons]
    # Values of two digits, of a polygon of three, are read more easily in a parameter file.
    step = 10.0 ** (math.floor(math.log10(widest)) - 1)
    if min(of_polygons, default=math.inf) < cost(4.0 * float(half.prod()), 4):
        corners, step = polygons[0], 0.1 * step
        centre = corners.mean(axis=0)
        # The rounded one contains the places too.
        wider = centre + (1.0 + step / _half_width(corners)) * (corners - centre)
        edges = step * np.rint(wider / step).ravel()
    else:
        half *= math.sqrt((count + 1.0) / (count + 1.0 - min(count, 4)))
        low, high = np.floor((middle - half) / step), np.ceil((middle + half) / step)
        edges = step * np.concatenate([low, high])
    return tuple(float(f"{edge:.10g}") for edge in edges)


def _enclosing(place: FloatArray) -> Iterator[FloatArray]:
    """Yield convex polygons around places, counter-clockwise, with ever fewer corners, (K, 2).

    The first is the convex hull. Each other one lacks the side of the one before without which the
    neighbouring sides meet with the least additional size.
    """
    try:
        corners = place[ConvexHull(place).vertices]
    except QhullError:  # Too few places, or all of them on a line
        return
    while True:
        yield corners
        if len(corners) == 3:
            return
        # A side from b to c is replaced by where those from a to b and from c to d meet.
        before, following = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
        first, last = corners - before, np.roll(following, -1, axis=0) - following
        turn, side = _cross(first, last), following - corners
        meets = turn > 0.0
        along = _cross(side, last) / np.where(meets, turn, 1.0)
        added = np.where(meets, 0.5 * along * _cross(first, side), np.inf)
        row = int(added.argmin())
        meeting = corners[row] + along[row] * first[row]
        corners = np.delete(np.roll(corners, -row, axis=0), 1, axis=0)
        corners[0] = meeting


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    product: FloatArray = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return product


def _half_width(corners: FloatArray) -> float:
    """Return the least distance of a side of a convex polygon from the mean of its corners."""
    side, off = np.roll(corners, -1, axis=0) - corners, corners.mean(axis=0) - corners
    return float((_cross(side, off) / np.hypot(*side.T)).min())


def covers(given: Any, area: tuple[float, ...], most: float) -> bool:
    """Return whether a configured area contains the places of one that was found.

    It must also be at most `most` times as long and as wide.
    """
    configured = AREA.read(given)
    if configured is None:
        return False
    own, found = Area.of(configured), Area.of(area)
    middle = found.corners.mean(axis=0)
    inner = middle + (1.0 - EDGE) * (found.corners - middle)
    return bool(own.probability(inner).all() and own.size <= most**2 * found.size)
