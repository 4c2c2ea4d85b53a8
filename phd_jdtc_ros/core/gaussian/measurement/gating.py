"""Gating: the detections in the gate of each hypothesis, and their approximate likelihoods."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray, contiguous
from ...bisection import count_below, count_up_to
from ...compilation import Float1, Float2, Float3, Float4, Int1, compiled, inner
from ...sensors.polar_geometry import MIN_RANGE
from ...sensors.report import Report
from ...sensors.sensor import Sensor
from ...types import FULL_TURN
from ..algebra import linearised
from ..algebra.blocks import wrapped
from ..algebra.kalman import TINY
from ..mixture import Mixture

# Radius of the gate in standard deviations of the innovation; a target's detection falls outside
# with a probability of 4e-6.
GATE_SIGMA = 5.0
# Lower bound of the standard deviations of expected measurements, by which distances are divided.
LEAST_STD = 1e-6


class Expected(NamedTuple):
    """Expected measurement of each Gaussian."""

    measured: FloatArray  # (H, R, Z)
    # Covariance of the expected measurement, without the sensor's noise, (H, R, Z, Z).
    covariance: FloatArray
    std: FloatArray  # Roots of its diagonal, not below `LEAST_STD`, (H, R, Z)

    @staticmethod
    def of(mixture: Mixture, sensor: Sensor) -> Expected:
        """Return the measurements that a sensor is expected to make of a mixture's Gaussians."""
        if not sensor.polar:
            found = linearised.expected(mixture.mean, mixture.covariance, sensor)
            variance = np.diagonal(found[1], axis1=-2, axis2=-1)
            return Expected(*contiguous(*found, np.sqrt(np.maximum(variance, LEAST_STD**2))))
        return Expected(*_expected(mixture.mean, mixture.covariance, sensor.axes, sensor.frame))


