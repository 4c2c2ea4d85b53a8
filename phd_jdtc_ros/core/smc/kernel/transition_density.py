"""The transition density of one particle set's rows to those of a later one, within a gate."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...pair_search.candidates import near_chunks
from ...pair_search.grid import grid_candidates
from ...pair_search.sweep import candidates
from ...targets.modes import ModeSpace
from ...targets.motion import MotionModel, whitener
from ..particle_set import ParticleSet


class TransitionDensity(NamedTuple):
    """A transition density: a Gaussian about the noise-free successor times a mode matrix."""

    modes: ModeSpace
    transition: FloatArray  # (O, O)
    # By motion model, a matrix (D, D) that whitens states by multiplication from the right; zero
    # outside the motion's support.
    whitening: dict[MotionModel, FloatArray]
    peak: FloatArray  # Density at the centre of the Gaussian, by mode of the later row, (O,)
    # By motion model, the noise-free successors of the earlier rows, (N_t, D).
    successor: dict[MotionModel, FloatArray]
    mode: IntArray  # Flat mode of each earlier row, (N_t,)
    scale: FloatArray  # Factor of each earlier row, (N_t,)

    @staticmethod
    def of_noise(
        covariance: dict[MotionModel, FloatArray],
        modes: ModeSpace,
        transition: FloatArray,
        successor: dict[MotionModel, FloatArray],
        mode: IntArray,
        scale: FloatArray,
    ) -> TransitionDensity:
        """Return the density with a given noise covariance, (K, K), on each motion's support."""
        whitening, peak = {}, {}
        for motion, noise in covariance.items():
            matrix, log_determinant = whitener(noise)
            support = list(motion.support)
            size = successor[motion].shape[1]
            whitening[motion] = np.zeros((size, size))
            whitening[motion][np.ix_(support, support)] = matrix.T
            peak[motion] = np.exp(log_determinant - 0.5 * len(support) * np.log(2.0 * np.pi))
        by_mode = np.array([peak[motion] for motion in modes.motions])
        return TransitionDensity(modes, transition, whitening, by_mode, successor, mode, scale)

    def whiten(self, state: FloatArray, mode: IntArray) -> FloatArray:
        """Return later rows in the coordinates of their own mode's noise, shape (N, D)."""
        result = np.empty_like(state)
        for motion, matrix in self.whitening.items():
            with_motion = np.array([other == motion for other in self.modes.motions])
            rows = np.flatnonzero(with_motion[mode])
            result[rows] = state.take(rows, axis=0) @ matrix
        return result

    def gated_pairs(
        self,
        later: ParticleSet,
        rows: IntArray,
        radius: float | FloatArray,
        groups: tuple[IntArray, IntArray] | None = None,
    ) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
        """Yield (index into `rows`, earlier row, density) of pairs within the radius, in chunks.

        Destination modes with the same motion and the same possible source modes form one block of
        a common search. Coordinates outside a motion's support are zero. If groups of later and
        earlier rows are given, only rows of one group are paired, and the radius must be a single
        number.
        """
        mode, size = later.mode.take(rows), len(self.mode)
        query = self.whiten(later.state.take(rows, axis=0), mode)
        density = np.empty((len(self.modes), size))
        block_of = np.empty(len(self.modes), dtype=np.int64)
        blocks: dict[tuple[MotionModel, bytes], int] = {}
        points: list[FloatArray] = []
        sources: list[IntArray] = []
        for index, motion in enumerate(self.modes.motions):
            probability = self.transition[:, index]
            density[index] = (self.peak[index] * probability)[self.mode] * self.scale
            reachable = probability > 0.0
            block_of[index] = blocks.setdefault((motion, reachable.tobytes()), len(points))
            if block_of[index] == len(points):
                source = np.flatnonzero(reachable[self.mode])
                successor = self.successor[motion].take(source, axis=0)
                points.append(successor @ self.whitening[motion])
                sources.append(source)
        source, mode_row = np.concatenate(sources), mode * size
        point, block = np.concatenate(points), block_of[mode]
        point_block = np.repeat(np.arange(len(points)), [len(source) for source in sources])
        if len(query) == 0 or len(point) == 0:
            return
        if groups is None:
            search = candidates(query, block, point, point_block, radius)
        else:
            query_group = groups[0][rows] * len(points) + block
            point_group = groups[1][source] * len(points) + point_block
            search = grid_candidates(query, query_group, point, point_group, float(radius))
        for row, point_row, square in near_chunks(search):
            column = source.take(point_row)
            value = np.exp(-0.5 * square)
            value *= density.take(mode_row.take(row) + column)
            yield row, column, value
