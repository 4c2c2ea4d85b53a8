"""The background layers of the page's picture, and the compact code of its integers.

Detections, learned clutter and the earth are layers. A column of integers is stored as compressed
differences, in base64.

Lines of latitude, longitude and range are computed: the page loads no map tiles, and works without
a network.
"""

from __future__ import annotations

import base64
import gzip
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.colors import to_hex

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types.clutter_raster import ClutterRaster
from phd_jdtc_ros.report.style import MapScale, round_step

from ..record import AllPlots, RadarSite
from ..style import CLUTTER, purples

# Steps of the colour scale of amplitudes, which is logarithmic.
SHADES = 8


class Columns:
    """Columns of 32-bit integers; the page's script reads them by name.

    `index` has names and numbers of entries, in the order of `text`.
    """

    def __init__(self) -> None:
        self.index: list[tuple[str, int]] = []
        self._parts: list[bytes] = []

    def add(self, name: str, values: npt.ArrayLike) -> None:
        """Add a column.

        It stores the differences of successive entries, from 0 on, with the sign as the lowest bit:
        first the lowest bytes of all entries, and last the highest, which are mostly 0.
        """
        numbers = np.asarray(values, dtype=np.int64)
        steps = np.diff(numbers, prepend=0)
        folded = np.where(steps < 0, -2 * steps - 1, 2 * steps).astype("<u4")
        self.index.append((name, len(numbers)))
        self._parts.append(folded.view(np.uint8).reshape(-1, 4).T.tobytes())

    def text(self) -> str:
        """Return all columns, compressed, as base64."""
        return pack(b"".join(self._parts))


def pack(data: bytes) -> str:
    """Return bytes, compressed by gzip, as base64; the text is reproducible."""
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode("ascii")


def _shades(weak: float, strong: float) -> list[str]:
    return [to_hex(shade) for shade in purples(weak, strong, SHADES)]


# Colour scale of each page style: high amplitudes have the most contrast, low ones remain visible.
AMPLITUDE_SCALES = {"light": _shades(0.45, 1.0), "dark": _shades(0.75, 0.0)}


def shades_of(plots: AllPlots) -> IntArray:
    """Return the step of each amplitude on the scale from least to greatest; -1 for none."""
    shades, known = np.full(len(plots.amplitude), -1, dtype=np.int64), plots.known
    if known.any():
        level = np.log10(plots.amplitude[known])
        span = max(float(np.ptp(level)), 0.04)
        shades[known] = np.minimum((level - level.min()) / span * SHADES, SHADES - 1).astype(int)
    return shades


# Ends of the opacity scale: decimal logarithms of false detections per revolution and km^2.
FAINTEST, STRONGEST = 0.0, 3.0


def clutter_levels(raster: ClutterRaster, columns: Columns) -> dict[str, Any]:
    """Add the squares' opacity as a column, rows by y; return their positions in metres."""
    # Number of steps of the opacity.
    opacities = 100
    level = np.log10(np.maximum(raster.density, 10.0**FAINTEST))
    columns.add("clutter", np.rint(np.minimum(level / STRONGEST, 1.0) * opacities).ravel())
    low_x, _, low_y, _ = raster.extent
    rows, across = raster.density.shape
    return {
        "corner": [float(low_x), float(low_y)],
        "cell": float(raster.cell),
        "shape": [rows, across],
        "colour": CLUTTER,
        "steps": opacities,
    }


# Number of points of a line.
POINTS = 73
# Largest number of rings of a radar, and allowed steps as multiples of a power of ten.
MOST_RINGS, RING_STEPS = 4, (1.0, 2.0, 2.5, 5.0)
# Length of lines beyond the first view, as a share of its extent: pages are wide.
BEYOND = 0.6
# Nodes of the interpolation grid along an axis (its error is 3 m with 12 km between nodes), and
# resolution of its degrees.
NODES, DEGREE = 65, 1e-5


