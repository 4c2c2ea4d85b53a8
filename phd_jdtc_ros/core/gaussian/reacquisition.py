"""Extra hypotheses for targets whose identities are detected outside all their gates."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..association.evidence import OutOfGate
from ..models.manoeuvre import PROBABILITY, manoeuvre
from ..models.tracker_model import TrackerModel
from ..state_space import StateSpace
from .mixture import Mixture
from .reduction import Branched


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
    """Return the covariance of each manoeuvre in the state space, shape (L, D, D)."""
    space: StateSpace = model.modes.space
    moments = manoeuvre(since_s, speed, model)
    spread = np.zeros((len(since_s), size, size))
    for position, velocity in zip(space.position, space.velocity, strict=True):
        spread[:, position, position] = moments.position
        spread[:, velocity, velocity] = moments.velocity
        spread[:, position, velocity] = spread[:, velocity, position] = moments.position_velocity
    spread[:, space.turn_rate, space.turn_rate] = moments.turn_rate
    return spread
