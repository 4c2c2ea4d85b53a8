"""Association of one radar's detections with Bernoulli targets.

A target consists of weighted rows, particles or Gaussians, whose weights sum to its existence
probability. Only the target index of each row matters here.
"""

from __future__ import annotations

from typing import NamedTuple

from ..arrays import FloatArray, IntArray, contiguous
from .claims import Claims


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


def bernoulli(target: IntArray, targets: int, weight: FloatArray, claims: Claims) -> Shares:
    """Return the factors by which the detections change the weights of Bernoulli targets.

    `target`, (N,), is the target of each row, below `targets`, T, and `weight` its prior weight.

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
