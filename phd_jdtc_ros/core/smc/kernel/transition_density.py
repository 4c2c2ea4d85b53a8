"""The transition density of one particle set's rows to those of a later one, within a gate."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...pair_search.candidates import near_chunks
from ...pair_search.grid import within_groups
from ...pair_search.sweep import candidates
from ...targets.modes import ModeSpace
from ...targets.motion import MotionModel, whitener
from ..particle_set import ParticleSet


class TransitionDensity(NamedTuple):
    """A transition density: a Gaussian about the noise-free successor times a mode matrix."""

    transition: FloatArray  # (O, O)
    # Dict of motion model to array of shape (D, D). Whitens states by multiplication from the
    # right; zero outside the motion's support.
    whitening: dict[MotionModel, FloatArray]
    peak: FloatArray  # Density at the centre of the Gaussian, by mode of the later row, (O,)
    # Dict of motion model to array of shape (N_t, D). Noise-free successors of the earlier rows.
    successor: dict[MotionModel, FloatArray]
    scale: FloatArray  # Factor of each earlier row, (N_t,)


def transition_density(
    modes: ModeSpace,
    transition: FloatArray,
    covariance: dict[MotionModel, FloatArray],
    successor: dict[MotionModel, FloatArray],
    scale: FloatArray,
) -> TransitionDensity:
    """Return the density with a given noise covariance, (K, K), on each motion's support.

    For the other arguments see `TransitionDensity`.
    """
    whitening, peak = {}, {}
    for motion, noise in covariance.items():
        matrix, log_determinant = whitener(noise)
        support = list(motion.support)
        size = successor[motion].shape[1]
        whitening[motion] = np.zeros((size, size))
        whitening[motion][np.ix_(support, support)] = matrix.T
        peak[motion] = np.exp(log_determinant - 0.5 * len(support) * np.log(2.0 * np.pi))
    by_mode = np.array([peak[motion] for motion in modes.motions])
    return TransitionDensity(transition, whitening, by_mode, successor, scale)


def whiten(
    state: FloatArray, mode: IntArray, modes: ModeSpace, kernel: TransitionDensity
) -> FloatArray:
    """Return later rows in the coordinates of their own mode's noise, shape (N, D)."""
    result = np.empty_like(state)
    for motion, matrix in kernel.whitening.items():
        with_motion = np.array([other == motion for other in modes.motions])
        chosen = np.flatnonzero(with_motion[mode])
        result[chosen] = state.take(chosen, axis=0) @ matrix
    return result


def gated_density(
    kernel: TransitionDensity,
    modes: ModeSpace,
    earlier: ParticleSet,
    later: ParticleSet,
    rows: IntArray,
    radius: float | FloatArray,
    groups: tuple[IntArray, IntArray] | None = None,
) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Yield (index into `rows`, earlier row, density) of all pairs within the radius, in chunks.

    Destination modes with the same motion and the same possible source modes form one block of a
    common search. Coordinates outside a motion's support are zero. If groups of later and earlier
    rows are given, only rows of one group are paired, and the radius must be a single number.
    """
    state, mode = later.state.take(rows, axis=0), later.mode.take(rows)
    query = whiten(state, mode, modes, kernel)
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
