"""Measurements of Gaussians in range and azimuth, compiled; see `linearised` for other sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...arrays import TINY, FloatArray, IntArray, contiguous
from ...compilation import Float1, Float2, Float3, Float4, Int1, compiled, inner
from ...types import FULL_TURN
from ..polar_geometry import MIN_RANGE
from ..report import Report
from . import polar_gate
from .angles import angle_of
from .linearised import LEAST_STD, Linearised, Measured

# Times of measurements that are all made at the stamp.
NO_TIMES = np.zeros(0)


@dataclass(frozen=True)
class PolarGaussians(Linearised):
    """Measurements of Gaussians by a polar radar; see `Linearised` for the parameters."""

    pose: FloatArray  # Position of the radar, and the cosine and the sine of its yaw, (4,)

    def expected(
        self, mean: FloatArray, covariance: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return expected measurements, their covariances, and standard deviations."""
        axes = self.sensor.space.planar_axes
        return _expected_measurements(mean, covariance, axes, self.pose)

    def gate_pairs(
        self,
        weight: FloatArray,
        mean: FloatArray,
        measured: FloatArray,
        covariance: FloatArray,
        report: Report,
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs of hypotheses and detections in a gate, and their log likelihoods."""
        sensor, detections = self.sensor, report.detections
        measurement, times = detections.measurement, detections.time_s
        turn = measurement[:, 1] % FULL_TURN
        order, noise_std = turn.argsort(kind="stable"), self.gate_ratio * report.detection_std
        return polar_gate.gate(
            *(sensor.max_range, sensor.space.planar_axes, self.pose, mean, measured, covariance),
            *(weight, measurement, noise_std, NO_TIMES if times is None else times),
            *(turn[order], order),
        )

    def innovations(
        self,
        gaussians: tuple[FloatArray, FloatArray, FloatArray],
        measured: Measured,
        pairs: tuple[IntArray, IntArray],
        modes: int,
        iterations: int,
        converged: float,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the columns of `kalman.Innovation`; errors are taken as independent."""
        sensor, times = self.sensor, measured.time_s
        return _innovations(
            *(iterations, converged, modes, sensor.space.planar_axes, self.pose),
            *contiguous(
                *(*gaussians, *pairs, measured.measurement, measured.noise_std),
                NO_TIMES if times is None else times,
            ),
        )


@compiled
def _expected_measurements(
    mean: Float3, covariance: Float4, axes: Int1, pose: Float1
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the results of `PolarGaussians.expected`; for `axes` and `pose` see `_innovations`."""
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
    return measured, spread, std


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
    iterations: int,
    converged: float,
    modes: int,
    axes: Int1,
    pose: Float1,
    mean: Float2,
    covariance: Float3,
    weight: Float1,
    group: Int1,
    column: Int1,
    measurement: Float2,
    noise_std: Float2,
    time_s: Float1,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the results of `PolarGaussians.innovations`.

    `axes` are those of the position and the velocity; `pose` is the radar's position, and the
    cosine and the sine of its yaw.
    """
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
