"""Extra particles for targets whose identities are detected outside all their gates.

They are drawn by importance sampling: positions from the detection, and velocities given these.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ..arrays import FloatArray, IntArray, factorize
from ..attributes.uniqueness import Lost
from ..models.manoeuvre import PROBABILITY, Manoeuvre, manoeuvre
from ..models.tracker_model import TrackerModel
from ..sensors.report import Report
from .particle_set import ParticleSet
from .proposals.detections_in_plane import Places, places_of


def with_strays(
    particles: ParticleSet,
    lost: Lost,
    report: Report,
    model: TrackerModel,
    rng: np.random.Generator,
) -> ParticleSet:
    """Return the set with more particles of lost targets: manoeuvres beyond their models.

    Parameters
    ----------
    particles : ParticleSet
        The predicted set of a labelled filter.
    lost : Lost
        The lost targets, by index of the distinct labels.
    """
    target = factorize(particles.origin)[1]
    count = model.detection_births.particles
    row = np.concatenate([_draw(particles, target, own, count, rng) for own in lost.target])
    column, since_s = lost.column.repeat(count), lost.since_s.repeat(count)
    seen = places_of(report).take(column)
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
    strayed, mass = np.unique(lost.target), np.bincount(target, particles.weight)
    share = PROBABILITY * mass[lost.target].repeat(count) / count
    kept = np.where(np.isin(target, strayed), 1.0 - PROBABILITY, 1.0)
    weight = np.concatenate([particles.weight * kept, share * np.exp(log_prior - log_density)])
    every = np.concatenate([np.arange(len(particles)), row])
    return ParticleSet(
        state=np.concatenate([particles.state, state]),
        mode=particles.mode[every],
        origin=particles.origin[every],
        parent=particles.parent[every],
        multiplicity=np.concatenate([particles.multiplicity, np.ones(len(row), dtype=np.int64)]),
        poisson=weight,
        components=sparse.csr_array((len(every), 0)),
        label=particles.label[:0],
        log_snr=particles.log_snr[every],
    )


def _draw(
    particles: ParticleSet, target: IntArray, own: int, count: int, rng: np.random.Generator
) -> IntArray:
    """Draw rows of a target in proportion to their weights, shape (count,)."""
    rows = np.flatnonzero(target == own)
    share = np.cumsum(particles.weight[rows])
    place = np.searchsorted(share, share[-1] * (np.arange(count) + rng.random()) / count)
    drawn: IntArray = rows[np.minimum(place, len(rows) - 1)]
    return drawn


def _positions(seen: Places, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
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
    change: FloatArray = gain[:, None] * moved + rest[:, None] * rng.standard_normal(moved.shape)
    return change
