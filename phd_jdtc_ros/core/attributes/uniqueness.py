"""One unique identity, one target: who has it already, and who has it and is lost.

Of a detection that shows such an identity, a target that has it speaks against a new target and
against all others: they would have the same. It does so where it may have come to the detection;
elsewhere the identity is another transponder's that was given twice, or a reflection.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by
from .identity import Belief, IdentityModel

# However sure, an identity is another target's with less than this.
MOST_TAKEN = 1.0 - 1e-12


class Lost(NamedTuple):
    """Targets that have the identity of a detection, and are not where it is.

    Parameters
    ----------
    target : int array of shape (L,)
        Indices of the engine's targets.
    column : int array of shape (L,)
        Their detections.
    since_s : array of shape (L,)
        Seconds from each target's last detection to this one.
    """

    target: IntArray
    column: IntArray
    since_s: FloatArray


class Taken(NamedTuple):
    """How probably the identities that M detections show are those of known targets.

    Parameters
    ----------
    by_another : array of shape (E,)
        For each edge of a target and a detection: that of another target.
    log_unknown : array of shape (M,)
        Log of what the intensity of unknown targets at each detection is multiplied by.
    """

    by_another: FloatArray
    log_unknown: FloatArray


def taken(
    belief: Belief,
    target: IntArray,
    column: IntArray,
    shown: IntArray,
    undetected: FloatArray,
    model: IdentityModel,
) -> Taken:
    """Return which of the detections' identities are taken.

    Parameters
    ----------
    belief : Belief
        Of T targets.
    target, column : int arrays of shape (E,)
        The edges: each target with the detections that it may have, each once.
    shown : int array of shape (M,)
        The identity that each detection shows; negative where it shows none.
    undetected : array of shape (T,)
        Existence probability of each target, given that it is not the source of a detection.
    model : IdentityModel

    Notes
    -----
    If a new target is the source of a detection, an old one is not, and exists with r' =
    r (1 - p_D) / (1 - r p_D). Let b be its belief in the identity: then it leaves it to the new one
    with the probability 1 - r' b. What a new target shows may still be garbled.
    """
    if not model.unique:
        return Taken(np.zeros(len(target)), np.zeros(len(shown)))
    has = np.minimum(undetected[target] * belief.of(target, shown[column]), MOST_TAKEN)
    log_left = np.log1p(-has)
    left = sum_by(column, log_left, len(shown))
    others = -np.expm1(left[column] - log_left)
    unknown = np.log1p(model.own(shown) * np.expm1(left))
    return Taken(np.maximum(others, 0.0), unknown)


def lost(
    has: IntArray,
    seen_ns: IntArray,
    shown: IntArray,
    shown_ns: IntArray,
    near: tuple[IntArray, IntArray],
) -> Lost | None:
    """Return the targets that detections show and that are not near them; None if there are none.

    Parameters
    ----------
    has : int array of shape (T,)
        The unique identity of each target, negative where it is not known.
    seen_ns : int array of shape (T,)
        When each was last seen, nanoseconds.
    shown : int array of shape (M,)
        The identity that each detection shows; negative where it shows none.
    shown_ns : int array of shape (M,)
        When, nanoseconds.
    near : tuple of two int arrays of shape (P,)
        Targets and their detections that are near to each other.
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
