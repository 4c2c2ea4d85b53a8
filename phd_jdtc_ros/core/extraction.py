"""From an intensity to targets: by detection component, or by the paper's clustering."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy import sparse
from scipy.cluster.vq import kmeans2

from . import resampling
from .modes import ModeSpace
from .types import Estimates, FloatArray, IntArray, ParticlePHD, sum_by

# A component is a target when it is likelier than not.
EXISTENCE_THRESHOLD = 0.5
CLUSTER_SAMPLES = 2000


class Extraction(Protocol):
    """How targets are read off an intensity."""

    def __call__(
        self,
        phd: ParticlePHD,
        modes: ModeSpace,
        stamp_ns: int,
        lag: int,
        rng: np.random.Generator,
    ) -> Estimates:
        """Return the targets of `phd`, filtered (lag 0) or smoothed."""
        ...


def components(
    phd: ParticlePHD, modes: ModeSpace, stamp_ns: int, lag: int, rng: np.random.Generator
) -> Estimates:
    """Report every detection component, and every unexplained group, likelier than not.

    A group is the mass of one (origin, class) that no detection explains: without it, a target
    that all radars missed would vanish for a scan. The class is the majority of the mass, the
    state and covariance are those of that class. A mass above 1.5 is two unresolved targets,
    reported as one.

    Notes
    -----
    Deviation from Sec. IV-C, Step 6, which rounds the total mass and clusters; the PHD's mass is
    biased and a detection already says which particles belong together.
    """
    entry = phd.explained.tocoo()
    target_class = modes.class_of[phd.mode]
    # Unexplained groups follow the components in one index space.
    first_group = phd.explained.shape[1]
    origins, origin_index = np.unique(phd.origin, return_inverse=True)
    classes = len(modes.classes)
    row = np.concatenate([entry.row, np.arange(len(phd))])
    group = np.concatenate([entry.col, first_group + origin_index.ravel() * classes + target_class])
    weight = np.concatenate([entry.data, phd.unexplained])
    size = first_group + len(origins) * classes
    mass = sum_by(group, weight, size)

    found = np.flatnonzero(mass > EXISTENCE_THRESHOLD)
    label = np.full(size, -1)
    label[found] = np.arange(len(found))
    kept = label[group] >= 0
    row, group, weight = row[kept], label[group[kept]], weight[kept]
    return _moments(phd, modes, stamp_ns, lag, row, group, weight, len(found))


def _moments(
    phd: ParticlePHD,
    modes: ModeSpace,
    stamp_ns: int,
    lag: int,
    row: IntArray,
    group: IntArray,
    weight: FloatArray,
    count: int,
) -> Estimates:
    """Return the moments of each group's majority class; entries are (row, group, weight)."""
    classes = len(modes.classes)
    target_class = modes.class_of[phd.mode[row]]
    class_mass = sum_by(group * classes + target_class, weight, count * classes).reshape(
        count, classes
    )
    mass = class_mass.sum(axis=1)
    majority = class_mass.argmax(axis=1) if count else np.zeros(0, dtype=np.int64)
    kept = target_class == majority[group]
    row, group = row[kept], group[kept]
    share = weight[kept] / class_mass[group, majority[group]]

    # A (T, entries) matrix of shares turns both moments into sparse products.
    member = sparse.csr_array((share, (group, np.arange(len(row)))), shape=(count, len(row)))
    state = member @ phd.state[row]
    offset = phd.state[row] - state[group]
    dimension = phd.state.shape[1]
    outer = (offset[:, :, None] * offset[:, None, :]).reshape(len(row), dimension**2)
    covariance = (member @ outer).reshape(count, dimension, dimension)
    return Estimates(
        stamp_ns=stamp_ns,
        lag=lag,
        state=state,
        covariance=covariance,
        weight=mass,
        class_probability=class_mass / np.where(mass > 0.0, mass, 1.0)[:, None],
        class_id=majority,
        track_id=np.zeros(count, dtype=np.int64),
    )


def clusters(
    phd: ParticlePHD, modes: ModeSpace, stamp_ns: int, lag: int, rng: np.random.Generator
) -> Estimates:
    """Round each class's mass to a number of targets and cluster its particles by k-means.

    Notes
    -----
    Sec. IV-C, Steps 5 and 6: resample within each class, then cluster within each class.
    """
    target_class = modes.class_of[phd.mode]
    rows, groups, count = [], [], 0
    for class_id in range(len(modes.classes)):
        member = np.flatnonzero(target_class == class_id)
        weight = phd.weight[member]
        targets = round(float(weight.sum()))
        if targets == 0:
            continue
        copies = resampling.systematic(
            weight, np.zeros(len(member), dtype=np.int64), np.array([CLUSTER_SAMPLES]), rng
        )
        drawn = np.repeat(member, copies)
        scale = phd.state[drawn].std(axis=0)
        whitened = phd.state[drawn] / np.where(scale > 0.0, scale, 1.0)
        # The seed is an integer because scipy renamed the argument that takes a generator.
        _, label = kmeans2(whitened, targets, minit="++", seed=int(rng.integers(2**31)))
        rows.append(drawn)
        groups.append(count + label)
        count += targets
    if count == 0:
        return _moments(phd, modes, stamp_ns, lag, *_no_entries(), 0)
    row, group = np.concatenate(rows), np.concatenate(groups)
    size = np.bincount(group, minlength=count)
    # k-means may leave a cluster empty; it is not a target.
    label = np.cumsum(size > 0) - 1
    return _moments(
        phd, modes, stamp_ns, lag, row, label[group], 1.0 / size[group], int((size > 0).sum())
    )


def _no_entries() -> tuple[IntArray, IntArray, FloatArray]:
    return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0)


EXTRACTIONS: dict[str, Extraction] = {"components": components, "clusters": clusters}
