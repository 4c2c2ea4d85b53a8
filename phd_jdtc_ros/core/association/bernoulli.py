"""How one radar's detections are shared among targets, each of which is at most one.

A target is described by weighted rows, particles or Gaussians, whose weights sum to its existence
probability. Here it only matters which target each row is of.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray, distinct_cells, sum_by

BoolArray = npt.NDArray[np.bool_]
# Lower bound of the probability that a target is missed; odds are divided by it.
LEAST_MISSED = 1e-6


@dataclass(frozen=True)
class Claims:
    """How well the targets' N rows and all other sources explain one radar's M detections.

    Parameters
    ----------
    row, column : int arrays of shape (P,)
        The row and the detection of each pair within the gate.
    mass : array of shape (P,)
        p_D L_z w of each pair, divided by a scale of its detection.
    other : array of shape (M,)
        Intensity of clutter and unknown targets, divided by the same scale.
    detection_probability : array of shape (N,)
        p_D of each row; 0 beyond the radar's range.
    """

    row: IntArray
    column: IntArray
    mass: FloatArray
    other: FloatArray
    detection_probability: FloatArray

    def part(self, rows: BoolArray | FloatArray) -> FloatArray:
        """Return which share of all claims of each detection is of some rows, (N,) to (M,).

        Of rows that belong to them with a probability, that part counts.
        """
        size = len(self.other)
        whole = sum_by(self.column, self.mass, size)
        part = sum_by(self.column, self.mass * rows.take(self.row), size)
        share: FloatArray = part / np.where(whole > 0.0, whole, 1.0)
        return share


class Shares(NamedTuple):
    """The factors from prior to posterior weights.

    A row of target g has the weight ``prior * (1 - p_D) * missed[g]`` if it was missed, and
    ``mass * pair`` for each of its pairs if that pair's detection is its own.

    Parameters
    ----------
    prior : array of shape (N,)
        The rows' weights before, with targets of a mass above one scaled down to one.
    missed : array of shape (T,)
        By target.
    pair : array of shape (P,)
        By pair.
    claimed : array of shape (M,)
        Probability that a target is the source of each detection.
    approximate : int
        Number of clusters too large for exact probabilities; see `marginals.Marginals`.
    """

    prior: FloatArray
    missed: FloatArray
    pair: FloatArray
    claimed: FloatArray
    approximate: int


def undetected(existence: FloatArray, missed: FloatArray) -> FloatArray:
    """Return the existence probabilities of targets, given that they are not detected.

    Parameters
    ----------
    existence : array of shape (T,)
        Before the detections.
    missed : array of shape (T,)
        Probability that each exists and is not detected.
    """
    return missed / np.maximum(1.0 - existence + missed, LEAST_MISSED)


def bernoulli(target: IntArray, targets: int, weight: FloatArray, claims: Claims) -> Shares:
    """Return how the detections change the weights of targets that are at most one each.

    Parameters
    ----------
    target : int array of shape (N,)
        The target of each row, below `targets`.
    targets : int
        T.
    weight : array of shape (N,)
        Of each row before the update.
    claims : Claims

    Notes
    -----
    Let r be the probability that the target exists, r p_D that it is detected, and p_z and p_0 the
    marginal probabilities of its association with detection z and with none. Then
    w <- w [p_0 (1 - p_D) / (1 - r p_D) + sum_z p_z p_D L_z / sum_s p_D L_z w].

    References
    ----------
    Meyer et al., "Message passing algorithms for scalable multitarget tracking", Proceedings of
    the IEEE 106(2), 2018, for the same marginals in a particle filter of Bernoulli targets.
    """
    # Names of correctors are known without it, and it loads numba.
    from .marginals import marginals

    size = len(claims.other)
    # The reduction of a set may round a mass to a little more than one.
    excess = np.maximum(sum_by(target, weight, targets), 1.0)
    prior = weight / excess.take(target)
    detected = sum_by(target, prior * claims.detection_probability, targets)
    missed = np.maximum(1.0 - detected, LEAST_MISSED)

    edge, edge_of_pair = distinct_cells(
        (target * size).take(claims.row) + claims.column, targets * size
    )
    edge_target, column = edge // max(size, 1), edge % max(size, 1)
    explained = sum_by(edge_of_pair, claims.mass, len(edge)) / excess[edge_target]
    odds = explained / missed[edge_target]
    probability, none, approximate = marginals(edge_target, column, odds, targets, claims.other)

    scale = probability / np.where(explained > 0.0, explained, 1.0) / excess[edge_target]
    claimed = np.minimum(sum_by(column, probability, size), 1.0)
    return Shares(prior, none / missed, scale.take(edge_of_pair), claimed, approximate)
