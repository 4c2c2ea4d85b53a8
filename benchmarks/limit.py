"""The least work of any search: whiten both sets, sort one and gather it."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.targets.motion import whitener


def whiten_sort_gather(
    earlier: ParticleSet, later: ParticleSet, model: TrackerModel, dt: float
) -> list[FloatArray]:
    """Whiten for every destination mode, sort by one coordinate and gather, without a search."""
    gathered = []
    transition = model.modes.transition(dt)
    for mode, motion in enumerate(model.modes.motions):
        matrix, _ = whitener(motion.noise_covariance(dt))
        support = list(motion.support)
        sources = np.flatnonzero(transition[earlier.mode, mode] > 0.0)
        successor = motion.mean(earlier.state[sources], dt)[:, support] @ matrix.T
        states = later.state[later.mode == mode][:, support] @ matrix.T
        for points in (successor, states):
            order = np.argsort(points[:, 0], kind="stable")
            gathered.append(points[order])
    return gathered
