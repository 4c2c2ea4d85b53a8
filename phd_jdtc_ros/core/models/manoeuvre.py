"""Covariance of deviations from the motion models, and of measurement errors beyond the noise.

A detection with a target's unique identity is the target's, however improbable its position is
under the configured motion models and standard deviations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from .tracker_model import TrackerModel

# Probability that a target without a detection in its gate has deviated from its motion models.
PROBABILITY = 1e-3
# Standard deviation of its acceleration since its last detection, along each axis, m/s^2: one g.
ACCELERATION = 10.0
# Standard deviation of a radar's additional error along each axis, metres.
OFFSET = 50.0


class Manoeuvre(NamedTuple):
    """Covariance of targets' deviations from their motion models since their last detections.

    The deviations along both axes are independent and have the same covariance.
    """

    position: FloatArray  # Variance of the position, m^2, (L,)
    velocity: FloatArray  # Variance of the velocity, m^2/s^2, (L,)
    position_velocity: FloatArray  # Covariance of position and velocity, m^2/s, (L,)
    turn_rate: float  # Variance of the turn rate, rad^2/s^2


def manoeuvre(since_s: FloatArray, model: TrackerModel) -> Manoeuvre:
    """Return the covariance of deviations `since_s` seconds after the last detection, shape (L,).

    The acceleration a is constant: the velocity changes by a t and the position by a t^2 / 2. The
    standard deviation of the velocity is at most that of a new target.
    """
    births = model.detection_births
    velocity_std = np.minimum(ACCELERATION * since_s, births.velocity_std)
    position_std = 0.5 * since_s * velocity_std
    return Manoeuvre(
        position_std**2 + OFFSET**2,
        velocity_std**2,
        position_std * velocity_std,
        births.turn_rate_std**2,
    )
