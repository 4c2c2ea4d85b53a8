"""Measured velocities: noise, and the distribution for false detections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class VelocityModel:
    """Measurement model of velocities over ground, with independent errors along both axes."""

    std: float  # Standard deviation along each axis, metres per second
    # Width of the uniform distribution for false detections along each axis, metres per second:
    # road traffic with some margin.
    span: float = 200.0

    @property
    def log_clutter_area(self) -> float:
        """Log area of the uniform distribution for false detections."""
        return float(2.0 * np.log(self.span))

    @staticmethod
    def log_density(error: FloatArray, covariance: FloatArray) -> FloatArray:
        """Return log densities of errors, (..., 2), given covariances; 0 where one is unknown."""
        is_known = _are_known(error)
        known = np.where(is_known[..., None], error, 0.0)
        square = (known * np.linalg.solve(covariance, known[..., None])[..., 0]).sum(axis=-1)
        log_scale = np.linalg.slogdet(covariance)[1] + 2.0 * np.log(2.0 * np.pi)
        return np.where(is_known, -0.5 * (square + log_scale), 0.0)


class Velocities(NamedTuple):
    """The velocities of a report in the world frame."""

    model: VelocityModel
    velocity: FloatArray  # Metres per second, (M, 2); NaN where unknown
    noise: FloatArray  # Covariances, (M, 2, 2)

    @property
    def is_known(self) -> BoolArray:
        """Whether each velocity is known, (M,)."""
        return _are_known(self.velocity)

    def take(self, rows: IntArray) -> Velocities:
        """Return the velocities of these rows."""
        return Velocities(self.model, self.velocity[rows], self.noise[rows])


def _are_known(vectors: FloatArray) -> BoolArray:
    """Return whether all components of vectors, (..., 2), are known."""
    known: BoolArray = np.logical_and.reduce(np.isfinite(vectors), axis=-1)
    return known
