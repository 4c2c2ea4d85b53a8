"""Prediction (Sec. IV-C, Step 1): targets survive and move, are spawned, and are born."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..arrays import FloatArray, IntArray, factorize, sum_by
from ..models.tracker_model import TrackerModel
from ..targets import birth
from ..targets.birth import BirthTerm
from ..tracks import labels
from . import resampling
from .correction import Corrector
from .particle_set import AgedParticles, ParticleSet
from .proposals import proposal
from .proposals.detections_in_plane import InPlane
from .resampling import ParticleBudget


def predict(
    earlier: Sequence[AgedParticles],
    births: Sequence[tuple[int, float]],
    detections: InPlane,
    model: TrackerModel,
    corrector: Corrector,
    budget: ParticleBudget,
    scan_index: int,
    rng: np.random.Generator,
) -> ParticleSet:
    """Predict the intensity to a scan: survivors, spawned targets, births.

    The scan continues the `earlier` sets. `births` has the index of each birth term to draw, and
    the time since its last draw, seconds. The scan's `detections` are used in the proposal of the
    survivors' process noise. Every copy of a row has its own process noise. All weight is in the
    Poisson part, and parents are rows of the concatenated stored sets. The scan's index determines
    the labels of births and spawned targets.

    Sec. IV-C, Step 1. Deviation: the steps of survival and birth, which the paper omits, are added,
    and the spawn weight includes the parent's weight, rate and mode.
    """
    label = labels.first_predicted(scan_index)
    spawned = label + len(model.births)
    parts, offset = [], 0
    for particles, dt in earlier:
        predicted = [_survivors(particles, model, dt, detections, rng)]
        if model.spawn.rate > 0.0:
            predicted.append(_spawn(particles, model, corrector, budget, dt, spawned, rng))
            spawned = max(spawned, int(predicted[1].row_label.max(initial=0)) + 1)
        parts += [replace(part, parent=part.parent + offset) for part in predicted]
        offset += len(particles)
    for index, dt in births:
        term = model.births[index]
        parts.append(_births(term, model, budget.per_birth_term, dt, label + index, rng))
    return ParticleSet.concatenate(parts or [ParticleSet.empty(len(model.modes.space))])


def _draw_mode(transition: FloatArray, mode: IntArray, rng: np.random.Generator) -> IntArray:
    """Draw each particle's next mode from the row of its mode in the [from, to] matrix."""
    cumulative = np.cumsum(transition, axis=1)
    cumulative[:, -1] = 1.0
    uniform = rng.random(len(mode))
    drawn = np.zeros(len(mode), dtype=np.int64)
    # Modes are taken one at a time, because temporary arrays of shape (N, O) would take several
    # times as long.
    for bound in cumulative.T[:-1]:
        drawn += uniform >= bound.take(mode)
    return drawn


def _survivors(
    particles: ParticleSet,
    model: TrackerModel,
    dt: float,
    detections: InPlane,
    rng: np.random.Generator,
) -> ParticleSet:
    modes = model.modes
    copy = np.repeat(np.arange(len(particles)), particles.multiplicity)
    source_mode = particles.mode[copy]
    weight = (particles.weight / np.maximum(particles.multiplicity, 1))[copy]
    weight *= modes.survival(dt)[source_mode]
    mode = _draw_mode(modes.transition(dt), source_mode, rng)
    state, factor = np.empty((len(copy), particles.state.shape[1])), np.ones(len(copy))
    for index, motion_model in enumerate(modes.motions):
        rows = np.flatnonzero(mode == index)
        earlier = particles.state.take(copy.take(rows), axis=0)
        state[rows], factor[rows] = proposal.sample(motion_model, earlier, dt, detections, rng)
    row_label = particles.row_label[copy]
    if (factor != 1.0).any():
        weight = _restore_mass(weight * factor, weight, row_label)
    log_snr = model.amplitudes.diffuse(particles.log_snr[copy], mode, modes, dt, rng)
    return ParticleSet.unassigned(state, mode, row_label, copy, weight, log_snr)


def _restore_mass(weight: FloatArray, prior: FloatArray, row_label: IntArray) -> FloatArray:
    """Return weights scaled so that every label keeps its mass under `prior`."""
    distinct, target = factorize(row_label)
    mass, prior_mass = (sum_by(target, part, len(distinct)) for part in (weight, prior))
    return weight * (prior_mass / np.where(mass > 0.0, mass, 1.0)).take(target)


def _spawn(
    particles: ParticleSet,
    model: TrackerModel,
    corrector: Corrector,
    budget: ParticleBudget,
    dt: float,
    label: int,
    rng: np.random.Generator,
) -> ParticleSet:
    """Return the spawned particles; a labelled corrector gives those of each parent a new label."""
    spawn = model.spawn
    mass = float(particles.weight.sum())
    count = min(int(np.ceil(spawn.particles_per_target * mass)), budget.most)
    parent = resampling.draw(particles.weight, count, rng)
    mode = _draw_mode(spawn.transition, particles.mode[parent], rng)
    state = np.empty((len(parent), particles.state.shape[1]))
    for index, motion_model in enumerate(model.modes.motions):
        rows = np.flatnonzero(mode == index)
        moved = motion_model.mean(particles.state.take(parent.take(rows), axis=0), dt)
        support = list(motion_model.support)
        moved[:, support] += rng.standard_normal((len(rows), len(support))) * spawn.std[support]
        state[rows] = moved
    rate = spawn.rate * dt / model.modes.interval_s
    weight = np.full(len(parent), rate * mass / max(count, 1))
    log_snr = model.amplitudes.draw(mode, model.modes, rng)
    row_label = particles.row_label[parent]
    if corrector.labelled:
        row_label = label + factorize(row_label)[1]
    return ParticleSet.unassigned(state, mode, row_label, parent, weight, log_snr)


def _births(
    term: BirthTerm,
    model: TrackerModel,
    count: int,
    dt: float,
    label: int,
    rng: np.random.Generator,
) -> ParticleSet:
    state, mode = birth.sample(term, model.modes, count, rng)
    expected = float(term.rate.sum()) * dt / model.modes.interval_s
    return ParticleSet.unassigned(
        state,
        mode,
        np.full(count, label),
        np.full(count, -1),
        np.full(count, expected / count),
        model.amplitudes.draw(mode, model.modes, rng),
    )
