"""The motion modes of all classes; classes that move alike share one set of motion modes.

A hypothesis of the Gaussian engine has one Gaussian per motion mode, and weights over motion modes
and classes. Classes with equal motions, mode matrices and survival probabilities share their
Gaussians: only their weights differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..arrays import (
    Bool1,
    BoolArray,
    Float1,
    Float2,
    Float3,
    Float4,
    FloatArray,
    Int1,
    IntArray,
    frozen,
    read_only,
)
from ..models.amplitude_model import SnrCells
from ..models.tracker_model import TrackerModel
from ..targets.motion import MotionModel
from ..types import Estimates
from .mixture import Mixture

# Number of sets of intervals that are kept: the reports of whole revolutions have the same ones.
MOST_INTERVALS = 256
# Number of thresholds whose detection probabilities are kept: one for each sensor, and those that
# the factor `Limit` has raised.
MOST_THRESHOLDS = 256


class ModePairs(NamedTuple):
    """The K pairs of a motion mode and one to which a target of some class may change from it.

    They are sorted by the latter.
    """

    before: Int1  # (K,)
    after: Int1  # (K,)


class Motion(NamedTuple):
    """Survival and motion of targets over I intervals."""

    turns: Bool1  # Whether each motion mode is a coordinated turn, (R,)
    # Variance of the turn rate of targets that begin to turn, by motion mode after, (R,).
    begun: Float1
    arc: Float3  # `motion.turn_arc` of each motion mode, (I, R, 4)
    survival: Float2  # Probability to survive, by motion mode before, (I, R)
    # Probability to survive and to change from the first mode of a pair to the second, (I, K).
    change: Float2
    noise: Float4  # Process noise, by motion mode after, (I, R, D, D)
    # Matrix of each motion mode, (I, R, D, D); 0 for a coordinated turn, whose own the state gives.
    transition: Float4


class Intervals(NamedTuple):
    """What happens to targets over I intervals."""

    motion: Motion
    # For each interval, the transition matrix between each class's cells of SNR, [from, to],
    # (C, S, S); None if targets stay in their cells.
    snr: list[FloatArray | None]


class Spawned(NamedTuple):
    """Weights of spawned targets by those of the parent, (R C, R C), and their noise, (R, D, D)."""

    weight: Float2
    noise: Float3


@dataclass(frozen=True)
class Dynamics:
    """The motion modes and cells of a model."""

    model: TrackerModel

    @cached_property
    def cells(self) -> SnrCells:
        """The S cells of each class's signal-to-noise ratio."""
        return self.model.amplitudes.cells(self.model.modes)

    @cached_property
    def mode_of(self) -> IntArray:
        """Index of each flat mode's motion mode, shape (O,)."""
        modes, first_of = self.model.modes, {}
        mode_of, count = np.zeros(len(modes), dtype=np.int64), 0
        for index, target_class in enumerate(modes.classes):
            flat = np.flatnonzero(modes.class_of == index)
            motions_key = (
                target_class.motions,
                target_class.mode_transition.tobytes(),
                target_class.survival_probability,
            )
            if motions_key not in first_of:
                first_of[motions_key] = count
                count += len(flat)
            mode_of[flat] = first_of[motions_key] + np.arange(len(flat))
        return mode_of

    @cached_property
    def flat_of(self) -> IntArray:
        """The first flat mode of each motion mode, shape (R,)."""
        first: IntArray = np.unique(self.mode_of, return_index=True)[1]
        return first

    @cached_property
    def motions(self) -> tuple[MotionModel, ...]:
        """The R motion models."""
        return tuple(self.model.modes.motions[flat] for flat in self.flat_of)

    @cached_property
    def pairs(self) -> ModePairs:
        """The pairs of motion modes that one class has."""
        class_of = self.model.modes.class_of[self.flat_of]
        after, before = np.nonzero(class_of[:, None] == class_of)
        return frozen(ModePairs(before, after))

    @cached_property
    def supported(self) -> FloatArray:
        """Indicator, 0 or 1, of the axes on which each mode has a density, shape (R, D)."""
        supported = np.zeros((len(self.motions), len(self.model.modes.space)))
        for row, motion in zip(supported, self.motions, strict=True):
            row[list(motion.support)] = 1.0
        return supported

    @cached_property
    def turns(self) -> BoolArray:
        """Whether each motion mode is a coordinated turn, shape (R,)."""
        return self.supported[:, self.model.modes.space.turn_rate] > 0.0

    @cached_property
    def spread(self) -> FloatArray:
        """Weights over (motion mode, class) of unit mass in each flat mode, shape (O, R, C)."""
        modes = self.model.modes
        spread = np.zeros((len(modes), len(self.motions), len(modes.classes)))
        spread[np.arange(len(modes)), self.mode_of, modes.class_of] = 1.0
        return spread

    @cached_property
    def nothing(self) -> Mixture:
        """A mixture of no targets."""
        classes, cells = self.cells.log_snr.shape
        modes, size = self.supported.shape
        return Mixture.empty(modes, classes, cells, size)

    @cached_property
    def nobody(self) -> Estimates:
        """The estimates of no targets."""
        modes = self.model.modes
        return Estimates.empty(0, 0, len(modes.classes), modes.space)

    def unknown_snr(self, count: int) -> FloatArray:
        """Return the probabilities of the cells of new targets, shape (count, C, S)."""
        return self.cells.prior[None].repeat(count, axis=0)

    @cached_property
    def birth_weight(self) -> FloatArray:
        """Weights over (motion mode, class) of a birth component of each class, (C, R, C)."""
        modes = self.model.modes
        of_class = modes.class_of == np.arange(len(modes.classes))[:, None]
        weight: FloatArray = np.tensordot(of_class * modes.motion_share, self.spread, axes=1)
        return weight

    @cached_property
    def births(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weights, (B, R, C), means and covariances of the birth terms, over a nominal interval."""
        terms, (modes, size) = self.model.births, self.supported.shape
        weight, mean = np.zeros((len(terms), *self.spread.shape[1:])), np.zeros((len(terms), size))
        covariance = np.zeros((len(terms), modes, size, size))
        for row, term in enumerate(terms):
            weight[row] = np.tensordot(term.rate, self.spread, axes=1)
            mean[row] = term.mean
            covariance[row] = self.diagonal(term.std**2)
        return weight, mean[:, None] * self.supported, covariance

    @cached_property
    def spawned(self) -> Spawned:
        """Weights and noise of spawned targets."""
        spawn, spread = self.model.spawn, self.spread.reshape(len(self.spread), -1)
        weight = (spread > 0.0).T.astype(np.float64) @ spawn.transition @ spread
        return frozen(Spawned(weight, self.diagonal(spawn.std**2)))

    def diagonal(self, variance: FloatArray) -> FloatArray:
        """Return a diagonal matrix for each motion mode, on its axes, (R, D, D)."""
        covariance: FloatArray = self.supported[..., None] * np.diag(variance)
        return covariance

    @cached_property
    def _mode_of_cell(self) -> IntArray:
        """The index of some flat mode of each cell's class, shape (C S,)."""
        classes, cells = self.cells.log_snr.shape
        return np.searchsorted(self.model.modes.class_of, np.arange(classes)).repeat(cells)

    @cached_property
    def _cell_probabilities(self) -> dict[float, FloatArray]:
        return {}

    def cell_probability(self, threshold: float) -> FloatArray:
        """Return p_D in each cell of SNR at a detection threshold, (C, S)."""
        cache = self._cell_probabilities
        if threshold not in cache:
            if len(cache) == MOST_THRESHOLDS:
                cache.clear()
            model, log_snr = self.model, self.cells.log_snr
            of_cell = self._mode_of_cell, log_snr.ravel(), threshold, model.modes
            probability = model.amplitudes.detection_probability(*of_cell)
            cache[threshold] = read_only(probability.reshape(log_snr.shape))
        return cache[threshold]

    @cached_property
    def _intervals(self) -> dict[bytes, Intervals]:
        return {}

    def over(self, dt: FloatArray) -> Intervals:
        """Return survival and motion over intervals in seconds, (I,); the latest ones are kept."""
        cache, key = self._intervals, dt.tobytes()
        if key not in cache:
            if len(cache) == MOST_INTERVALS:
                cache.clear()
            modes, flat, pairs = self.model.modes, self.flat_of, self.pairs
            lengths = dt.tolist()
            survival = np.array([modes.survival(interval_s)[flat] for interval_s in lengths])
            change = np.array(
                [
                    modes.transition(interval_s)[flat[pairs.before], flat[pairs.after]]
                    for interval_s in lengths
                ]
            )
            snr = [self.cells.transition(interval_s) for interval_s in lengths]
            change *= survival[:, pairs.before]
            noise = np.array([modes.noise(interval_s)[flat] for interval_s in lengths])
            matrices = self._matrices(dt)
            arc = np.ascontiguousarray(modes.arc(dt)[:, flat])
            turns = read_only(self.turns, np.bool_)
            begun = np.array([each.begun_turn_variance for each in self.motions])
            motion = Motion(turns, begun, arc, survival, change, noise, matrices)
            cache[key] = Intervals(frozen(motion), snr)
        return cache[key]

    def _matrices(self, dt: FloatArray) -> FloatArray:
        """Return the matrix of each motion mode over intervals, (I, R, D, D); 0 if it turns."""
        modes, size = self.supported.shape
        matrices, rest = np.zeros((len(dt), modes, size, size)), np.zeros((len(dt), size))
        for mode in np.flatnonzero(~self.turns):
            matrices[:, mode] = self.motions[mode].jacobian(rest, dt)
        return matrices
