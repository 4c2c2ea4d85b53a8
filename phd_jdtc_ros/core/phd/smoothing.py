"""The backward step of particles (Sec. IV-C, Step 4), and the death terms of both recursions.

Deviation: the printed sum has the weight w^(s)_{t+1|k}; it is that of the later particle, q.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from ..arrays import FloatArray
from .kernel import Kernel
from .particles import Particles

# Returns phi_j, the factor on 1 - P_s of every component, (J,), given its mass sum_s a_j(s), the
# part expected to survive, sum_s P_s(s) a_j(s), and the part alive at t + 1 by all scans,
# B_j = sum_s a_j(s) B(s), (J,) each.
DeathTerm: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


def printed_death_term(mass: FloatArray, surviving: FloatArray, alive: FloatArray) -> FloatArray:
    """Return phi = 1: the term as printed.

    Sec. II-B, backward equation. It is right only for targets with a small existence probability.
    A target that was certain and then died loses its mass in the whole lag window.
    """
    return np.ones(len(mass))


def bernoulli_death_term(mass: FloatArray, surviving: FloatArray, alive: FloatArray) -> FloatArray:
    """Return the death factor of each component as a Bernoulli target.

    Deviation from Sec. II-B: after a correction the posterior is a Poisson part plus Bernoulli
    components a_j, and phi_j = (1 - B_j) / (1 - sum_s P_s(s) a_j(s)), with B_j clipped at 1. It is
    the exact backward step if component j alone contributes to mu.
    """
    # A component is at most one target, but resampling may round its mass up to a little more.
    absent = 1.0 - surviving / np.maximum(mass, 1.0)
    return (1.0 - np.minimum(alive, 1.0)) / np.where(absent > 0.0, absent, np.inf)


def backward_step(
    particles: Particles, kernel: Kernel, later: Particles, death_term: DeathTerm
) -> Particles:
    """Return the set at t with smoothed weights, given the filtered set and the smoothed next one.

    Sec. IV-C, Step 4: a_{j,t|k}(s) = a_{j,t|t}(s) [B(s) + (1 - P_s) phi_j] with the sum of the
    paper, B(s) = sum_q K[q, s] w_{t+1|k}(q) / mu_q; for the Poisson part phi is 1.
    """
    backward, survival = kernel.ratio @ later.weight, kernel.survival
    mass = particles.by_component(np.ones(len(particles)))
    masses = mass, particles.by_component(survival), particles.by_component(backward)
    parts, death = particles.components, 1.0 - survival
    data = particles.by_entry(death) * death_term(*masses).take(parts.indices)
    data += particles.by_entry(backward)
    data *= parts.data
    components = copy.copy(parts)  # The pattern is shared
    components.data = data
    return replace(particles, poisson=particles.poisson * (backward + death), components=components)
