"""The general mode: one flat index over all pairs of class and motion mode.

The paper treats class and motion mode as one jump-Markov variable o = (c, r). With a flat index,
all filters of the family share the same code, whatever their engine and corrector. A plain filter
has one mode, a multi-model filter has several modes of one class, and a filter that only classifies
has several classes with one motion each.

The class of a living target never changes, so the transition over o is block-diagonal in c.
All matrices are [from, to]; rows sum to one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import linalg

from ..arrays import BoolArray, FloatArray, IntArray, read_only
from ..state_space import StateSpace
from .motion import MotionModel

# Tolerance for rounding errors in a generator; its inverse is the largest condition number of the
# eigenvectors.
GENERATOR_TOLERANCE = 1e-9


@dataclass(frozen=True)
class ClassModel:
    """The model of one class of targets."""

    name: str
    # Lowest and highest mean signal-to-noise ratio of the class's targets, linear.
    snr_band: tuple[float, float]
    motions: tuple[MotionModel, ...]  # The class's R motion modes
    mode_transition: FloatArray  # Motion-mode matrix for the nominal interval, (R, R)
    survival_probability: float  # Probability to survive one nominal interval


def markov_generator(transition: FloatArray) -> FloatArray | None:
    """Return the rate matrix G with ``expm(G) = transition``, or None if there is none.

    A rate matrix has non-negative off-diagonal entries and rows that sum to zero. Not every
    transition matrix has one: no two-state chain in continuous time changes its state within an
    interval with a probability above one half in both directions, as [[.3, .7], [.7, .3]] does.
    """
    if np.array_equal(transition, np.eye(len(transition))):
        return np.zeros_like(transition)
    if np.linalg.det(transition) <= 0.0:  # That of expm(G) is exp(trace G) > 0.
        return None
    generator = np.asarray(linalg.logm(transition))
    off_diagonal = generator - np.diag(np.diag(generator))
    if (
        not np.all(np.isfinite(generator))
        or np.abs(np.imag(generator)).max() > GENERATOR_TOLERANCE
        or np.real(off_diagonal).min() < -GENERATOR_TOLERANCE
    ):
        return None
    return np.ascontiguousarray(np.real(generator))


def _stationary_distribution(transition: FloatArray) -> FloatArray:
    """Return p with ``p transition = p``, shape (R,); the one of least norm if there are several.

    That is uniform for an identity.
    """
    size = len(transition)
    equations = np.vstack([transition.T - np.eye(size), np.ones(size)])
    solution = np.linalg.lstsq(equations, np.eye(size + 1)[size], rcond=None)[0]
    distribution = np.maximum(solution, 0.0)
    share: FloatArray = distribution / distribution.sum()
    return share


@dataclass(frozen=True)
class ModeSpace:
    """The flat mode space of a set of classes."""

    classes: tuple[ClassModel, ...]
    interval_s: float  # Nominal interval of the classes' matrices and probabilities, seconds

    @cached_property
    def class_of(self) -> IntArray:
        """The class of each flat mode, shape (O,)."""
        sizes = [len(model.motions) for model in self.classes]
        index: IntArray = read_only(np.repeat(np.arange(len(sizes)), sizes), np.int64)
        return index

    @cached_property
    def motions(self) -> tuple[MotionModel, ...]:
        """The motion model of each flat mode, length O."""
        return tuple(motion for model in self.classes for motion in model.motions)

    @cached_property
    def space(self) -> StateSpace:
        """The axes of the states, the same for every motion."""
        return self.motions[0].space

    @cached_property
    def moves(self) -> BoolArray:
        """Whether the targets of each class can move, shape (C,): some motion has a velocity."""
        velocity = set(self.space.velocity)
        able = [any(velocity & set(m.support) for m in model.motions) for model in self.classes]
        return np.array(able)

    @cached_property
    def motion_share(self) -> FloatArray:
        """The share of each motion mode in its class in the long run, shape (O,).

        It is the stationary distribution of the class's mode matrix, and the probability that a
        target of unknown history is in the mode.
        """
        parts = [_stationary_distribution(np.asarray(c.mode_transition)) for c in self.classes]
        share: FloatArray = read_only(np.concatenate(parts))
        return share

    def __len__(self) -> int:
        return len(self.motions)

    @cached_property
    def _nominal_transition(self) -> FloatArray:
        blocks = [model.mode_transition for model in self.classes]
        matrix = linalg.block_diag(*blocks)
        # Rows may differ from one by rounding; the difference must not become a change of class.
        normalised: FloatArray = read_only(matrix / matrix.sum(axis=1, keepdims=True))
        return normalised

    @cached_property
    def _generator(self) -> FloatArray | None:
        blocks = [markov_generator(np.asarray(c.mode_transition)) for c in self.classes]
        given = [block for block in blocks if block is not None]
        return linalg.block_diag(*given) if len(given) == len(blocks) else None

    @cached_property
    def _eigen(self) -> tuple[Any, Any, Any] | None:
        """Eigenvalues of the generator, its eigenvectors and their inverse.

        None without a generator, or if the eigenvectors are nearly dependent.
        """
        if self._generator is None:
            return None
        values, vectors = np.linalg.eig(self._generator)
        if np.linalg.cond(vectors) > 1.0 / GENERATOR_TOLERANCE:
            return None
        return values, vectors, np.linalg.inv(vectors)

    def transition(self, dt: float) -> FloatArray:
        """Return the (O, O) transition matrix over the interval `dt` in seconds.

        If a matrix has no generator, the interval is rounded to whole nominal ones, at least one.
        """
        steps = dt / self.interval_s
        if abs(steps - 1.0) < 1e-6:
            return self._nominal_transition
        if self._generator is None:
            return np.linalg.matrix_power(self._nominal_transition, max(1, round(steps)))
        if self._eigen is None:
            matrix = np.asarray(linalg.expm(self._generator * steps))
        else:  # This is a hundred times as fast.
            values, vectors, inverse = self._eigen
            matrix = np.real((vectors * np.exp(values * steps)) @ inverse)
        matrix = np.maximum(matrix, 0.0)
        normalised: FloatArray = matrix / matrix.sum(axis=1, keepdims=True)
        return normalised

    def survival(self, dt: float) -> FloatArray:
        """Return the probability to survive `dt` seconds, per flat mode, shape (O,)."""
        return self.nominal_survival[self.class_of] ** (dt / self.interval_s)

    @cached_property
    def nominal_survival(self) -> FloatArray:
        """The probability to survive a nominal interval, per class, shape (C,)."""
        return np.array([model.survival_probability for model in self.classes])

    def noise(self, dt: FloatArray | float) -> FloatArray:
        """Return the process noise of each flat mode after `dt` seconds, (..., O, D, D)."""
        size = len(self.space)
        noise = np.zeros((*np.shape(dt), len(self), size, size))
        for mode, motion in enumerate(self.motions):
            rows, columns = np.ix_(motion.support, motion.support)
            noise[..., mode, rows, columns] = motion.noise_covariance(dt)
        return noise

    def arc(self, dt: FloatArray | float) -> FloatArray:
        """Return the `turn_arc` of each flat mode after `dt` seconds, (..., O, 4)."""
        return np.stack([motion.arc(dt) for motion in self.motions], axis=-2)

    @cached_property
    def noise_factors(self) -> FloatArray:
        """The motions' `noise_factors` by flat mode, (3, O, D, D)."""
        size = len(self.space)
        factors = np.zeros((3, len(self.motions), size, size))
        for by_mode, motion in zip(factors.swapaxes(0, 1), self.motions, strict=True):
            index = (slice(None), *np.ix_(motion.support, motion.support))
            by_mode[index] = motion.noise_factors
        return factors
