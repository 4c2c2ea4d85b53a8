"""Gating of particles and detections, by lists of detections per cell of range and azimuth.

Every detection is listed in all cells that its gate touches, so a particle is compared only with
the list of its own cell. Cells are half a gate wide, so that few of these comparisons fail. If
gates are tiny, the cells are coarser, to bound their number.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..types import FULL_TURN
from .candidates import CHUNK_PAIRS, chunks, expand

MOST_RANGE_CELLS = 64
MOST_AZIMUTH_CELLS = 256
# Factor on the gates for which detections are listed, so that rounding cannot put a particle at the
# edge of a gate into a cell without its detection.
MARGIN = 1.0 + 1e-9


class Cells(NamedTuple):
    """Cells of range and azimuth."""

    # Number of cells in azimuth and in range. One more, empty cell in range stands for all longer
    # ranges.
    shape: tuple[int, int]
    range_width: float  # Extent of a cell in range, metres

    def of(self, measured: FloatArray) -> IntArray:
        """Return the cell of each (range, azimuth in (-pi, pi]) row, shape (N,)."""
        azimuths, ranges = self.shape
        azimuth_cell = ((measured[:, 1] + np.pi) * (azimuths / FULL_TURN)).astype(np.int64)
        range_cell = np.minimum(measured[:, 0] / self.range_width, ranges).astype(np.int64)
        cell: IntArray = np.minimum(azimuth_cell, azimuths - 1) * (ranges + 1) + range_cell
        return cell


class _Gates(NamedTuple):
    """Gates of detections, each with the cells from `first` to `last` that it touches, (G,).

    Detections are repeated one revolution to either side, so that gates across +-pi need no special
    case.
    """

    detection: IntArray
    range: FloatArray
    azimuth: FloatArray
    first_azimuth: IntArray
    last_azimuth: IntArray
    first_range: IntArray
    last_range: IntArray


class CellLists(NamedTuple):
    """The detections near each cell."""

    cells: Cells
    start: IntArray  # Index in the lists at which each cell begins, (cells + 1,)
    detection: IntArray  # Ascending in every cell, (L,)
    range: FloatArray  # Range of each of these detections, metres, (L,)
    # Azimuth of each, radians, (L,). It is shifted by a full turn if this puts it next to its cell,
    # so that differences need no wrapping.
    azimuth: FloatArray


def _gates(measured: FloatArray, range_gate: float, azimuth_gate: float) -> tuple[Cells, _Gates]:
    """Return the cells for detections, and their gates; for the parameters see `cell_lists`."""
    top = float(measured[:, 0].max(initial=0.0)) + range_gate * MARGIN
    ranges = int(np.clip(np.ceil(2.0 * top / range_gate), 1, MOST_RANGE_CELLS))
    azimuths = int(np.clip(2.0 * FULL_TURN / azimuth_gate, 1, MOST_AZIMUTH_CELLS))
    range_width = top / ranges

    detection = np.repeat(np.arange(len(measured)), 3)
    distance = measured[detection, 0]
    azimuth = (measured[:, 1:] + np.array([-FULL_TURN, 0.0, FULL_TURN])).ravel()
    reach = azimuth_gate * MARGIN
    low, high = (
        np.floor((azimuth + sign * reach + np.pi) * (azimuths / FULL_TURN)) for sign in (-1.0, 1.0)
    )
    in_revolution = np.flatnonzero((high >= 0.0) & (low < azimuths))
    detection, distance, azimuth = (
        detection[in_revolution],
        distance[in_revolution],
        azimuth[in_revolution],
    )
    first_azimuth = np.maximum(low[in_revolution], 0.0).astype(np.int64)
    last_azimuth = np.minimum(high[in_revolution], azimuths - 1).astype(np.int64)
    reach = range_gate * MARGIN
    first_range = (np.maximum(distance - reach, 0.0) / range_width).astype(np.int64)
    last_range = np.minimum((distance + reach) / range_width, ranges - 1).astype(np.int64)
    cells = first_azimuth, last_azimuth, first_range, last_range
    return Cells((azimuths, ranges), range_width), _Gates(detection, distance, azimuth, *cells)


def cell_lists(measured: FloatArray, range_gate: float, azimuth_gate: float) -> CellLists:
    """List detections, (range, azimuth in (-pi, pi]), (M, 2), by cell.

    The half widths of the gate are in metres and radians, the latter at most pi.
    """
    cells, gates = _gates(measured, range_gate, azimuth_gate)
    azimuths, ranges = cells.shape
    across = gates.last_range - gates.first_range + 1
    size = across * (gates.last_azimuth - gates.first_azimuth + 1)
    entry = np.repeat(np.arange(len(size)), size)
    offset = np.arange(len(entry)) - (np.cumsum(size) - size)[entry]
    azimuth_cell = gates.first_azimuth[entry] + offset // across[entry]
    cell = azimuth_cell * (ranges + 1) + gates.first_range[entry] + offset % across[entry]
    entry = entry[np.argsort(cell, kind="stable")]
    number = np.bincount(cell, minlength=azimuths * (ranges + 1))
    start = np.concatenate([[0], np.cumsum(number)])
    return CellLists(cells, start, gates.detection[entry], gates.range[entry], gates.azimuth[entry])


def count_near(
    measured: FloatArray, range_gate: float, azimuth_gate: float, predicted: FloatArray
) -> int:
    """Return how many entries the lists of the cells of points, (N, 2), have together.

    The lists are not made. For the other parameters see `cell_lists`.
    """
    cells, gates = _gates(measured, range_gate, azimuth_gate)
    azimuths, ranges = cells.shape
    # Every gate adds one from the corner of its first cell on, and takes it beyond its last cells.
    steps = np.zeros((azimuths + 1, ranges + 1), dtype=np.int64)
    np.add.at(steps, (gates.first_azimuth, gates.first_range), 1)
    np.add.at(steps, (gates.last_azimuth + 1, gates.first_range), -1)
    np.add.at(steps, (gates.first_azimuth, gates.last_range + 1), -1)
    np.add.at(steps, (gates.last_azimuth + 1, gates.last_range + 1), 1)
    count = steps.cumsum(axis=0).cumsum(axis=1)
    return int(count.ravel().take(cells.of(predicted)).sum())


def near_detections(
    lists: CellLists, predicted: FloatArray, std: FloatArray, sigmas: float, azimuth_gate: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the particle, ascending, the detection and the square distance of pairs in the gate.

    Distances are in standard deviations; `std` has those of range and azimuth, metres and radians.
    The gate is `sigmas` of these, with a half width in azimuth of at most pi. Predictions are
    (range, azimuth in (-pi, pi]), (N, 2).
    """
    cell = lists.cells.of(predicted)
    count = np.diff(lists.start).take(cell)
    owner = np.flatnonzero(count)
    count, begin = count.take(owner), lists.start.take(cell.take(owner))
    distance, azimuth = np.ascontiguousarray((predicted / std).T)
    listed_range, listed_azimuth = lists.range / std[0], lists.azimuth / std[1]
    scaled_gate = azimuth_gate / float(std[1])
    results = [(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))]
    for chunk in chunks(count, CHUNK_PAIRS):
        particle, entry = expand(owner[chunk], begin[chunk], count[chunk])
        range_error = listed_range.take(entry) - distance.take(particle)
        azimuth_error = listed_azimuth.take(entry) - azimuth.take(particle)
        square = range_error * range_error
        square += azimuth_error * azimuth_error
        is_near = square <= sigmas * sigmas
        # Half open: a detection exactly half a revolution away is found on one side only.
        is_near &= azimuth_error >= -scaled_gate
        is_near &= azimuth_error < scaled_gate
        inside = np.flatnonzero(is_near)
        detection = lists.detection.take(entry.take(inside))
        results.append((particle.take(inside), detection, square.take(inside)))
    particles, detections, squares = zip(*results, strict=True)
    return np.concatenate(particles), np.concatenate(detections), np.concatenate(squares)
