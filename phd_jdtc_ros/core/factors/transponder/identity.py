"""Mode A code and Mode S address: the belief about each target's, and a reply's likelihood.

A belief is a distribution over a few candidates, all other identities together, and the absence of
a transponder. A detection shows one identity or none. No belief excludes a detection, since a reply
may be garbled or missing, and a target may be assigned a new code.

A unique identity belongs to one target only. Addresses are unique, because an airframe keeps its
own. Codes are not: there are 4096 in the world, neighbouring centres assign the same ones, and some
are shared by groups of aircraft.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray, sum_by
from ...types import UNKNOWN

# Largest number of candidates of a target; the weight of less probable ones joins the rest.
CANDIDATES = 4
# Marks a detection of a sensor that does not report this identity.
NOT_REPORTED = -2
CODES, ADDRESSES = 1 << 12, 1 << 24
# Last two columns of a belief: all other identities, and no transponder.
REST, ABSENT = -2, -1


@dataclass(frozen=True)
class IdentityModel:
    """Model of targets' identities and of their replies."""

    size: int  # N: the number of possible identities
    equipped: float = 0.9  # Probability that a target has a transponder
    reply: float = 0.95  # Probability that a detection of an equipped target has a reply
    # Probability that a reply is garbled, and that a target without a transponder has one.
    garbled: float = 0.01
    kept_s: float = 1800.0  # Mean time until a target gets another identity, seconds
    shared: tuple[int, ...] = ()  # Identities that many targets have
    # Probability that a target has a shared identity; all of them are equally probable.
    shared_probability: float = 0.0
    unique: bool = False  # Whether no two targets have the same identity
    # Probability that a unique identity is cloned all the same: two targets send it.
    cloned: float = 1e-3

    def prior(self, identity: IntArray) -> FloatArray:
        """Return the prior probability of identities for a new target, elementwise."""
        if not self.shared:
            return np.full(np.shape(identity), 1.0 / self.size)
        unshared = (1.0 - self.shared_probability) / (self.size - len(self.shared))
        shared = self.shared_probability / len(self.shared)
        return np.where(np.isin(identity, self.shared), shared, unshared)

    @property
    def reply_probability(self) -> float:
        """Probability that a detection of an undetected target has a reply."""
        return self.equipped * self.reply + (1.0 - self.equipped) * self.garbled

    def genuine_probability(self, identity: IntArray) -> FloatArray:
        """Return the probability that an undetected target's reply is not garbled, elementwise."""
        genuine = self.equipped * self.reply * (1.0 - self.garbled) * self.prior(identity)
        return np.where(identity < 0, 0.0, genuine / self.unknown_target_likelihood(identity))

    def unknown_target_likelihood(self, identity: IntArray) -> FloatArray:
        """Return the likelihood of each reply, or of its absence, from an undetected target.

        Same shape as `identity`.
        """
        prior = self.prior(identity)
        answer = self.reply * ((1.0 - self.garbled) * prior + self.garbled / self.size)
        likelihood = self.equipped * answer + (1.0 - self.equipped) * self.garbled * prior
        return np.where(identity == UNKNOWN, 1.0 - self.reply_probability, likelihood)


class Belief(NamedTuple):
    """Distributions of T targets' identities."""

    candidate: IntArray  # Distinct identities, (T, K); `UNKNOWN` where there are fewer
    # Probability of each candidate, of all other identities together, and of no transponder,
    # (T, K + 2); rows sum to one.
    weight: FloatArray

    @staticmethod
    def fresh(targets: int, model: IdentityModel) -> Belief:
        """Return the prior belief about new targets."""
        weight = np.zeros((targets, CANDIDATES + 2))
        weight[:, REST], weight[:, ABSENT] = model.equipped, 1.0 - model.equipped
        return Belief(np.full((targets, CANDIDATES), UNKNOWN), weight)

    def predict(self, dt: FloatArray, model: IdentityModel) -> Belief:
        """Return the belief `dt` seconds later, (T,), as identities may have changed."""
        unchanged = np.exp(-dt / model.kept_s)[:, None]
        weight = self.weight.copy()
        weight[:, :REST] *= unchanged
        weight[:, REST] += ((1.0 - unchanged) * self.weight[:, :REST]).sum(axis=1)
        return Belief(self.candidate, weight)

    def most_probable(self) -> IntArray:
        """Return each target's identity of a probability above 0.5, or `UNKNOWN`, (T,)."""
        best = self.weight[:, :REST].argmax(axis=1)
        row = np.arange(len(best))
        return np.where(self.weight[row, best] > 0.5, self.candidate[row, best], UNKNOWN)

    def probability_of(self, target: IntArray, reply: IntArray) -> FloatArray:
        """Return the probability that each target has the identity shown; all shapes (E,)."""
        match = (self.candidate[target] == reply[:, None]) & (reply >= 0)[:, None]
        probability: FloatArray = (self.weight[target, :REST] * match).sum(axis=1)
        return probability


