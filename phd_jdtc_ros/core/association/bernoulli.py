"""Association of one radar's detections with Bernoulli targets.

A target consists of weighted rows, particles or Gaussians, whose weights sum to its existence
probability. Only the target index of each row matters here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..arrays import FloatArray, IntArray, contiguous, frozen
from .claims import Claims

if TYPE_CHECKING:
    from .shares import Shares


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

    claims = frozen(Claims(*contiguous(*claims)))
    target, weight = contiguous(target, weight)
    return posterior_shares(marginals.MOST_WORK, targets, target, weight, claims)
