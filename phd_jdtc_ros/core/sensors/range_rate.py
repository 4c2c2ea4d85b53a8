"""Range rates: their noise, their ambiguity, and what false detections have of them.

A pulse-Doppler radar measures the range rate modulo the interval that its pulse repetition gives.
All range rates that differ by whole intervals are folds of one another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray

# Folds whose innovations are farther out than this many deviations count for nothing.
FOLD_SIGMA = 6.0
# With deviations that reach more folds than this to either side, the density is uniform.
MOST_FOLDS = 8


@dataclass(frozen=True)
class RangeRateModel:
    """How a radar measures range rates; they are positive where a target recedes.

    Parameters
    ----------
    std : float
        Standard deviation, metres per second.
    ambiguity : float
        The interval modulo which it measures them, metres per second; 0 if it knows them wholly.
    span : float
        Width of the interval in which the range rates of false detections are uniform if there is
        no ambiguity, metres per second.
    """

    std: float
    ambiguity: float = 0.0
    span: float = 200.0

    @property
    def clutter_width(self) -> float:
        """Width of the interval in which those of false detections are uniform, m/s."""
        return self.ambiguity or self.span

    def wrapped(self, rate: FloatArray) -> FloatArray:
        """Return the folds that are nearest to zero; shape kept."""
        if not self.ambiguity:
            return rate
        nearest: FloatArray = rate - self.ambiguity * np.round(rate / self.ambiguity)
        return nearest

    def folds(self, reach: float) -> FloatArray:
        """Return the shifts, m/s, between a range rate and its folds up to `reach`, shape (K,).

        For a value that is wrapped; the first shift is 0.
        """
        if not self.ambiguity:
            return np.zeros(1)
        count = int(min(np.floor(reach / self.ambiguity + 0.5), MOST_FOLDS))
        numbers = np.arange(-count, count + 1, dtype=np.float64)
        return self.ambiguity * numbers[np.argsort(np.abs(numbers), kind="stable")]

    def folded(
        self, error: FloatArray, variance: FloatArray | float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the innovation over all folds, its variance over them, and its log density.

        Parameters
        ----------
        error : array
            Measured less expected range rate, metres per second.
        variance : array of the same shape, or float
            Of the innovation if there were no ambiguity.

        Returns
        -------
        innovation, spread : arrays of the same shape
            Mean and variance of the folds of the error, weighted by their densities.
        log_density : array of the same shape
            Log of the sum of these densities.

        Notes
        -----
        Where one fold is much more probable than the others the innovation is that fold, and the
        spread is zero. Else the update with the innovation, and with a covariance that is reduced
        by so much less, has the mean and the covariance of the mixture of the updates with each
        fold.
        """
        nearest = self.wrapped(error)
        widest = float(np.sqrt(np.max(variance, initial=0.0)))
        shifts = self.folds(FOLD_SIGMA * widest)
        log_norm = -0.5 * np.log(2.0 * np.pi * np.asarray(variance))
        if len(shifts) == 1:
            spread = np.zeros_like(nearest)
            return nearest, spread, log_norm - 0.5 * nearest**2 / variance
        each = nearest + shifts.reshape(-1, *(1 for _ in nearest.shape))
        log_each = -0.5 * each**2 / variance
        best = log_each.max(axis=0)
        share = np.exp(log_each - best)
        total = share.sum(axis=0)
        share /= total
        innovation = (share * each).sum(axis=0)
        spread = (share * (each - innovation) ** 2).sum(axis=0)
        return innovation, spread, log_norm + best + np.log(total)

    def log_density(self, error: FloatArray, variance: FloatArray | float) -> FloatArray:
        """Return the log density of errors over all folds; 0 where they are NaN, shape kept."""
        known = np.isfinite(error)
        density = self.folded(np.where(known, error, 0.0), variance)[2]
        return np.where(known, density, 0.0)


class Rates(NamedTuple):
    """The range rates of a report.

    Parameters
    ----------
    model : RangeRateModel
    rate : array of shape (M,)
        Metres per second relative to the radar; NaN where it is unknown.
    std : array of shape (M,)
        Metres per second.
    """

    model: RangeRateModel
    rate: FloatArray
    std: FloatArray

    def take(self, rows: IntArray) -> Rates:
        """Return those of these rows."""
        return Rates(self.model, self.rate[rows], self.std[rows])
