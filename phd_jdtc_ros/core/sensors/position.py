"""A sensor whose detections are places, such as a lidar, a camera or multilateration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.special import ndtr, owens_t

from ..arrays import TINY, FloatArray, IntArray, ReadOnly, read_only
from ..types import Detections
from . import polar_geometry
from .gaussians import HeightPrior, PlanePlots, noise_covariance
from .of_gaussians.linearised import Linearised
from .range_rate import Rates, Velocities, VelocityModel
from .sensor import Sensor
from .visibility import FieldOfView


@dataclass(frozen=True)
class Area(ReadOnly):
    """A polygon in the sensor's frame whose sides do not cross."""

    corners: FloatArray  # In order, metres, (K, 2), K >= 3

    @staticmethod
    def rectangle(first_x: float, first_y: float, last_x: float, last_y: float) -> Area:
        """Return the area between two corners, with sides along the axes."""
        across = [[first_x, first_y], [last_x, first_y], [last_x, last_y], [first_x, last_y]]
        return Area(np.array(across))

    @staticmethod
    def of(given: Sequence[float]) -> Area:
        """Return the rectangle of least and largest x and y, or the polygon of more corners."""
        if len(given) == 4:
            return Area.rectangle(given[0], given[1], given[2], given[3])
        return Area(np.reshape(given, (-1, 2)))

    @cached_property
    def signed_size(self) -> float:
        """Size, square metres; negative if the corners are in clockwise order."""
        (x, y), (next_x, next_y) = self.corners.T, np.roll(self.corners, -1, axis=0).T
        return 0.5 * float((x * next_y - next_x * y).sum())

    @property
    def size(self) -> float:
        """Size, square metres."""
        return abs(self.signed_size)

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


@dataclass(frozen=True)
class WatchedArea(FieldOfView):
    """A field of view that is an area, in which false detections are uniform."""

    area: Area  # To which rates of births and of false detections refer
    probability: float  # Detection probability of targets in the area
    seen: Area | None = None  # What of it, or beyond it, a report covers; None for the area

    def of(self, report: Detections) -> WatchedArea:
        """Return the area that a report covered."""
        return self if report.area is None else replace(self, seen=Area.rectangle(*report.area))

    @property
    def limits(self) -> tuple[IntArray, FloatArray]:
        """The sides of a rectangular area; none of another polygon, which no component limits."""
        area = self.seen or self.area
        return (np.array([0, 1]), area.bounds) if area.is_rectangle else super().limits

    @property
    def size(self) -> float:
        """Size of the area, square metres."""
        return self.area.size

    @property
    def clutter_share(self) -> float:
        """Expected false detections of the report as a share of those in the area."""
        return 1.0 if self.seen is None else self.seen.size / self.size

    def probability_in_view(
        self, measured: FloatArray, std: FloatArray | None = None
    ) -> FloatArray:
        """Return the probability that each target is in the area, (N,); see `FieldOfView`."""
        return (self.seen or self.area).probability(measured, std)

    def detection_probability(
        self, measured: FloatArray, std: FloatArray | None = None
    ) -> FloatArray:
        """Return the detection probability, which is the same everywhere, (N,)."""
        return np.full(len(measured), self.probability)

    @property
    def largest_probability(self) -> float:
        """The detection probability."""
        return self.probability

    def place(self, measured: FloatArray) -> FloatArray:
        """Return ranges and azimuths of measurements from the sensor's position, (N, 2)."""
        return polar_geometry.measure(measured, (0.0, 0.0), 0.0)

    def log_clutter(self, rate: float) -> float:
        """Return the log intensity of uniform false detections per square metre."""
        return math.log(max(rate, TINY) / self.size)


@dataclass(frozen=True, kw_only=True)
class PositionSensor(Sensor):
    """A sensor that measures x and y in its own frame, metres; see `Sensor` for the parameters.

    It detects targets in an area, in which its false detections are uniform. The errors of a
    detection may be correlated, see `Detections.noise_correlation`.
    """

    components: ClassVar[tuple[str, ...]] = ("x", "y")

    # Standard deviations along its axes, metres, of detections without their own.
    std: tuple[float, float]
    visibility: WatchedArea
    velocity_model: VelocityModel | None = None  # None if it measures no velocities
    # Heights of targets of which it reports none; None in the plane. Its measurement is x and y
    # also in space, where a height is `Detections.z`.
    height_prior: HeightPrior | None = None

    def with_scaled_noise(self, of_std: FloatArray) -> PositionSensor:
        """Return the sensor with deviations of its noise multiplied by factors; see `Sensor`."""
        in_x, in_y, _ = of_std.tolist()
        return self.changed(std=(in_x * self.std[0], in_y * self.std[1]))

    @cached_property
    def of_gaussians(self) -> Linearised:
        """Its measurements of Gaussians, compiled; loaded here as those of a polar radar are."""
        from .of_gaussians.planar import PlanarGaussians

        pose = np.array([*self.position, math.cos(self.yaw), math.sin(self.yaw)])
        return PlanarGaussians(self, pose)

    @cached_property
    def noise_std(self) -> FloatArray:
        """Standard deviations of (x, y), (2,)."""
        std: FloatArray = read_only(self.std)
        return std

    @cached_property
    def _rotation(self) -> FloatArray:
        """Rotation from the world frame to the sensor's, (2, 2)."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([[cos, sin], [-sin, cos]])

    def linearise(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the measurements of positions and their Jacobians; see `Sensor`."""
        place = position[..., :2]
        measured = (place - np.asarray(self.position)) @ self._rotation.T
        return measured, np.broadcast_to(self._rotation, (*place.shape, 2))

    def to_world(self, measurement: FloatArray) -> FloatArray:
        """Return the positions of measurements, (M, P), at the mean height in space."""
        position: FloatArray = measurement @ self._rotation + np.asarray(self.position)
        if self.height_prior is None:
            return position
        return np.column_stack([position, np.full(len(position), self.height_prior.mean)])

    def log_jacobian(self, measured: FloatArray) -> FloatArray:
        """Return zeros: areas are the same in both frames."""
        return np.zeros(len(measured))

    def in_plane(self, detections: Detections) -> PlanePlots:
        """Return the detections as positions with covariances, at their own times."""
        turn = self._rotation.T
        std, correlation = self.noise_std_of(detections), detections.noise_correlation
        covariance = turn @ noise_covariance(std, correlation) @ turn.T
        if self.height_prior is not None:
            covariance = np.pad(covariance, ((0, 0), (0, 1), (0, 1)))
            covariance[:, 2, 2] = self.height_prior.std**2
        return PlanePlots.of(self.to_world(detections.measurement), covariance)

    def motion_of(self, detections: Detections) -> Rates | Velocities | None:
        """Return the velocities of detections in the world frame; None without usable ones."""
        model, velocity = self.velocity_model, detections.velocity
        if model is None or velocity is None:
            return None
        std = np.full(velocity.shape, model.std)
        if (reported_std := detections.velocity_std) is not None:
            std = np.where(np.isfinite(reported_std), reported_std, std)
        turn = np.eye(velocity.shape[1])
        turn[:2, :2] = self._rotation.T
        noise = turn @ noise_covariance(std, None) @ turn.T
        return Velocities(model, velocity @ turn.T, noise)
