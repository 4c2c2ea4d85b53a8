"""Prediction of particles (Sec. IV-C, Step 1): targets survive, are spawned, and are born.

Deviation: the steps of survivors and births, which the paper's text omits, are added, and the
weight of a spawned particle has the factors that the paper omits: the parent's weight, the rate
lambda_beta, and the probability of the mode. The proposals phi of classes and of states are beta's.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray
from ..models.tracker_model import TrackerModel
from ..targets import birth, motion
from .particles import Particles
from .resampling import ParticleBudget, draw


def predict(
    particles: Particles,
    model: TrackerModel,
    budget: ParticleBudget,
    dt: float,
    scan_index: int,
    rng: np.random.Generator,
) -> Particles:
    """Return the intensity after `dt` seconds, all of it in the Poisson part.

    Every copy of a row has process noise of its own. `scan_index` numbers the origins of births.
    """
    parts = [_survivors(particles, model, dt, rng)]
    if model.spawn.rate > 0.0:
        parts.append(_spawned(particles, model, budget, dt, rng))
    first = scan_index * len(model.births)
    for index in range(len(model.births)):
        parts.append(_born(index, model, budget.per_birth_term, dt, first + index, rng))
    return Particles.concatenate(parts)


def _draw_mode(transition: FloatArray, mode: IntArray, rng: np.random.Generator) -> IntArray:
    """Draw each particle's next mode from the row of its mode in the [from, to] matrix."""
    cumulative = np.cumsum(transition, axis=1)
    uniform = rng.random(len(mode))
    drawn = np.zeros(len(mode), dtype=np.int64)
    # Modes are taken one at a time, because temporary arrays of shape (N, O) would take several
    # times as long.
    for bound in cumulative.T[:-1]:
        drawn += uniform >= bound.take(mode)
    return drawn


def _survivors(
    particles: Particles, model: TrackerModel, dt: float, rng: np.random.Generator
) -> Particles:
    """Return the survivors: P_s w, with a mode from h and a state from that mode's motion."""
    modes = model.modes
    copy = np.repeat(np.arange(len(particles)), particles.multiplicity)
    weight = (modes.survival(dt)[particles.mode] * particles.weight / particles.multiplicity)[copy]
    mode = _draw_mode(modes.transition(dt), particles.mode[copy], rng)
    state = np.empty((len(copy), len(modes.space)))
    for index, motion_model in enumerate(modes.motions):
        rows = np.flatnonzero(mode == index)
        state[rows] = motion.sample(motion_model, particles.state[copy[rows]], dt, rng)
    return Particles.unexplained(state, mode, particles.origin[copy], copy, weight)


def _spawned(
    particles: Particles,
    model: TrackerModel,
    budget: ParticleBudget,
    dt: float,
    rng: np.random.Generator,
) -> Particles:
    """Return the spawned particles. As they are drawn from beta, all have the same weight.

    Deviation: they spread about F x_{k-1}, with F of the spawned target's mode; see `SpawnModel`.
    """
    spawn, mass = model.spawn, float(particles.weight.sum())
    count = min(int(np.ceil(spawn.particles_per_target * mass)), budget.most)
    parent = draw(particles.weight, count, rng)
    mode = _draw_mode(spawn.transition, particles.mode[parent], rng)
    state = np.empty((len(parent), len(model.modes.space)))
    for index, motion_model in enumerate(model.modes.motions):
        rows = np.flatnonzero(mode == index)
        moved = motion_model.mean(particles.state[parent[rows]], dt)
        support = list(motion_model.support)
        moved[:, support] += rng.standard_normal((len(rows), len(support))) * spawn.std[support]
        state[rows] = moved
    rate = spawn.rate * dt / model.modes.interval_s
    weight = np.full(len(parent), rate * mass / max(count, 1))
    return Particles.unexplained(state, mode, particles.origin[parent], parent, weight)


def _born(
    index: int,
    model: TrackerModel,
    count: int,
    dt: float,
    origin: int,
    rng: np.random.Generator,
) -> Particles:
    """Return the births of one term."""
    modes, term = model.modes, model.births[index]
    state, mode = birth.sample(term, modes, count, rng)
    weight = np.full(count, term.rate.sum() * dt / modes.interval_s / count)
    orphaned = np.full(count, -1)
    return Particles.unexplained(state, mode, np.full(count, origin), orphaned, weight)
