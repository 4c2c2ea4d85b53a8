"""Positions and velocities of their own for the particles of a young target.

Where the process noise is small, the particles of a target stay on the paths on which they were
born. With every scan the target's position and the velocity that no range rate tells are known
better, fewer of the paths have both, and the particles are soon copies of a handful, spread less
than the target is uncertain. The particles of a young target are therefore moved a little, each
distinct one by its own draw, and drawn together by so much that their mean and covariance stay the
same in expectation.

Notes
-----
With the mean m and the covariance P of position and velocity, x becomes
m + sqrt(1 - h^2) (x - m) + h e with e from N(0, P). That is a draw from a kernel density with
shrinkage. It is no importance sampling: a Gaussian density of position and velocity stays as it
is, and another one becomes smoother; their covariance with the turn rate, which is not moved,
shrinks by sqrt(1 - h^2). The folds of an ambiguous range rate are far apart, so that each has a
mean and a covariance of its own.

References
----------
Musso, Oudjane and Le Gland, "Improving regularised particle filters", in *Sequential Monte Carlo
Methods in Practice*, 2001; Liu and West, "Combined parameter and state estimation in
simulation-based filtering", in the same book, for the shrinkage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...arrays import FloatArray, IntArray, factorize, run_starts, sum_by
from ...sensors.sensor import Sensor
from ...targets.modes import ModeSpace
from ...tracks.labels import first_scan
from ..particle_set import ParticleSet

# Scans in which a target's particles are moved. In the first one, that of its birth, they are not,
# because each particle still has a draw of its own.
YOUNG_SCANS = 25
# h: the deviation of the kernel, as a share of the target's. Both were found by the share of
# positions outside 3 sigma by age in the scenario `automotive`, on seeds 7000 to 7006.
BANDWIDTH = 0.4


def regularised(
    stored: ParticleSet,
    radars: Sequence[Sensor],
    modes: ModeSpace,
    scan_index: int,
    rng: np.random.Generator,
) -> ParticleSet:
    """Return a resampled set in which the particles of young targets are drawn from kernels.

    Parameters
    ----------
    stored : ParticleSet
    radars : sequence of Sensor
        Those that reported in the scan.
    modes : ModeSpace
    scan_index : int
        Of the scan.
    rng : numpy.random.Generator
    """
    age = scan_index - first_scan(stored.origin)
    row = np.flatnonzero((age > 0) & (age < YOUNG_SCANS))
    if not len(row):
        return stored
    key = stored.origin[row] * len(modes.classes) + modes.class_of[stored.mode[row]]
    group = factorize(key)[1]
    state = stored.state.copy()
    for radar in radars:
        if radar.range_rate is not None and radar.range_rate.ambiguity:
            rate = radar.range_rate_of(state[row])
            group = _parted(group, rate, radar.range_rate.ambiguity)
    place = np.ix_(row, np.array([*modes.space.position, *modes.space.velocity]))
    state[place] = _smoothed(state[place], stored.weight[row], group, rng)
    return replace(stored, state=state)


def _parted(group: IntArray, rate: FloatArray, ambiguity: float) -> IntArray:
    """Return groups by fold too: those of range rates, m/s, about that of a group's first row."""
    order = np.argsort(group, kind="stable")
    first = order[run_starts(group[order])]
    fold = np.round((rate - rate[first][group]) / ambiguity).astype(np.int64)
    fold -= fold.min()
    parted: IntArray = factorize(group * (fold.max() + 1) + fold)[1]
    return parted


def _smoothed(
    value: FloatArray, weight: FloatArray, group: IntArray, rng: np.random.Generator
) -> FloatArray:
    """Return draws from the kernels about values, (N, K), of groups with means and covariances."""
    count, size = int(group.max()) + 1, value.shape[1]
    share = weight / sum_by(group, weight, count).take(group)
    mean = np.stack([sum_by(group, share * axis, count) for axis in value.T], axis=1)
    offset = value - mean.take(group, axis=0)
    covariance = np.empty((count, size, size))
    for i in range(size):
        for j in range(i, size):
            product = share * offset[:, i] * offset[:, j]
            covariance[:, i, j] = covariance[:, j, i] = sum_by(group, product, count)
    # Not Cholesky's factor: a group of few particles has a singular covariance.
    variance, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(variance, 0.0))[:, None, :]
    normal = rng.standard_normal(value.shape)
    # Written out by axes: products of many matrices of four rows cost several times as much.
    kernel = np.zeros_like(value)
    for i in range(size):
        for j in range(size):
            kernel[:, i] += root[:, i, j].take(group) * normal[:, j]
    drawn: FloatArray = mean.take(group, axis=0)
    drawn += np.sqrt(1.0 - BANDWIDTH**2) * offset + BANDWIDTH * kernel
    return drawn
