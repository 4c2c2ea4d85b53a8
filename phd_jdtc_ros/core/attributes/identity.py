"""Mode A code and Mode S address: the belief about each target's, and a reply's likelihood.

A belief is a few candidates, the rest of all identities as one, and that the target has no
transponder. A detection shows one identity or none. An answer may be garbled, a target may not
answer, and a new code may be assigned to it, so that no belief ever excludes a detection.

An identity may be unique: what one target has, no other one has. Addresses are, because an airframe
keeps its own. Codes are not: there are 4096 for all the world, neighbouring centres give the same
ones, and some are for whole groups of aircraft.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by
from ..types import UNKNOWN

# Candidates that are kept of each target; the improbable ones beyond go back to the rest.
CANDIDATES = 4
# Marks a detection of a sensor that does not report this identity.
NOTHING = -2
CODES, ADDRESSES = 1 << 12, 1 << 24
# The columns of a belief behind those of its candidates.
REST, ABSENT = -2, -1


@dataclass(frozen=True)
class IdentityModel:
    """How targets and their answers get their identities.

    Parameters
    ----------
    size : int
        N: the number of identities that there can be.
    equipped : float
        Probability that a target has a transponder.
    reply : float
        Probability that such a target's detection has an answer.
    garbled : float
        Probability that an answer is any identity, and of one where there is no transponder.
    kept_s : float
        Mean time until a target gets another identity, seconds.
    shared : tuple of int
        Identities that many targets have.
    shared_probability : float
        That a target has one of those; each is as probable.
    unique : bool
        Whether no two targets have the same.
    """

    size: int
    equipped: float = 0.9
    reply: float = 0.95
    garbled: float = 0.01
    kept_s: float = 1800.0
    shared: tuple[int, ...] = ()
    shared_probability: float = 0.0
    unique: bool = False

    def prior(self, identity: IntArray) -> FloatArray:
        """Return how probable identities are for a target that nothing is known of; shape kept."""
        if not self.shared:
            return np.full(np.shape(identity), 1.0 / self.size)
        own = (1.0 - self.shared_probability) / (self.size - len(self.shared))
        each = self.shared_probability / len(self.shared)
        return np.where(np.isin(identity, self.shared), each, own)

    @property
    def answered(self) -> float:
        """Probability that a detection of an unknown target has an answer."""
        return self.equipped * self.reply + (1.0 - self.equipped) * self.garbled

    def own(self, identity: IntArray) -> FloatArray:
        """Return how probably what unknown targets' detections show is their own; shape kept."""
        shown = self.equipped * self.reply * (1.0 - self.garbled) * self.prior(identity)
        return np.where(identity < 0, 0.0, shown / self.clutter_likelihood(identity))

    def clutter_likelihood(self, identity: IntArray) -> FloatArray:
        """Return the probability of what detections of unknown targets show; shape kept."""
        prior = self.prior(identity)
        answer = self.reply * ((1.0 - self.garbled) * prior + self.garbled / self.size)
        shown = self.equipped * answer + (1.0 - self.equipped) * self.garbled * prior
        return np.where(identity == UNKNOWN, 1.0 - self.answered, shown)


class Belief(NamedTuple):
    """What T targets' identities may be.

    Parameters
    ----------
    candidate : int array of shape (T, K)
        Distinct; `UNKNOWN` where there are fewer.
    weight : array of shape (T, K + 2)
        Probability of each candidate, of all other identities together, and of no transponder;
        rows sum to one.
    """

    candidate: IntArray
    weight: FloatArray

    @staticmethod
    def fresh(targets: int, model: IdentityModel) -> Belief:
        """Return the belief about targets that nothing is known of."""
        weight = np.zeros((targets, CANDIDATES + 2))
        weight[:, REST], weight[:, ABSENT] = model.equipped, 1.0 - model.equipped
        return Belief(np.full((targets, CANDIDATES), UNKNOWN), weight)

    def moved(self, dt: FloatArray, model: IdentityModel) -> Belief:
        """Return the belief `dt` seconds later, (T,): some targets have got another identity."""
        kept = np.exp(-dt / model.kept_s)[:, None]
        weight = self.weight.copy()
        weight[:, :REST] *= kept
        weight[:, REST] += ((1.0 - kept) * self.weight[:, :REST]).sum(axis=1)
        return Belief(self.candidate, weight)

    def reported(self) -> IntArray:
        """Return each target's identity if one is more probable than not, else `UNKNOWN`, (T,)."""
        best = self.weight[:, :REST].argmax(axis=1)
        row = np.arange(len(best))
        return np.where(self.weight[row, best] > 0.5, self.candidate[row, best], UNKNOWN)

    def of(self, target: IntArray, shown: IntArray) -> FloatArray:
        """Return how probably targets have what is shown as a candidate, both of shape (E,)."""
        match = (self.candidate[target] == shown[:, None]) & (shown >= 0)[:, None]
        probability: FloatArray = (self.weight[target, :REST] * match).sum(axis=1)
        return probability


