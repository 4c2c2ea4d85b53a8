"""The Gaussian mixture of each target: hypotheses of association, motion modes, classes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, ReadOnly, frozen
from ..compilation import Float1, Float2, Float3, Float4, Int1, compiled
from ..snapshot import MAX_MASS, MAX_STATE, ROUNDING, covariances, floats, integers
from ..state_space import StateSpace


class Extents(NamedTuple):
    """Position and velocity of the target of each label, with their spread."""

    label: IntArray  # Ascending, (T,)
    target: IntArray  # Index of each row's label in `label`, (N,)
    # Mean position and velocity, and the root mean square distances from them, metres and metres
    # per second, (T, 6).
    moments: FloatArray


class Sums(NamedTuple):
    """The targets of H hypotheses, and sums of the weights."""

    label: Int1  # The distinct labels, ascending, (T,)
    target: Int1  # Index of each hypothesis's target in `label`, (H,)
    mode_weight: Float2  # Weight of each Gaussian, (H, R)
    mass: Float1  # Weight of each hypothesis, (H,)
    existence: Float1  # Existence probability of each target, (T,)


class Gaussians(NamedTuple):
    """The weights and the Gaussians of H hypotheses; see `Mixture`."""

    weight: Float3
    mean: Float3
    covariance: Float4


class Hypotheses(NamedTuple):
    """The columns of a `Mixture` and of its `Sums`, as compiled functions take them."""

    label: Int1
    target: Int1
    mode_weight: Float2
    mass: Float1
    existence: Float1
    row_label: Int1
    weight: Float3
    mean: Float3
    covariance: Float4
    snr: Float3


@compiled
def _sums(row_label: Int1, order: Int1, weight: Float3) -> Sums:
    """Return the sums of the weights; `order` is that of the hypotheses by label."""
    count, modes, classes = weight.shape
    label, target, targets = np.empty(count, np.int64), np.empty(count, np.int64), 0
    for row in order:
        if targets == 0 or row_label[row] != label[targets - 1]:
            label[targets] = row_label[row]
            targets += 1
        target[row] = targets - 1
    mode_weight, mass, existence = np.zeros((count, modes)), np.zeros(count), np.zeros(targets)
    for row in range(count):
        for mode in range(modes):
            for class_id in range(classes):
                mode_weight[row, mode] += weight[row, mode, class_id]
            mass[row] += mode_weight[row, mode]
        existence[target[row]] += mass[row]
    return Sums(label[:targets], target, mode_weight, mass, existence)


@compiled
def _extents(axes: Int1, mixture: Hypotheses) -> FloatArray:
    """Return `Extents.moments`; `axes` has the axes of the position before the velocity's."""
    target, mode_weight, existence = mixture.target, mixture.mode_weight, mixture.existence
    mean, covariance = mixture.mean, mixture.covariance
    moments, half = np.zeros((len(existence), 6)), len(axes) // 2
    share = np.zeros(mode_weight.shape)
    for row in range(len(target)):
        target_mass, target_moments = existence[target[row]], moments[target[row]]
        for mode in range(mode_weight.shape[1]):
            share[row, mode] = mode_weight[row, mode] / target_mass if target_mass > 0.0 else 0.0
            for i in range(len(axes)):
                target_moments[i] += share[row, mode] * mean[row, mode, axes[i]]
    for row in range(len(target)):
        target_moments = moments[target[row]]
        for mode in range(mode_weight.shape[1]):
            for i in range(len(axes)):
                axis = axes[i]
                square = (mean[row, mode, axis] - target_moments[i]) ** 2
                square += covariance[row, mode, axis, axis]
                target_moments[len(axes) + i // half] += share[row, mode] * square
    for target_moments in moments:
        for column in range(len(axes), len(target_moments)):
            target_moments[column] = np.sqrt(target_moments[column])
    return moments


@dataclass(frozen=True)
class Mixture(ReadOnly):
    """A labelled multi-Bernoulli density whose targets are mixtures of Gaussians.

    A hypothesis is the density of a target given one assignment of recent detections to it. It has
    one Gaussian per motion mode, a weight for each motion mode and class, and the probabilities of
    the class's signal-to-noise ratios. The weights of a target's hypotheses sum to its existence
    probability.

    Notes
    -----
    The SNR of a target counts as independent of its motion, given its class and its detections.
    This neglects that a miss shows less where the detection probability is small anyway.
    """

    # Label of each hypothesis's target, (H,); see `labels`.
    row_label: Annotated[IntArray, integers("H", 0, key="origin")]
    weight: Annotated[FloatArray, floats("HOC", 0.0, MAX_MASS)]  # (H, R, C)
    # World frame; metres, metres per second, radians per second, (H, R, D).
    mean: Annotated[FloatArray, floats("HOD", -MAX_STATE, MAX_STATE)]
    # Zero on axes on which a motion mode is not defined, (H, R, D, D).
    covariance: Annotated[FloatArray, covariances("HODD", MAX_STATE)]
    # Probability of each cell of the signal-to-noise ratio, given the class, (H, C, S); see
    # `SnrCells`. A sum of shares may exceed 1 by rounding.
    snr: Annotated[FloatArray, floats("HCS", 0.0, 1.0 + ROUNDING)]

    def __len__(self) -> int:
        return len(self.row_label)

    @cached_property
    def sums(self) -> Sums:
        """The targets, and sums of the weights."""
        order = self.row_label.argsort(kind="stable")
        return frozen(_sums(self.row_label, order, self.weight))

    @property
    def gaussians(self) -> Gaussians:
        """The weights, the means and the covariances."""
        return Gaussians(self.weight, self.mean, self.covariance)

    @cached_property
    def hypotheses(self) -> Hypotheses:
        """The columns and sums, for compiled functions."""
        return Hypotheses(
            *self.sums, self.row_label, self.weight, self.mean, self.covariance, self.snr
        )

    def take(self, rows: IntArray) -> Mixture:
        """Return the hypotheses of these rows."""
        return self.changed(
            row_label=self.row_label.take(rows),
            weight=self.weight.take(rows, axis=0),
            mean=self.mean.take(rows, axis=0),
            covariance=self.covariance.take(rows, axis=0),
            snr=self.snr.take(rows, axis=0),
        )

    def class_mass(self, rows: IntArray | None = None) -> FloatArray:
        """Return the expected number of targets of each class, (C,), of some rows or of all."""
        weight = self.weight if rows is None else self.weight[rows]
        mass: FloatArray = weight.sum(axis=(0, 1))
        return mass

    def extents(self, space: StateSpace) -> Extents:
        """Return the position and extent of each target."""
        return Extents(
            self.sums.label, self.sums.target, _extents(space.planar_axes, self.hypotheses)
        )

    @staticmethod
    def empty(modes: int, classes: int, cells: int, size: int) -> Mixture:
        """Return a mixture of no targets."""
        return Mixture(
            np.zeros(0, dtype=np.int64),
            np.zeros((0, modes, classes)),
            np.zeros((0, modes, size)),
            np.zeros((0, modes, size, size)),
            np.zeros((0, classes, cells)),
        )

    @staticmethod
    def concatenate(parts: Sequence[Mixture]) -> Mixture:
        """Return several mixtures concatenated into one."""
        if len(parts) == 1:
            return parts[0]
        return parts[0].changed(
            row_label=np.concatenate([part.row_label for part in parts]),
            weight=np.concatenate([part.weight for part in parts]),
            mean=np.concatenate([part.mean for part in parts]),
            covariance=np.concatenate([part.covariance for part in parts]),
            snr=np.concatenate([part.snr for part in parts]),
        )
