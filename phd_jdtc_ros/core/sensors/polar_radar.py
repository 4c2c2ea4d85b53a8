"""The polar radar: geometry, noise, field of view and detection probability."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from ..arrays import FloatArray, IntArray, read_only, wrap_angle
from ..types import Detections
from . import point_gate, polar_geometry
from .gaussians import PlanePlots
from .of_gaussians.linearised import Linearised
from .polar_geometry import MIN_RANGE
from .range_rate import RangeRateModel, Rates, Velocities, rates_of
from .sensor import Sensor
from .site import HeightProjection
from .visibility import Visibility


def linearise(
    position: FloatArray, origin: Sequence[float] | FloatArray, yaw: float | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the measurements of positions, (..., 2), and their derivatives by the position.

    Measurements are (range, azimuth), and `origin` and `yaw` are as in `polar_geometry`. Every
    position may have its own radar: `origin` is then (..., 2), and `yaw` (...).
    """
    line = position - np.asarray(origin)
    east, north = line[..., 0], line[..., 1]
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, left = cos * east + sin * north, cos * north - sin * east
    distance = np.maximum(np.sqrt(ahead**2 + left**2), MIN_RANGE)
    along, across = east / distance, north / distance
    measured, jacobian = np.empty(position.shape), np.empty((*position.shape, 2))
    measured[..., 0], measured[..., 1] = distance, np.arctan2(left, ahead)
    jacobian[..., 0, 0], jacobian[..., 0, 1] = along, across
    jacobian[..., 1, 0], jacobian[..., 1, 1] = -across / distance, along / distance
    return measured, jacobian


@dataclass(frozen=True, kw_only=True)
class RadarModel(Sensor):
    """A radar that measures range and azimuth; see `Sensor` for the common parameters.

    Sec. V, observation equation. Deviation: the arctangent has four quadrants, and innovations are
    wrapped.
    """

    components: ClassVar[tuple[str, ...]] = ("range", "azimuth")
    least_std: tuple[float, ...] = (0.01, 1e-5)

    range_std: float  # Standard deviation of ranges, metres
    azimuth_std: float  # Standard deviation of azimuths, radians
    visibility: Visibility  # Field of view, and detection probability if it is given
    # Model of its range rates; None if it has none, or if they are not used.
    range_rate: RangeRateModel | None = None
    # Projection of its detections to the plane, given their heights; None if the measurements do
    # not depend on heights.
    height_projection: HeightProjection | None = None

    def with_scaled_noise(self, of_std: FloatArray) -> RadarModel:
        """Return the radar with deviations of its noise multiplied by factors; see `Sensor`."""
        in_range, in_azimuth, of_rate = of_std.tolist()
        scaled = self.changed(
            range_std=in_range * self.range_std, azimuth_std=in_azimuth * self.azimuth_std
        )
        own = self.range_rate
        if own is None or of_rate == 1.0:
            return scaled
        return scaled.changed(range_rate=replace(own, std=of_rate * own.std))

    @cached_property
    def of_gaussians(self) -> Linearised:
        """Its measurements of Gaussians, compiled.

        The compiled functions are loaded here, because reading and writing reports needs none.
        """
        from .of_gaussians.polar import PolarGaussians

        pose = np.array([*self.position, math.cos(self.yaw), math.sin(self.yaw)])
        return PolarGaussians(self, pose, self.max_range)

    @property
    def max_range(self) -> float:
        """Largest range, metres: targets are not detected and detections are rejected beyond."""
        return self.visibility.max_range

    def measure(self, state: FloatArray) -> FloatArray:
        """Return noise-free (range, azimuth) of each state; shape (N, D) to (N, 2)."""
        position = state[:, list(self.space.position)]
        return polar_geometry.measure(position, self.position, self.yaw)

    def linearise(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (range, azimuth) of positions and Jacobians; see `linearise`."""
        return linearise(position, self.position, self.yaw)

    def range_rate_of(self, state: FloatArray, time_s: FloatArray | None = None) -> FloatArray:
        """Return the noise-free range rate of each state, m/s; shape (N, D) to (N,).

        `time_s` has the time of each measurement relative to the stamp of the states, seconds,
        (N,).
        """
        velocity = state[:, list(self.space.motion)]
        origin, own_velocity = self.origin
        line = state[:, list(self.space.place)] - origin
        if time_s is not None:
            line = line + time_s[:, None] * velocity
        distance = np.maximum(np.sqrt((line**2).sum(axis=1)), MIN_RANGE)
        radial: FloatArray = (line * (velocity - own_velocity)).sum(axis=1) / distance
        return radial

    def motion_of(self, detections: Detections) -> Rates | Velocities | None:
        """Return the range rates of detections; None without usable ones."""
        return rates_of(self.range_rate, detections)

    def wrap(self, error: FloatArray) -> FloatArray:
        """Return differences of (range, azimuth) with wrapped azimuths; (..., 2)."""
        wrapped: FloatArray = error.copy()
        wrapped[..., 1] = wrap_angle(error[..., 1])
        return wrapped

    def to_world(self, measurement: FloatArray) -> FloatArray:
        """Return world (x, y) in metres of (range, azimuth) rows; shape (M, 2)."""
        return polar_geometry.to_plane(measurement, self.position, self.yaw)

    def in_plane(self, detections: Detections) -> PlanePlots:
        """Return detections as positions with covariances, at their own times."""
        measured, std = detections.measurement, self.noise_std_of(detections)
        bearing, sides = measured[:, 1] + self.yaw, std.copy()
        sides[:, 1] *= np.maximum(measured[:, 0], MIN_RANGE)
        # The errors are along the line of sight and across it.
        axes = np.empty((len(measured), 2, 2))
        axes[:, 0, 0] = axes[:, 1, 1] = np.cos(bearing)
        axes[:, 1, 0] = np.sin(bearing)
        axes[:, 0, 1] = -axes[:, 1, 0]
        return PlanePlots(self.to_world(measured), axes, sides)

    def log_jacobian(self, measured: FloatArray) -> FloatArray:
        """Return log |dz/dp| at (range, azimuth), the log of one over the range; shape (N,)."""
        return -np.log(np.maximum(measured[:, 0], MIN_RANGE))

    @cached_property
    def noise_std(self) -> FloatArray:
        """Standard deviations of (range, azimuth), shape (2,)."""
        std: FloatArray = read_only([self.range_std, self.azimuth_std])
        return std

    def gated_pairs(
        self, predicted: FloatArray, detections: Detections
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs of points and detections in the gate; see `point_gate.gated_pairs`."""
        return point_gate.gated_pairs(predicted, detections, self.noise_std_of(detections))


def polar_radars(sensors: Iterable[Sensor]) -> tuple[RadarModel, ...]:
    """Return the sensors as polar radars, for functions that support only these.

    Raise `TypeError` if a sensor is not a polar radar.
    """
    radars = []
    for sensor in sensors:
        if not isinstance(sensor, RadarModel):
            raise TypeError(f"{sensor.name}: {type(sensor).__name__} given, must be a polar radar")
        radars.append(sensor)
    return tuple(radars)
