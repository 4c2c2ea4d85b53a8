"""Which target each detection comes from: marginal probabilities by belief propagation.

A target has one detection at the most and a detection one source at the most. The exact marginals
of that are exponential in the number of targets that compete; loopy belief propagation on the
bipartite graph of targets and detections is linear in its edges, always converges, and is exact
wherever the graph is a tree.
"""

from __future__ import annotations

import numpy as np

from .types import FloatArray, IntArray, sum_by

ITERATIONS = 200
TOLERANCE = 1e-6
# Sums without one term are formed by subtraction. Odds against clutter beyond this are as good as
# certain, and below it nothing is lost to rounding.
LEAST_CLUTTER = 1e-9


def marginals(
    target: IntArray, detection: IntArray, odds: FloatArray, targets: int, clutter: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the marginal probabilities of single-source, single-detection associations.

    Parameters
    ----------
    target, detection : int arrays of shape (E,)
        The edges, none twice.
    odds : array of shape (E,)
        Of that detection against none, for the target alone: the mass that the edge explains over
        the probability that the target has no detection.
    targets : int
        T.
    clutter : array of shape (M,)
        What else may explain each detection, in the units of `odds`.

    Returns
    -------
    edge : array of shape (E,)
        Probability that the target is the detection's source.
    none : array of shape (T,)
        Probability that the target has no detection, be it missed or not there.

    References
    ----------
    Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
    propagation", IEEE Transactions on Aerospace and Electronic Systems 50(4), 2014.
    """
    clutter = np.maximum(clutter, LEAST_CLUTTER)
    free = 1.0 / clutter[detection]  # message to the target: how free the detection is
    for _ in range(ITERATIONS):
        taken = odds * free
        others = sum_by(target, taken, targets)[target] - taken
        wanted = odds / (1.0 + np.maximum(others, 0.0))  # message to the detection
        others = sum_by(detection, wanted, len(clutter))[detection] - wanted
        before, free = free, 1.0 / (clutter[detection] + np.maximum(others, 0.0))
        if np.all(np.abs(free - before) <= TOLERANCE * before):
            break
    taken = odds * free
    total = 1.0 + sum_by(target, taken, targets)
    return taken / total[target], 1.0 / total
