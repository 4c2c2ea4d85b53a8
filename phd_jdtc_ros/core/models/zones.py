"""Zones: polygons in the world frame that mean something to an operator."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import BoolArray, FloatArray, ReadOnly

# No track starts in an exclusion zone. The others only give the entry its name.
GUARD, EXCLUSION, LAND = KINDS = ("guard", "exclusion", "land")


@dataclass(frozen=True)
class Zone(ReadOnly):
    """The inside of rings whose sides do not cross: outlines, and holes in them."""

    name: str
    kind: str  # One of `KINDS`
    sides: FloatArray  # Both ends of each side of all rings, world frame, metres, (S, 2, 2)

    @cached_property
    def bounds(self) -> FloatArray:
        """The least and the largest coordinates, [end, axis], (2, 2)."""
        corners = self.sides.reshape(-1, 2)
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    def contains(self, position: FloatArray) -> BoolArray:
        """Return whether places, (N, 2), are inside, (N,).

        A ray from a place inside crosses the sides an odd number of times.
        """
        inside: BoolArray = ((position >= self.bounds[0]) & (position <= self.bounds[1])).all(
            axis=1
        )
        x, y = position[inside].T[:, :, None]
        (x0, y0), (x1, y1) = self.sides.transpose(1, 2, 0)
        between, rise = (y0 > y) != (y1 > y), y1 - y0
        share = (y - y0) / np.where(rise == 0.0, 1.0, rise)
        crossed = between & (x < x0 + share * (x1 - x0))
        inside[inside] = crossed.sum(axis=1) % 2 == 1
        return inside