@compiled
def _expected(
    mean: Float3, covariance: Float4, axes: Int1, pose: Float1
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the columns of `Expected`; for `axes` and `pose` see `kalman`."""
    count, modes = mean.shape[:2]
    measured, spread = np.empty((count, modes, 2)), np.empty((count, modes, 2, 2))
    std = np.empty((count, modes, 2))
    x, y = axes[0], axes[1]
    at_x, at_y, cos, sin = pose[0], pose[1], pose[2], pose[3]
    for row in range(count):
        for mode in range(modes):
            east, north = mean[row, mode, x] - at_x, mean[row, mode, y] - at_y
            ahead, left = cos * east + sin * north, cos * north - sin * east
            distance = max(math.sqrt(ahead * ahead + left * left), MIN_RANGE)
            measured[row, mode, 0], measured[row, mode, 1] = distance, math.atan2(left, ahead)
            j, k = east / distance, north / distance
            n, m = -k / distance, j / distance
            own = covariance[row, mode]
            p, q, r = own[x, x], own[x, y], own[y, y]
            spread[row, mode, 0, 0] = j * (p * j + q * k) + k * (q * j + r * k)
            spread[row, mode, 1, 1] = n * (p * n + q * m) + m * (q * n + r * m)
            cross = j * (p * n + q * m) + k * (q * n + r * m)
            spread[row, mode, 0, 1] = spread[row, mode, 1, 0] = cross
            for axis in range(2):
                variance = spread[row, mode, axis, axis]
                std[row, mode, axis] = max(math.sqrt(max(variance, 0.0)), LEAST_STD)
    return measured, spread, std


@inner
def _longer(array: Any, size: int) -> Any:
    """Return a table with room for more rows."""
    longer = np.empty((size, array.shape[1]), array.dtype)
    for row in range(len(array)):
        for column in range(array.shape[1]):
            longer[row, column] = array[row, column]
    return longer


@inner
def _write_box(
    row: int,
    measured: FloatArray,
    reach: FloatArray,
    weight: FloatArray,
    max_range: float,
    box: FloatArray,
) -> bool:
    """Write the box around a row's gates: both ranges, and the centre and half width in azimuth.

    Return whether any Gaussian has weight and reaches into the radar's range.
    """
    found = False
    for mode in range(len(reach)):
        near, far = measured[row, mode, 0] - reach[mode, 0], measured[row, mode, 0] + reach[mode, 0]
        if not (weight[row, mode] > 0.0 and near <= max_range):
            continue
        if not found:
            box[0], box[1], box[2], box[3] = near, far, measured[row, mode, 1], 0.0
            found = True
        box[0], box[1] = min(box[0], near), max(box[1], far)
        half = abs(wrapped(measured[row, mode, 1] - box[2])) + reach[mode, 1]
        box[3] = max(box[3], half)
    return found


@inner
def _write_rates(
    row: int, mean: FloatArray, axes: IntArray, pose: FloatArray, rate: FloatArray
) -> None:
    """Write the time derivatives of a row's measurements, and the bounds of their sizes, (R, 4)."""
    for mode in range(len(rate)):
        east, north = mean[row, mode, axes[0]] - pose[0], mean[row, mode, axes[1]] - pose[1]
        along, across = mean[row, mode, axes[2]], mean[row, mode, axes[3]]
        distance = max(math.sqrt(east * east + north * north), MIN_RANGE)
        rate[mode, 0] = (east * along + north * across) / distance
        rate[mode, 1] = (east * across - north * along) / (distance * distance)
        rate[mode, 2] = abs(along) + abs(across)
        rate[mode, 3] = rate[mode, 2] / distance


@compiled
def _gate_pairs(
    max_range: float,
    axes: Int1,
    pose: Float1,
    mean: Float3,
    measured: Float3,
    covariance: Float4,
    weight: Float2,
    detection: Float2,
    order: Int1,
    noise_std: Float2,
    time_s: Float1,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the results of `gate_pairs`; `order` is that of the detections by azimuth from 0."""
    (count, modes), size = weight.shape, len(order)
    room, found = 4 * count + 64, 0
    pairs, log_likelihood = np.empty((room, 2), np.int64), np.empty((room, modes))
    around, reach, box = np.empty(modes, np.bool_), np.empty((modes, 2)), np.empty(4)
    inverse, log_root, rate = np.empty((modes, 3)), np.empty(modes), np.zeros((modes, 4))
    # Two turns of detections, so that the azimuths of a gate are a single run.
    azimuth, distance = np.empty(2 * size), np.empty(2 * size)
    widest, latest = np.zeros(2), 0.0
    for place in range(size):
        one = order[place]
        distance[place] = distance[size + place] = detection[one, 0]
        azimuth[place] = detection[one, 1] % FULL_TURN
        azimuth[size + place] = azimuth[place] + FULL_TURN
        latest = max(latest, abs(time_s[one]))
        for axis in range(2):
            widest[axis] = max(widest[axis], noise_std[one, axis])
    for row in range(count):
        anywhere, noise_range, noise_azimuth = False, -1.0, -1.0
        if latest > 0.0:
            _write_rates(row, mean, axes, pose, rate)
        for mode in range(modes):
            for axis in range(2):
                std = math.sqrt(covariance[row, mode, axis, axis] + widest[axis] ** 2)
                reach[mode, axis] = GATE_SIGMA * std + latest * rate[mode, 2 + axis]
            # The azimuth's variance grows with the square of the angle that the Gaussian covers.
            wide = covariance[row, mode, 1, 1] >= (0.5 * math.pi / GATE_SIGMA) ** 2
            inside = reach[mode, 0] - latest * rate[mode, 2]
            around[mode] = wide and measured[row, mode, 0] <= inside
            anywhere = anywhere or around[mode]
        if not _write_box(row, measured, reach, weight, max_range, box):
            continue
        half = math.pi if anywhere else min(box[3], math.pi)
        low = (box[2] - half) % FULL_TURN
        begin, near, far = count_below(azimuth[:size], low), box[0], box[1]
        end = begin + size
        if half < math.pi:
            end = min(end, count_up_to(azimuth, low + 2.0 * half))
        for place in range(begin, end):
            away = distance[place]
            if not near <= away <= far:
                continue
            one = order[place if place < size else place - size]
            if found == room:
                room *= 2
                pairs, log_likelihood = _longer(pairs, room), _longer(log_likelihood, room)
            if noise_std[one, 0] != noise_range or noise_std[one, 1] != noise_azimuth:
                noise_range, noise_azimuth = noise_std[one, 0], noise_std[one, 1]
                for mode in range(modes):
                    a = covariance[row, mode, 0, 0] + noise_range**2
                    b = covariance[row, mode, 0, 1]
                    c = covariance[row, mode, 1, 1] + noise_azimuth**2
                    determinant = max(a * c - b * b, TINY)
                    inverse[mode, 0], inverse[mode, 2] = c / determinant, a / determinant
                    inverse[mode, 1] = -2.0 * b / determinant
                    log_root[mode] = 0.5 * math.log(determinant) + math.log(FULL_TURN)
            gated = False
            for mode in range(modes):
                log_likelihood[found, mode] = -np.inf
                if not weight[row, mode] > 0.0:
                    continue
                along = away - measured[row, mode, 0] - rate[mode, 0] * time_s[one]
                across = detection[one, 1] - measured[row, mode, 1] - rate[mode, 1] * time_s[one]
                across = wrapped(across)
                square = inverse[mode, 0] * along**2 + inverse[mode, 2] * across**2
                square += inverse[mode, 1] * along * across
                if around[mode] or square <= GATE_SIGMA**2:
                    log_likelihood[found, mode] = -0.5 * square - log_root[mode]
                    gated = True
            pairs[found, 0], pairs[found, 1] = row, one
            found += gated
    return pairs[:found, 0].copy(), pairs[:found, 1].copy(), log_likelihood[:found]


def gate_pairs(
    mixture: Mixture, expected: Expected, report: Report
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the pairs of a hypothesis and a detection in the gate of one of its Gaussians.

    Returns
    -------
    row, column : int arrays of shape (P,)
    log_likelihood : array of shape (P, R)
        Log likelihood with the measurement linearised at the mean; -inf outside a Gaussian's gate.
    """
    sensor, measurement = report.sensor, report.detections.measurement
    if not sensor.polar:
        spread = expected.measured, expected.covariance
        return linearised.gate_pairs(mixture.mode_weight, mixture.mean, *spread, report, GATE_SIGMA)
    order = (measurement[:, 1] % FULL_TURN).argsort(kind="stable")
    columns = mixture.mean, expected.measured, expected.covariance, mixture.mode_weight
    of_report = measurement, order, report.detection_std, report.time_s
    return _gate_pairs(sensor.max_range, sensor.axes, sensor.frame, *columns, *of_report)
