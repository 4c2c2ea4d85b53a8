"""Detections as Gaussians at places, and the mixture of noises with outliers."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from ..arrays import FloatArray, IntArray

# Standard deviation of the elevation of a detection without one, radians.
UNKNOWN_STD = 30.0


def noise_covariance(std: FloatArray, correlation: FloatArray | None) -> FloatArray:
    """Return covariances, (M, Z, Z), from deviations, (M, Z), and correlations, (M,) or None.

    A correlation is that of the first two components, NaN where unknown; all others are
    independent.
    """
    axis, covariance = np.arange(std.shape[1]), np.zeros((*std.shape, std.shape[1]))
    covariance[:, axis, axis] = std**2
    if correlation is not None:
        known_correlation = np.where(np.isfinite(correlation), correlation, 0.0)
        covariance[:, 0, 1] = covariance[:, 1, 0] = known_correlation * std[:, 0] * std[:, 1]
    return covariance


class PlanePlots(NamedTuple):
    """Detections as positions in the world frame, at their own times."""

    # Metres, (M, P), where P is 2, or 3 in space; see `StateSpace.place`.
    position: FloatArray
    axes: FloatArray  # Principal axes of the errors, unit vectors in columns, (M, P, P)
    std: FloatArray  # Standard deviations along these axes, metres, (M, P)

    @classmethod
    def of(cls, position: FloatArray, covariance: FloatArray) -> PlanePlots:
        """Return positions, (M, P), with these covariances, (M, P, P)."""
        variance, axes = np.linalg.eigh(covariance)
        return cls(position, axes, np.sqrt(np.maximum(variance, 0.0)))

    @property
    def root(self) -> FloatArray:
        """Square roots of the covariances, metres, shape (M, P, P)."""
        return self.axes * self.std[:, None, :]

    @property
    def covariance(self) -> FloatArray:
        """Covariances of the positions, square metres, shape (M, P, P)."""
        covariance = np.zeros_like(self.axes)
        for std, axis in zip(self.std.T, np.moveaxis(self.axes, 2, 0), strict=True):
            covariance += (std**2)[:, None, None] * axis[:, :, None] * axis[:, None, :]
        return covariance


class Births(NamedTuple):
    """Hypotheses of the places of targets that are born at detections."""

    row: IntArray  # Detection of each hypothesis, ascending, (K,)
    share: FloatArray  # Probability of each among those of its detection, (K,)
    plots: PlanePlots  # K places


class HeavyTails(Protocol):
    """The noise of a measurement as a mixture of the usual and a larger one."""

    @property
    def share(self) -> float:
        """Probability that a detection of a target has the larger noise."""

    @property
    def ratio(self) -> float:
        """Standard deviations of the larger noise relative to the usual ones."""
