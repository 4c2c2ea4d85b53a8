"""Covariance of deviations from the motion models.

A detection with a target's unique identity outside its gates is of a target that has manoeuvred, or
a reflection: see `factors.transponder.reflections`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from .tracker_model import TrackerModel

# Probability that a target without a detection in its gate has deviated from its motion models.
PROBABILITY = 1e-3
# Standard deviation of its acceleration since its last detection, along each axis, m/s^2: one g.
# A slow target turns no faster than it can, rad/s, and gains speed, m/s^2: one that is parked does
# not leave its place by an error of the radar.
ACCELERATION, TURN_RATE, SPEEDING = 10.0, 0.1, 1.0


class Manoeuvre(NamedTuple):
    """Covariance of targets' deviations from their motion models since their last detections.

    The deviations along both axes are independent and have the same covariance.
    """

    position: FloatArray  # Variance of the position, m^2, (L,)
    velocity: FloatArray  # Variance of the velocity, m^2/s^2, (L,)
    position_velocity: FloatArray  # Covariance of position and velocity, m^2/s, (L,)
    turn_rate: float  # Variance of the turn rate, rad^2/s^2


def manoeuvre(since_s: FloatArray, speed: FloatArray, model: TrackerModel) -> Manoeuvre:
    """Return the covariance of deviations `since_s` seconds after the last detection, shape (L,).

    `speed` are the targets' speeds, metres per second, (L,). The acceleration is white noise: of
    the variance s^2 that the velocity gets in t, the position gets s^2 t^2 / 3. The standard
    deviation of the velocity is at most that of a new target.
    """
    births = model.detection_births
    acceleration = np.minimum(TURN_RATE * speed + SPEEDING, ACCELERATION)
    velocity = np.minimum(acceleration * since_s, births.velocity_std) ** 2
    return Manoeuvre(
        velocity * since_s**2 / 3.0,
        velocity,
        0.5 * velocity * since_s,
        births.turn_rate_std**2,
    )
