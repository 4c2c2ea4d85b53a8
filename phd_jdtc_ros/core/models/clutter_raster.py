"""Maps of clutter as a picture: how many false detections come from where, in the world frame."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray, read_only
from ..clutter.map import ClutterMap
from ..sensors.sensor import Sensor

# Cells along the longer side at most, their least size in metres, and what is left about them.
MOST, LEAST_CELL, MARGIN = 256, 5.0, 0.05
# Each of a map's cells is drawn as so many points in each direction.
POINTS = 3
# A picture is of where more than a stray detection is remembered.
REPEATED = 1.0


@dataclass(frozen=True, eq=False)
class ClutterRaster:
    """False detections by square of the world.

    Parameters
    ----------
    corner : tuple of two floats
        Least x and y, world frame, metres.
    cell : float
        Side of a square, metres.
    density : array of shape (rows, columns)
        False detections per turn, or scan, and km^2; rows by y, columns by x. A radar's own are of
        its turns, and those of several radars are added.
    """

    corner: tuple[float, float]
    cell: float
    density: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "density", read_only(self.density))

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Least and greatest x, and least and greatest y, metres."""
        rows, columns = self.density.shape
        x, y = self.corner
        return x, x + columns * self.cell, y, y + rows * self.cell


def raster(maps: Mapping[str, ClutterMap], radars: Sequence[Sensor]) -> ClutterRaster | None:
    """Return the picture of the maps of some radars, by name; None if nothing was learned.

    It shows the places at which detections have come again, with a margin, or else all places.
    """
    parts = list(_points(maps, radars))
    if not parts:
        return None
    world, each, count = (np.concatenate(column) for column in zip(*parts, strict=True))
    again = world[count > REPEATED] if (count > REPEATED).any() else world
    low, high = again.min(axis=0), again.max(axis=0)
    margin = MARGIN * float((high - low).max()) + LEAST_CELL
    low, high = low - margin, high + margin
    cell = _round_up(max(float((high - low).max()) / (MOST - 1), LEAST_CELL))
    first = np.floor(low / cell)
    columns, rows = (np.ceil(high / cell) - first).astype(int).tolist()
    place = np.floor(world / cell) - first
    inside = ((place >= 0.0) & (place < [columns, rows])).all(axis=1)
    x, y = place[inside].astype(int).T
    total = np.zeros(rows * columns)
    np.add.at(total, y * columns + x, each[inside])
    density = total.reshape(rows, columns) * (1e6 / cell**2)
    return ClutterRaster((float(first[0] * cell), float(first[1] * cell)), cell, density)


def _points(
    maps: Mapping[str, ClutterMap], radars: Sequence[Sensor]
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield, of each map, places in the world, their part of its rate, and their cell's count."""
    for radar in radars:
        learned = maps.get(radar.name)
        if learned is None or not len(learned.cell):
            continue
        offsets = (np.arange(POINTS) + 0.5) / POINTS - 0.5
        down, right = (grid.ravel() for grid in np.meshgrid(offsets, offsets))
        shape = len(learned.cell), POINTS**2
        row, column = np.divmod(learned.cell, learned.grid.columns)
        places = np.stack(
            [
                np.broadcast_to(row[:, None] + down, shape).ravel(),
                np.broadcast_to(column[:, None] + right, shape).ravel(),
            ]
        )
        count = np.repeat(learned.count, POINTS**2)
        each = count / (POINTS**2 * max(learned.turns, 1.0))
        yield learned.grid.world(places, radar), each, count


def _round_up(length: float) -> float:
    """Return the least of 1, 2, 5, 10, 20 and so on that is not below a length."""
    decade = 10.0 ** math.floor(math.log10(length))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= length)
