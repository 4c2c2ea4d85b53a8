"""Measurements of Gaussians as positions, compiled; see `linearised` for other sensors.

The measurement is linear, so that one step is exact and distances are the same in all frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...arrays import TINY, FloatArray, IntArray, frozen, read_only
from ...compilation import Float1, Float2, Float3, Float4, Int1, compiled, inner
from ...types import Detections
from ..gaussians import noise_covariance
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


class _Mount(NamedTuple):
    """The place of a sensor."""

    axes: Int1  # Axes of the position and the velocity in a state
    pose: Float1  # Position of the sensor, and the cosine and the sine of its yaw, (4,)


class _Plots(NamedTuple):
    """M measured positions with their noise; see `linearised.Measured`."""

    measurement: Float2  # (M, 2)
    noise: Float3  # Covariances, (M, 2, 2)
    time_s: Float1  # (M,), or empty if all are made at the stamp


@dataclass(frozen=True)
class PlanarGaussians(Linearised):
    """Measurements of Gaussians by a sensor of positions; see `Linearised` for the parameters."""

    pose: FloatArray  # Position of the sensor, and the cosine and the sine of its yaw, (4,)

    @cached_property
    def _mount(self) -> _Mount:
        axes = read_only(self.sensor.space.planar_axes, np.int64)
        return _Mount(axes, read_only(self.pose))

    def expected(self, mean: FloatArray, covariance: FloatArray) -> Expected:
        """Return the expected measurements of Gaussians."""
        return frozen(_expected_measurements(self._mount, mean, covariance))

    def candidate_count(self, predicted: FloatArray, detections: Detections) -> int:
        """Return the number of pairs that are near each other along the first axis."""
        along = np.sort(detections.measurement[:, 0])
        reach = 2.0 * GATE_SIGMA * float(self.sensor.noise_std.max())
        ends = (along.searchsorted(predicted[:, 0] + side) for side in (reach, -reach))
        last, first = ends
        return int((last - first).sum())

    def gate_pairs(
        self, weight: FloatArray, mean: FloatArray, expected: Expected, report: Readings
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs of hypotheses and detections in a gate, and their log likelihoods."""
        detections = report.detections
        std, correlation = self.gate_ratio * report.detection_std, detections.noise_correlation
        plots = _plots(Measured(detections.measurement, std, correlation, detections.time_s))
        order = detections.measurement[:, 0].argsort(kind="stable")
        return _gate(self._mount, weight, mean, expected, plots, order)

    def innovations(
        self, gaussians: WeightedGaussians, measured: Measured, pairs: Pairs
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the columns of `kalman.Innovation`; the iteration ends with its first step."""
        return _innovations(pairs, self._mount, gaussians, _plots(measured))


def _plots(measured: Measured) -> _Plots:
    """Return measurements as compiled functions take them."""
    times = NO_TIMES if measured.time_s is None else measured.time_s
    noise = noise_covariance(measured.noise_std, measured.correlation)
    return frozen(_Plots(measured.measurement, noise, times))


@inner
def _measured_place(
    mean: FloatArray, mount: _Mount, time: float
) -> tuple[float, float, float, float]:
    """Return the position of a state in the sensor's frame after some seconds, and its rate."""
    axes, pose = mount.axes, mount.pose
    cos, sin = pose[2], pose[3]
    east_rate, north_rate = mean[axes[2]], mean[axes[3]]
    east = mean[axes[0]] + time * east_rate - pose[0]
    north = mean[axes[1]] + time * north_rate - pose[1]
    return (
        cos * east + sin * north,
        cos * north - sin * east,
        cos * east_rate + sin * north_rate,
        cos * north_rate - sin * east_rate,
    )


@inner
def _measured_spread(
    covariance: FloatArray, mount: _Mount, time: float
) -> tuple[float, float, float]:
    """Return the covariance of that position, xx, xy and yy in the sensor's frame."""
    axes, cos, sin = mount.axes, mount.pose[2], mount.pose[3]
    x, y, vx, vy = axes[0], axes[1], axes[2], axes[3]
    p, q, r = covariance[x, x], covariance[x, y], covariance[y, y]
    if time != 0.0:
        crossed = covariance[x, vy] + covariance[vx, y]
        p += time * (2.0 * covariance[x, vx] + time * covariance[vx, vx])
        q += time * (crossed + time * covariance[vx, vy])
        r += time * (2.0 * covariance[y, vy] + time * covariance[vy, vy])
    both = 2.0 * cos * sin * q
    return (
        cos * cos * p + both + sin * sin * r,
        cos * sin * (r - p) + (cos * cos - sin * sin) * q,
        sin * sin * p - both + cos * cos * r,
    )


@compiled
def _expected_measurements(mount: _Mount, mean: Float3, covariance: Float4) -> Expected:
    """Return the results of `PlanarGaussians.expected`."""
    count, modes = mean.shape[:2]
    measured, spread = np.empty((count, modes, 2)), np.empty((count, modes, 2, 2))
    std = np.empty((count, modes, 2))
    for row in range(count):
        for mode in range(modes):
            x, y, _, _ = _measured_place(mean[row, mode], mount, 0.0)
            measured[row, mode, 0], measured[row, mode, 1] = x, y
            p, q, r = _measured_spread(covariance[row, mode], mount, 0.0)
            spread[row, mode, 0, 0], spread[row, mode, 1, 1] = p, r
            spread[row, mode, 0, 1] = spread[row, mode, 1, 0] = q
            std[row, mode, 0] = max(math.sqrt(max(p, 0.0)), LEAST_STD)
            std[row, mode, 1] = max(math.sqrt(max(r, 0.0)), LEAST_STD)
    return Expected(measured, spread, std)


@inner
def _density(x: float, y: float, p: float, q: float, r: float) -> tuple[float, float]:
    """Return the square Mahalanobis distance of an error, and its log density."""
    determinant = max(p * r - q * q, TINY)
    square = (r * x * x - 2.0 * q * x * y + p * y * y) / determinant
    return square, -0.5 * (square + math.log(determinant)) - math.log(2.0 * math.pi)


@compiled
def _gate(
    mount: _Mount, weight: Float2, mean: Float3, expected: Expected, plots: _Plots, order: Int1
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the results of `PlanarGaussians.gate_pairs`; `order` has the plots by their x."""
    (measured, covariance, _), (measurement, noise, time_s) = expected, plots
    (count, modes), size = weight.shape, len(measurement)
    along, widest, latest = np.empty(size), 0.0, 0.0
    for place in range(size):
        z = order[place]
        along[place] = measurement[z, 0]
        widest = max(widest, noise[z, 0, 0], noise[z, 1, 1])
        latest = max(latest, abs(time_s[z])) if len(time_s) else 0.0
    pairs, room = 0, 4 * count + 64
    rows, columns = np.empty(room, np.int64), np.empty(room, np.int64)
    log_likelihood, log_density = np.empty((room, modes)), np.empty(modes)
    rate = np.empty((modes, 2))
    for row in range(count):
        low, high = np.inf, -np.inf
        for mode in range(modes):
            if weight[row, mode] > 0.0:
                _, _, rate[mode, 0], rate[mode, 1] = _measured_place(mean[row, mode], mount, 0.0)
                reach = GATE_SIGMA * math.sqrt(covariance[row, mode, 0, 0] + widest)
                reach += latest * abs(rate[mode, 0])
                low = min(low, measured[row, mode, 0] - reach)
                high = max(high, measured[row, mode, 0] + reach)
        for place in range(np.searchsorted(along, low), size):
            if along[place] > high:
                break
            z, found = order[place], False
            time = time_s[z] if len(time_s) else 0.0
            for mode in range(modes):
                log_density[mode] = -np.inf
                if not weight[row, mode] > 0.0:
                    continue
                square, log_value = _density(
                    measurement[z, 0] - measured[row, mode, 0] - time * rate[mode, 0],
                    measurement[z, 1] - measured[row, mode, 1] - time * rate[mode, 1],
                    covariance[row, mode, 0, 0] + noise[z, 0, 0],
                    covariance[row, mode, 0, 1] + noise[z, 0, 1],
                    covariance[row, mode, 1, 1] + noise[z, 1, 1],
                )
                if square <= GATE_SIGMA**2:
                    log_density[mode], found = log_value, True
            if not found:
                continue
            if pairs == room:
                room *= 2
                rows, columns = np.append(rows, rows), np.append(columns, columns)
                log_likelihood = np.concatenate((log_likelihood, log_likelihood))
            rows[pairs], columns[pairs] = row, z
            log_likelihood[pairs] = log_density
            pairs += 1
    return rows[:pairs], columns[:pairs], log_likelihood[:pairs]


@compiled
def _innovations(
    pairs: Pairs, mount: _Mount, gaussians: WeightedGaussians, plots: _Plots
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the results of `PlanarGaussians.innovations`."""
    (mean, covariance, weight), (measurement, noise, time_s) = gaussians, plots
    group, column, modes, _, _ = pairs
    count, cos, sin = len(group) * modes, mount.pose[2], mount.pose[3]
    jacobian, inverse = np.zeros((count, 2, 2)), np.zeros((count, 2, 2))
    weighted, log_likelihood = np.zeros((count, 2)), np.full(count, -np.inf)
    for row in range(count):
        pair = row // modes
        gaussian, z = group[pair] * modes + row % modes, column[pair]
        if gaussian < 0 or not weight[gaussian] > 0.0:
            continue
        time = time_s[z] if len(time_s) else 0.0
        x, y, _, _ = _measured_place(mean[gaussian], mount, time)
        p, q, r = _measured_spread(covariance[gaussian], mount, time)
        p, q, r = p + noise[z, 0, 0], q + noise[z, 0, 1], r + noise[z, 1, 1]
        x, y = measurement[z, 0] - x, measurement[z, 1] - y
        determinant = max(p * r - q * q, TINY)
        jacobian[row, 0, 0], jacobian[row, 0, 1] = cos, sin
        jacobian[row, 1, 0], jacobian[row, 1, 1] = -sin, cos
        inverse[row, 0, 0], inverse[row, 1, 1] = r / determinant, p / determinant
        inverse[row, 0, 1] = inverse[row, 1, 0] = -q / determinant
        weighted[row, 0] = (r * x - q * y) / determinant
        weighted[row, 1] = (p * y - q * x) / determinant
        _, log_likelihood[row] = _density(x, y, p, q, r)
    return jacobian, weighted, inverse, log_likelihood
