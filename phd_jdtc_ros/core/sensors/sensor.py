"""Base class of sensors: measurements, noise, coverage, positions.

Its subclasses are `polar_radar.RadarModel`, `spatial_radar.SpatialRadar` and
`position.PositionSensor`. The engine, births, the region, the factors and the reporting rule depend
only on this class. A new kind of sensor implements the abstract members; the other ones have
defaults for a sensor that measures without a turning antenna and sees all targets.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, TypeVar

import numpy as np

from ..arrays import FloatArray, ReadOnly
from ..state_space import PLANAR, StateSpace
from ..types import Detections, Pose
from .gaussians import Births, HeavyTails, PlanePlots, ReportedHeights
from .of_gaussians.linearised import Linearised
from .range_rate import Rates, Velocities
from .visibility import FieldOfView

SensorT = TypeVar("SensorT", bound="Sensor")


@dataclass(frozen=True, kw_only=True)
class Sensor(ReadOnly, ABC):
    """A sensor at its pose: its measurements, its noise and its coverage.

    Measurements have shape (..., Z), positions (..., P) and states (..., D). Positions and states
    are in the world frame; a position has the axes `StateSpace.place`, two or three.
    """

    # Names of the components of a measurement.
    components: ClassVar[tuple[str, ...]] = ()

    name: str  # Also the sensor's frame
    position: tuple[float, float]  # In the world frame, metres
    yaw: float  # Direction of the sensor's x axis in the world frame, radians counter-clockwise
    visibility: FieldOfView  # Where it detects targets, and how probably
    threshold: float  # Detection threshold tau on the amplitude
    # Expected uniform false detections in the field of view per revolution of the antenna, or per
    # scan if it does not turn; those at rejected ranges are included.
    clutter_rate: float
    # In the world frame, metres per second; range rates are relative to it.
    velocity: tuple[float, float] = (0.0, 0.0)
    space: StateSpace = PLANAR  # Axes of the measured states
    rotation_s: float = 0.0  # Rotation period of the antenna, seconds; 0 if it does not turn
    # Distance within which detections are merged, metres; 0 for none. See `detection_clusters`.
    cluster_distance: float = 0.0
    # Smallest plausible noise, (Z,), which is never too large; by default that of places, metres.
    least_std: tuple[float, ...] = (0.001, 0.001)
    # Outliers among its measurements; None without any.
    outliers: HeavyTails | None = None
    # Errors of the heights that it reports in space; None if it reports none, and in the plane.
    reported_heights: ReportedHeights | None = None

    def at(self: SensorT, pose: Pose | None) -> SensorT:
        """Return the sensor at a pose; None keeps its pose."""
        if pose is None:
            return self
        return self.changed(position=pose.position, yaw=pose.yaw, velocity=pose.velocity)

    @property
    def pose(self) -> Pose:
        """Its pose at rest."""
        return Pose(self.position, self.yaw)

    @abstractmethod
    def with_scaled_noise(self: SensorT, of_std: FloatArray) -> SensorT:
        """Return the sensor with deviations of its noise multiplied by factors, (Z + 1,).

        The factors are of its components and then of its range rates.
        """

    @property
    def origin(self) -> FloatArray:
        """Its position and its velocity along the axes of `StateSpace.place`, metres, (2, P)."""
        return np.array([self.position, self.velocity])

    @cached_property
    def of_gaussians(self) -> Linearised:
        """Its measurements of Gaussians; a subclass may have compiled ones."""
        return Linearised(self)

    @property
    @abstractmethod
    def noise_std(self) -> FloatArray:
        """Standard deviations of a measurement, (Z,)."""

    @abstractmethod
    def linearise(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the measurements of positions and their Jacobians, (..., Z) and (..., Z, P)."""

    @abstractmethod
    def to_world(self, measurement: FloatArray) -> FloatArray:
        """Return the positions of measurements, (M, Z) to (M, P)."""

    @abstractmethod
    def log_jacobian(self, measured: FloatArray) -> FloatArray:
        """Return log |dz/dp| at measurements: converts their density to one in the plane."""

    @abstractmethod
    def in_plane(self, detections: Detections) -> PlanePlots:
        """Return the detections as positions with covariances, for births and proposals."""

    def places_of_births(self, detections: Detections) -> Births:
        """Return the hypotheses of the places of targets born at detections."""
        births = Births(
            np.arange(len(detections)), np.ones(len(detections)), self.in_plane(detections)
        )
        own = self.reported_heights
        heights = None if own is None else own.of(detections)
        return births if heights is None else heights.divide(births)

    def noise_std_of(self, detections: Detections) -> FloatArray:
        """Return the standard deviations of each detection, its own or the sensor's, (M, Z)."""
        reported_std = detections.noise_std
        usual_std = self.noise_std[None].repeat(len(detections.measurement), axis=0)
        return (
            usual_std
            if reported_std is None
            else np.where(np.isfinite(reported_std), reported_std, usual_std)
        )

    def measure(self, state: FloatArray) -> FloatArray:
        """Return the noise-free measurement of each state, (N, D) to (N, Z)."""
        return self.linearise(state[:, list(self.space.place)])[0]

    def wrap(self, error: FloatArray) -> FloatArray:
        """Return differences of measurements, (..., Z), with wrapped angles."""
        return error

    def motion_of(self, detections: Detections) -> Rates | Velocities | None:
        """Return the measured motion of detections; None without a usable one."""
        return None