class ReplyLikelihood(NamedTuple):
    """What detections show, compared with what is believed of targets.

    Parameters
    ----------
    prior : Belief
        Before the detections, with every identity that one of the target's pairs shows among its
        candidates, L of them.
    likelihood : array of shape (E, L + 2)
        Of each pair's detection, by column of the belief.
    log_factor : array of shape (E,)
        Log of the likelihood of each pair's detection, over that of an unknown target.
    """

    prior: Belief
    likelihood: FloatArray
    log_factor: FloatArray


def compared(
    belief: Belief,
    target: IntArray,
    shown: IntArray,
    model: IdentityModel,
    taken: FloatArray | float = 0.0,
) -> ReplyLikelihood:
    """Return what the detections of pairs are worth as evidence.

    Parameters
    ----------
    belief : Belief
        Of T targets.
    target : int array of shape (E,)
    shown : int array of shape (E,)
        The identity that each pair's detection shows; `UNKNOWN` for no answer, `NOTHING` where it
        does not say.
    model : IdentityModel
    taken : array of shape (E,) or float
        Probability that another target has what the pair's detection shows, so that its own target
        cannot.
    """
    prior = _widened(belief, target, shown, model)
    answered = (shown >= 0)[:, None]
    garbled = model.garbled / model.size
    match = (prior.candidate[target] == shown[:, None]) & answered
    likelihood = np.empty((len(target), prior.weight.shape[1]))
    free = np.broadcast_to(1.0 - np.asarray(taken), shown.shape)[:, None]
    likelihood[:, :REST] = model.reply * ((1.0 - model.garbled) * free * match + garbled)
    # What is shown is a candidate, so that none of the rest shows it but garbled.
    likelihood[:, REST] = model.reply * garbled
    likelihood[:, ABSENT] = model.garbled * model.prior(shown)
    silent = np.full(prior.weight.shape[1], 1.0 - model.reply)
    silent[ABSENT] = 1.0 - model.garbled
    likelihood = np.where(answered, likelihood, silent)
    said = shown != NOTHING
    likelihood[~said] = 1.0
    evidence = (prior.weight[target] * likelihood).sum(axis=1)
    log_factor = np.where(said, np.log(evidence / model.clutter_likelihood(shown)), 0.0)
    return ReplyLikelihood(prior, likelihood, log_factor)


def _widened(belief: Belief, target: IntArray, shown: IntArray, model: IdentityModel) -> Belief:
    """Return the belief with what the targets' pairs show taken out of the rest."""
    among = (belief.candidate[target] == shown[:, None]).any(axis=1)
    new = np.flatnonzero((shown >= 0) & ~among)
    owner, identity = np.divmod(np.unique(target[new] * model.size + shown[new]), model.size)
    place = np.arange(len(owner)) - np.searchsorted(owner, owner)
    known = belief.candidate.shape[1]
    width = known + int(place.max(initial=-1)) + 1
    candidate = np.full((len(belief.candidate), width), UNKNOWN)
    candidate[:, :known] = belief.candidate
    weight = np.zeros((len(candidate), width + 2))
    weight[:, :known], weight[:, REST:] = belief.weight[:, :REST], belief.weight[:, REST:]
    there = belief.candidate != UNKNOWN
    left = 1.0 - (model.prior(belief.candidate) * there).sum(axis=1)
    share = model.prior(identity) / left[owner]
    candidate[owner, known + place] = identity
    weight[owner, known + place] = share * belief.weight[owner, REST]
    weight[:, REST] *= 1.0 - sum_by(owner, share, len(candidate))
    return Belief(candidate, weight)


def learned(shown: ReplyLikelihood, target: IntArray, own: FloatArray, none: FloatArray) -> Belief:
    """Return the belief after an association.

    Parameters
    ----------
    shown : ReplyLikelihood
    target : int array of shape (E,)
    own : array of shape (E,)
        Probability of each pair, given that its target exists.
    none : array of shape (T,)
        Probability of none of its pairs.

    Notes
    -----
    Given its detection, a target's identity does not depend on the association of the others, so
    that this is exact until improbable candidates are given up.
    """
    prior = shown.prior.weight
    joint = prior[target] * shown.likelihood
    after = joint * (own / joint.sum(axis=1))[:, None]
    weight = none[:, None] * prior
    np.add.at(weight, target, after)
    weight /= weight.sum(axis=1, keepdims=True)
    return _narrowed(Belief(shown.prior.candidate, weight))


def _narrowed(belief: Belief) -> Belief:
    """Return the belief with its most probable candidates; the others go back to the rest."""
    named = np.where(belief.candidate == UNKNOWN, -1.0, belief.weight[:, :REST])
    order = np.argsort(-named, axis=1, kind="stable")[:, :CANDIDATES]
    candidate = np.take_along_axis(belief.candidate, order, axis=1)
    weight = np.zeros((len(candidate), CANDIDATES + 2))
    weight[:, :REST] = np.take_along_axis(belief.weight[:, :REST], order, axis=1)
    weight[:, ABSENT] = belief.weight[:, ABSENT]
    weight[:, REST] = 1.0 - weight[:, :REST].sum(axis=1) - weight[:, ABSENT]
    weight[:, REST] = np.maximum(weight[:, REST], 0.0)
    return Belief(candidate, weight)
