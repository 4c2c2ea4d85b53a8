"""The backward kernel between two stored particle sets (Sec. IV-C, Step 4), built once per scan.

The kernel K and its normaliser mu do not depend on later scans. They are cached, so that every lag
costs one sparse product. Only pairs within a gate of the process noise are kept, which a k-d tree
finds, as in the paper.

Deviation: Step 4 sums all pairs. After a long interval nearly every particle may descend from
nearly every one of the set before. A row with many pairs is therefore thinned, by systematic
resampling in proportion to kernel times weight, so that the memory is linear in the particles. Two
random draws per row already bound the variance of the estimates over time (Olsson and Westerborn,
"Efficient particle-based online smoothing in general hidden Markov models: the PaRIS algorithm",
Bernoulli 23(3), 2017).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import sparse, spatial

from ..arrays import GOLDEN_RATIO, FloatArray, IntArray, SparseArray, add_by_row, run_starts
from ..models.tracker_model import TrackerModel
from ..targets import birth
from ..targets.motion import whitener
from .particles import Particles
from .resampling import comb

# Largest number of pairs of a later row.
MAX_PAIRS_PER_ROW = 128
# Later row, earlier row and density of pairs; the later rows ascend.
Pairs = tuple[IntArray, IntArray, FloatArray]


class Kernel(NamedTuple):
    """The cached backward kernel between two consecutive stored sets."""

    ratio: SparseArray  # K[q, s] / mu_q, transposed: ``B = ratio @ w_{t+1|k}``, (N_t, N_{t+1})
    survival: FloatArray  # P_s over the true interval, (N_t,)
    # Number of later rows for which mu is zero, since no survivor, spawned target or birth is
    # within the gate. Each is linked to its parent instead.
    orphans: int


def build(earlier: Particles, later: Particles, model: TrackerModel, dt: float) -> Kernel:
    """Return the kernel between two stored sets, `dt` seconds apart.

    Within a class K[q, s] = P_s h[r_s, r_q] f_{r_q}(x_q | x_s), and mu_q = gamma(x_q, o_q) +
    sum_s w_{t|t}(s) K[q, s] + sum_s w_{t|t}(s) beta(q | s), the last sum over all classes. As in
    the paper, the spawn intensity is part of mu and not of the numerator. h is the matrix of modes.

    Deviation: f is the motion of the destination mode, and gamma has the probability of the mode.
    The printed variance of omega is zero for constant velocity, a point mass, so that densities
    into this mode are compared in four dimensions, and those into a turn in five.
    """
    modes, spawn = model.modes, model.spawn
    survival, intervals = modes.survival(dt), dt / modes.interval_s
    survived, spawned = survival[:, None] * modes.transition(dt), spawn.rate * spawn.transition
    mu = intervals * birth.intensity(model.births, modes, later.state, later.mode)
    none = np.zeros(0, dtype=np.int64)
    parts: list[Pairs] = [(none, none, np.zeros(0))]
    for mode, motion in enumerate(modes.motions):
        support, (rows,) = list(motion.support), (later.mode == mode).nonzero()
        state, successor = later.state[rows][:, support], motion.mean(earlier.state, dt)[:, support]
        noise = motion.noise_covariance(dt), np.diag(spawn.std[support] ** 2)
        for row, column, kernel in _near(state, successor, noise[0], survived[earlier.mode, mode]):
            weight, later_row = earlier.weight[column], rows[row]
            add_by_row(mu, later_row, kernel * weight)
            parts.append(thin((later_row, column, kernel), weight))
        for row, column, beta in _near(state, successor, noise[1], spawned[earlier.mode, mode]):
            add_by_row(mu, rows[row], intervals * beta * earlier.weight[column])
    row, column, kernel = (np.concatenate(each) for each in zip(*parts, strict=True))
    # An orphan is paired with its parent alone, to which its whole weight returns.
    orphan = np.flatnonzero((mu <= 0.0) & (later.parent >= 0))
    parent = later.parent[orphan]
    ratio = np.concatenate([kernel / mu[row], 1.0 / earlier.weight[parent]])
    index = np.concatenate([column, parent]), np.concatenate([row, orphan])
    matrix = sparse.csr_array((ratio, index), shape=(len(earlier), len(later)))
    return Kernel(matrix, survival[earlier.mode], len(orphan))


def _near(
    state: FloatArray, successor: FloatArray, noise: FloatArray, rate: FloatArray
) -> Iterator[Pairs]:
    """Yield the pairs of later states and noise-free successors within the gate of the noise.

    States, (N, K) and (N_t, K), and noise, (K, K), are on one motion's support. The density of the
    noise is multiplied by the rate of each earlier row, (N_t,), and left out where that is zero.
    """
    matrix, log_determinant = whitener(noise)
    peak = np.exp(log_determinant - 0.5 * len(noise) * np.log(2.0 * np.pi))
    (sources,) = rate.nonzero()
    # At most a million pairs at a time, 25 MB: after a long interval nearly every particle may
    # descend from every one of the set before.
    query, step = state @ matrix.T, max((1 << 20) // max(len(sources), 1), 1)
    tree = spatial.cKDTree(successor[sources] @ matrix.T, balanced_tree=False)
    for begin in range(0, len(query), step):
        # Gate on the process noise, in standard deviations: with 6, single weights are off by 5 %,
        # with 7 by up to 2e-3, and with 7.5 by less than 1e-4.
        part = spatial.cKDTree(query[begin : begin + step], balanced_tree=False)
        near = part.sparse_distance_matrix(tree, 7.5, output_type="ndarray")
        order = np.argsort(near["i"] * len(sources) + near["j"])
        row, column = near["i"][order], sources[near["j"][order]]
        yield begin + row, column, peak * np.exp(-0.5 * near["v"][order] ** 2) * rate[column]


def thin(pairs: Pairs, weight: FloatArray) -> Pairs:
    """Return the pairs, with long rows replaced by a systematic selection of their pairs.

    The rows ascend and are complete, and the columns of a row ascend. `weight` is that of the
    earlier row of each pair. At most `MAX_PAIRS_PER_ROW` pairs per row are kept, and each row keeps
    its sum of kernel times weight.

    The selection is deterministic: the offset of a row's comb follows from the row's number, and
    the offsets of many rows are spread evenly over the distance of two teeth, so that over many
    rows a pair is hit in proportion to its share.
    """
    row, column, value = pairs
    if not (row[MAX_PAIRS_PER_ROW:] == row[:-MAX_PAIRS_PER_ROW]).any():  # Mostly no row is long
        return pairs
    first = run_starts(row)
    count = np.diff(np.append(first, len(row)))
    in_long_row = (count > MAX_PAIRS_PER_ROW).repeat(count)
    pair = np.flatnonzero(in_long_row)
    long_row = row[first[count > MAX_PAIRS_PER_ROW]]
    group = np.arange(len(long_row)).repeat(count[count > MAX_PAIRS_PER_ROW])
    share = value[pair] * weight[pair]
    mu = np.bincount(group, share)
    # The combs of consecutive rows begin at different offsets, the same in every run.
    offset = np.asarray(long_row * GOLDEN_RATIO % 1.0)
    copies = comb(share, group, np.full(len(long_row), MAX_PAIRS_PER_ROW), offset)
    is_kept, is_hit = np.logical_not(in_long_row), copies > 0
    pair, group = pair[is_hit], group[is_hit]
    is_kept[pair] = True
    value = value.copy()
    value[pair] = copies[is_hit] * mu[group] / (MAX_PAIRS_PER_ROW * weight[pair])
    return row[is_kept], column[is_kept], value[is_kept]
