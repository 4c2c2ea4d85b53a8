"""Density of false detections in the world frame, as maps of clutter have learned it."""

from __future__ import annotations

from dataclasses import dataclass

from ..arrays import FloatArray, ReadOnly


@dataclass(frozen=True, eq=False)
class ClutterRaster(ReadOnly):
    """Density of false detections by square of the world."""

    corner: tuple[float, float]  # Least x and y, world frame, metres
    cell: float  # Side of a square, metres
    # False detections per revolution or scan and km^2, rows by y and columns by x. Each radar
    # counts by its own revolutions, and the densities of several radars are added.
    density: FloatArray

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Least and greatest x, and least and greatest y, metres."""
        rows, columns = self.density.shape
        x, y = self.corner
        return x, x + columns * self.cell, y, y + rows * self.cell
