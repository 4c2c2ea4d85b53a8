"""Density of detections in the neighbourhood of a place, without the place itself.

Reflectors of a quay, of land or of a harbour lie side by side, whereas moving ships are mostly
alone at sea. The first detections at a place are therefore weak evidence of clutter, and detections
around it are strong evidence.
"""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray, IntArray
from .grid import Grid

# Half width of a neighbourhood, in cells.
REACH = 8
# Half width, in cells, of the place itself with a ship's last positions.
OWN = 2
# Number of cells of a neighbourhood without the place itself.
CELLS = (2 * REACH + 1) ** 2 - (2 * OWN + 1) ** 2
# Detections per revolution that are not counted: those of one reflector, or of one other ship
# without a track.
UNCOUNTED = 1.0
# Shares of a neighbourhood's cells that its detections fill, up to which it is a line of reflectors
# and from which on it is an area of clutter, as of the sea or of rain.
LINE, AREA = 1.0 / 6.0, 0.5
# Detections per revolution and cell up to which an area may be the sea, and from which on it is
# land: the sea would hide all targets there.
SEA, LAND = 0.25, 0.5


def detections_around(
    grid: Grid, cell: IntArray, count: FloatArray, places: FloatArray
) -> FloatArray:
    """Return the number of detections in the neighbourhood of each place, shape (..., M).

    Cells, (K,), and counts, (..., K), are as in `ClutterMap`; for the places, (2, M), see
    `Grid.places`.
    """
    centre = np.floor(places + 0.5).astype(np.int64)
    cumulative = np.concatenate([np.zeros((*count.shape[:-1], 1)), count.cumsum(axis=-1)], axis=-1)
    wide_count, own_count = (_block(grid, cell, cumulative, centre, half) for half in (REACH, OWN))
    return np.maximum(wide_count - own_count, 0.0)


def probability_of_area(around: FloatArray, square: FloatArray, density: FloatArray) -> FloatArray:
    """Return the weight of an area of clutter without reflectors, from 0 to 1, elementwise.

    `around` is the number of detections in a neighbourhood, `square` the sum of the squares of its
    cells' numbers, and `density` the detections per revolution and cell. The square of the sum over
    the sum of squares is the number of cells that the detections fill.
    """
    filled = around**2 / np.maximum(CELLS * square, 1e-12)
    even: FloatArray = np.clip((filled - LINE) / (AREA - LINE), 0.0, 1.0)
    return even * np.clip((LAND - density) / (LAND - SEA), 0.0, 1.0)


def _block(
    grid: Grid, cell: IntArray, cumulative: FloatArray, centre: IntArray, half: int
) -> FloatArray:
    """Return the detections in squares of cells, (..., M), of cumulative counts, (..., K + 1)."""
    columns = grid.columns
    half_across = min(half, (columns - 1) // 2)
    row = centre[0] + np.arange(-half, half + 1)[:, None]
    first, end = centre[1] - half_across, centre[1] + half_across + 1
    total = np.zeros((*cumulative.shape[:-1], centre.shape[1]))
    # The last column adjoins the first: a square may wrap around the end of a row.
    for turn in (-columns, 0, columns):
        left, right = (np.clip(edge + turn, 0, columns) for edge in (first, end))
        if (right > left).any():
            low, high = (np.searchsorted(cell, row * columns + edge) for edge in (left, right))
            total += (cumulative[..., high] - cumulative[..., low]).sum(axis=-2)
    return total