def graticule(
    plane: Plane, corner: FloatArray, far: FloatArray, columns: Columns
) -> dict[str, Any]:
    """Add the lines of latitude and longitude as columns, metres; return their texts.

    The first view is from `corner` to `far`, x and y in metres, (2,).
    """
    lines: list[FloatArray] = []
    labels: list[str] = []
    beyond = BEYOND * (far - corner)
    extents = _extent(plane, corner - beyond, far + beyond)
    for along, across, name in ((0, 1, "NS"), (1, 0, "EW")):
        # Largest number of lines of the graticule across the picture.
        step = round_step(float(np.ptp(extents[along])) / 8)
        first, last = np.ceil(extents[along][0] / step), np.floor(extents[along][1] / step)
        for value in np.arange(first, last + 1.0) * step:
            pair = [np.full(POINTS, value)] * 2
            pair[across] = np.linspace(extents[across][0], extents[across][1], POINTS)
            lines.append(np.stack(plane.to_plane(*pair)))
            labels.append(degrees(value, step, name))
    drawn = np.concatenate([np.zeros((2, 0)), *lines], axis=1)
    for axis, values in zip("xy", drawn, strict=True):
        columns.add(f"graticule.{axis}", np.rint(values))
    return {"points": POINTS, "labels": labels}


def earth_grid(
    plane: Plane, corner: FloatArray, far: FloatArray, columns: Columns
) -> dict[str, Any]:
    """Add latitudes and longitudes of a grid's nodes as columns; return the nodes' positions.

    For the parameters see `graticule`. Longitudes are continuous over the antimeridian.
    """
    beyond = BEYOND * (far - corner)
    nodes = np.linspace(corner - beyond, far + beyond, NODES)
    latitude, longitude = plane.to_geodetic(*np.meshgrid(nodes[:, 0], nodes[:, 1]))
    columns.add("earth.latitude", np.rint(latitude.ravel() / DEGREE))
    columns.add("earth.longitude", np.rint(_away(plane, longitude).ravel() / DEGREE))
    return {
        "corner": nodes[0].tolist(),
        "cell": (nodes[1] - nodes[0]).tolist(),
        "nodes": NODES,
        "degree": DEGREE,
    }


def rings(
    radars: Sequence[RadarSite], corner: FloatArray, far: FloatArray
) -> list[tuple[float, float, float, str]]:
    """Return rings of equal range about radars: x, y and radius in metres, and a text.

    For the corners of the first view see `graticule`.
    """
    places = [radar.position for radar in radars]
    farthest = max(
        (np.hypot(*np.maximum(far - p, np.array(p) - corner)) for p in places), default=0
    )
    if farthest <= 0.0:
        return []
    scale = MapScale.of_extent(float((far - corner).max()))
    step = round_step(farthest / MOST_RINGS, RING_STEPS)
    return [
        (*place, float(radius), f"{radius / scale.metres:g} {scale.unit}")
        for place in places
        for radius in np.arange(1, MOST_RINGS + 1) * step
        if radius <= farthest
    ]


def degrees(value: float, step: float, names: str) -> str:
    """Return an angle as text, with the digits that a step needs and the hemisphere's letter."""
    digits = max(int(np.ceil(-np.log10(step) - 1e-9)), 0)
    shown = (value + 180.0) % 360.0 - 180.0 if names == "EW" else value
    side = names[0] if round(shown, digits) >= 0.0 else names[1]
    return f"{abs(shown):.{digits}f}° {side}"


def _extent(plane: Plane, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the least and greatest latitude and longitude in a rectangle, degrees."""
    grid = np.meshgrid(*(np.linspace(low[k], high[k], 41) for k in (0, 1)))
    latitude, longitude = plane.to_geodetic(*grid)
    away = _away(plane, longitude)
    return (
        np.array([latitude.min(), latitude.max()]),
        np.array([away.min(), away.max()]),
    )


def _away(plane: Plane, longitude: FloatArray) -> FloatArray:
    """Return longitudes relative to the origin, continuous over the antimeridian."""
    return (longitude - plane.origin[1] + 180.0) % 360.0 - 180.0 + plane.origin[1]
