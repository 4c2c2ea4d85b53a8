"""Extra hypotheses for targets whose identities are detected outside all their gates.

A detection with a target's unique identity outside its gates is of a target that has manoeuvred, or
a reflection: see `factors.transponder.reflections`.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..association.evidence import OutOfGate
from ..models.tracker_model import TrackerModel
from .mixture import Mixture
from .reduction import Branched

# Probability that a target without a detection in its gate has deviated from its motion models.
PROBABILITY = 1e-3
# Standard deviation of its acceleration since its last detection, along each axis, m/s^2: one g.
# A slow target turns no faster than it can, rad/s, and gains speed, m/s^2: one that is parked does
# not leave its place by an error of the radar.
ACCELERATION, TURN_RATE, SPEEDING = 10.0, 0.1, 1.0


def with_reacquired(predicted: Branched, lost: OutOfGate, model: TrackerModel) -> Branched:
    """Return the hypotheses with one more for each lost target: a manoeuvre beyond its models.

    It is a copy of the target's most probable hypothesis with a covariance that the manoeuvre
    inflates, and has the same parent. Its weight is negligible for detections without identities.
    """
    mixture = predicted.mixture
    target, lost_row = np.unique(lost.target, return_index=True)
    order = np.lexsort((-mixture.sums.mass, mixture.sums.target))
    row = order[np.searchsorted(mixture.sums.target[order], target)]
    mean = mixture.mean[row][:, :, list(model.modes.space.velocity)]
    speed = np.hypot(mean[..., 0], mean[..., 1]).max(axis=1)
    spread = _manoeuvre_covariance(lost.since_s[lost_row], speed, mixture.mean.shape[2], model)
    used = mixture.covariance[row][:, :, np.arange(len(spread[0])), np.arange(len(spread[0]))] > 0.0
    weight = mixture.weight.copy()
    weight[np.isin(mixture.sums.target, target)] *= 1.0 - PROBABILITY
    share = (
        PROBABILITY * mixture.sums.existence[target] / np.maximum(mixture.sums.mass[row], 1e-300)
    )
    added = Mixture(
        mixture.row_label[row],
        share[:, None, None] * mixture.weight[row],
        mixture.mean[row],
        mixture.covariance[row] + spread[:, None] * used[..., :, None] * used[..., None, :],
        mixture.snr[row],
    )
    return Branched(
        Mixture.concatenate([mixture.changed(weight=weight), added]),
        np.concatenate([predicted.parent, predicted.parent[row]]),
    )


def _manoeuvre_covariance(
    since_s: FloatArray, speed: FloatArray, size: int, model: TrackerModel
) -> FloatArray:
    """Return the covariances of deviations from the motion models, shape (L, D, D).

    They are those of targets of some speeds, m/s, some seconds after their last detections, both
    (L,). The acceleration along each axis is white noise: of the variance s^2 that the velocity
    gets in t, the position gets s^2 t^2 / 3. The standard deviation of the velocity is at most that
    of a new target.
    """
    births, space = model.detection_births, model.modes.space
    acceleration = np.minimum(TURN_RATE * speed + SPEEDING, ACCELERATION)
    variance = np.minimum(acceleration * since_s, births.velocity_std) ** 2
    spread = np.zeros((len(since_s), size, size))
    for position, velocity in zip(space.position, space.velocity, strict=True):
        spread[:, position, position] = variance * since_s**2 / 3.0
        spread[:, velocity, velocity] = variance
        spread[:, position, velocity] = spread[:, velocity, position] = 0.5 * variance * since_s
    spread[:, space.turn_rate, space.turn_rate] = births.turn_rate_std**2
    return spread
