"""How often the neighbourhood of a place answers, beside the place itself.

Reflectors of a quay, of land or of a harbour lie side by side, and ships that move are mostly alone
at sea. So the first detections at a place say little of what it is, but those about it say much.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray
from .grid import Grid

# Cells in each direction of a neighbourhood, and of the place itself, with where a ship was before.
REACH, OWN = 8, 2
# Cells of a neighbourhood without the place itself.
CELLS = (2 * REACH + 1) ** 2 - (2 * OWN + 1) ** 2
# Detections in a turn of one reflector, or of another ship that is not known yet, tell nothing of a
# neighbourhood. With so many more it is as probably one of reflectors as not.
SINGLE, FEW = 1.0, 0.5


def detections_about(
    grid: Grid, cell: IntArray, count: FloatArray, places: FloatArray
) -> FloatArray:
    """Return the number of detections in the neighbourhood of each place, shape (M,).

    Parameters
    ----------
    grid : Grid
    cell : int array of shape (K,)
        Ascending, as in `ClutterMap`.
    count : array of shape (K,)
        Detections of each.
    places : array of shape (2, M)
        Rows and columns, see `Grid.places`.
    """
    centre = np.floor(places + 0.5).astype(np.int64)
    before = np.concatenate([[0.0], np.cumsum(count)])
    wide, own = (_block(grid, cell, before, centre, half) for half in (REACH, OWN))
    about: FloatArray = np.maximum(wide - own, 0.0)
    return about


def probability_among_reflectors(about: FloatArray) -> FloatArray:
    """Return how probably a neighbourhood is one of reflectors, shape kept.

    Parameters
    ----------
    about : array
        Detections per turn that come from it beyond `SINGLE`.
    """
    share: FloatArray = about / (about + FEW)
    return share


def _block(
    grid: Grid, cell: IntArray, before: FloatArray, centre: IntArray, half: int
) -> FloatArray:
    """Return the detections in squares of cells, (M,), given those before each cell, (K + 1,)."""
    columns = grid.columns
    half_across = min(half, (columns - 1) // 2)
    row = centre[0] + np.arange(-half, half + 1)[:, None]
    first, end = centre[1] - half_across, centre[1] + half_across + 1
    total = np.zeros(centre.shape[1])
    # The last column is beside the first, so that a square may lie at both ends of a row.
    for turn in (-columns, 0, columns):
        left, right = (np.clip(edge + turn, 0, columns) for edge in (first, end))
        if (right > left).any():
            low, high = (np.searchsorted(cell, row * columns + edge) for edge in (left, right))
            total += (before[high] - before[low]).sum(axis=0)
    return total
