"""The backward step (Sec. IV-C, Step 4) over cached transitions, with selectable death terms."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ..arrays import FloatArray, sum_by
from ..window.backward_pass import Message, smoothed_sets
from .kernel.backward_kernel import ParticleEntry, Transition
from .particle_set import ParticleSet

# The term of the backward step for targets that do not survive: returns phi_j, the factor on
# 1 - P_s, for every component, (J,). The arguments are those of `backward_step`.
DeathTerm: TypeAlias = Callable[[ParticleSet, FloatArray, FloatArray], FloatArray]


def paper_death_term(
    particles: ParticleSet, survival: FloatArray, backward: FloatArray
) -> FloatArray:
    """Return phi = 1: the term as printed.

    Sec. II-B, backward equation. It is correct only for targets with a small existence probability.
    A target that was certain and then died loses its mass in the whole lag window.
    """
    return np.ones(particles.components.shape[1])


def bernoulli_death_term(
    particles: ParticleSet, survival: FloatArray, backward: FloatArray
) -> FloatArray:
    """Return the death factor of each component as a Bernoulli target.

    Deviation from Sec. II-B: after an update the posterior is a Poisson part plus Bernoulli
    components a_j, and for component j
    phi_j = (1 - B_j) / (1 - sum_s P_s(s) a_j(s)), with B_j = sum_s a_j(s) B(s) clipped at 1.
    It is the exact backward step if component j alone contributes to mu.
    """
    parts = particles.components
    components = parts.shape[1]

    def by_component(factor: FloatArray) -> FloatArray:
        return sum_by(parts.indices, parts.data * particles.by_entry(factor), components)

    survived = np.minimum(by_component(backward), 1.0)
    # A component is at most one target, but resampling may round its mass up to a little more.
    mass = np.maximum(particles.component_mass, 1.0)
    dying = 1.0 - by_component(survival) / mass
    return (1.0 - survived) / np.where(dying > 0.0, dying, np.inf)


class _Message(NamedTuple):
    """The content of a backward message to N earlier rows."""

    survival: FloatArray  # P_s, (N,)
    backward: FloatArray  # B of `backward_step`, (N,)


DEATH_TERMS: dict[str, DeathTerm] = {"bernoulli": bernoulli_death_term, "paper": paper_death_term}


def backward_step(
    particles: ParticleSet, survival: FloatArray, backward: FloatArray, death_term: DeathTerm
) -> ParticleSet:
    """Return the set at t with smoothed weights, given those at t + 1.

    The set is the filtered one, with its filtered components. `survival` is P_s of each particle
    over the interval to t + 1, and `backward` is B(s), the smoothed mass w_{t+1|k} of the later set
    that it explains, divided by its weight; both (N,).

    Sec. IV-C, Step 4: a_{j,t|k}(s) = a_{j,t|t}(s) [B(s) + (1 - P_s) phi_j]; for the Poisson part
    phi is 1. Deviation: the superscript of w_{t+1|k} in the numerator is (q), not (s).
    """
    death = 1.0 - survival
    factor = death_term(particles, survival, backward)
    parts = particles.components
    data = particles.by_entry(death) * factor.take(parts.indices)
    data += particles.by_entry(backward)
    data *= parts.data
    components = copy.copy(parts)  # the pattern is shared
    components.data = data
    return replace(particles, poisson=particles.poisson * (backward + death), components=components)


def backward_pass(entries: Sequence[ParticleEntry], death_term: DeathTerm) -> Iterator[ParticleSet]:
    """Yield the smoothed sets of a window, newest first: lag 0, lag 1 and so on.

    The entries are in order of time. A source that is not among them has been dropped; nothing is
    sent to it.
    """

    def send(later: ParticleSet, link: Transition) -> _Message:
        return _Message(link.survival, link.ratio @ later.weight)

    def receive(particles: ParticleSet, received: Sequence[Message[_Message]]) -> ParticleSet:
        return backward_step(particles, *_gather(len(particles), received), death_term)

    return smoothed_sets(entries, send, receive)


def _gather(size: int, received: Sequence[Message[_Message]]) -> _Message:
    """Return P_s and B of all rows of a set; both are 1 for rows without a message."""
    parts = [
        (part.rows, _Message(*(values[part.part] for values in part.content))) for part in received
    ]
    if parts[0][0] is None:
        return parts[0][1]
    gathered = _Message(np.ones(size), np.ones(size))
    for rows, message in parts:
        gathered.survival[rows], gathered.backward[rows] = message
    return gathered
