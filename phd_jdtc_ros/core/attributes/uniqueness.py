"""Unique identities: detections whose identity another target has, and targets that were lost.

If a known target has the identity that a detection shows, the detection is less likely from a new
target or from any other one. This holds only if the known target may be at the detection;
elsewhere the identity was assigned twice, or the detection is a reflection.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by
from .identity import Belief, IdentityModel

# Upper bound of the probability that another target has an identity; keeps logarithms finite.
MOST_TAKEN = 1.0 - 1e-12


class Lost(NamedTuple):
    """Targets that have the identity of a detection outside their gates.

    Parameters
    ----------
    target : int array of shape (L,)
        Indices of the engine's targets.
    column : int array of shape (L,)
        The detection with the target's identity.
    since_s : array of shape (L,)
        Seconds from each target's last detection to this one.
    """

    target: IntArray
    column: IntArray
    since_s: FloatArray


class Taken(NamedTuple):
    """Probabilities that known targets have the identities shown by M detections.

    Parameters
    ----------
    by_another : array of shape (E,)
        For each edge: probability that a target other than the edge's has the identity.
    log_unknown : array of shape (M,)
        Log factor of the intensity of unknown targets at each detection.
    """

    by_another: FloatArray
    log_unknown: FloatArray


def find_taken(
    belief: Belief,
    target: IntArray,
    column: IntArray,
    shown: IntArray,
    undetected: FloatArray,
    model: IdentityModel,
) -> Taken:
    """Return the probabilities that the detections' identities are taken.

    Parameters
    ----------
    belief : Belief
        Of T targets.
    target, column : int arrays of shape (E,)
        The edges: the distinct pairs of targets and detections.
    shown : int array of shape (M,)
        The identity that each detection shows; negative without one.
    undetected : array of shape (T,)
        Existence probability of each target, given that it is not the source of a detection.
    model : IdentityModel

    Notes
    -----
    If a new target is the source of a detection, an old one is not, and exists with probability
    r' = r (1 - p_D) / (1 - r p_D). With the belief b in the identity, the old target leaves it free
    with probability 1 - r' b. The reply of a new target may also be garbled.
    """
    if not model.unique:
        return Taken(np.zeros(len(target)), np.zeros(len(shown)))
    has = np.minimum(undetected[target] * belief.of(target, shown[column]), MOST_TAKEN)
    log_left = np.log1p(-has)
    left = sum_by(column, log_left, len(shown))
    others = -np.expm1(left[column] - log_left)
    unknown = np.log1p(model.genuine(shown) * np.expm1(left))
    return Taken(np.maximum(others, 0.0), unknown)


def lost(
    has: IntArray,
    seen_ns: IntArray,
    shown: IntArray,
    shown_ns: IntArray,
    near: tuple[IntArray, IntArray],
) -> Lost | None:
    """Return the targets whose identities detections show outside their gates, or None.

    Parameters
    ----------
    has : int array of shape (T,)
        The unique identity of each target, negative if unknown.
    seen_ns : int array of shape (T,)
        Time of each target's last detection, nanoseconds.
    shown : int array of shape (M,)
        The identity that each detection shows; negative without one.
    shown_ns : int array of shape (M,)
        Time of each detection, nanoseconds.
    near : tuple of two int arrays of shape (P,)
        Targets and detections of the pairs in gates.
    """
    away = (has[:, None] == shown) & (shown >= 0)
    away[near] = False
    target, column = np.nonzero(away)
    since_ns = shown_ns[column] - seen_ns[target]
    row = np.flatnonzero(since_ns > 0)
    if not len(row):
        return None
    since_s = since_ns[row].astype(np.float64) * 1e-9
    return Lost(target[row], column[row], since_s)
