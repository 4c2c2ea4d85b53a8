"""Measurements of Gaussians, which are linearised by `Sensor.linearise`, in array operations.

`polar` has compiled functions for range and azimuth, and `planar` for positions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ...arrays import BoolArray, Float1, Float2, Float3, Float4, FloatArray, Int1, IntArray, frozen
from ...state_space import StateSpace
from ...types import Detections
from ..gaussians import HeavyTails, noise_covariance

# Radius of the gate in standard deviations of the innovation; a target's detection falls outside
# with a probability of 4e-6.
GATE_SIGMA = 5.0
# Lower bound of the standard deviations of expected measurements, by which distances are divided.
LEAST_STD = 1e-6
# Times of measurements that are all made at the stamp.
NO_TIMES = np.zeros(0)


class Measuring(Protocol):
    """The part of a sensor that measures; see `Sensor`."""

    @property
    def space(self) -> StateSpace:
        """Axes of the measured states."""

    @property
    def noise_std(self) -> FloatArray:
        """Standard deviations of a measurement, (Z,)."""

    @property
    def outliers(self) -> HeavyTails | None:
        """Outliers among its measurements; None without any."""

    def linearise(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the measurements of positions and their Jacobians, (..., Z) and (..., Z, P)."""

    def wrap(self, error: FloatArray) -> FloatArray:
        """Return differences of measurements, (..., Z), with wrapped angles."""


class Readings(Protocol):
    """The part of a report that gates need; see `View`."""

    @property
    def detections(self) -> Detections:
        """M detections."""

    @property
    def detection_std(self) -> FloatArray:
        """Standard deviations of each detection, (M, Z)."""

    @property
    def time_s(self) -> FloatArray:
        """Time of each detection relative to the stamp, seconds, (M,)."""

    def __len__(self) -> int:
        """Return the number of detections."""


class Measured(NamedTuple):
    """M measurements with their noise."""

    measurement: FloatArray  # (M, Z)
    noise_std: FloatArray  # Standard deviations, (M, Z)
    correlation: FloatArray | None = None  # See `Detections.noise_correlation`, (M,)
    time_s: FloatArray | None = None  # Time relative to the stamp of the Gaussians, seconds, (M,)


class WeightedGaussians(NamedTuple):
    """N Gaussians at a stamp."""

    mean: Float2  # (N, D)
    covariance: Float3  # (N, D, D)
    weight: Float1  # (N,)

    @staticmethod
    def of(
        mean: FloatArray, covariance: FloatArray, weight: FloatArray | None = None
    ) -> WeightedGaussians:
        """Return the Gaussians of these columns; their weights are 1 if None."""
        weight = np.ones(len(mean)) if weight is None else weight
        return frozen(WeightedGaussians(mean, covariance, weight))


class Pairs(NamedTuple):
    """P pairs of Gaussians and measurements, and how they are linearised; see `innovations`."""

    # Group of each pair, (P,): `modes` Gaussians one after the other; -1 for none.
    group: Int1
    column: Int1  # Measurement of each pair, (P,)
    modes: int
    iterations: int  # Largest number of linearisations
    # A step that moves the measurement by less than this share of its standard deviation is the
    # last one.
    converged: float


class Expected(NamedTuple):
    """The measurements that a sensor is expected to make of Gaussians."""

    measured: Float3  # (H, R, Z)
    # Covariance of the expected measurement, without the sensor's noise, (H, R, Z, Z).
    covariance: Float4
    std: Float3  # Roots of its diagonal, not below `LEAST_STD`, (H, R, Z)


