"""Fields of view: where a sensor detects targets, how probably, and its uniform clutter there."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ndtr

from ..arrays import TINY, BoolArray, FloatArray, IntArray, wrap_angle
from ..types import FULL_TURN, Coverage, Detections
from .point_gate import DETECTION_GATE_SIGMA
from .polar_geometry import MIN_RANGE

WHOLE_TURN = Coverage(-np.pi, FULL_TURN)
# Tolerance with which a sector counts as a whole revolution, radians: degrees in files are rounded.
TURN_TOLERANCE = 1e-9
# A larger standard deviation makes an azimuth practically uniform, radians.
WIDEST_STD = np.pi
# Standard deviations beyond which a normal density has no mass.
FARTHEST = 8.0
# Component of a measurement in space, and the smallest standard deviation of an expected one,
# radians.
ELEVATION, LEAST_ELEVATION_STD = 2, 1e-6


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


class FieldOfView(ABC):
    """Where a sensor detects targets, and how probably; by default in all reports.

    Measurements have shape (N, Z). Standard deviations of expected measurements, (N, Z), are
    without the sensor's noise; they are None if the measurements are certain.
    """

    @property
    @abstractmethod
    def size(self) -> float:
        """Size in measurement units; undetected targets are uniform in it."""

    @property
    def limits(self) -> tuple[IntArray, FloatArray]:
        """Intervals of components of a measurement in which targets are detected, (I, 2).

        The first array has the component of each, ascending, (I,). There are none if no component
        has limits.
        """
        return np.zeros(0, np.int64), np.zeros((0, 2))

    @abstractmethod
    def probability_in_view(
        self, measured: FloatArray, std: FloatArray | None = None
    ) -> FloatArray:
        """Return the probability that targets are in the field of view, (N,)."""

    def coverage_probability(
        self,
        measured: FloatArray,
        sector: Coverage | None,
        noise: FloatArray,
        std: FloatArray | None = None,
    ) -> FloatArray:
        """Return the probability that a report covers targets, (N,); only these can be missed.

        `sector` is that of the report, None for a whole one; for `noise` see
        `probability_in_sector`.
        """
        covered = self.probability_in_view(measured, std)
        if sector is not None:
            covered *= self.probability_in_sector(measured, sector, noise, std)
        return covered

    def probability_in_sector(
        self, measured: FloatArray, sector: Coverage, noise: FloatArray, std: FloatArray | None
    ) -> FloatArray:
        """Return the probability that targets in the field of view are measured in a sector, (N,).

        `noise` has the standard deviations of the sensor's noise, (Z,).
        """
        return np.ones(len(measured))

    def may_be_swept(
        self, measured: FloatArray, radius: FloatArray, noise: FloatArray, report: Detections
    ) -> BoolArray:
        """Return a mask of the circles that the antenna may have swept for a report, (N,).

        `measured` has the measurements of their centres, and `radius` is in metres, (N,). For
        `noise` see `probability_in_sector`.
        """
        return np.ones(len(measured), dtype=np.bool_)

    def of(self, report: Detections) -> FieldOfView:
        """Return the field of view that a report had."""
        return self

    @property
    @abstractmethod
    def largest_probability(self) -> float | None:
        """Largest configured p_D of covered targets; None if p_D follows from the SNR."""

    @abstractmethod
    def detection_probability(
        self, measured: FloatArray, std: FloatArray | None = None
    ) -> FloatArray | None:
        """Return the configured p_D of covered targets, (N,); None if it follows from the SNR."""

    @abstractmethod
    def place(self, measured: FloatArray) -> FloatArray:
        """Return ranges and azimuths of measurements from the sensor's position, (N, 2)."""

    @property
    def clutter_share(self) -> float:
        """Share of the uniform clutter that is among the detections; above 0."""
        return 1.0

    @abstractmethod
    def log_clutter(self, rate: float) -> float:
        """Return the log intensity of uniform false detections, in measurement units.

        `rate` is their expected number in the field of view; see `Sensor.clutter_rate`.
        """


