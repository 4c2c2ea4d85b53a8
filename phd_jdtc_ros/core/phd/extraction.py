"""Extraction of targets from an intensity (Sec. IV-C, Step 6): by component, or by clustering."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from ..arrays import FloatArray, IntArray, factorize, sum_by
from ..targets.modes import ModeSpace
from ..types import Estimates
from . import resampling
from .particles import Particles

# Number of particles as which the process noise of one interval counts in a target's covariance.
# Later scans leave weight on few particles, whose sample covariance is too small, or zero for one.
PRIOR_PARTICLES = 2.0


class Groups(NamedTuple):
    """Groups of rows of an intensity, each of which is a target."""

    row: IntArray  # Row of each entry, (E,)
    group: IntArray  # Its group, 0 to G - 1, (E,)
    weight: FloatArray  # Its weight in the group, (E,)


# Returns the targets of a particle set, given the mass above which they are reported.
Extraction: TypeAlias = Callable[[Particles, ModeSpace, float, np.random.Generator], Groups]
# Returns the mean and the covariance of the states of each group, (G, D) and (G, D, D), given the
# entries of `Groups`.
MomentsOf: TypeAlias = Callable[[IntArray, IntArray, FloatArray], tuple[FloatArray, FloatArray]]


def groups_above(threshold: float, key: IntArray, row: IntArray, weight: FloatArray) -> Groups:
    """Return the groups of equal `key` with a mass above the threshold; the arguments are (E,)."""
    distinct, index = factorize(key)
    reported = sum_by(index, weight, len(distinct)) > threshold
    is_reported, rank = reported[index], np.cumsum(reported) - 1
    return Groups(row[is_reported], rank[index[is_reported]], weight[is_reported])


def components(
    particles: Particles, modes: ModeSpace, threshold: float, rng: np.random.Generator
) -> Groups:
    """Report every component, and every group of the Poisson part, with a mass above the threshold.

    A group is the Poisson mass of one (origin, class). Without groups, a target that all radars
    missed would not be reported for a scan. A mass above 1.5 stands for two unresolved targets,
    which are reported as one.

    Deviation from Sec. IV-C, Step 6, which takes the number of targets from the sum of the weights
    and clusters: the mass of the PHD filter is biased, and components already group the particles
    of each target.
    """
    parts, (poisson,) = particles.components, particles.poisson.nonzero()
    entry_row = np.arange(len(particles)).repeat(np.diff(parts.indptr))
    unexplained = particles.origin[poisson] * len(modes.classes)
    unexplained += modes.class_of[particles.mode[poisson]]
    return groups_above(
        threshold,
        key=np.concatenate([parts.indices, parts.shape[1] + unexplained]),
        row=np.concatenate([entry_row, poisson]),
        weight=np.concatenate([parts.data, particles.poisson[poisson]]),
    )


def clusters(
    particles: Particles, modes: ModeSpace, threshold: float, rng: np.random.Generator
) -> Groups:
    """Round each class's mass to a number of targets and cluster its particles by k-means.

    Sec. IV-C, Steps 5 and 6: resample within each class, then cluster within each class.
    """
    # This is imported here to shorten a node's start: the default extraction does not need it.
    from scipy.cluster.vq import kmeans2

    target_class = modes.class_of[particles.mode]
    rows, groups, count = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)], 0
    for class_id in range(len(modes.classes)):
        member = np.flatnonzero(target_class == class_id)
        weight = particles.weight[member]
        targets = round(float(weight.sum()))
        if targets == 0:
            continue
        cluster_samples = 2000
        drawn = member[resampling.draw(weight, cluster_samples, rng)]
        scale = particles.state[drawn].std(axis=0)
        whitened = particles.state[drawn] / np.where(scale > 0.0, scale, 1.0)
        # The seed is an integer because scipy renamed the argument that takes a generator.
        _, label = kmeans2(whitened, targets, minit="++", seed=int(rng.integers(2**31)))
        rows.append(drawn)
        groups.append(count + label)
        count += targets
    # A cluster that k-means leaves empty is no target.
    _, group = factorize(np.concatenate(groups))
    return Groups(np.concatenate(rows), group, 1.0 / np.bincount(group)[group])


def estimates(
    groups: Groups, mode: IntArray, modes: ModeSpace, moments_of: MomentsOf, stamp_ns: int, lag: int
) -> Estimates:
    """Return the moments of each group's class of largest mass; `mode` has the mode of each row."""
    row, group, weight = groups
    classes, count = len(modes.classes), int(group.max(initial=-1)) + 1
    target_class = modes.class_of[mode[row]]
    class_mass = sum_by(group * classes + target_class, weight, count * classes)
    class_mass = class_mass.reshape(count, classes)
    majority, mass = class_mass.argmax(axis=1), class_mass.sum(axis=1)
    in_majority = target_class == majority[group]
    mean, covariance = moments_of(row[in_majority], group[in_majority], weight[in_majority])
    return Estimates(
        stamp_ns=stamp_ns,
        lag=lag,
        state=mean,
        covariance=covariance,
        weight=mass,
        class_probability=class_mass / mass[:, None],
        class_id=majority,
        track_id=np.zeros(count, dtype=np.int64),
        space=modes.space,
    )


def moments_of_particles(particles: Particles, modes: ModeSpace) -> MomentsOf:
    """Return the moments of particles, regular on the axes of their modes for any number of them.

    The sample covariance is increased by a share of the process noise of one interval:
    `PRIOR_PARTICLES` over the sum of these and the effective number of particles.
    """

    def moments_of(
        row: IntArray, group: IntArray, weight: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        state, count = particles.state[row], int(group.max(initial=-1)) + 1
        share = weight / sum_by(group, weight, count)[group]
        mean = np.stack([sum_by(group, share * axis, count) for axis in state.T], axis=1)
        offset = (state - mean[group]).T
        prior = PRIOR_PARTICLES / (1.0 / sum_by(group, share**2, count) + PRIOR_PARTICLES)
        by_mode = sum_by(group * len(modes) + particles.mode[row], share, count * len(modes))
        noise = np.tensordot(by_mode.reshape(count, len(modes)), modes.noise(modes.interval_s), 1)
        covariance = prior[:, None, None] * noise
        # One pair of axes at a time keeps temporary arrays no larger than a column.
        for i, j in np.ndindex(covariance.shape[1:]):
            covariance[:, i, j] += sum_by(group, share * offset[i] * offset[j], count)
        return mean, covariance

    return moments_of
