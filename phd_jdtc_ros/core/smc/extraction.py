"""Extraction of targets from an intensity: by component, or by clustering (Sec. IV-C, Step 6)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from ..arrays import FloatArray, IntArray, factorize, sum_by
from ..targets.modes import ModeSpace
from ..types import Estimates
from . import resampling
from .particle_set import ParticleSet

CLUSTER_SAMPLES = 2000
# Weight, in particles, of the prior covariance of a target. It was tuned by the share of smoothed
# positions outside 3 sigma, on seeds from 9000: one particle is too few.
PRIOR_PARTICLES = 2.0


class Groups(NamedTuple):
    """Groups of particles, each of which is a target."""

    row: IntArray  # Particle of each entry, (E,)
    group: IntArray  # Its group, (E,)
    weight: FloatArray  # Its weight in the group, (E,)
    label: IntArray  # Label of each group's target, (G,); -1 for none


# Returns the targets of a particle set, given the existence probability above which they are
# reported.
Extraction: TypeAlias = Callable[[ParticleSet, ModeSpace, float, np.random.Generator], Groups]


def components(
    particles: ParticleSet, modes: ModeSpace, threshold: float, rng: np.random.Generator
) -> Groups:
    """Report every component, and every group of the Poisson part, with a mass above the threshold.

    A group is the mass of one (label, class) outside all components. Without groups, a target that
    all radars missed would not be reported for a scan. A target's class is the one of largest mass,
    and its state and covariance are the moments of that class. A mass above 1.5 stands for two
    unresolved targets, which are reported as one.

    Deviation from Sec. IV-C, Step 6, which rounds the total mass and clusters: the mass of the
    PHD filter is biased, and components already group the particles of each target.
    """
    parts = particles.components
    target_class = modes.class_of[particles.mode]
    # Groups of the Poisson part are numbered after the components.
    first_group = parts.shape[1]
    poisson = np.flatnonzero(particles.poisson)
    distinct, label_index = factorize(particles.row_label[poisson])
    classes = len(modes.classes)
    row = np.concatenate([np.arange(len(particles)).repeat(np.diff(parts.indptr)), poisson])
    group = np.concatenate(
        [parts.indices, first_group + label_index * classes + target_class[poisson]]
    )
    weight = np.concatenate([parts.data, particles.poisson[poisson]])
    size = first_group + len(distinct) * classes
    mass = sum_by(group, weight, size)

    reported = np.flatnonzero(mass > threshold)
    rank = np.full(size, -1)
    rank[reported] = np.arange(len(reported))
    is_reported = rank[group] >= 0
    row, group, weight = row[is_reported], rank[group[is_reported]], weight[is_reported]
    label = np.concatenate([particles.label, np.full(size - first_group, -1)])[reported]
    return Groups(row, group, weight, label)


def estimates(
    particles: ParticleSet, modes: ModeSpace, stamp_ns: int, lag: int, groups: Groups
) -> Estimates:
    """Return the moments of each group's majority class; `track_id` is the label plus one.

    Later scans leave weight on few particles of a young target, so that their sample covariance is
    too small, and zero for a single one. The covariance is therefore the mean of an inverse Wishart
    posterior: the sample covariance counts as the effective number of particles, and a prior counts
    as `PRIOR_PARTICLES`. The prior is the covariance of all particles as they were drawn, plus the
    process noise of one interval. With hundreds of effective particles the result is the sample
    covariance; it is regular even if all particles descend from one.
    """
    row, group, weight, label = groups
    classes, count = len(modes.classes), len(label)
    target_class = modes.class_of[particles.mode[row]]
    class_mass = sum_by(group * classes + target_class, weight, count * classes).reshape(
        count, classes
    )
    mass = class_mass.sum(axis=1)
    majority = class_mass.argmax(axis=1) if count else np.zeros(0, dtype=np.int64)
    in_majority = target_class == majority[group]
    row, group = row[in_majority], group[in_majority]
    share = weight[in_majority] / class_mass[np.arange(count), majority].take(group)

    # One axis at a time keeps temporary arrays no larger than a column.
    dimension = particles.state.shape[1]
    offset = np.stack([axis.take(row) for axis in particles.state.T])
    state = np.stack([sum_by(group, share * axis, count) for axis in offset], axis=1)
    for axis in range(dimension):
        offset[axis] -= state[:, axis].take(group)
    effective = 1.0 / sum_by(group, share**2, count)
    prior = PRIOR_PARTICLES / (effective + PRIOR_PARTICLES)
    # The weights in the covariance sum to one in every group.
    drawn_share = particles.multiplicity.take(row).astype(np.float64)
    drawn_share /= sum_by(group, drawn_share, count).take(group)
    blended = share + prior.take(group) * (drawn_share - share)
    covariance = np.empty((count, dimension, dimension))
    for i in range(dimension):
        spread = blended * offset[i]
        for j in range(i, dimension):
            covariance[:, i, j] = covariance[:, j, i] = sum_by(group, spread * offset[j], count)
    covariance += prior[:, None, None] * _noise(
        modes, particles.mode.take(row), group, share, count
    )
    return Estimates(
        stamp_ns=stamp_ns,
        lag=lag,
        state=state,
        covariance=covariance,
        weight=mass,
        class_probability=class_mass / np.where(mass > 0.0, mass, 1.0)[:, None],
        class_id=majority,
        track_id=label + 1,
        space=modes.space,
    )


def _noise(
    modes: ModeSpace, mode: IntArray, group: IntArray, share: FloatArray, count: int
) -> FloatArray:
    """Return the process noise of one interval, averaged over each group's modes; (G, D, D)."""
    size = len(modes.space)
    covariance = np.zeros((count, size, size))
    for index, motion in enumerate(modes.motions):
        support = np.array(motion.support)
        of_mode = sum_by(group, share * (mode == index), count)[:, None, None]
        axes = np.ix_(np.arange(count), support, support)
        covariance[axes] += of_mode * motion.noise_covariance(modes.interval_s)
    return covariance


def clusters(
    particles: ParticleSet, modes: ModeSpace, threshold: float, rng: np.random.Generator
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
        drawn = member[resampling.draw(weight, CLUSTER_SAMPLES, rng)]
        scale = particles.state[drawn].std(axis=0)
        whitened = particles.state[drawn] / np.where(scale > 0.0, scale, 1.0)
        # The seed is an integer because scipy renamed the argument that takes a generator.
        _, label = kmeans2(whitened, targets, minit="++", seed=int(rng.integers(2**31)))
        rows.append(drawn)
        groups.append(count + label)
        count += targets
    row, group = np.concatenate(rows), np.concatenate(groups)
    size = np.bincount(group, minlength=count)
    # k-means may leave a cluster empty, which is no target.
    rank = np.cumsum(size > 0) - 1
    unlabelled = np.full(int((size > 0).sum()), -1)
    return Groups(row, rank[group], 1.0 / size[group], unlabelled)


EXTRACTIONS: dict[str, Extraction] = {"components": components, "clusters": clusters}
