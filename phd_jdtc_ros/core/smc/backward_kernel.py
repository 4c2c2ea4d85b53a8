# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The backward kernel between two stored particle sets, built once per scan.

The kernel K and its normaliser mu (Sec. IV-C, Step 4) do not depend on later scans. They are
cached, so that every lag costs one sparse product. Only pairs within 7.5 standard deviations of the
process noise are kept: with a gate of 6, single weights are off by 5 %, with 7 by up to 2e-3, and
with 7.5 by less than 1e-4. Rows with many pairs are thinned (`kernel_thinning`).
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
# Spawned mass farther out changes mu by less than this share, a tenth of the gate's own error, and
# is left out. For most rows the limit is at 5 or 6 sigma, which saves a quarter of the tests.
SPAWN_TOLERANCE = 1e-5
# Bins of the histogram that bounds the spawned mass; fewer would give a looser bound.
MOST_BINS = 4096


@dataclass(frozen=True)
class Transition:
    """The cached backward kernel between two consecutive stored sets.

    Parameters
    ----------
    ratio : sparse array of shape (N_t, N_{t+1})
        K[q, s] / mu_q, transposed, so that ``B = ratio @ w_{t+1|k}``.
    survival : array of shape (N_t,)
        P_s over the true interval.
    orphans : int
        Number of rows of the later set that no survivor, spawn or birth explains within the gate.
        Each is paired with its parent.
    """

    ratio: SparseArray
    survival: FloatArray
    orphans: int


class _Kernel(NamedTuple):
    """A transition density: a Gaussian about the noise-free successor, times a mode matrix.

    Parameters
    ----------
    transition : array of shape (O, O)
    whitening : dict of motion model to array of shape (D, D)
        Multiplies states from the right; zero outside the motion's support.
    peak : array of shape (O,)
        Density of the Gaussian at its centre, by mode of the later row.
    successor : dict of motion model to array of shape (N_t, D)
        Noise-free successors of the earlier rows.
    scale : array of shape (N_t,)
        Factor of each earlier row.
    """

    transition: FloatArray
    whitening: dict[MotionModel, FloatArray]
    peak: FloatArray
    successor: dict[MotionModel, FloatArray]
    scale: FloatArray


class _Sums(NamedTuple):
    """A kernel's pairs by later row, and their contribution to mu.

    Parameters
    ----------
    value : array of shape (pairs,)
    column : int array of shape (pairs,)
        The earlier rows.
    start : int array of shape (N_{t+1} + 1,)
        Index at which the pairs of each later row begin.
    mu : array of shape (N_{t+1},)
        Sum of kernel times weight over all pairs of each later row, before thinning.
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
        With a labelled one, only rows of one origin are paired.
    dt : float
        True interval between them, seconds.
    found : tuple of Newborn
        Targets born at the detections of the later scan, by radar.

    Returns
    -------
    Transition

    Notes
    -----
    Sec. IV-C, Step 4: K[q, s] = P_s h[r_s, r_q] f_{r_q}(x_q | x_s) within a class, and
    mu_q = gamma(x_q, o_q) + sum_s w_{t|t}(s) K[q, s] + sum_s w_{t|t}(s) beta(q | s), the last sum
    over all classes. As in the paper, the spawn intensity is part of mu and not of the numerator.

    Deviation: with a labelled corrector, sums are over rows of the same origin. Births and spawned
    targets begin origins of their own and are part of no other origin's mu.
    """
    modes = model.modes
    survival = modes.survival(dt)[earlier.mode]
    successor = {motion: motion.mean(earlier.state, dt) for motion in dict.fromkeys(modes.motions)}
    noise = {motion: motion.noise_covariance(dt) for motion in successor}
    kernel = _kernel(modes, modes.transition(dt), noise, successor, survival)
    if corrector.labelled:
        ratio, column, start, mu = _within_origins(kernel, modes, earlier, later)
    else:
        every = np.arange(len(later))
        pairs = _gated_density(kernel, modes, earlier, later, every, GATE_SIGMA)
        ratio, column, start, mu = _summed(pairs, earlier, later)
        mu += _birth_intensity(later, model, dt, found)
        if model.spawn.rate > 0.0 and len(earlier):
            mu += _spawn_intensity(mu, earlier, later, model, dt, successor)
    ratio /= np.where(mu > 0.0, mu, 1.0).repeat(np.diff(start))
    # An orphan is paired with its parent alone. This is the limit of K / mu as the gate widens.
    orphan = np.flatnonzero((mu <= 0.0) & (later.parent >= 0))
    if corrector.labelled:  # a spawned target has no past in its parent's origin
        orphan = orphan[later.origin[orphan] == earlier.origin[later.parent[orphan]]]
    if len(orphan):
        parent = later.parent[orphan]
        ratio = np.insert(ratio, start[orphan], 1.0 / earlier.weight[parent])
        column = np.insert(column, start[orphan], parent.astype(np.int32))
        start[1:] += np.cumsum(np.bincount(orphan, minlength=len(later))).astype(np.int32)
    return Transition(
        ratio=sparse.csc_array((ratio, column, start), shape=(len(earlier), len(later))),
        survival=survival,
        orphans=len(orphan),
    )


