"""Association of one radar's detections with Bernoulli targets.

A target consists of weighted rows, particles or Gaussians, whose weights sum to its existence
probability. Only the target index of each row matters here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray, contiguous, sum_by

BoolArray = npt.NDArray[np.bool_]
# Lower bound of the probability of a missed detection, by which odds are divided.
LEAST_MISSED = 1e-6


@dataclass(frozen=True)
class Claims:
    """Association likelihoods of N rows of targets, and of all other sources, for M detections."""

    row: IntArray  # Row of each pair within the gate, (P,)
    column: IntArray  # Detection of each pair, (P,)
    mass: FloatArray  # p_D L_z w of each pair, divided by a scale of its detection, (P,)
    other: FloatArray  # Intensity of clutter and unknown targets, divided by the same scale, (M,)
    detection_probability: FloatArray  # p_D of each row, (N,); 0 beyond the radar's range

    def part(self, rows: BoolArray | FloatArray) -> FloatArray:
        """Return the share of some rows, (N,), in the likelihoods of each detection, (M,).

        `rows` is a mask, or the probability that each row counts.
        """
        size = len(self.other)
        whole = sum_by(self.column, self.mass, size)
        part = sum_by(self.column, self.mass * rows.take(self.row), size)
        share: FloatArray = part / np.where(whole > 0.0, whole, 1.0)
        return share


class Shares(NamedTuple):
    """The factors from prior to posterior weights.

    The posterior weight of a row of target g is ``prior * (1 - p_D) * missed[g]`` for a missed
    detection, and ``mass * pair`` for each of its pairs.
    """

    # Prior weights of the rows, (N,); targets with a mass above one are scaled to one.
    prior: FloatArray
    missed: FloatArray  # Factor of each target on its rows' weights for a missed detection, (T,)
    pair: FloatArray  # Factor of each pair, (P,)
    claimed: FloatArray  # Probability that a target is the source of each detection, (M,)
    # Number of clusters too large for exact probabilities; see `marginals`.
    approximate: int


def undetected(existence: FloatArray, missed: FloatArray) -> FloatArray:
    """Return the existence probabilities of targets after a missed detection.

    Parameters
    ----------
    existence : array of shape (T,)
        Prior existence probabilities.
    missed : array of shape (T,)
        Probability that each target exists and is not detected.
    """
    return missed / np.maximum(1.0 - existence + missed, LEAST_MISSED)


def bernoulli(target: IntArray, targets: int, weight: FloatArray, claims: Claims) -> Shares:
    """Return the factors by which the detections change the weights of Bernoulli targets.

    Parameters
    ----------
    target : int array of shape (N,)
        The target of each row, below `targets`.
    targets : int
        T.
    weight : array of shape (N,)
        Prior weight of each row.

    Notes
    -----
    Let r be the existence probability of the target, r p_D the probability that it is detected, and
    p_z and p_0 the marginal probabilities of its association with detection z and with none. Then
    w <- w [p_0 (1 - p_D) / (1 - r p_D) + sum_z p_z p_D L_z / sum_s p_D L_z w].

    References
    ----------
    Meyer et al., "Message passing algorithms for scalable multitarget tracking", Proceedings of
    the IEEE 106(2), 2018, for the same marginals in a particle filter of Bernoulli targets.
    """
    # Only an engine loads compiled code, and the names of correctors are known without it.
    from . import marginals
    from .shares import posterior_shares

    columns = (claims.row, claims.column, claims.mass, claims.other, claims.detection_probability)
    return Shares(
        *posterior_shares(marginals.MOST_WORK, targets, *contiguous(target, weight, *columns))
    )