@dataclass(frozen=True)
class Visibility(FieldOfView):
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
    # Largest range of the clutter, metres; 0 for `max_range`.
    clutter_max_range: float = 0.0
    # Ranges at which the relative density of false detections is given, metres. It is linear
    # between them, and constant outside; empty if it is uniform.
    clutter_ranges: tuple[float, ...] = ()
    clutter_density: tuple[float, ...] = ()  # Density at each of `clutter_ranges`

    @property
    def size(self) -> float:
        """Size, radians times metres, and in space times radians."""
        return self.fov.width * self.max_range * self.elevation_width

    @property
    def largest_probability(self) -> float | None:
        """Largest configured p_D, at any range; None if p_D follows from the SNR."""
        return max(self.probabilities, default=None)

    def detection_probability(
        self, measured: FloatArray, std: FloatArray | None = None
    ) -> FloatArray | None:
        """Return the configured p_D at (range, azimuth), (N,); see `FieldOfView`."""
        if not self.probabilities:
            return None
        return self.probability(measured[:, 0], None if std is None else std[:, 0])

    def place(self, measured: FloatArray) -> FloatArray:
        """Return the ranges and azimuths of measurements, (N, 2)."""
        return measured[:, :ELEVATION]

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
        # Smallest probability of the range limits by which an expected value is divided.
        least_inside = 1e-9
        is_inside = inside > least_inside
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

        `measured` has expected ranges, azimuths and, in space, elevations, (N, Z), and `std` their
        standard deviations; without these the result is 1 or 0. The components are taken as
        independent, which matters only near a corner of the field of view.
        """
        probability = self._probability_in_plane(measured, std)
        if measured.shape[1] == ELEVATION:
            return probability
        low, high = self.elevation_limits
        elevation = measured[:, ELEVATION]
        if std is None:
            return probability * ((elevation >= low) & (elevation <= high))
        deviation = np.maximum(std[:, ELEVATION], LEAST_ELEVATION_STD)
        inside = ndtr((high - elevation) / deviation) - ndtr((low - elevation) / deviation)
        covered: FloatArray = probability * inside
        return covered

    def _probability_in_plane(self, measured: FloatArray, std: FloatArray | None) -> FloatArray:
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

    @property
    def elevation_limits(self) -> tuple[float, float]:
        """Lowest and highest elevation of the field of view in space, radians."""
        return self.elevations or (-0.5 * math.pi, 0.5 * math.pi)

    @property
    def elevation_width(self) -> float:
        """Width of the elevations of the field of view, radians; 1 in the plane."""
        return 1.0 if self.elevations is None else self.elevations[1] - self.elevations[0]

    def probability_in_sector(
        self, measured: FloatArray, sector: Coverage, noise: FloatArray, std: FloatArray | None
    ) -> FloatArray:
        """Return the probability that targets are measured in a sector, (N,).

        A plot belongs to the sector of its measured azimuth.
        """
        of_azimuth = noise[1]
        measured_std = of_azimuth if std is None else np.hypot(std[:, 1], of_azimuth)
        return sector_probability(measured[:, 1], sector, measured_std)

    def may_be_swept(
        self, measured: FloatArray, radius: FloatArray, noise: FloatArray, report: Detections
    ) -> BoolArray:
        """Return a mask of the circles that the antenna may have swept for a report, (N,).

        It swept the coverage of the report, and the azimuths of its detections themselves; without
        a coverage the field of view.
        """
        distance, azimuth = np.maximum(measured[:, 0], MIN_RANGE), measured[:, 1]
        margin = np.arcsin(np.minimum(radius / distance, 1.0))
        margin += DETECTION_GATE_SIGMA * noise[1]
        in_reach: BoolArray = radius >= distance
        swept = self.fov if report.coverage is None else report.coverage
        offset = np.mod(azimuth + margin - swept.start, FULL_TURN)
        in_reach |= offset <= swept.width + 2.0 * margin
        if report.coverage is None:
            gate = DETECTION_GATE_SIGMA * noise[0]
            in_reach &= distance - radius <= self.max_range + gate
            in_reach &= distance + radius >= self.min_range - gate
        elif len(report):
            azimuths = np.mod(report.measurement[:, 1], FULL_TURN)
            azimuths.sort()
            first = azimuth - margin
            index = azimuths.searchsorted(np.mod(first, FULL_TURN))
            following = azimuths.take(index, mode="wrap")
            in_reach |= np.mod(following - first, FULL_TURN) <= 2.0 * margin
        return in_reach

    @property
    def clutter_range(self) -> float:
        """Largest range of the uniform clutter, metres."""
        return self.clutter_max_range or self.max_range

    @property
    def clutter_share(self) -> float:
        """Share of the uniform clutter that is neither too near nor obstructed, above 0."""
        far = 1.0 - self.min_range / self.clutter_range
        arcs = (self.fov,) if self._arcs is None else self._arcs
        clear = sum(arc.width for arc in arcs) / self.fov.width if self.blind else 1.0
        # Lower bound of the share of the uniform clutter by which counts of it are divided.
        least_clutter_share = 0.01
        return max(far * clear, least_clutter_share)

    def clutter_of_revolution(self, rate: float) -> float:
        """Return the uniform clutter of a revolution, scaled up from the field of view; above 0."""
        # A rate of zero is allowed; the floor keeps the update's quotient defined.
        return max(rate, TINY) * FULL_TURN / self.fov.width

    def log_clutter(self, rate: float) -> float:
        """Return the log intensity of uniform false detections over measurements."""
        per_area = np.log(self.clutter_of_revolution(rate) / (FULL_TURN * self.clutter_range))
        return float(per_area) - math.log(self.elevation_width)

    @cached_property
    def limits(self) -> tuple[IntArray, FloatArray]:
        """Intervals of the components within the field of view; see `FieldOfView`.

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