@dataclass(frozen=True)
class Linearised:
    """The measurements that a sensor makes of Gaussians.

    Means have shape (H, R, D) and covariances (H, R, D, D).
    """

    sensor: Measuring

    def expected(self, mean: FloatArray, covariance: FloatArray) -> Expected:
        """Return the expected measurements of Gaussians."""
        position = list(self.sensor.space.place)
        measured, jacobian = self.sensor.linearise(mean[..., position])
        spread = jacobian @ covariance[..., position, :][..., position] @ jacobian.swapaxes(-1, -2)
        variance = np.diagonal(spread, axis1=-2, axis2=-1)
        std = np.sqrt(np.maximum(variance, LEAST_STD**2))
        return frozen(Expected(measured, spread, std))

    def candidate_count(self, predicted: FloatArray, detections: Detections) -> int:
        """Return a bound of the number of pairs of predicted measurements and detections in gates.

        `predicted` has shape (N, Z).
        """
        return len(predicted) * len(detections)

    def is_nearly_normal(self, std: FloatArray) -> BoolArray:
        """Return whether expected measurements of Gaussians are nearly normal, (N, Z) to (N,).

        `std` has the standard deviations of the measurements.
        """
        return np.ones(len(std), dtype=np.bool_)

    @property
    def gate_ratio(self) -> float:
        """Ratio of the standard deviations in a gate to the usual ones: outliers are in it too."""
        outliers = self.sensor.outliers
        return 1.0 if outliers is None else outliers.ratio

    def gate_pairs(
        self, weight: FloatArray, mean: FloatArray, expected: Expected, report: Readings
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the results of `PriorMixture.gate`.

        Parameters
        ----------
        weight : array of shape (H, R)
            Gaussians without weight have no gate.
        mean : array of shape (H, R, D)
        """
        measured, covariance, _ = expected
        sensor, modes = self.sensor, weight.shape[1]
        _, slope = sensor.linearise(mean[..., list(sensor.space.place)])
        rate = (slope @ mean[..., list(sensor.space.motion), None])[..., 0]
        detections = report.detections
        covariance_of_noise = noise_covariance(report.detection_std, detections.noise_correlation)
        noise = self.gate_ratio**2 * covariance_of_noise
        row = [np.zeros(0, np.int64)]
        column = [np.zeros(0, np.int64)]
        log_likelihood = [np.zeros((0, modes))]
        # At most so many candidate pairs of Gaussians and detections are gated at a time.
        step = max((1 << 16) // max(modes * len(report), 1), 1)
        for begin in range(0, len(weight), step):
            block = slice(begin, begin + step)
            error = report.detections.measurement - measured[block, :, None]
            error = sensor.wrap(error - rate[block, :, None] * report.time_s[:, None])
            square, log_density = _normal_density(error, covariance[block, :, None] + noise)
            inside = (square <= GATE_SIGMA**2) & (weight[block] > 0.0)[..., None]
            log_density = np.where(inside, log_density, -np.inf).swapaxes(1, 2)
            gated_row, gated_column = np.nonzero(inside.any(axis=1))
            row.append(begin + gated_row)
            column.append(gated_column)
            log_likelihood.append(log_density[gated_row, gated_column])
        return np.concatenate(row), np.concatenate(column), np.concatenate(log_likelihood)

    def innovations(
        self, gaussians: WeightedGaussians, measured: Measured, pairs: Pairs
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the columns of `kalman.Innovation` for pairs of Gaussians and measurements.

        Notes
        -----
        An update takes as many components as a place has axes. With the measurement's Jacobian J,
        the innovation's covariance S and the innovation v, it adds P J' S^-1 v to a state and takes
        P J' S^-1 J P from its covariance. For other numbers of components v is therefore replaced
        by J' S^-1 v, the inverse of S by J' S^-1 J, and the Jacobian by the identity.
        """
        sensor, (mean, covariance, weight) = self.sensor, gaussians
        gaussian = gaussians_of_groups(pairs.group, pairs.modes)
        column = pairs.column.repeat(pairs.modes)
        has_weight = (gaussian >= 0) & (weight[gaussian] > 0.0)
        row, count = np.where(has_weight, gaussian, 0), len(gaussian)
        measurement, noise_std = measured.measurement[column], measured.noise_std[column]
        noise = noise_covariance(measured.noise_std, measured.correlation)[column]
        axes = np.arange(len(sensor.space.place))
        with_time = np.zeros((count, len(axes), mean.shape[1]))
        with_time[:, axes, list(sensor.space.place)] = 1.0
        if measured.time_s is not None:
            velocity = list(sensor.space.motion)
            with_time[:, axes, velocity] = measured.time_s[column, None]
        prior = (with_time @ mean[row][..., None])[..., 0]
        spread = with_time @ covariance[row] @ with_time.swapaxes(1, 2)
        size = measurement.shape[1]
        jacobian, weighted = np.zeros((count, size, len(axes))), np.zeros((count, size))
        inverse, log_likelihood = np.zeros((count, size, size)), np.zeros(count)
        position, rows = prior.copy(), np.arange(count)
        for _ in range(pairs.iterations):
            predicted, slope = sensor.linearise(position[rows])
            shift = (slope @ (position[rows] - prior[rows])[..., None])[..., 0]
            error = sensor.wrap(measurement[rows] - predicted) + shift
            total = slope @ spread[rows] @ slope.swapaxes(1, 2) + noise[rows]
            jacobian[rows], inverse[rows] = slope, np.linalg.inv(total)
            weighted[rows] = (inverse[rows] @ error[..., None])[..., 0]
            log_likelihood[rows] = _normal_density(error, total)[1]
            gain = spread[rows] @ slope.swapaxes(1, 2)
            updated = prior[rows] + (gain @ weighted[rows][..., None])[..., 0]
            step = (slope @ (updated - position[rows])[..., None])[..., 0]
            position[rows] = updated
            rows = rows[(np.abs(step) >= pairs.converged * noise_std[rows]).any(axis=1)]
        if size != len(axes):
            transposed = jacobian.swapaxes(1, 2)
            weighted = (transposed @ weighted[..., None])[..., 0]
            inverse = transposed @ inverse @ jacobian
            jacobian = np.broadcast_to(np.eye(len(axes)), inverse.shape)
        return jacobian, weighted, inverse, np.where(has_weight, log_likelihood, -np.inf)


def gaussians_of_groups(group: IntArray, modes: int) -> IntArray:
    """Return the Gaussians of groups of `modes` rows, one after the other; -1 for group -1."""
    if modes == 1:
        return group
    gaussian: IntArray = np.maximum(group[:, None] * modes + np.arange(modes), -1).ravel()
    return gaussian


def _normal_density(error: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the square Mahalanobis distances and log normal densities of errors, (...)."""
    solved = np.linalg.solve(covariance, error[..., None])[..., 0]
    square = (error * solved).sum(axis=-1)
    constant = error.shape[-1] * math.log(2.0 * math.pi)
    return square, -0.5 * (square + np.linalg.slogdet(covariance)[1] + constant)
