"""Coverage of a radar: its field of view, and the detection probability by range."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ndtr

from ..arrays import FloatArray, IntArray, wrap_angle
from ..types import FULL_TURN, Coverage

WHOLE_TURN = Coverage(-np.pi, FULL_TURN)
# Tolerance with which a sector counts as a whole revolution, radians: degrees in files are rounded.
TURN_TOLERANCE = 1e-9
# A larger standard deviation makes an azimuth practically uniform, radians.
WIDEST_STD = np.pi
# Standard deviations beyond which a normal density has no mass.
FARTHEST = 8.0
# Component of a measurement in space.
ELEVATION = 2
# Smallest probability of the range limits by which an expected value is divided.
LEAST_INSIDE = 1e-9


def sector_probability(
    azimuth: FloatArray, sector: Coverage, azimuth_std: FloatArray | float | None = None
) -> FloatArray:
    """Return the probability that an azimuth of normal density is inside a sector, elementwise.

    The standard deviations are positive; None if the azimuths are certain. A target near the edge
    of a sector is reported in it or in the next one by chance.
    """
    if sector.width > FULL_TURN - TURN_TOLERANCE:
        return np.ones_like(azimuth)
    if azimuth_std is None:
        offset = np.mod(azimuth - sector.start, FULL_TURN)
        return (offset <= sector.width).astype(np.float64)
    half, std = 0.5 * sector.width, np.minimum(azimuth_std, WIDEST_STD)
    offset = wrap_angle(azimuth - sector.start - half)
    share: FloatArray = ndtr((offset + half) / std) - ndtr((offset - half) / std)
    if half + FARTHEST * np.maximum.reduce(std, axis=None, initial=0.0) > np.pi:
        for shifted in (offset - FULL_TURN, offset + FULL_TURN):
            share += ndtr((shifted + half) / std) - ndtr((shifted - half) / std)
    return share


@dataclass(frozen=True)
class Visibility:
    """A radar's field of view, and its detection probability if it is given."""

    max_range: float  # Largest range at which targets are detected, metres
    min_range: float = 0.0  # Smallest range, metres: detections are rejected below
    fov: Coverage = WHOLE_TURN  # Azimuths of the field of view
    # Lowest and highest elevation in space, radians; not used in the plane.
    elevations: tuple[float, float] | None = None
    blind: tuple[Coverage, ...] = ()  # Obstructed azimuths within the field of view
    # Ranges at which the detection probability is given, metres. It is linear between them, and
    # constant outside; empty if it follows from the classes' signal-to-noise ratios.
    ranges: tuple[float, ...] = ()
    probabilities: tuple[float, ...] = ()  # Detection probability at each of `ranges`

    def probability(self, distance: FloatArray, std: FloatArray | None = None) -> FloatArray:
        """Return the given detection probability at expected ranges, (N,).

        With standard deviations of the ranges, (N,), the result is the mean over the part of each
        normal density that is within the range limits.
        """
        if std is None or len(self.probabilities) == 1:
            return np.interp(distance, self.ranges, self.probabilities)
        edges, level, slope = self._parts
        # The normal distribution and density at the edges; over a part, the mean of the deviation
        # is minus the variance times the difference of the density.
        offset = distance[:, None] - edges
        normal = -offset / std[:, None]
        below, density = ndtr(normal), np.exp(-0.5 * normal**2) / np.sqrt(2.0 * np.pi)
        share = below[:, 1:] - below[:, :-1]
        mean = (level[:-1] + slope * offset[:, :-1]) * share
        mean -= slope * std[:, None] * (density[:, 1:] - density[:, :-1])
        inside, total = share.sum(axis=1), mean.sum(axis=1)
        is_inside = inside > LEAST_INSIDE
        if is_inside.all():
            expected: FloatArray = total / inside
            return expected
        nearest = np.interp(distance, self.ranges, self.probabilities)
        return np.where(is_inside, total / np.where(is_inside, inside, 1.0), nearest)

    @cached_property
    def _parts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Edges of the ranges with a linear probability, its value at each edge, and its slopes."""
        edges = np.array(self.ranges)
        edges = edges[(edges > self.min_range) & (edges < self.max_range)]
        edges = np.concatenate([[self.min_range], edges, [self.max_range]])
        level = np.interp(edges, self.ranges, self.probabilities)
        return edges, level, np.diff(level) / np.diff(edges)

    def probability_in_view(
        self, measured: FloatArray, std: FloatArray | None = None
    ) -> FloatArray:
        """Return the probability that targets are in the field of view, (N,).

        `measured` has expected ranges and azimuths, (N, 2), and `std` their standard deviations;
        without these the result is 1 or 0. The range and the azimuth are taken as independent,
        which matters only near a corner of the field of view.
        """
        distance, azimuth = measured[:, 0], measured[:, 1]
        if std is None:
            inside = (distance >= self.min_range) & (distance <= self.max_range)
            certain = inside.astype(np.float64)
            return certain if self._arcs is None else certain * self._clear(azimuth)
        probability: FloatArray = ndtr((self.max_range - distance) / std[:, 0])
        if self.min_range > 0.0:
            probability -= ndtr((self.min_range - distance) / std[:, 0])
        if self._arcs is not None:
            probability *= np.sum(
                [sector_probability(azimuth, arc, std[:, 1]) for arc in self._arcs], 0
            )
        return probability

    def probability_of_elevation(
        self, elevation: FloatArray, std: FloatArray | None = None
    ) -> FloatArray:
        """Return the probability that expected elevations are in the field of view, (N,)."""
        low, high = self.elevations or (-np.inf, np.inf)
        if std is None:
            return ((elevation >= low) & (elevation <= high)).astype(np.float64)
        inside: FloatArray = ndtr((high - elevation) / std) - ndtr((low - elevation) / std)
        return inside

    @property
    def clear_share(self) -> float:
        """Share of the field of view's azimuths that are not obstructed."""
        if not self.blind:
            return 1.0
        return sum(arc.width for arc in self._arcs or ()) / self.fov.width

    @cached_property
    def limits(self) -> tuple[IntArray, FloatArray]:
        """Intervals of the components within the field of view; see `Sensor.limits`.

        Azimuths are those of three revolutions, so that each is inside at any multiple of a
        revolution; there are no intervals if all azimuths are clear.
        """
        nearest = self.min_range if self.min_range > 0.0 else -np.inf
        sides = np.array([(arc.start, arc.start + arc.width) for arc in self._arcs or ()])
        turns = FULL_TURN * np.arange(-2.0, 1.0)
        azimuths = (sides.reshape(-1, 1, 2) + turns[:, None]).reshape(-1, 2)
        intervals = np.concatenate([[[nearest, self.max_range]], azimuths])
        component = np.minimum(np.arange(len(intervals)), 1)
        if self.elevations is None:
            return component, intervals
        return np.append(component, ELEVATION), np.concatenate([intervals, [self.elevations]])

    def _clear(self, azimuth: FloatArray) -> FloatArray:
        """Return 1 for each azimuth in the field of view and not obstructed, 0 otherwise."""
        clear = sector_probability(azimuth, self.fov)
        for sector in self.blind:
            clear *= 1.0 - sector_probability(azimuth, sector)
        return clear

    @cached_property
    def _arcs(self) -> tuple[Coverage, ...] | None:
        """The clear azimuths as arcs that do not overlap; None if all are clear."""
        if not self.blind and self.fov.width > FULL_TURN - TURN_TOLERANCE:
            return None
        sides = [(arc.start, arc.start + arc.width) for arc in (self.fov, *self.blind)]
        edges = np.unique(np.mod(sides, FULL_TURN))
        width = np.mod(np.roll(edges, -1) - edges, FULL_TURN)
        is_clear = (width > 0.0) & (self._clear(edges + 0.5 * width) > 0.0)
        return tuple(Coverage(*each) for each in zip(edges[is_clear], width[is_clear], strict=True))
