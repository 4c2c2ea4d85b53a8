"""Possible paths of targets from now on: samples of their mixtures, moved by their motion modes.

A path begins at a sample of one of a target's Gaussians, changes its motion mode as the mode matrix
says, and has the process noise of each mode. So the paths show turns, and that a target that has
long flown straight will probably go on doing so, which the moments of an estimate do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..targets.modes import ModeSpace
from .dynamics import Dynamics
from .mixture import Mixture


class Samples(NamedTuple):
    """Samples of the states of targets."""

    state: FloatArray  # (N, D)
    mode: IntArray  # Flat mode of each, (N,)

    @staticmethod
    def concatenate(parts: Sequence[Samples]) -> Samples:
        """Return several sets of samples, at least one, as one."""
        return Samples(*map(np.concatenate, zip(*parts, strict=True)))


def sample(
    mixture: Mixture, label: int, dynamics: Dynamics, count: int, rng: np.random.Generator
) -> Samples:
    """Return independent samples of the target of a label, given that it exists."""
    modes = dynamics.model.modes
    rows = np.flatnonzero(mixture.row_label == label)
    # By hypothesis and flat mode.
    weight = mixture.weight[rows][:, dynamics.mode_of, modes.class_of].ravel()
    drawn = rng.choice(len(weight), count, p=weight / weight.sum())
    row, flat = np.divmod(drawn, len(modes))
    used, of_sample = np.unique(rows[row] * len(modes) + flat, return_inverse=True)
    row, mode = np.divmod(used, len(modes))
    size, motion = len(modes.space), dynamics.mode_of[mode]
    mean = mixture.mean[row, motion][:, :size]
    root = _root(mixture.covariance[row, motion][:, :size, :size])
    noise = rng.standard_normal((count, size))
    state = mean[of_sample] + np.einsum("nij,nj->ni", root[of_sample], noise)
    return Samples(state, flat)


def moved(samples: Samples, dt: float, modes: ModeSpace, rng: np.random.Generator) -> Samples:
    """Return the samples after `dt` seconds, at least 0, given that the targets survive."""
    if dt <= 0.0:
        return samples
    below = modes.transition(dt).cumsum(axis=1)[:, :-1]
    chance = rng.random(len(samples.mode))
    mode = (chance[:, None] > below[samples.mode]).sum(axis=1)
    noise = rng.standard_normal(samples.state.shape)
    root, state = _root(modes.noise(dt)), samples.state.copy()
    turn_std = np.sqrt([motion.begun_turn_variance for motion in modes.motions])
    straight = np.array([modes.space.turn_rate not in motion.support for motion in modes.motions])
    begins = np.flatnonzero(straight[samples.mode] & (turn_std[mode] > 0.0))
    state[begins, modes.space.turn_rate] = turn_std[mode[begins]] * rng.standard_normal(len(begins))
    for index, motion in enumerate(modes.motions):
        own = np.flatnonzero(mode == index)
        state[own] = motion.mean(state[own], dt) + noise[own] @ root[index].T
    return Samples(state, mode)


def _root(covariance: FloatArray) -> FloatArray:
    """Return matrices whose product with their transposes is a covariance, (..., D, D)."""
    values, vectors = np.linalg.eigh(covariance)
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    return root
