"""A sensor whose detections are places, such as a lidar, a camera or multilateration."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from ..arrays import TINY, FloatArray, IntArray
from ..types import Coverage, Detections
from .area import Area
from .gaussians import PlanePlots, noise_covariance
from .of_gaussians.linearised import Linearised
from .sensor import Sensor
from .velocity import Velocities, VelocityModel


@dataclass(frozen=True, kw_only=True)
class PositionSensor(Sensor):
    """A sensor that measures x and y in its own frame, metres; see `Sensor` for the parameters.

    It detects targets in an area, in which its false detections are uniform. The errors of a
    detection may be correlated, see `Detections.noise_correlation`.
    """

    components: ClassVar[tuple[str, ...]] = ("x", "y")

    # Standard deviations along its axes, metres, of detections without their own.
    std: tuple[float, float]
    area: Area
    detection_probability: float  # Of targets in the area
    velocity_model: VelocityModel | None = None  # None if it measures no velocities

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

    @property
    def noise_std(self) -> FloatArray:
        """Standard deviations of (x, y), (2,)."""
        return np.array(self.std)

    @cached_property
    def _rotation(self) -> FloatArray:
        """Rotation from the world frame to the sensor's, (2, 2)."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([[cos, sin], [-sin, cos]])

    def linearise(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the measurements of positions and their Jacobians; see `Sensor`."""
        measured = (position - np.asarray(self.position)) @ self._rotation.T
        return measured, np.broadcast_to(self._rotation, (*position.shape, 2))

    def to_world(self, measurement: FloatArray) -> FloatArray:
        """Return the positions of measurements, (M, 2)."""
        position: FloatArray = measurement @ self._rotation + np.asarray(self.position)
        return position

    def log_jacobian(self, measured: FloatArray) -> FloatArray:
        """Return zeros: areas are the same in both frames."""
        return np.zeros(len(measured))

    def in_plane(self, detections: Detections) -> PlanePlots:
        """Return the detections as positions with covariances, at their own times."""
        turn = self._rotation.T
        std, correlation = self.noise_std_of(detections), detections.noise_correlation
        covariance = turn @ noise_covariance(std, correlation) @ turn.T
        return PlanePlots.of(self.to_world(detections.measurement), covariance)

    def velocities_of(self, detections: Detections) -> Velocities | None:
        """Return the velocities of detections in the world frame; None without usable ones."""
        model, velocity = self.velocity_model, detections.velocity
        if model is None or velocity is None:
            return None
        std = np.full(velocity.shape, model.std)
        if (reported_std := detections.velocity_std) is not None:
            std = np.where(np.isfinite(reported_std), reported_std, std)
        turn = self._rotation.T
        noise = turn @ noise_covariance(std, None) @ turn.T
        return Velocities(model, velocity @ self._rotation, noise)

    @property
    def limits(self) -> tuple[IntArray, FloatArray]:
        """The sides of a rectangular area; none of another polygon, which no component limits."""
        if not self.area.is_rectangle:
            return super().limits
        return np.array([0, 1]), self.area.bounds

    @property
    def field_size(self) -> float:
        """Size of the area, square metres."""
        return abs(self.area.signed_size)

    @property
    def largest_detection_probability(self) -> float:
        """The probability that a target in the area is detected."""
        return self.detection_probability

    def coverage_probability(
        self, predicted: FloatArray, coverage: Coverage | None, std: FloatArray | None = None
    ) -> FloatArray:
        """Return the probability that each target is in the area, (N,); see `Sensor`."""
        return self.area.probability(predicted, std)

    def log_uniform_clutter(self, rate: float) -> float:
        """Return the log intensity of uniform false detections per square metre."""
        return math.log(max(rate, TINY) / self.field_size)
