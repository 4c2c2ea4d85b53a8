"""Renders clutter maps as a raster: density of false detections in the world frame."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...arrays import FloatArray
from ...sensors.sensor import Sensor
from ...types.clutter_raster import ClutterRaster
from .map import ClutterMap

# Largest number of cells along the longer side.
MAX_CELLS = 256
# Smallest side of a cell, metres.
MIN_CELL = 5.0
# Margin, as a share of the longer side.
MARGIN = 0.05
# Number of points in each direction with which a cell of a map is drawn.
POINTS = 3
# A raster extends over cells with more detections than this, if there are any: not over stray ones.
REPEATED = 1.0


def raster(maps: Mapping[str, ClutterMap], radars: Sequence[Sensor]) -> ClutterRaster | None:
    """Return the raster of the maps of radars, by name; None if nothing was learned.

    It extends over the places with repeated detections and a margin, or else over all places.
    """
    parts = list(_points(maps, radars))
    if not parts:
        return None
    world, rate, count = (np.concatenate(column) for column in zip(*parts, strict=True))
    shown = world[count > REPEATED] if (count > REPEATED).any() else world
    low, high = shown.min(axis=0), shown.max(axis=0)
    margin = MARGIN * float((high - low).max()) + MIN_CELL
    low, high = low - margin, high + margin
    cell = _round_up(max(float((high - low).max()) / (MAX_CELLS - 1), MIN_CELL))
    first = np.floor(low / cell)
    columns, rows = (np.ceil(high / cell) - first).astype(int).tolist()
    cell_index = np.floor(world / cell) - first
    inside = ((cell_index >= 0.0) & (cell_index < [columns, rows])).all(axis=1)
    x, y = cell_index[inside].astype(int).T
    total = np.zeros(rows * columns)
    np.add.at(total, y * columns + x, rate[inside])
    density = total.reshape(rows, columns) * (1e6 / cell**2)
    return ClutterRaster((float(first[0] * cell), float(first[1] * cell)), cell, density)


def _points(
    maps: Mapping[str, ClutterMap], radars: Sequence[Sensor]
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield each map's points in the world, with their part of its rate and their cell's count."""
    for radar in radars:
        learned = maps.get(radar.name)
        if learned is None or not len(learned.cell):
            continue
        offsets = (np.arange(POINTS) + 0.5) / POINTS - 0.5
        down, right = (grid.ravel() for grid in np.meshgrid(offsets, offsets))
        shape = len(learned.cell), POINTS**2
        row, column = np.divmod(learned.cell, learned.grid.columns)
        cell_position = np.stack(
            [
                np.broadcast_to(row[:, None] + down, shape).ravel(),
                np.broadcast_to(column[:, None] + right, shape).ravel(),
            ]
        )
        count = np.repeat(learned.count, POINTS**2)
        rate = count / (POINTS**2 * max(learned.revolutions, 1.0))
        yield learned.grid.world(cell_position, radar), rate, count


def _round_up(length: float) -> float:
    """Return the least of 1, 2, 5, 10, 20 and so on that is not below a length."""
    decade = 10.0 ** math.floor(math.log10(length))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= length)
