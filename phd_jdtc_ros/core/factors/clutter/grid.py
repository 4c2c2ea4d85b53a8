"""Cells of a clutter map: polar around a stationary radar, and squares for a moving one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Protocol

import numpy as np

from ...arrays import FloatArray, IntArray
from ...snapshot import floats, integers
from ...types import FULL_TURN

# Size of a cell in standard deviations of a detection.
CELL_SIGMA = 3.0
# Largest number of cells in a revolution: far more than the azimuth noise of any antenna needs.
MAX_AZIMUTH_CELLS = 10**6
# Number of squares in each direction from the world's zero.
HALF = 1 << 26


class ToWorld(Protocol):
    """The part of a radar that maps cells need: its projection to the world."""

    def to_world(self, measurement: FloatArray) -> FloatArray:
        """Return world (x, y) in metres of (range, azimuth) rows; shape (M, 2)."""


class Grid(Protocol):
    """Cells, numbered by row and column; the last column adjoins the first."""

    @property
    def columns(self) -> int:
        """Number of columns."""

    def places(self, measurement: FloatArray, world: FloatArray) -> FloatArray:
        """Return row and column of each detection, (2, M); cell centres are integers.

        `measurement` has range and azimuth, metres and radians, and `world` the same places in the
        world frame, metres, (M, 2).
        """

    def world(self, places: FloatArray, radar: ToWorld) -> FloatArray:
        """Return the world positions, (N, 2), of rows and columns, (2, N); inverse of `places`."""

    def log_share(self, measurement: FloatArray, max_range: float) -> FloatArray:
        """Return the log share of each detection's cell in uniform clutter, shape (M,).

        Uniform clutter extends over all azimuths and over ranges up to `max_range`, metres.
        """


@dataclass(frozen=True)
class PolarGrid:
    """Cells of range and azimuth."""

    range_cell: Annotated[float, floats("", 1e-9, 1e12)]  # Extent of a cell in range, metres
    columns: Annotated[int, integers("", 3, MAX_AZIMUTH_CELLS)]  # Number of cells in a revolution

    @classmethod
    def of_noise(cls, range_std: float, azimuth_std: float) -> PolarGrid:
        """Return cells for detections of these standard deviations, metres and radians."""
        azimuths = int(np.ceil(min(FULL_TURN / (CELL_SIGMA * azimuth_std), MAX_AZIMUTH_CELLS)))
        return cls(CELL_SIGMA * range_std, max(azimuths, 3))

    def places(self, measurement: FloatArray, world: FloatArray) -> FloatArray:
        """See `Grid.places`."""
        along = np.maximum(measurement[:, 0], 0.0) / self.range_cell + 0.5
        across = (measurement[:, 1] + np.pi) * (self.columns / FULL_TURN) - 0.5
        return np.stack([along, across])

    def world(self, places: FloatArray, radar: ToWorld) -> FloatArray:
        """See `Grid.world`."""
        along = np.maximum((places[0] - 0.5) * self.range_cell, 0.0)
        across = (places[1] + 0.5) * (FULL_TURN / self.columns) - np.pi
        return radar.to_world(np.stack([along, across], axis=1))[:, :2]

    def log_share(self, measurement: FloatArray, max_range: float) -> FloatArray:
        """See `Grid.log_share`."""
        return np.full(len(measurement), np.log(self.range_cell / (self.columns * max_range)))


@dataclass(frozen=True)
class GroundGrid:
    """Squares of the world, for a moving radar."""

    cell: Annotated[float, floats("", 1e-9, 1e12)]  # Side of a square, metres

    @classmethod
    def of_noise(cls, range_std: float, azimuth_std: float, max_range: float) -> GroundGrid:
        """Return squares for the standard deviations of detections at a quarter of the range."""
        return cls(CELL_SIGMA * max(range_std, azimuth_std * 0.25 * max_range))

    @property
    def columns(self) -> int:
        """Number of columns; the last one is unused."""
        return 2 * HALF

    def places(self, measurement: FloatArray, world: FloatArray) -> FloatArray:
        """See `Grid.places`."""
        inside: FloatArray = np.clip(world.T / self.cell + HALF, 0.0, 2.0 * HALF - 2.0)
        return inside

    def world(self, places: FloatArray, radar: ToWorld) -> FloatArray:
        """See `Grid.world`."""
        position: FloatArray = (places.T - HALF) * self.cell
        return position

    def log_share(self, measurement: FloatArray, max_range: float) -> FloatArray:
        """See `Grid.log_share`."""
        ring = FULL_TURN * np.maximum(measurement[:, 0], self.cell)
        share: FloatArray = np.log(self.cell / ring) + np.log(self.cell / max_range)
        return share


def corners(grid: Grid, places: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the four cells around each place and their interpolation weights, shapes (4, M)."""
    # These are integers, because the numbers of squares of the world exceed the exact range of
    # floats.
    row, column = np.floor(places).astype(np.int64)
    below, after = places - np.stack([row, column])
    cells, shares = [], []
    for down in (0, 1):
        for right in (0, 1):
            cells.append((row + down) * grid.columns + np.mod(column + right, grid.columns))
            shares.append((below if down else 1.0 - below) * (after if right else 1.0 - after))
    return np.array(cells), np.array(shares)
