"""Places on the earth in a local plane."""

from __future__ import annotations

import math

# Mean radius, metres.
EARTH_RADIUS = 6_371_008.8
METRES_PER_NM = 1852.0
MPS_PER_KT = METRES_PER_NM / 3600.0
STANDARD_GRAVITY = 9.80665


def east_north(place: tuple[float, float], origin: tuple[float, float]) -> tuple[float, float]:
    """Return a place's coordinates in the plane about an origin, metres east and north.

    Place and origin are latitudes and longitudes, degrees. The projection is the azimuthal
    equidistant one of a sphere: distances and bearings from the origin are true. 300 km from it,
    distances across are 0.04 % too long.
    """
    (north, east), (north_0, east_0) = (map(math.radians, point) for point in (place, origin))
    away = east - east_0
    across = math.cos(north) * math.sin(away)
    along = math.cos(north_0) * math.sin(north) - math.sin(north_0) * math.cos(north) * math.cos(
        away
    )
    up = math.sin(north_0) * math.sin(north) + math.cos(north_0) * math.cos(north) * math.cos(away)
    chord = math.hypot(across, along)
    scale = EARTH_RADIUS * (math.atan2(chord, up) / chord if chord else 1.0)
    return scale * across, scale * along
