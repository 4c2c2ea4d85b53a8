# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The backward kernel between two stored particle sets, built once a scan.

The kernel K and its normaliser mu do not depend on later scans, so they are cached and every lag
costs one sparse product. Only pairs within 7.5 standard deviations of the process noise are kept:
at 6, single weights are off by 5 %, at 7 by up to 2e-3, and at 7.5 by less than 1e-4. Of many pairs
in a row, a draw is kept (`partners`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from ..arrays import FloatArray, IntArray, SparseArray, factorize
from ..models import birth, detection_birth
from ..models.detection_birth import Newborn
from ..models.modes import ModeSpace
from ..models.motion import MotionModel, whitener
from ..models.tracker_model import TrackerModel
from ..pair_search import kernels
from ..pair_search.candidates import near_chunks
from ..pair_search.grid import within_groups
from ..pair_search.rows import Points, Queries
from ..pair_search.sweep import candidates
from . import kernel_thinning
from .correction import Corrector
from .particle_set import ParticleSet

GATE_SIGMA = 7.5
# Spawned mass is summed only as far out as it can change mu by this share, a tenth of what the gate
# may cost: for most rows to 5 or 6 sigma, a quarter less to test.
SPAWN_TOLERANCE = 1e-5
# Of the histogram that bounds the spawned mass; coarser ones bound it less closely.
MOST_BINS = 4096


@dataclass(frozen=True)
class Transition:
    """What the backward step needs to know of two consecutive stored sets.

    Parameters
    ----------
    ratio : sparse array of shape (N_t, N_{t+1})
        K[q, s] / mu_q, transposed, so that ``B = ratio @ w_{t+1|k}``.
    survival : array of shape (N_t,)
        P_s over the true interval.
    orphans : int
        Rows of the later set that neither a parent, a spawn nor a birth explains within the gate;
        each is given to its ancestor.
    """

    ratio: SparseArray
    survival: FloatArray
    orphans: int


class _Kernel(NamedTuple):
    """A transition density: Gaussian about the noise-free successor, times a mode matrix.

    Parameters
    ----------
    transition : array of shape (O, O)
    whitening : dict of motion model to array of shape (D, D)
        Multiplied from the right; zero outside the motion's support.
    peak : array of shape (O,)
        The Gaussian's density at its centre, by mode of the later row.
    successor : dict of motion model to array of shape (N_t, D)
        Noise-free successors of the earlier rows.
    scale : array of shape (N_t,)
        A factor of every earlier row.
    """

    transition: FloatArray
    whitening: dict[MotionModel, FloatArray]
    peak: FloatArray
    successor: dict[MotionModel, FloatArray]
    scale: FloatArray


class _Sums(NamedTuple):
    """A kernel's pairs by later row, and what they add to mu.

    Parameters
    ----------
    value : array of shape (pairs,)
    column : int array of shape (pairs,)
        The earlier rows.
    start : int array of shape (N_{t+1} + 1,)
        Where each later row's pairs begin.
    mu : array of shape (N_{t+1},)
    """

    value: FloatArray
    column: npt.NDArray[np.int32]
    start: npt.NDArray[np.int32]
    mu: FloatArray


def build(
    earlier: ParticleSet,
    later: ParticleSet,
    model: TrackerModel,
    corrector: Corrector,
    dt: float,
    found: tuple[Newborn, ...] = (),
) -> Transition:
    """Return the cached transition between two stored sets.

    Parameters
    ----------
    earlier, later : ParticleSet
        Stored sets at t and t + 1, of N_t and N_{t+1} rows.
    model : TrackerModel
    corrector : Corrector
        With a labelled one, only rows of one origin are joined.
    dt : float
        True interval between them, seconds.
    found : tuple of Newborn
        What the later scan's detections found.

    Returns
    -------
    Transition

    Notes
    -----
    Sec. IV-C, Step 4: K[q, s] = P_s h[r_s, r_q] f_{r_q}(x_q | x_s) within a class, and
    mu_q = gamma(x_q, o_q) + sum_s w_{t|t}(s) K[q, s] + sum_s w_{t|t}(s) beta(q | s), the last sum
    over all classes. As in the paper the spawn intensity stands in mu and not in the numerator.
    Where origins are targets, sums are over rows of the same origin: births and spawned targets
    begin origins of their own and stand in no other's mu.
    """
    modes = model.modes
    survival = modes.survival(dt)[earlier.mode]
    successor = {motion: motion.mean(earlier.state, dt) for motion in dict.fromkeys(modes.motions)}
    noise = {motion: motion.noise_covariance(dt) for motion in successor}
    moved = _kernel(modes, modes.transition(dt), noise, successor, survival)
    if corrector.labelled:
        ratio, column, start, mu = _within_origins(moved, modes, earlier, later)
    else:
        every = np.arange(len(later))
        pairs = _gated_density(moved, modes, earlier, later, every, GATE_SIGMA)
        ratio, column, start, mu = _summed(pairs, earlier, later)
        mu += _appearing(later, model, dt, found)
        if model.spawn.rate > 0.0 and len(earlier):
            mu += _spawn_intensity(mu, earlier, later, model, dt, successor)
    ratio /= np.where(mu > 0.0, mu, 1.0).repeat(np.diff(start))
    # A row without any explanation inside the gate goes to the row it was drawn from, which is
    # the limit of the quotient as the gate widens.
    orphan = np.flatnonzero((mu <= 0.0) & (later.parent >= 0))
    if corrector.labelled:  # spawned ones have no past of their own
        orphan = orphan[later.origin[orphan] == earlier.origin[later.parent[orphan]]]
    if len(orphan):
        heir = later.parent[orphan]
        ratio = np.insert(ratio, start[orphan], 1.0 / earlier.weight[heir])
        column = np.insert(column, start[orphan], heir.astype(np.int32))
        start[1:] += np.cumsum(np.bincount(orphan, minlength=len(later))).astype(np.int32)
    return Transition(
        ratio=sparse.csc_array((ratio, column, start), shape=(len(earlier), len(later))),
        survival=survival,
        orphans=len(orphan),
    )


def _appearing(
    later: ParticleSet, model: TrackerModel, dt: float, found: tuple[Newborn, ...]
) -> FloatArray:
    """Return the intensity of births at every later row, shape (N_{t+1},)."""
    modes, state, mode = model.modes, later.state, later.mode
    total = birth.intensity(model.births, modes, state, mode) * dt / modes.interval_s
    for one in found:
        total += detection_birth.intensity(one, model.detection_births, modes, state, mode)
    return total


def _kernel(
    modes: ModeSpace,
    transition: FloatArray,
    covariance: dict[MotionModel, FloatArray],
    successor: dict[MotionModel, FloatArray],
    scale: FloatArray,
) -> _Kernel:
    """Return the kernel with this noise on each motion's support."""
    whitening, peak = {}, {}
    for motion, noise in covariance.items():
        matrix, log_determinant = whitener(noise)
        support = list(motion.support)
        size = successor[motion].shape[1]
        whitening[motion] = np.zeros((size, size))
        whitening[motion][np.ix_(support, support)] = matrix.T
        peak[motion] = np.exp(log_determinant - 0.5 * len(support) * np.log(2.0 * np.pi))
    by_mode = np.array([peak[motion] for motion in modes.motions])
    return _Kernel(transition, whitening, by_mode, successor, scale)


def _spawn_intensity(
    mu: FloatArray,
    earlier: ParticleSet,
    later: ParticleSet,
    model: TrackerModel,
    dt: float,
    successor: dict[MotionModel, FloatArray],
) -> FloatArray:
    """Return sum_s w(s) beta(q | s) for every later row, shape (N_{t+1},).

    `mu` is what survival and births give. Beyond the radius r of a row, the spawned intensity is
    at most that of all mass within the gate at the distance r, and that must be a small share of
    `mu`.
    """
    spawn, modes = model.spawn, model.modes
    noise = {motion: np.diag(spawn.std[list(motion.support)] ** 2) for motion in successor}
    rate = spawn.rate * dt / modes.interval_s
    beside = _kernel(modes, spawn.transition, noise, successor, rate * earlier.weight)
    most = (beside.peak * spawn.transition.max(axis=0))[later.mode]
    most *= _mass_about(later.state, beside, GATE_SIGMA * spawn.std, modes.space.position)
    tiny = np.finfo(float).tiny
    log_share = np.log(np.maximum(most, tiny)) - np.log(np.maximum(mu, tiny))
    square = np.minimum(2.0 * (log_share - np.log(SPAWN_TOLERANCE)), GATE_SIGMA**2)
    rows = np.flatnonzero(square > 0.0)
    radius = np.sqrt(square[rows])
    total = np.zeros(len(rows))
    for row, _, value in _gated_density(beside, modes, earlier, later, rows, radius):
        _add_by_row(total, row, value)
    intensity = np.zeros(len(later))
    intensity[rows] = total
    return intensity


def _mass_about(
    state: FloatArray, kernel: _Kernel, reach: FloatArray, axes: tuple[int, ...]
) -> FloatArray:
    """Return at least the scaled mass that has a successor within `reach` of each state, (N,).

    Counted in bins at least as wide as the reach, three of them, on the axis that holds less.
    """
    bound = np.full(len(state), np.inf)
    for axis in axes:
        moved = np.array([successor[:, axis] for successor in kernel.successor.values()])
        low, high = moved.min(), moved.max()
        width = max(reach[axis], (high - low) / MOST_BINS)
        bins = int((high - low) / width) + 1
        mass = np.zeros(bins + 4)
        for place in ((moved - low) / width).astype(np.int64):
            mass[2:-2] += np.bincount(place, kernel.scale, minlength=bins)
        own = np.floor((state[:, axis] - low) / width).clip(-1, bins).astype(np.int64) + 2
        bound = np.minimum(bound, (mass[:-2] + mass[1:-1] + mass[2:])[own - 1])
    return bound


def _within_origins(
    kernel: _Kernel, modes: ModeSpace, earlier: ParticleSet, later: ParticleSet
) -> _Sums:
    """Return the kernel between rows of one origin, and its sums."""
    # No class turns into another: so many smaller groups.
    key = [
        modes.class_of[side.mode] + len(modes.classes) * side.origin for side in (later, earlier)
    ]
    group = factorize(np.concatenate(key))[1]
    later_group, earlier_group = group[: len(later)], group[len(later) :]
    every = np.arange(len(later))
    compiled = kernels.chosen().kernel_within_groups
    if compiled is None or len(group) == 0:
        groups = later_group, earlier_group
        pairs = _gated_density(kernel, modes, earlier, later, every, GATE_SIGMA, groups)
        return _summed(pairs, earlier, later)
    motions = list(kernel.successor)
    survival = np.zeros(len(modes))
    survival[earlier.mode] = kernel.scale  # it depends on the mode alone
    value, near, start, mu = compiled(
        Queries(_whitened(later.state, later.mode, modes, kernel), later_group, later.mode),
        Points(
            np.stack([kernel.successor[motion] @ kernel.whitening[motion] for motion in motions]),
            earlier_group,
            earlier.mode,
            earlier.weight,
        ),
        np.array([motions.index(motion) for motion in modes.motions]),
        kernel.peak * kernel.transition * survival[:, None],
        GATE_SIGMA,
        kernel_thinning.offsets(every),
        kernel_thinning.MOST,
    )
    return _Sums(value, near, start, mu)


def _summed(
    pairs: Iterable[tuple[IntArray, IntArray, FloatArray]], earlier: ParticleSet, later: ParticleSet
) -> _Sums:
    """Return the pairs of a kernel in one, and the sums of kernel times weight by later row.

    Of rows with many partners, a draw of them stands for all.
    """
    values, columns = [np.zeros(0)], [np.zeros(0, dtype=np.int32)]
    count = np.zeros(len(later), dtype=np.int64)
    mu = np.zeros(len(later))
    for row, near, density in kernel_thinning.whole_rows(pairs):
        weight = earlier.weight.take(near)
        _add_by_row(mu, row, density * weight)
        kept, column, value = kernel_thinning.drawn(row, near, density, weight)
        _add_by_row(count, kept, None)
        values.append(value)
        columns.append(column.astype(np.int32))
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return _Sums(np.concatenate(values), np.concatenate(columns), start, mu)


def _add_by_row(total: FloatArray | IntArray, row: IntArray, weight: FloatArray | None) -> None:
    """Add to `total`, in place, the sums of `weight` (of ones) over ascending rows."""
    if len(row):
        part = np.bincount(row - row[0], weights=weight)
        total[row[0] : row[0] + len(part)] += part


def _whitened(state: FloatArray, mode: IntArray, modes: ModeSpace, kernel: _Kernel) -> FloatArray:
    """Return later rows in the coordinates of their own mode's noise, shape (N, D)."""
    whitened = np.empty_like(state)
    for motion, matrix in kernel.whitening.items():
        own = np.array([other == motion for other in modes.motions])
        chosen = np.flatnonzero(own[mode])
        whitened[chosen] = state.take(chosen, axis=0) @ matrix
    return whitened


def _gated_density(
    kernel: _Kernel,
    modes: ModeSpace,
    earlier: ParticleSet,
    later: ParticleSet,
    rows: IntArray,
    radius: float | FloatArray,
    groups: tuple[IntArray, IntArray] | None = None,
) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Yield (place in `rows`, earlier row, density) of all pairs within the radius, in chunks.

    Destination modes that share their motion and their possible sources are one block of a common
    search; coordinates outside a motion's support are all zero. With groups of the later and the
    earlier rows, only those of one group are paired, and the radius is one number.
    """
    state, mode = later.state.take(rows, axis=0), later.mode.take(rows)
    query = _whitened(state, mode, modes, kernel)
    density = np.empty((len(modes), len(earlier)))
    block_of = np.empty(len(modes), dtype=np.int64)
    blocks: dict[tuple[MotionModel, bytes], int] = {}
    points: list[FloatArray] = []
    sources: list[IntArray] = []
    for index, motion in enumerate(modes.motions):
        probability = kernel.transition[:, index]
        density[index] = (kernel.peak[index] * probability)[earlier.mode] * kernel.scale
        reachable = probability > 0.0
        block_of[index] = blocks.setdefault((motion, reachable.tobytes()), len(points))
        if block_of[index] == len(points):
            source = np.flatnonzero(reachable[earlier.mode])
            points.append(kernel.successor[motion].take(source, axis=0) @ kernel.whitening[motion])
            sources.append(source)
    source, mode_row = np.concatenate(sources), mode * len(earlier)
    point, block = np.concatenate(points), block_of[mode]
    point_block = np.repeat(np.arange(len(points)), [len(source) for source in sources])
    if len(query) == 0 or len(point) == 0:
        return
    if groups is None:
        near = near_chunks(candidates(query, block, point, point_block, radius))
    else:
        line = groups[0][rows] * len(points) + block
        point_line = groups[1][source] * len(points) + point_block
        near = within_groups(query, line, point, point_line, float(radius))
    for row, found, square in near:
        column = source.take(found)
        value = np.exp(-0.5 * square)
        value *= density.take(mode_row.take(row) + column)
        yield row, column, value
