"""The system plane: the projection of the earth in which targets are tracked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray

if TYPE_CHECKING:
    import pyproj


@dataclass(frozen=True)
class SystemPlane:
    """The oblique stereographic plane about an origin on the WGS84 ellipsoid.

    It is the system plane of multi-radar trackers, and of ASTERIX I062/100. The projection is
    conformal: it preserves angles, and lengthens distances equally in all directions, by 1 + (d /
    2R)^2 at the distance d from the origin with the earth's radius R. This is 0.006 % at 100 km and
    0.1 % at 400 km: there a length of 10 km becomes 10.01 km, and a speed of 250 m/s becomes 250.25
    m/s.

    Coordinates are doubles here. In a cloud they are FLOAT32 metres, whose resolution per axis is
    0.008 m from 65 to 131 km, 0.016 m to 262 km and 0.031 m to 524 km; the error is at most half of
    it.

    PROJ computes it, by EPSG method 9809: J. P. Snyder, *Map Projections: A Working Manual*, USGS
    Professional Paper 1395, 1987; IOGP Guidance Note 7-2, "Oblique Stereographic".
    """

    # Half of the meridian arc, degrees (11 m), whose chord gives the direction of true north.
    MERIDIAN_STEP = 1e-4

    # Latitude and longitude of the plane's origin, degrees, and the height of the world's zero,
    # metres.
    origin: Sequence[float]
    _projection: pyproj.Proj = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        origin = tuple(map(float, self.origin))
        if len(origin) != 3 or not np.isfinite(origin).all() or abs(origin[0]) > 90.0:
            raise ValueError(
                f"origin: {list(self.origin)} given, must be a latitude from -90 to 90 degrees, a "
                "longitude in degrees and a height in metres, all finite"
            )
        object.__setattr__(self, "origin", origin)
        import pyproj  # Only trackers with a geodetic map need it

        projection = pyproj.Proj(
            proj="sterea", lat_0=origin[0], lon_0=origin[1], ellps="WGS84", units="m"
        )
        object.__setattr__(self, "_projection", projection)

    def to_plane(
        self, latitude: npt.ArrayLike, longitude: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Return the coordinates x, to the east, and y, to the north, metres, of places in degrees.

        NaN gives NaN, and a latitude beyond a pole a ValueError.
        """
        latitude, longitude = _places(latitude, longitude)
        x, y = self._projection(longitude, latitude)
        return np.asarray(x, dtype=float), np.asarray(y, dtype=float)

    def to_geodetic(self, x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return latitudes, and longitudes from -180 to 180, degrees; NaN gives NaN."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        longitude, latitude = self._projection(x, y, inverse=True)
        return np.asarray(latitude, dtype=float), np.asarray(longitude, dtype=float)

    def convergence(self, latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> FloatArray:
        """Return the direction of true north, radians counter-clockwise from the y axis.

        It is also the direction of true east from the x axis, and so the yaw of a sensor whose x
        axis points east. A latitude beyond a pole gives a ValueError.
        """
        latitude, longitude = _places(latitude, longitude)
        # PROJ's own convergence is infinite at a pole and at longitudes beyond a revolution.
        (x_0, y_0), (x_1, y_1) = (
            self.to_plane(np.clip(latitude + step, -90.0, 90.0), longitude)
            for step in (-self.MERIDIAN_STEP, self.MERIDIAN_STEP)
        )
        return np.arctan2(x_0 - x_1, y_1 - y_0)


def _places(latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Broadcast both to one shape; raise ValueError for a latitude beyond a pole."""
    north, east = np.broadcast_arrays(
        np.asarray(latitude, dtype=float), np.asarray(longitude, dtype=float)
    )
    beyond = np.abs(north) > 90.0  # False for NaN
    if beyond.any():
        raise ValueError(f"latitude: {north[beyond].flat[0]} given, must be from -90 to 90 degrees")
    return north, east
