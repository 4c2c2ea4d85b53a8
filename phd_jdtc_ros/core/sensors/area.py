"""The area that a sensor of positions covers: a rectangle along its axes, or a polygon."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ndtr, owens_t

from ..arrays import TINY, FloatArray, ReadOnly


@dataclass(frozen=True)
class Area(ReadOnly):
    """A polygon in the sensor's frame whose sides do not cross."""

    corners: FloatArray  # In order, metres, (K, 2), K >= 3

    @staticmethod
    def rectangle(first_x: float, first_y: float, last_x: float, last_y: float) -> Area:
        """Return the area between two corners, with sides along the axes."""
        across = [[first_x, first_y], [last_x, first_y], [last_x, last_y], [first_x, last_y]]
        return Area(np.array(across))

    @cached_property
    def signed_size(self) -> float:
        """Size, square metres; negative if the corners are in clockwise order."""
        (x, y), (next_x, next_y) = self.corners.T, np.roll(self.corners, -1, axis=0).T
        return 0.5 * float((x * next_y - next_x * y).sum())

    @cached_property
    def bounds(self) -> FloatArray:
        """The least and the largest coordinates, [axis, end], (2, 2)."""
        return np.stack([self.corners.min(axis=0), self.corners.max(axis=0)], axis=1)

    @cached_property
    def is_rectangle(self) -> bool:
        """Whether the sides are four and along the axes."""
        sides = np.roll(self.corners, -1, axis=0) - self.corners
        return len(sides) == 4 and bool((np.count_nonzero(sides, axis=1) == 1).all())

    def probability(self, place: FloatArray, std: FloatArray | None = None) -> FloatArray:
        """Return the probability that places are inside, (N,), given their means, (N, 2).

        `std` has the standard deviations of their independent coordinates, positive, (N, 2); None
        if the places are certain.

        Notes
        -----
        By Green's theorem the integral of the density over the polygon is that of
        Phi((x - m_x) / s_x) phi((y - m_y) / s_y) / s_y dy along its sides. Along a side x is linear
        in v = (y - m_y) / s_y, and the integral of Phi(a + b v) phi(v) up to v is the bivariate
        normal distribution at (a / sqrt(1 + b^2), v) with the correlation -b / sqrt(1 + b^2).
        """
        if std is None:
            return self._contains(place)
        if self.is_rectangle:
            (low, high) = (ndtr((end - place) / std) for end in self.bounds.T)
            inside: FloatArray = (high - low).prod(axis=1)
            return inside
        (x, y), (sigma_x, sigma_y) = place.T[:, :, None], std.T[:, :, None]
        begin, end = self.corners, np.roll(self.corners, -1, axis=0)
        sloping = begin[:, 1] != end[:, 1]
        begin, end = begin[sloping], end[sloping]
        first, last = ((side[:, 1] - y) / sigma_y for side in (begin, end))
        slope = (end[:, 0] - begin[:, 0]) / (end[:, 1] - begin[:, 1]) * sigma_y / sigma_x
        root = np.sqrt(1.0 + slope**2)
        height = ((begin[:, 0] - x) / sigma_x - slope * first) / root
        sides = _below(height, last, -slope / root, root)
        sides -= _below(height, first, -slope / root, root)
        total: FloatArray = np.sign(self.signed_size) * sides.sum(axis=1)
        return np.minimum(np.maximum(total, 0.0), 1.0)

    def _contains(self, place: FloatArray) -> FloatArray:
        """Return 1 for each place inside, 0 otherwise, (N,)."""
        if self.is_rectangle:
            low, high = self.bounds.T
            inside: FloatArray = ((place >= low) & (place <= high)).all(axis=1).astype(np.float64)
            return inside
        begin, end = self.corners, np.roll(self.corners, -1, axis=0)
        x, y = place.T[:, :, None]
        between = (begin[:, 1] > y) != (end[:, 1] > y)
        rise = end[:, 1] - begin[:, 1]
        share = (y - begin[:, 1]) / np.where(rise == 0.0, 1.0, rise)
        right = x < begin[:, 0] + share * (end[:, 0] - begin[:, 0])
        crossed: FloatArray = (between & right).sum(axis=1) % 2.0
        return crossed


def _below(
    one: FloatArray, other: FloatArray, correlation: FloatArray, root: FloatArray
) -> FloatArray:
    """Return the bivariate normal distribution, elementwise, by Owen's T function.

    `root` is 1 / sqrt(1 - correlation^2).

    References
    ----------
    Owen, "Tables for computing bivariate normal probabilities", Annals of Mathematical Statistics
    27(4), 1956.
    """
    # At zero the ratios below are undefined, and the distribution is continuous.
    h, k = (np.where(np.abs(each) < TINY**0.1, TINY**0.1, each) for each in (one, other))
    h, k = np.broadcast_arrays(h, k)
    below: FloatArray = 0.5 * (ndtr(h) + ndtr(k))
    below -= owens_t(h, (k / h - correlation) * root) + owens_t(k, (h / k - correlation) * root)
    return below - np.where(h * k > 0.0, 0.0, 0.5)


def farthest(area: Area, position: tuple[float, float] = (0.0, 0.0)) -> float:
    """Return the distance of an area's farthest corner from a place, metres."""
    return max(math.dist(corner, position) for corner in area.corners.tolist())