def _birth_intensity(
    later: ParticleSet, model: TrackerModel, dt: float, newborns: tuple[Newborn, ...]
) -> FloatArray:
    """Return the intensity of births at every later row, shape (N_{t+1},)."""
    modes, state, mode = model.modes, later.state, later.mode
    total = birth.intensity(model.births, modes, state, mode) * dt / modes.interval_s
    for newborn in newborns:
        total += detection_birth.intensity(newborn, model.detection_births, modes, state, mode)
    return total


def _kernel(
    modes: ModeSpace,
    transition: FloatArray,
    covariance: dict[MotionModel, FloatArray],
    successor: dict[MotionModel, FloatArray],
    scale: FloatArray,
) -> _Kernel:
    """Return the kernel with the given noise covariance on each motion's support."""
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

    `mu` is the intensity of survivors and births. The search radius r of a row is chosen so that
    the spawned intensity beyond it is a small share of `mu`. It is at most the intensity of all
    mass within the gate, placed at the distance r.
    """
    spawn, modes = model.spawn, model.modes
    noise = {motion: np.diag(spawn.std[list(motion.support)] ** 2) for motion in successor}
    rate = spawn.rate * dt / modes.interval_s
    kernel = _kernel(modes, spawn.transition, noise, successor, rate * earlier.weight)
    bound = (kernel.peak * spawn.transition.max(axis=0))[later.mode]
    bound *= _mass_bound(later.state, kernel, GATE_SIGMA * spawn.std, modes.space.position)
    tiny = np.finfo(float).tiny
    log_share = np.log(np.maximum(bound, tiny)) - np.log(np.maximum(mu, tiny))
    square = np.minimum(2.0 * (log_share - np.log(SPAWN_TOLERANCE)), GATE_SIGMA**2)
    rows = np.flatnonzero(square > 0.0)
    radius = np.sqrt(square[rows])
    total = np.zeros(len(rows))
    for row, _, value in _gated_density(kernel, modes, earlier, later, rows, radius):
        _add_by_row(total, row, value)
    intensity = np.zeros(len(later))
    intensity[rows] = total
    return intensity


def _mass_bound(
    state: FloatArray, kernel: _Kernel, reach: FloatArray, axes: tuple[int, ...]
) -> FloatArray:
    """Return an upper bound of the scaled mass with a successor within `reach` of each state, (N,).

    Bins along one axis are at least as wide as the reach, so that three of them contain all such
    mass. The bound is the smallest over the axes.
    """
    bound = np.full(len(state), np.inf)
    for axis in axes:
        moved = np.array([successor[:, axis] for successor in kernel.successor.values()])
        low, high = moved.min(), moved.max()
        width = max(reach[axis], (high - low) / MOST_BINS)
        bins = int((high - low) / width) + 1
        mass = np.zeros(bins + 4)
        for moved_bin in ((moved - low) / width).astype(np.int64):
            mass[2:-2] += np.bincount(moved_bin, kernel.scale, minlength=bins)
        state_bin = np.floor((state[:, axis] - low) / width).clip(-1, bins).astype(np.int64) + 2
        bound = np.minimum(bound, (mass[:-2] + mass[1:-1] + mass[2:])[state_bin - 1])
    return bound


def _within_origins(
    kernel: _Kernel, modes: ModeSpace, earlier: ParticleSet, later: ParticleSet
) -> _Sums:
    """Return the kernel between rows of one origin, and its sums."""
    # A target's class never changes, so groups by class too are smaller and faster to search.
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
    survival[earlier.mode] = kernel.scale  # the scale is P_s, which depends on the mode alone
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
    """Return the pairs of all chunks, thinned, and the sums of kernel times weight by later row."""
    values, columns = [np.zeros(0)], [np.zeros(0, dtype=np.int32)]
    count = np.zeros(len(later), dtype=np.int64)
    mu = np.zeros(len(later))
    for row, near, density in kernel_thinning.complete_rows(pairs):
        weight = earlier.weight.take(near)
        _add_by_row(mu, row, density * weight)
        kept, column, value = kernel_thinning.thin(row, near, density, weight)
        _add_by_row(count, kept, None)
        values.append(value)
        columns.append(column.astype(np.int32))
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return _Sums(np.concatenate(values), np.concatenate(columns), start, mu)


def _add_by_row(total: FloatArray | IntArray, row: IntArray, weight: FloatArray | None) -> None:
    """Add the sums of `weight` over ascending rows to `total`, in place; None counts pairs."""
    if len(row):
        part = np.bincount(row - row[0], weights=weight)
        total[row[0] : row[0] + len(part)] += part


def _whitened(state: FloatArray, mode: IntArray, modes: ModeSpace, kernel: _Kernel) -> FloatArray:
    """Return later rows in the coordinates of their own mode's noise, shape (N, D)."""
    whitened = np.empty_like(state)
    for motion, matrix in kernel.whitening.items():
        with_motion = np.array([other == motion for other in modes.motions])
        chosen = np.flatnonzero(with_motion[mode])
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
    """Yield (index into `rows`, earlier row, density) of all pairs within the radius, in chunks.

    Destination modes with the same motion and the same possible source modes form one block of a
    common search. Coordinates outside a motion's support are zero. If groups of the later and the
    earlier rows are given, only rows of one group are paired, and the radius must be one number.
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
        query_group = groups[0][rows] * len(points) + block
        point_group = groups[1][source] * len(points) + point_block
        near = within_groups(query, query_group, point, point_group, float(radius))
    for row, point_row, square in near:
        column = source.take(point_row)
        value = np.exp(-0.5 * square)
        value *= density.take(mode_row.take(row) + column)
        yield row, column, value
