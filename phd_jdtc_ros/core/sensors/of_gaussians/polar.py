"""Measurements of Gaussians in range and azimuth, compiled; see `linearised` for other sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import TINY, BoolArray, FloatArray, IntArray, frozen, read_only
from ...compilation import Float3, Float4, compiled, inner
from ...types import FULL_TURN, Detections
from ..point_gate import candidate_count
from ..polar_geometry import MIN_RANGE
from . import polar_gate
from .angles import angle_of
from .linearised import (
    LEAST_STD,
    NO_TIMES,
    Expected,
    Linearised,
    Measured,
    Pairs,
    Readings,
    WeightedGaussians,
)
from .polar_gate import Plots, Radar

# With a larger standard deviation of the azimuth, a Gaussian is so near to the radar that neither
# azimuth nor range is normal, radians.
LARGEST_AZIMUTH_STD = 0.5


@dataclass(frozen=True)
class PolarGaussians(Linearised):
    """Measurements of Gaussians by a polar radar; see `Linearised` for the parameters."""

    pose: FloatArray  # Position of the radar, and the cosine and the sine of its yaw, (4,)
    max_range: float  # Largest range of a detection, metres

    @cached_property
    def _radar(self) -> Radar:
        axes = read_only(self.sensor.space.planar_axes, np.int64)
        return Radar(float(self.max_range), axes, read_only(self.pose))

    def expected(self, mean: FloatArray, covariance: FloatArray) -> Expected:
        """Return the expected measurements of Gaussians."""
        return frozen(_expected_measurements(self._radar, mean, covariance))

    def candidate_count(self, predicted: FloatArray, detections: Detections) -> int:
        """Return the number of candidate pairs; see `point_gate.candidate_count`."""
        return candidate_count(predicted, detections, self.sensor.noise_std)

    def is_nearly_normal(self, std: FloatArray) -> BoolArray:
        """Return whether (range, azimuth) of Gaussians are nearly normal; see `Linearised`."""
        normal: BoolArray = std[:, 1] < LARGEST_AZIMUTH_STD
        return normal

    def gate_pairs(
        self, weight: FloatArray, mean: FloatArray, expected: Expected, report: Readings
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs of hypotheses and detections in a gate, and their log likelihoods."""
        detections = report.detections
        turn = detections.measurement[:, 1] % FULL_TURN
        order, noise_std = turn.argsort(kind="stable"), self.gate_ratio * report.detection_std
        plots = _plots(Measured(detections.measurement, noise_std, time_s=detections.time_s))
        return polar_gate.gate(self._radar, weight, mean, expected, plots, turn[order], order)

    def innovations(
        self, gaussians: WeightedGaussians, measured: Measured, pairs: Pairs
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the columns of `kalman.Innovation`; errors are taken as independent."""
        return _innovations(pairs, self._radar, gaussians, _plots(measured))


def _plots(measured: Measured) -> Plots:
    """Return measurements as compiled functions take them."""
    times = NO_TIMES if measured.time_s is None else measured.time_s
    return frozen(Plots(measured.measurement, measured.noise_std, times))


@compiled
def _expected_measurements(radar: Radar, mean: Float3, covariance: Float4) -> Expected:
    """Return the results of `PolarGaussians.expected`."""
    axes, pose = radar.axes, radar.pose
    count, modes = mean.shape[:2]
    measured, spread = np.empty((count, modes, 2)), np.empty((count, modes, 2, 2))
    std = np.empty((count, modes, 2))
    x, y = axes[0], axes[1]
    sensor_x, sensor_y, cos, sin = pose[0], pose[1], pose[2], pose[3]
    for row in range(count):
        for mode in range(modes):
            east, north = mean[row, mode, x] - sensor_x, mean[row, mode, y] - sensor_y
            ahead, left = cos * east + sin * north, cos * north - sin * east
            distance = max(math.sqrt(ahead * ahead + left * left), MIN_RANGE)
            measured[row, mode, 0], measured[row, mode, 1] = distance, math.atan2(left, ahead)
            j, k = east / distance, north / distance
            n, m = -k / distance, j / distance
            state_covariance = covariance[row, mode]
            p, q, r = state_covariance[x, x], state_covariance[x, y], state_covariance[y, y]
            spread[row, mode, 0, 0] = j * (p * j + q * k) + k * (q * j + r * k)
            spread[row, mode, 1, 1] = n * (p * n + q * m) + m * (q * n + r * m)
            cross = j * (p * n + q * m) + k * (q * n + r * m)
            spread[row, mode, 0, 1] = spread[row, mode, 1, 0] = cross
            for axis in range(2):
                variance = spread[row, mode, axis, axis]
                std[row, mode, axis] = max(math.sqrt(max(variance, 0.0)), LEAST_STD)
    return Expected(measured, spread, std)


@inner
def _position_covariance(
    covariance: FloatArray, gaussian: int, axes: IntArray, time: float
) -> tuple[float, float, float]:
    """Return the covariance of a position some seconds after the stamp: xx, xy and yy."""
    x, y, vx, vy = axes[0], axes[1], axes[2], axes[3]
    p, q, r = covariance[gaussian, x, x], covariance[gaussian, x, y], covariance[gaussian, y, y]
    if time != 0.0:
        crossed = covariance[gaussian, x, vy] + covariance[gaussian, vx, y]
        p += time * (2.0 * covariance[gaussian, x, vx] + time * covariance[gaussian, vx, vx])
        q += time * (crossed + time * covariance[gaussian, vx, vy])
        r += time * (2.0 * covariance[gaussian, y, vy] + time * covariance[gaussian, vy, vy])
    return p, q, r


@compiled
def _innovations(
    pairs: Pairs, radar: Radar, gaussians: WeightedGaussians, plots: Plots
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the results of `PolarGaussians.innovations`."""
    (group, column, modes, iterations, converged), (_, axes, pose) = pairs, radar
    (mean, covariance, weight), (measurement, noise_std, time_s) = gaussians, plots
    count = len(group) * modes
    jacobian, inverse = np.zeros((count, 2, 2)), np.zeros((count, 2, 2))
    weighted, log_likelihood = np.zeros((count, 2)), np.full(count, -np.inf)
    x, y, vx, vy = axes[0], axes[1], axes[2], axes[3]
    radar_x, radar_y, cos, sin = pose[0], pose[1], pose[2], pose[3]
    # The directions of the measurements, from east: their angles from a line are small, so that
    # most pairs need no arctangent.
    to_east, to_north = np.empty(len(measurement)), np.empty(len(measurement))
    for z in range(len(measurement)):
        ahead, left = math.cos(measurement[z, 1]), math.sin(measurement[z, 1])
        to_east[z], to_north[z] = cos * ahead - sin * left, sin * ahead + cos * left
    for row in range(count):
        pair = row // modes
        gaussian, z = group[pair] * modes + row % modes, column[pair]
        if gaussian < 0 or not weight[gaussian] > 0.0:
            continue
        time = time_s[z] if len(time_s) else 0.0
        # Positions are relative to the radar.
        prior_x = mean[gaussian, x] + time * mean[gaussian, vx] - radar_x
        prior_y = mean[gaussian, y] + time * mean[gaussian, vy] - radar_y
        p, q, r = _position_covariance(covariance, gaussian, axes, time)
        noise_range, noise_azimuth = noise_std[z, 0] ** 2, noise_std[z, 1] ** 2
        tolerance = converged * noise_std[z, 0]
        east, north = prior_x, prior_y
        nearness, inverse_square, a, b, d, determinant, scale = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        range_error, azimuth_error, range_weight, azimuth_weight = 0.0, 0.0, 0.0, 0.0
        last_x, last_y = east, north
        for _ in range(iterations):
            # The Jacobian's rows are (x, y) / distance and (-y, x) / distance^2; those factors come
            # last, so that divisions and roots are computed at the same time as the rest.
            square = max(east * east + north * north, MIN_RANGE**2)
            inverse_square, distance = 1.0 / square, math.sqrt(square)
            nearness = distance * inverse_square
            along_x, along_y = p * east + q * north, q * east + r * north
            across_x, across_y = q * east - p * north, r * east - q * north
            a = (east * along_x + north * along_y) * inverse_square + noise_range
            b = (east * across_x + north * across_y) * (inverse_square * nearness)
            d = (east * across_y - north * across_x) * inverse_square**2 + noise_azimuth
            shift_x, shift_y = east - prior_x, north - prior_y
            range_error = measurement[z, 0] - distance
            range_error += (east * shift_x + north * shift_y) * nearness
            azimuth_error = (east * shift_y - north * shift_x) * inverse_square + angle_of(
                east * to_east[z] + north * to_north[z], east * to_north[z] - north * to_east[z]
            )
            determinant = max(a * d - b * b, TINY)
            scale = 1.0 / determinant
            range_weight = (d * range_error - b * azimuth_error) * scale
            azimuth_weight = (a * azimuth_error - b * range_error) * scale
            along, across = range_weight * nearness, azimuth_weight * inverse_square
            last_x, last_y = east, north
            east = prior_x + along_x * along + across_x * across
            north = prior_y + along_y * along + across_y * across
            if max(abs(east - last_x), abs(north - last_y)) < tolerance:
                break
        jacobian[row, 0, 0], jacobian[row, 0, 1] = last_x * nearness, last_y * nearness
        jacobian[row, 1, 0] = -last_y * inverse_square
        jacobian[row, 1, 1] = last_x * inverse_square
        inverse[row, 0, 0], inverse[row, 1, 1] = d * scale, a * scale
        inverse[row, 0, 1] = inverse[row, 1, 0] = -b * scale
        weighted[row, 0], weighted[row, 1] = range_weight, azimuth_weight
        square = range_error * range_weight + azimuth_error * azimuth_weight
        log_likelihood[row] = -0.5 * (square + math.log(determinant)) - math.log(2.0 * math.pi)
    return jacobian, weighted, inverse, log_likelihood
