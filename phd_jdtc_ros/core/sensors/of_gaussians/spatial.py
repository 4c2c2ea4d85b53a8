"""Measurements of Gaussians in range, azimuth and elevation, compiled; see `spatial_radar`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ...arrays import TINY, BoolArray, FloatArray, IntArray, frozen, read_only
from ...compilation import Float1, Float2, Float3, Float4, Int1, compiled, inner
from ...types import Detections
from ..point_gate import candidate_count
from ..polar_geometry import MIN_RANGE
from .angles import wrapped
from .linearised import (
    GATE_SIGMA,
    LEAST_STD,
    NO_TIMES,
    Expected,
    Linearised,
    Measured,
    Pairs,
    Readings,
    WeightedGaussians,
)
from .polar import LARGEST_AZIMUTH_STD

LOG_SCALE = 1.5 * math.log(2.0 * math.pi)


class Antenna(NamedTuple):
    """A radar in space."""

    axes: Int1  # Axes of the place before those of its velocity, (6,)
    # Place of the antenna, cosine and sine of its yaw, and the earth's curvature, (6,).
    pose: Float1
    turn: Float2  # See `SpatialRadar.turn`


class SpatialPlots(NamedTuple):
    """M measurements with their noise.

    numba tells named tuples apart by their names: those of `polar` have others.
    """

    measurement: Float2  # (M, 3)
    noise_std: Float2  # (M, 3)
    time_s: Float1  # (M,), or empty if all are made at the stamp
    log_correction: Float1  # Added to the log likelihood of each, (M,)


@dataclass(frozen=True)
class SpatialGaussians(Linearised):
    """Measurements of Gaussians by a radar in space; see `Linearised` for the parameters."""

    sensor: Any  # A `SpatialRadar`
    pose: FloatArray  # See `Antenna`
    turn: FloatArray  # See `SpatialRadar.turn`

    @cached_property
    def _antenna(self) -> Antenna:
        space = self.sensor.space
        axes = read_only(np.array([*space.place, *space.motion]), np.int64)
        return Antenna(axes, read_only(self.pose), read_only(self.turn))

    def _plots(self, measured: Measured) -> SpatialPlots:
        times = NO_TIMES if measured.time_s is None else measured.time_s
        correction = self.sensor.log_correction(measured.noise_std[:, 2])
        return frozen(SpatialPlots(measured.measurement, measured.noise_std, times, correction))

    def expected(self, mean: FloatArray, covariance: FloatArray) -> Expected:
        """Return the expected measurements of Gaussians."""
        return frozen(_expected_measurements(self._antenna, mean, covariance))

    def candidate_count(self, predicted: FloatArray, detections: Detections) -> int:
        """Return the number of candidate pairs; see `point_gate.candidate_count`."""
        return candidate_count(predicted, detections, self.sensor.noise_std)

    def is_nearly_normal(self, std: FloatArray) -> BoolArray:
        """Return whether measurements of Gaussians are nearly normal; see `Linearised`."""
        azimuth, elevation = std[:, 1], std[:, 2]
        normal: BoolArray = (azimuth < LARGEST_AZIMUTH_STD) & (elevation < LARGEST_AZIMUTH_STD)
        return normal

    def gate_pairs(
        self, weight: FloatArray, mean: FloatArray, expected: Expected, report: Readings
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs of hypotheses and detections in a gate, and their log likelihoods."""
        detections = report.detections
        plots = self._plots(
            Measured(detections.measurement, report.detection_std, time_s=detections.time_s)
        )
        return _gate(self.gate_ratio**2, self._antenna, weight, mean, expected, plots)

    def innovations(
        self, gaussians: WeightedGaussians, measured: Measured, pairs: Pairs
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the columns of `kalman.Innovation`; errors are taken as independent."""
        return _innovations(pairs, self._antenna, gaussians, self._plots(measured))


@inner
def _turn(turn: FloatArray, measured: FloatArray, slope: FloatArray) -> None:
    """Turn a measurement and its Jacobian into the array's frame."""
    distance, azimuth, elevation = measured[0], measured[1], measured[2]
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    level, up = math.cos(elevation), math.sin(elevation)
    x = distance * (turn[0, 0] * level * cos + turn[0, 1] * level * sin + turn[0, 2] * up)
    y = distance * (turn[1, 0] * level * cos + turn[1, 1] * level * sin + turn[1, 2] * up)
    z = distance * (turn[2, 0] * level * cos + turn[2, 1] * level * sin + turn[2, 2] * up)
    flat = max(math.sqrt(x * x + y * y), MIN_RANGE)
    for k in range(3):
        # The change of the place in the level frame, and then in the array's.
        along, across, above = slope[0, k], slope[1, k], slope[2, k]
        ahead = level * cos * along - distance * (level * sin * across + up * cos * above)
        left = level * sin * along + distance * (level * cos * across - up * sin * above)
        high = up * along + distance * level * above
        dx = turn[0, 0] * ahead + turn[0, 1] * left + turn[0, 2] * high
        dy = turn[1, 0] * ahead + turn[1, 1] * left + turn[1, 2] * high
        dz = turn[2, 0] * ahead + turn[2, 1] * left + turn[2, 2] * high
        outward = (x * dx + y * dy) / flat
        slope[1, k] = (x * dy - y * dx) / (flat * flat)
        slope[2, k] = (flat * dz - z * outward) / (distance * distance)
    measured[1], measured[2] = math.atan2(y, x), math.atan2(z, flat)


@inner
def _write_measured(
    antenna: Antenna, place: FloatArray, measured: FloatArray, slope: FloatArray
) -> None:
    """Write the measurement of a place and its Jacobian; see `SpatialRadar.linearise`."""
    pose = antenna.pose
    east, north, height = place[0] - pose[0], place[1] - pose[1], place[2] - pose[2]
    cos, sin, curvature = pose[3], pose[4], pose[5]
    ahead, left = cos * east + sin * north, cos * north - sin * east
    level = max(math.sqrt(ahead * ahead + left * left), MIN_RANGE)
    u, w, u_d, w_d, u_h, w_h = level, height, 1.0, 0.0, 0.0, 1.0
    if curvature != 0.0:
        angle, stretch = curvature * level, 1.0 + curvature * height
        half = math.sin(0.5 * angle) / curvature
        w_h, u_h = math.cos(angle), math.sin(angle)
        u, w = stretch * u_h / curvature, height - 2.0 * stretch * curvature * half * half
        u_d, w_d = stretch * w_h, -stretch * u_h
    slant = max(math.sqrt(u * u + w * w), MIN_RANGE)
    nearness = 1.0 / slant
    r_d, r_h = (u * u_d + w * w_d) * nearness, (u * u_h + w * w_h) * nearness
    e_d = (u * w_d - w * u_d) * nearness * nearness
    e_h = (u * w_h - w * u_h) * nearness * nearness
    along, across = east / level, north / level
    measured[0], measured[1], measured[2] = slant, math.atan2(left, ahead), math.atan2(w, u)
    slope[0, 0], slope[0, 1], slope[0, 2] = r_d * along, r_d * across, r_h
    slope[1, 0], slope[1, 1], slope[1, 2] = -across / level, along / level, 0.0
    slope[2, 0], slope[2, 1], slope[2, 2] = e_d * along, e_d * across, e_h
    if len(antenna.turn) > 0:
        _turn(antenna.turn, measured, slope)


@inner
def _write_spread(slope: FloatArray, place: FloatArray, across: FloatArray, to: FloatArray) -> None:
    """Write the covariance of a measurement, J P J', and P J', from that of the place, P."""
    for i in range(3):
        for k in range(3):
            across[i, k] = (
                place[i, 0] * slope[k, 0] + place[i, 1] * slope[k, 1] + place[i, 2] * slope[k, 2]
            )
    for i in range(3):
        for k in range(i + 1):
            to[i, k] = to[k, i] = (
                slope[i, 0] * across[0, k] + slope[i, 1] * across[1, k] + slope[i, 2] * across[2, k]
            )


@inner
def _write_inverse(matrix: FloatArray, inverse: FloatArray) -> float:
    """Write the inverse of a covariance of three components; return its determinant."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    first, second, third = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = max(a * first + b * second + c * third, TINY)
    scale = 1.0 / determinant
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = (
        first * scale,
        (a * f - c * c) * scale,
        (a * d - b * b) * scale,
    )
    inverse[0, 1] = inverse[1, 0] = second * scale
    inverse[0, 2] = inverse[2, 0] = third * scale
    inverse[1, 2] = inverse[2, 1] = (b * c - a * e) * scale
    return float(determinant)


@inner
def _square(inverse: FloatArray, error: FloatArray) -> float:
    """Return the square Mahalanobis distance of an error."""
    x, y, z = error[0], error[1], error[2]
    square = inverse[0, 0] * x * x + inverse[1, 1] * y * y + inverse[2, 2] * z * z
    cross = inverse[0, 1] * x * y + inverse[0, 2] * x * z + inverse[1, 2] * y * z
    return float(square + 2.0 * cross)


@compiled
def _expected_measurements(antenna: Antenna, mean: Float3, covariance: Float4) -> Expected:
    """Return the results of `SpatialGaussians.expected`."""
    axes = antenna.axes
    count, modes = mean.shape[:2]
    measured, spread = np.empty((count, modes, 3)), np.empty((count, modes, 3, 3))
    std = np.empty((count, modes, 3))
    place, slope, across, own = np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for row in range(count):
        for mode in range(modes):
            for i in range(3):
                place[i] = mean[row, mode, axes[i]]
                for k in range(3):
                    own[i, k] = covariance[row, mode, axes[i], axes[k]]
            _write_measured(antenna, place, measured[row, mode], slope)
            _write_spread(slope, own, across, spread[row, mode])
            for i in range(3):
                variance = max(spread[row, mode, i, i], 0.0)
                std[row, mode, i] = max(math.sqrt(variance), LEAST_STD)
    return Expected(measured, spread, std)


@compiled
def _gate(
    gate_square: float,
    antenna: Antenna,
    weight: Float2,
    mean: Float3,
    expected: Expected,
    plots: SpatialPlots,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the results of `SpatialGaussians.gate_pairs`.

    `gate_square` is the factor on the variances of the noise. Most pairs are ruled out by their
    range or azimuth alone.
    """
    (measured, covariance, _), (measurement, noise_std, time_s, correction) = expected, plots
    axes = antenna.axes
    (count, modes), size = weight.shape, len(measurement)
    widest, latest = np.zeros(3), 0.0
    for z in range(size):
        latest = max(latest, abs(time_s[z])) if len(time_s) else 0.0
        for i in range(3):
            widest[i] = max(widest[i], noise_std[z, i])
    room = 4 * count + 64
    row_of, column_of = np.empty(room, np.int64), np.empty(room, np.int64)
    log_likelihood, pairs = np.empty((room, modes)), 0
    rate, reach, wide = np.zeros((modes, 3)), np.empty((modes, 2)), np.empty(modes, np.bool_)
    place, seen, slope = np.empty(3), np.empty(3), np.empty((3, 3))
    total, inverse, error = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for row in range(count):
        for mode in range(modes):
            if latest > 0.0:
                for i in range(3):
                    place[i] = mean[row, mode, axes[i]]
                _write_measured(antenna, place, seen, slope)
                for i in range(3):
                    rate[mode, i] = 0.0
                    for k in range(3):
                        rate[mode, i] += slope[i, k] * mean[row, mode, axes[3 + k]]
            for i in range(2):
                own = covariance[row, mode, i, i]
                reach[mode, i] = GATE_SIGMA * math.sqrt(own + gate_square * widest[i] ** 2)
                reach[mode, i] += latest * abs(rate[mode, i])
            # The azimuth of a Gaussian that is nearly overhead, or around the radar, is any.
            wide[mode] = covariance[row, mode, 1, 1] >= (0.5 * math.pi / GATE_SIGMA) ** 2
        for z in range(size):
            time, found = time_s[z] if len(time_s) else 0.0, False
            for mode in range(modes):
                if not weight[row, mode] > 0.0:
                    continue
                error[0] = measurement[z, 0] - measured[row, mode, 0]
                if abs(error[0]) > reach[mode, 0]:
                    continue
                error[1] = wrapped(measurement[z, 1] - measured[row, mode, 1])
                if abs(error[1]) > reach[mode, 1] and not wide[mode]:
                    continue
                error[2] = measurement[z, 2] - measured[row, mode, 2]
                for i in range(3):
                    error[i] -= time * rate[mode, i]
                    for k in range(3):
                        total[i, k] = covariance[row, mode, i, k]
                    total[i, i] += gate_square * noise_std[z, i] ** 2
                error[1] = wrapped(error[1])
                determinant = _write_inverse(total, inverse)
                square = _square(inverse, error)
                if square > GATE_SIGMA**2 and not wide[mode]:
                    continue
                if not found:
                    found = True
                    if pairs == room:
                        room *= 2
                        row_of = np.concatenate((row_of, row_of))
                        column_of = np.concatenate((column_of, column_of))
                        log_likelihood = np.concatenate((log_likelihood, log_likelihood))
                    for other in range(modes):
                        log_likelihood[pairs, other] = -np.inf
                log_density = -0.5 * (square + math.log(determinant)) - LOG_SCALE
                log_likelihood[pairs, mode] = log_density + correction[z]
            if found:
                row_of[pairs], column_of[pairs] = row, z
                pairs += 1
    return row_of[:pairs], column_of[:pairs], log_likelihood[:pairs]


@compiled
def _innovations(
    pairs: Pairs, antenna: Antenna, gaussians: WeightedGaussians, plots: SpatialPlots
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the results of `SpatialGaussians.innovations`."""
    (group, column, modes, iterations, converged), axes = pairs, antenna.axes
    (mean, covariance, weight) = gaussians
    measurement, noise_std, time_s, correction = plots
    count = len(group) * modes
    jacobian, inverse = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    weighted, log_likelihood = np.zeros((count, 3)), np.full(count, -np.inf)
    prior, place, seen, error = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    own, across, total = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for row in range(count):
        pair = row // modes
        gaussian, z = group[pair] * modes + row % modes, column[pair]
        if gaussian < 0 or not weight[gaussian] > 0.0:
            continue
        time, spread = time_s[z] if len(time_s) else 0.0, covariance[gaussian]
        for i in range(3):
            prior[i] = mean[gaussian, axes[i]] + time * mean[gaussian, axes[3 + i]]
            place[i] = prior[i]
            for k in range(3):
                own[i, k] = spread[axes[i], axes[k]]
                if time != 0.0:
                    crossed = spread[axes[i], axes[3 + k]] + spread[axes[3 + i], axes[k]]
                    own[i, k] += time * (crossed + time * spread[axes[3 + i], axes[3 + k]])
        slope, scale, weights = jacobian[row], inverse[row], weighted[row]
        square, determinant = 0.0, 1.0
        for _ in range(iterations):
            _write_measured(antenna, place, seen, slope)
            _write_spread(slope, own, across, total)
            for i in range(3):
                total[i, i] += noise_std[z, i] ** 2
                error[i] = measurement[z, i] - seen[i]
            error[1] = wrapped(error[1])
            for i in range(3):
                for k in range(3):
                    error[i] += slope[i, k] * (place[k] - prior[k])
            determinant = _write_inverse(total, scale)
            square = 0.0
            for i in range(3):
                weights[i] = (
                    scale[i, 0] * error[0] + scale[i, 1] * error[1] + scale[i, 2] * error[2]
                )
                square += weights[i] * error[i]
            for i in range(3):
                updated = prior[i] + across[i, 0] * weights[0]
                updated += across[i, 1] * weights[1] + across[i, 2] * weights[2]
                # The step along this axis; `prior` and `place` are in metres.
                seen[i], place[i] = updated - place[i], updated
            moved = False
            for i in range(3):
                step = slope[i, 0] * seen[0] + slope[i, 1] * seen[1] + slope[i, 2] * seen[2]
                moved = moved or abs(step) >= converged * noise_std[z, i]
            if not moved:
                break
        log_likelihood[row] = -0.5 * (square + math.log(determinant)) - LOG_SCALE + correction[z]
    return jacobian, weighted, inverse, log_likelihood
