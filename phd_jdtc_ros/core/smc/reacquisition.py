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
    members = [np.flatnonzero(target == index) for index in out_of_gate.target]
    row = np.concatenate([rows[draw(particles.weight[rows], count, rng)] for rows in members])
    column, since_s = out_of_gate.column.repeat(count), out_of_gate.since_s.repeat(count)
    plots = report_in_plane(report).take(column)
    space = model.modes.space
    position_axes, velocity_axes = list(space.position), list(space.velocity)
    prior_state = particles.state[row]
    moments = manoeuvre(since_s, np.hypot(*prior_state[:, velocity_axes].T), model)
    expected = prior_state[:, position_axes] + plots.time_s[:, None] * prior_state[:, velocity_axes]
    position, log_density = _draw_positions(plots, rng)
    displacement = position - expected
    state = prior_state.copy()
    state[:, velocity_axes] += _draw_velocities(displacement, moments, rng)
    state[:, position_axes] = position - plots.time_s[:, None] * state[:, velocity_axes]
    log_prior = -0.5 * (displacement**2).sum(axis=1) / moments.position
    log_prior -= np.log(2.0 * np.pi * moments.position)
    reacquired, mass = np.unique(out_of_gate.target), np.bincount(target, particles.weight)
    share = PROBABILITY * mass[out_of_gate.target].repeat(count) / count
    factor = np.where(np.isin(target, reacquired), 1.0 - PROBABILITY, 1.0)
    weight = np.concatenate([particles.weight * factor, share * np.exp(log_prior - log_density)])
    all_rows = np.concatenate([np.arange(len(particles)), row])
    return replace(
        particles.take(all_rows),
        state=np.concatenate([particles.state, state]),
        multiplicity=np.concatenate([particles.multiplicity, np.ones(len(row), dtype=np.int64)]),
        poisson=weight,
    )


def _draw_positions(plots: InPlane, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draw a position at each place, (N, 2); return also the log of its proposal density."""
    normal = rng.standard_normal(plots.position.shape)
    factor = np.linalg.cholesky(plots.covariance)
    log_density = -0.5 * (normal**2).sum(axis=1) - np.log(2.0 * np.pi)
    log_density -= np.log(factor[:, 0, 0] * factor[:, 1, 1])
    return plots.position + (factor @ normal[..., None])[..., 0], log_density


def _draw_velocities(
    displacement: FloatArray, moments: Manoeuvre, rng: np.random.Generator
) -> FloatArray:
    """Draw changes of velocity given the displacements by manoeuvres, both of shape (N, 2)."""
    gain = moments.position_velocity / moments.position
    residual_std = np.sqrt(np.maximum(moments.velocity - gain * moments.position_velocity, 0.0))
    return gain[:, None] * displacement + residual_std[:, None] * rng.standard_normal(
        displacement.shape
    )
