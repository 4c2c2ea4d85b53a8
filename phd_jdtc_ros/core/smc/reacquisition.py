"""Additional particles for targets whose identities are shown outside all of their gates.

They are drawn by importance sampling: positions from the detection, and velocities given these.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import FloatArray, factorize
from ..attributes.uniqueness import OutOfGate
from ..models.manoeuvre import PROBABILITY, Manoeuvre, manoeuvre
from ..models.tracker_model import TrackerModel
from ..sensors.report import Report
from .particle_set import ParticleSet
from .proposals.detections_in_plane import InPlane, report_in_plane
from .resampling import draw


def with_reacquired(
    particles: ParticleSet,
    out_of_gate: OutOfGate,
    report: Report,
    model: TrackerModel,
    rng: np.random.Generator,
) -> ParticleSet:
    """Return a predicted set with additional particles at detections that show a target's identity.

    The targets of `out_of_gate`, by index of the distinct labels of a labelled filter, have
    deviated from their motion models.
    """
    target = factorize(particles.row_label)[1]
    count = model.detection_births.particles
    members = [np.flatnonzero(target == own) for own in out_of_gate.target]
    row = np.concatenate([rows[draw(particles.weight[rows], count, rng)] for rows in members])
    column, since_s = out_of_gate.column.repeat(count), out_of_gate.since_s.repeat(count)
    seen = report_in_plane(report).take(column)
    space = model.modes.space
    place, speed = list(space.position), list(space.velocity)
    done = manoeuvre(since_s, model)
    before = particles.state[row]
    expected = before[:, place] + seen.time_s[:, None] * before[:, speed]
    position, log_density = _positions(seen, rng)
    moved = position - expected
    state = before.copy()
    state[:, speed] += _velocities(moved, done, rng)
    state[:, place] = position - seen.time_s[:, None] * state[:, speed]
    log_prior = -0.5 * (moved**2).sum(axis=1) / done.position - np.log(2.0 * np.pi * done.position)
    reacquired, mass = np.unique(out_of_gate.target), np.bincount(target, particles.weight)
    share = PROBABILITY * mass[out_of_gate.target].repeat(count) / count
    kept = np.where(np.isin(target, reacquired), 1.0 - PROBABILITY, 1.0)
    weight = np.concatenate([particles.weight * kept, share * np.exp(log_prior - log_density)])
    every = np.concatenate([np.arange(len(particles)), row])
    return replace(
        particles.take(every),
        state=np.concatenate([particles.state, state]),
        multiplicity=np.concatenate([particles.multiplicity, np.ones(len(row), dtype=np.int64)]),
        poisson=weight,
    )


def _positions(seen: InPlane, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draw a position at each place, (N, 2); return also the log of its proposal density."""
    normal = rng.standard_normal(seen.position.shape)
    factor = np.linalg.cholesky(seen.covariance)
    log_density = -0.5 * (normal**2).sum(axis=1) - np.log(2.0 * np.pi)
    log_density -= np.log(factor[:, 0, 0] * factor[:, 1, 1])
    return seen.position + (factor @ normal[..., None])[..., 0], log_density


def _velocities(moved: FloatArray, done: Manoeuvre, rng: np.random.Generator) -> FloatArray:
    """Draw changes of velocity given the displacements by manoeuvres, both of shape (N, 2)."""
    gain = done.both / done.position
    rest = np.sqrt(np.maximum(done.velocity - gain * done.both, 0.0))
    return gain[:, None] * moved + rest[:, None] * rng.standard_normal(moved.shape)
