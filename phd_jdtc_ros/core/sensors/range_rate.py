"""Measured motion: range rates and velocities, their noise, and what false detections have.

A pulse-Doppler radar measures the range rate modulo the interval of its pulse repetition frequency.
Range rates that differ by multiples of this interval are folds of one another.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray
from ..types import Detections


@dataclass(frozen=True)
class RangeRateModel:
    """Measurement model of range rates, which are positive for receding targets."""

    std: float  # Standard deviation, metres per second
    # Interval of the ambiguity, metres per second; 0 for unambiguous range rates.
    ambiguity: float = 0.0
    # Width of the uniform distribution for false detections without ambiguity, metres per second.
    span: float = 200.0
    # Standard deviation of a climb rate that is not estimated, metres per second.
    climb_std: float = 10.0

    @property
    def clutter_width(self) -> float:
        """Width of the uniform distribution for false detections, m/s."""
        return self.ambiguity or self.span

    def wrap(self, rate: FloatArray) -> FloatArray:
        """Return the folds nearest to zero, elementwise."""
        if not self.ambiguity:
            return rate
        return rate - self.ambiguity * np.round(rate / self.ambiguity)

    def folds(self, reach: float) -> FloatArray:
        """Return the shifts, m/s, from a wrapped range rate to its folds up to `reach`, (K,).

        The first shift is 0.
        """
        if not self.ambiguity:
            return np.zeros(1)
        # Largest number of folds to either side: beyond it the density is almost uniform.
        max_folds = 8
        count = int(min(np.floor(reach / self.ambiguity + 0.5), max_folds))
        numbers = np.arange(-count, count + 1, dtype=np.float64)
        return self.ambiguity * numbers[np.argsort(np.abs(numbers), kind="stable")]

    def fold(
        self, error: FloatArray, variance: FloatArray | float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the innovation over all folds, its variance over them, and its log density.

        `error` is the measured less the expected range rate, and `variance` that of the innovation
        without ambiguity. The first two results are the mean and the variance of the folds of the
        error, weighted by their densities; the third is the log of the sum of these densities.

        If one fold is much more probable than the others, the innovation is that fold and the
        spread is zero. In general, an update with the innovation and with a covariance reduction
        that is smaller by the spread has the mean and the covariance of the mixture of all folds.
        """
        nearest = self.wrap(error)
        widest = float(np.sqrt(np.max(variance, initial=0.0)))
        # Standard deviations of the innovation beyond which a fold is ignored.
        fold_sigma = 6.0
        shifts = self.folds(fold_sigma * widest)
        log_norm = -0.5 * np.log(2.0 * np.pi * np.asarray(variance))
        if len(shifts) == 1:
            spread = np.zeros_like(nearest)
            return nearest, spread, log_norm - 0.5 * nearest**2 / variance
        folds = nearest + shifts.reshape(-1, *(1 for _ in nearest.shape))
        log_each = -0.5 * folds**2 / variance
        best = log_each.max(axis=0)
        share = np.exp(log_each - best)
        total = share.sum(axis=0)
        share /= total
        innovation = (share * folds).sum(axis=0)
        spread = (share * (folds - innovation) ** 2).sum(axis=0)
        return innovation, spread, log_norm + best + np.log(total)

    def log_density(self, error: FloatArray, variance: FloatArray | float) -> FloatArray:
        """Return the log density of errors over all folds, elementwise; 0 for NaN."""
        has_rate = np.isfinite(error)
        density = self.fold(np.where(has_rate, error, 0.0), variance)[2]
        return np.where(has_rate, density, 0.0)


class Rates(NamedTuple):
    """The range rates of a report."""

    model: RangeRateModel
    rate: FloatArray  # Metres per second relative to the radar, (M,); NaN where unknown
    std: FloatArray  # Standard deviations, metres per second, (M,)
    # What they have of the range rate in the plane, (M,); see `Detections.level`.
    level: FloatArray | None = None

    def take(self, rows: IntArray) -> Rates:
        """Return the range rates of these rows."""
        level = None if self.level is None else self.level[rows]
        return Rates(self.model, self.rate[rows], self.std[rows], level)


def rates_of(model: RangeRateModel | None, detections: Detections) -> Rates | None:
    """Return the range rates of detections; None without usable ones.

    What a climb adds to them is unknown, and part of their standard deviation.
    """
    rate = detections.range_rate
    if model is None or rate is None:
        return None
    reported_std, usual_std = detections.range_rate_std, np.full(len(detections), model.std)
    if reported_std is not None:
        usual_std = np.where(np.isfinite(reported_std), reported_std, usual_std)
    level, rise = detections.level, detections.rise
    if level is None or rise is None:
        return Rates(model, rate, usual_std)
    climbing = np.nan_to_num(rise) * model.climb_std
    return Rates(model, rate, np.hypot(usual_std, climbing), np.nan_to_num(level, nan=1.0))


@dataclass(frozen=True)
class VelocityModel:
    """Measurement model of velocities over ground, with independent errors along the axes."""

    std: float  # Standard deviation along each axis, metres per second
    # Width of the uniform distribution for false detections along each axis, metres per second:
    # road traffic with some margin.
    span: float = 200.0
    # Width of the distribution of false climb rates, m/s, and the deviation of an unknown one,
    # which counts as 0: its density is nearly 1 / `span`.
    CLIMB_SPAN: ClassVar[float] = 20.0
    UNKNOWN_STD: ClassVar[float] = 80.0

    @staticmethod
    def log_density(error: FloatArray, covariance: FloatArray) -> FloatArray:
        """Return log densities of errors, (..., V), given covariances; 0 where one is unknown."""
        is_known = _are_known(error)
        known = np.where(is_known[..., None], error, 0.0)
        square = (known * np.linalg.solve(covariance, known[..., None])[..., 0]).sum(axis=-1)
        log_scale = np.linalg.slogdet(covariance)[1] + error.shape[-1] * np.log(2.0 * np.pi)
        return np.where(is_known, -0.5 * (square + log_scale), 0.0)


class Velocities(NamedTuple):
    """The velocities of a report in the world frame."""

    model: VelocityModel
    velocity: FloatArray  # Metres per second, (M, V) with V = 2 or 3; NaN where unknown
    noise: FloatArray  # Covariances, (M, V, V)

    @property
    def is_known(self) -> BoolArray:
        """Whether each velocity is known, (M,)."""
        return _are_known(self.velocity)

    @property
    def log_clutter(self) -> FloatArray:
        """Log densities of the velocities of false detections, (M,); 0 where one is unknown."""
        model, area = self.model, np.full(len(self.velocity), 2.0 * math.log(self.model.span))
        if self.velocity.shape[1] > 2:
            is_measured = self.noise[:, 2, 2] < model.UNKNOWN_STD**2
            area += np.log(np.where(is_measured, model.CLIMB_SPAN, model.span))
        return np.where(self.is_known, -area, 0.0)

    def take(self, rows: IntArray) -> Velocities:
        """Return the velocities of these rows."""
        return Velocities(self.model, self.velocity[rows], self.noise[rows])


def _are_known(vectors: FloatArray) -> BoolArray:
    """Return whether all components of vectors, (..., V), are known."""
    known: BoolArray = np.logical_and.reduce(np.isfinite(vectors), axis=-1)
    return known