class ReplyLikelihood(NamedTuple):
    """Likelihood of replies given the beliefs about targets."""

    # Belief before the update; its L candidates include every identity shown in a target's edges.
    prior: Belief
    # Likelihood of each edge's reply for each column of the belief, (E, L + 2).
    likelihood: FloatArray
    # Log likelihood ratio of each edge's detection against an undetected target, (E,).
    log_factor: FloatArray


def compare(
    belief: Belief,
    target: IntArray,
    reply: IntArray,
    model: IdentityModel,
    conflict: FloatArray | float = 0.0,
) -> ReplyLikelihood:
    """Return the likelihoods of the replies of edges.

    Each edge has a target, a row of `belief`, and the identity that its detection shows, both (E,):
    `UNKNOWN` for no reply, `NOT_REPORTED` if the sensor does not report this identity. `conflict`
    is the probability that another target has the identity shown, which excludes the edge's target.
    """
    prior = _add_candidates(belief, target, reply, model)
    has_reply = (reply >= 0)[:, None]
    garbled = model.garbled / model.size
    match = (prior.candidate[target] == reply[:, None]) & has_reply
    likelihood = np.empty((len(target), prior.weight.shape[1]))
    free = np.broadcast_to(1.0 - np.asarray(conflict), reply.shape)[:, None]
    likelihood[:, :REST] = model.reply * ((1.0 - model.garbled) * free * match + garbled)
    # Every identity shown is a candidate: the rest can only show it garbled.
    likelihood[:, REST] = model.reply * garbled
    likelihood[:, ABSENT] = model.garbled * model.prior(reply)
    silent = np.full(prior.weight.shape[1], 1.0 - model.reply)
    silent[ABSENT] = 1.0 - model.garbled
    likelihood = np.where(has_reply, likelihood, silent)
    reports = reply != NOT_REPORTED
    likelihood[~reports] = 1.0
    evidence = (prior.weight[target] * likelihood).sum(axis=1)
    log_factor = np.where(reports, np.log(evidence / model.unknown_target_likelihood(reply)), 0.0)
    return ReplyLikelihood(prior, likelihood, log_factor)


def _add_candidates(
    belief: Belief, target: IntArray, reply: IntArray, model: IdentityModel
) -> Belief:
    """Return the belief with the identities shown in edges as further candidates."""
    is_candidate = (belief.candidate[target] == reply[:, None]).any(axis=1)
    unlisted = np.flatnonzero((reply >= 0) & ~is_candidate)
    owner, identity = np.divmod(
        np.unique(target[unlisted] * model.size + reply[unlisted]), model.size
    )
    added_index = np.arange(len(owner)) - np.searchsorted(owner, owner)
    old_width = belief.candidate.shape[1]
    width = old_width + int(added_index.max(initial=-1)) + 1
    candidate = np.full((len(belief.candidate), width), UNKNOWN)
    candidate[:, :old_width] = belief.candidate
    weight = np.zeros((len(candidate), width + 2))
    weight[:, :old_width], weight[:, REST:] = belief.weight[:, :REST], belief.weight[:, REST:]
    is_listed = belief.candidate != UNKNOWN
    unlisted_mass = 1.0 - (model.prior(belief.candidate) * is_listed).sum(axis=1)
    share = model.prior(identity) / unlisted_mass[owner]
    candidate[owner, old_width + added_index] = identity
    weight[owner, old_width + added_index] = share * belief.weight[owner, REST]
    weight[:, REST] *= 1.0 - sum_by(owner, share, len(candidate))
    return Belief(candidate, weight)


def update(
    replies: ReplyLikelihood, target: IntArray, probability: FloatArray, missed: FloatArray
) -> Belief:
    """Return the belief after an association.

    `target` has the row of each edge's target in the belief, `probability` that of each edge, given
    that its target exists, (E,), and `missed` the probability that a target has none of its edges,
    (T,). Given its detection, a target's identity is independent of the other targets'
    associations. The update is therefore exact, except for the candidates that are dropped.
    """
    prior = replies.prior.weight
    joint = prior[target] * replies.likelihood
    posterior = joint * (probability / joint.sum(axis=1))[:, None]
    weight = missed[:, None] * prior
    np.add.at(weight, target, posterior)
    weight /= weight.sum(axis=1, keepdims=True)
    return _prune(Belief(replies.prior.candidate, weight))


def _prune(belief: Belief) -> Belief:
    """Return the belief with its most probable candidates; the others join the rest."""
    named = np.where(belief.candidate == UNKNOWN, -1.0, belief.weight[:, :REST])
    order = np.argsort(-named, axis=1, kind="stable")[:, :CANDIDATES]
    candidate = np.take_along_axis(belief.candidate, order, axis=1)
    weight = np.zeros((len(candidate), CANDIDATES + 2))
    weight[:, :REST] = np.take_along_axis(belief.weight[:, :REST], order, axis=1)
    weight[:, ABSENT] = belief.weight[:, ABSENT]
    weight[:, REST] = 1.0 - weight[:, :REST].sum(axis=1) - weight[:, ABSENT]
    weight[:, REST] = np.maximum(weight[:, REST], 0.0)
    return Belief(candidate, weight)
