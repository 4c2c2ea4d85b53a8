"""Dense groups of rows are split into strata before their pairs are searched.

Where nearly every particle of a label can descend from nearly every other, a kernel's cost grows
with the square of the particles, and most pairs are thinned out afterwards. Such a group is split
into B strata of every B-th earlier and later row, and only rows of one stratum are paired. Rows are
dealt out in turns, not at random, so that each stratum is an even sample of the group. Mu is summed
within a stratum, so that the backward sums over all strata stay about the same.
"""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray, IntArray
from ..particle_set import ParticleSet
from .kernel_thinning import MAX_PAIRS_PER_ROW
from .transition_density import TransitionDensity

# Number of earlier and of later rows of a group that are sampled to estimate its density.
PROBES = 16
# A group is split if its rows have more than this estimated number of pairs each.
DENSE = 2 * MAX_PAIRS_PER_ROW
# Number of pairs of each row in a stratum. With fewer, the moments of a smoothed set of 600
# particles are off by more than a fiftieth of its standard deviation.
LEFT = 3 * MAX_PAIRS_PER_ROW // 2


def split_into_strata(
    kernel: TransitionDensity,
    earlier: ParticleSet,
    later: ParticleSet,
    groups: tuple[IntArray, IntArray],
    radius: float,
) -> tuple[IntArray, IntArray]:
    """Return the groups of the later and the earlier rows, with dense groups split into strata.

    The radius is in standard deviations of the process noise.
    """
    count = int(max(side.max(initial=-1) for side in groups)) + 1
    size = [np.bincount(side, minlength=count) for side in groups]
    large = np.flatnonzero((size[1] > DENSE) & (size[0] > 0))
    if not len(large):
        return groups
    order = [np.argsort(side, kind="stable") for side in groups]
    first = [np.cumsum(number) - number for number in size]
    probe = [
        rows[begin[large, None] + (np.arange(PROBES) * number[large, None]) // PROBES]
        for rows, begin, number in zip(order, first, size, strict=True)
    ]
    pairs = _near_share(kernel, later, probe[0], probe[1], radius) * size[1][large]
    strata = np.ones(count, dtype=np.int64)
    strata[large] = np.where(pairs > DENSE, pairs / LEFT, 1.0).astype(np.int64)
    base = np.cumsum(strata) - strata
    later_stratum, earlier_stratum = (
        _assign_strata(side, particles.weight, strata)
        for side, particles in zip(groups, (later, earlier), strict=True)
    )
    return base[groups[0]] + later_stratum, base[groups[1]] + earlier_stratum


def _assign_strata(group: IntArray, weight: FloatArray, strata: IntArray) -> IntArray:
    """Return the stratum of each row within its group.

    The rows of a group are dealt out in turns, one row to each of its B strata. The heaviest row of
    each turn goes to a different stratum, so that all strata have about the same mass.
    """
    size = np.bincount(group, minlength=len(strata))
    begin = np.cumsum(size) - size
    order = np.argsort(group, kind="stable")
    row_group = group[order]
    turn = (np.arange(len(group)) - begin[row_group]) // strata[row_group]
    by_weight = np.lexsort((weight[order], turn, row_group))
    stratum = np.empty(len(group), dtype=np.int64)
    rank = (np.arange(len(group)) - begin[row_group]) % strata[row_group]
    stratum[order[by_weight]] = (rank + turn) % strata[row_group]
    return stratum


def _near_share(
    kernel: TransitionDensity, later: ParticleSet, row: IntArray, source: IntArray, radius: float
) -> FloatArray:
    """Return the share of the sampled pairs within the radius, by group, (G,)."""
    state, mode = later.state[row.ravel()], later.mode[row.ravel()]
    query = kernel.whiten(state, mode).reshape(*row.shape, -1)
    near_pairs = np.zeros(row.shape[0])
    for motion, matrix in kernel.whitening.items():
        with_motion = np.array([other == motion for other in kernel.modes.motions])[later.mode[row]]
        point = (kernel.successor[motion][source.ravel()] @ matrix).reshape(*source.shape, -1)
        square = ((query[:, :, None] - point[:, None]) ** 2).sum(axis=3)
        near_pairs += ((square <= radius**2) & with_motion[:, :, None]).sum(axis=(1, 2))
    share: FloatArray = near_pairs / (row.shape[1] * source.shape[1])
    return share
