"""What a target may do beyond its motion models, and a radar be off by beyond its noise.

A target that is known to be seen, by an identity that only it has, is where it is seen, however
improbable that is by the motions and deviations that were configured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from .tracker_model import TrackerModel

# Probability that a target that was not seen where it was expected did something else.
PROBABILITY = 1e-3
# Standard deviation of its acceleration since it was last seen, along each axis, m/s^2: one g.
ACCELERATION = 10.0
# Of what a radar is off by, along each axis, metres.
OFFSET = 50.0


class Manoeuvre(NamedTuple):
    """What targets have done since they were last seen, beyond their motion models.

    The same along both axes, and independent.

    Parameters
    ----------
    position, velocity : arrays of shape (L,)
        Variances.
    both : array of shape (L,)
        Covariance of position and velocity.
    turn_rate : float
        Variance.
    """

    position: FloatArray
    velocity: FloatArray
    both: FloatArray
    turn_rate: float


def manoeuvre(since_s: FloatArray, model: TrackerModel) -> Manoeuvre:
    """Return what targets may have done in some seconds, shape (L,).

    Notes
    -----
    The acceleration a is constant, so that the velocity changes by a t and the position by half of
    a t^2; but velocities do not spread more than those of new targets.
    """
    births = model.detection_births
    speed = np.minimum(ACCELERATION * since_s, births.velocity_std)
    moved = 0.5 * since_s * speed
    return Manoeuvre(moved**2 + OFFSET**2, speed**2, moved * speed, births.turn_rate_std**2)
