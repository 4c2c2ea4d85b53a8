"""The polar radar: geometry, noise, field of view and detection probability."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from ..arrays import TINY, BoolArray, FloatArray, IntArray, wrap_angle
from ..types import FULL_TURN, Coverage, Detections
from . import polar_gate, polar_geometry
from .gaussians import PlanePlots
from .of_gaussians.linearised import Linearised
from .polar_gate import DETECTION_GATE_SIGMA
from .polar_geometry import MIN_RANGE
from .sensor import Sensor
from .site import HeightProjection
from .visibility import Visibility, sector_probability

# Lower bound of the share of the uniform clutter by which counts of it are divided.
LEAST_CLUTTER_SHARE = 0.01


@dataclass(frozen=True, kw_only=True)
class RadarModel(Sensor):
    """A radar that measures range and azimuth; see `Sensor` for the common parameters.

    Sec. V, observation equation. Deviation: the arctangent has four quadrants, and innovations are
    wrapped.
    """

    components: ClassVar[tuple[str, ...]] = ("range", "azimuth")

    range_std: float  # Standard deviation of ranges, metres
    azimuth_std: float  # Standard deviation of azimuths, radians
    visibility: Visibility  # Field of view, and detection probability if it is given
    clutter_max_range: float  # Largest range of the uniform clutter, metres
    # Projection of its detections to the plane, given their heights; None if the measurements do
    # not depend on heights.
    height_projection: HeightProjection | None = None

    def with_scaled_noise(self, of_std: FloatArray) -> RadarModel:
        """Return the radar with deviations of its noise multiplied by factors; see `Sensor`."""
        in_range, in_azimuth, _ = of_std.tolist()
        scaled = super().with_scaled_noise(of_std)
        return scaled.changed(
            range_std=in_range * self.range_std, azimuth_std=in_azimuth * self.azimuth_std
        )

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

    @property
    def limits(self) -> tuple[IntArray, FloatArray]:
        """Intervals of the ranges and azimuths of its field of view; see `Visibility.limits`."""
        return self.visibility.limits

    @property
    def field_size(self) -> float:
        """Size of its field of view, radians times metres."""
        return self.visibility.fov.width * self.max_range

    def measure(self, state: FloatArray) -> FloatArray:
        """Return noise-free (range, azimuth) of each state; shape (N, D) to (N, 2)."""
        position = state[:, list(self.space.position)]
        return polar_geometry.measure(position, self.position, self.yaw)

    def linearise(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (range, azimuth) of positions and Jacobians; see `polar_geometry.linearise`."""
        return polar_geometry.linearise(position, self.position, self.yaw)

    def range_rate_of(self, state: FloatArray, time_s: FloatArray | None = None) -> FloatArray:
        """Return the noise-free range rate of each state, m/s; shape (N, D) to (N,).

        `time_s` has the time of each measurement relative to the stamp of the states, seconds,
        (N,).
        """
        velocity = state[:, list(self.space.motion)]
        line = state[:, list(self.space.place)] - self.origin
        if time_s is not None:
            line = line + time_s[:, None] * velocity
        distance = np.maximum(np.sqrt((line**2).sum(axis=1)), MIN_RANGE)
        radial: FloatArray = (line * (velocity - self.origin_velocity)).sum(axis=1) / distance
        return radial

    def wrap(self, error: FloatArray) -> FloatArray:
        """Return differences of (range, azimuth) with wrapped azimuths; (..., 2)."""
        wrapped: FloatArray = error.copy()
        wrapped[..., 1] = wrap_angle(error[..., 1])
        return wrapped

    def polar_place(self, measured: FloatArray) -> FloatArray:
        """Return the measurements themselves."""
        return measured

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

    @property
    def noise_std(self) -> FloatArray:
        """Standard deviations of (range, azimuth), shape (2,)."""
        return np.array([self.range_std, self.azimuth_std])

    @property
    def largest_detection_probability(self) -> float | None:
        """Largest configured p_D, at any range; None if p_D follows from the SNR."""
        return max(self.visibility.probabilities, default=None)

    def configured_detection_probability(
        self, measured: FloatArray, std: FloatArray | None = None
    ) -> FloatArray | None:
        """Return the configured p_D at (range, azimuth), (N,); see `Sensor`."""
        if not self.visibility.probabilities:
            return None
        return self.visibility.probability(measured[:, 0], None if std is None else std[:, 0])

    def coverage_probability(
        self, predicted: FloatArray, coverage: Coverage | None, std: FloatArray | None = None
    ) -> FloatArray:
        """Return the probability that a report covers each target, (N,); see `Sensor`."""
        probability = self.visibility.probability_in_view(predicted, std)
        if coverage is not None:
            probability *= self.sector_probability(predicted, coverage, std)
        return probability

    def sector_probability(
        self, predicted: FloatArray, sector: Coverage, std: FloatArray | None = None
    ) -> FloatArray:
        """Return the probability that targets are measured in a sector, (N,); see `Sensor`."""
        azimuth_std = self.azimuth_std
        measured_std = azimuth_std if std is None else np.hypot(std[:, 1], azimuth_std)
        return sector_probability(predicted[:, 1], sector, measured_std)

    def log_uniform_clutter(self, rate: float) -> float:
        """Return the log intensity of uniform false detections over (range, azimuth)."""
        return float(
            np.log(self.clutter_of_revolution(rate) / (FULL_TURN * self.clutter_max_range))
        )

    @property
    def clutter_share(self) -> float:
        """Share of the uniform clutter that is neither too near nor obstructed; see `Sensor`."""
        far = 1.0 - self.visibility.min_range / self.clutter_max_range
        return max(far * self.visibility.clear_share, LEAST_CLUTTER_SHARE)

    def clutter_of_revolution(self, rate: float) -> float:
        """Return the uniform clutter of a revolution, scaled up from the field of view; above 0."""
        # A rate of zero is allowed; the floor keeps the update's quotient defined.
        return max(rate, TINY) * FULL_TURN / self.visibility.fov.width

    def gated_pairs(
        self, predicted: FloatArray, detections: Detections, rate: FloatArray | None = None
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs of points and detections in the gate; see `polar_gate.gated_pairs`."""
        noise_std = None if detections.noise_std is None else self.noise_std_of(detections)
        return polar_gate.gated_pairs(predicted, detections, self.noise_std, noise_std, rate)

    def may_have_swept(
        self, position: FloatArray, radius: FloatArray, detections: Detections
    ) -> BoolArray:
        """Return a mask of the circles that the antenna may have swept for a report, (T,).

        It swept the coverage of the detections, and the azimuths of the detections themselves;
        without a coverage the field of view.
        """
        line = position - self.position
        distance = np.maximum(np.hypot(line[:, 0], line[:, 1]), MIN_RANGE)
        margin = np.arcsin(np.minimum(radius / distance, 1.0))
        margin += DETECTION_GATE_SIGMA * self.azimuth_std
        azimuth = np.arctan2(line[:, 1], line[:, 0]) - self.yaw
        in_reach: BoolArray = radius >= distance
        coverage, field = detections.coverage, self.visibility
        swept = field.fov if coverage is None else coverage
        offset = np.mod(azimuth + margin - swept.start, FULL_TURN)
        in_reach |= offset <= swept.width + 2.0 * margin
        if coverage is None:
            gate = DETECTION_GATE_SIGMA * self.range_std
            in_reach &= distance - radius <= field.max_range + gate
            in_reach &= distance + radius >= field.min_range - gate
        elif len(detections):
            azimuths = np.mod(detections.measurement[:, 1], FULL_TURN)
            azimuths.sort()
            first = azimuth - margin
            index = azimuths.searchsorted(np.mod(first, FULL_TURN))
            following = azimuths.take(index, mode="wrap")
            in_reach |= np.mod(following - first, FULL_TURN) <= 2.0 * margin
        return in_reach


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
