"""Unique identities: detections whose identity another target has, or a target outside its gates.

If a known target has the identity that a detection shows, the detection is less likely from a new
target or from any other one. This holds only if the known target may be at the detection;
elsewhere the identity was assigned twice, or the detection is a reflection.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray, sum_by
from ...association.evidence import OutOfGate
from .identity import Belief, IdentityModel


class Conflicts(NamedTuple):
    """Probabilities that known targets have the identities shown by M detections."""

    # Probability that a target other than the edge's has the identity, (E,).
    by_another: FloatArray
    # Log factor of the intensity of undetected targets at each detection, (M,).
    log_undetected: FloatArray


def identity_conflicts(
    belief: Belief,
    target: IntArray,
    column: IntArray,
    reply: IntArray,
    undetected: FloatArray,
    model: IdentityModel,
) -> Conflicts:
    """Return the probabilities that known targets have the detections' identities.

    `target` and `column` have the target and the detection of each edge, (E,), and `reply` the
    identity that each detection shows, negative without one, (M,). `undetected` is the existence
    probability of each target, given that it is not the source of any detection, (T,).

    If a new target is the source of a detection, an old one is not, and exists with probability
    r' = r (1 - p_D) / (1 - r p_D). With the belief b in the identity, the old target leaves it free
    with probability 1 - (1 - c) r' b, where c is the probability that the identity is cloned. The
    reply of a new target may also be garbled.
    """
    if not model.unique:
        return Conflicts(np.zeros(len(target)), np.zeros(len(reply)))
    probability = belief.probability_of(target, reply[column])
    # Where the identity is cloned, its owner does not exclude another one.
    excludes = (1.0 - model.cloned) * np.minimum(undetected[target] * probability, 1.0)
    log_free = np.log1p(-excludes)
    log_free_of_all = sum_by(column, log_free, len(reply))
    by_another = -np.expm1(log_free_of_all[column] - log_free)
    log_undetected = np.log1p(model.genuine_probability(reply) * np.expm1(log_free_of_all))
    return Conflicts(np.maximum(by_another, 0.0), log_undetected)


def find_out_of_gate(
    identity: IntArray,
    seen_ns: IntArray,
    reply: IntArray,
    reply_ns: IntArray,
    near: tuple[IntArray, IntArray],
) -> OutOfGate | None:
    """Return the targets whose identities detections show outside their gates, or None.

    `identity` and `seen_ns` have the identity of each target and the time of its last detection,
    (T,), `reply` and `reply_ns` the identity that each detection shows and its time, (M,), and
    `near` the targets and detections of the pairs in gates, (P,). Identities are negative if
    unknown; times are in nanoseconds.
    """
    away = (identity[:, None] == reply) & (reply >= 0)
    away[near] = False
    target, column = np.nonzero(away)
    since_ns = reply_ns[column] - seen_ns[target]
    row = np.flatnonzero(since_ns > 0)
    if not len(row):
        return None
    since_s = since_ns[row].astype(np.float64) * 1e-9
    return OutOfGate(target[row], column[row], since_s)
