"""The velocities of targets born at a detection, drawn again once their next detection is known.

A newborn target's velocity is known only by its prior. Where that is broad, next to none of its
particles come near the next detection. Its velocities are therefore drawn by importance sampling,
partly from the prior and partly from those that lead to one of the next detections. The weights
make up for the difference, so the newborn's density stays the same.

Of a target born with a range rate only the velocity across the line of sight is known by its prior,
and drawn again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...arrays import FloatArray, IntArray
from ...models.detection_birth import DetectionBirthModel
from ...models.tracker_model import TrackerModel
from ...sensors.polar_geometry import LEAST_RANGE
from ...sensors.sensor import Sensor
from ...tracks.labels import is_detected
from ...window.entries import Current, Entry
from ..correction import scale_rows
from ..kernel.backward_kernel import CurrentParticles
from ..particle_set import ParticleSet
from .detections_in_plane import Places

# Velocities are drawn again where they spread a target over this many deviations of a detection.
BROAD = 2.0
# The same where only the velocity across is drawn: more of them come near a detection by chance.
BROAD_ACROSS = 8.0
# Of the prior; farther out, no detection is taken for the target's next.
REACH_SIGMA = 3.0
# Share of the particles whose velocities come from the prior.
PRIOR_SHARE = 0.25
# A newborn's velocities spread less than this share of the prior where a range rate told them.
NARROW = 0.5
# What the velocities that lead to a detection are spread by, beyond its deviation.
INFLATION = 1.5


def redraw_velocities(
    touched: Sequence[CurrentParticles],
    stamp_ns: int,
    seen: Places,
    radars: Sequence[Sensor],
    model: TrackerModel,
    rng: np.random.Generator,
) -> list[CurrentParticles]:
    """Return the rows that a scan touches, with velocities of newborn targets drawn again.

    Parameters
    ----------
    touched : sequence of Current
    stamp_ns : int
        Of the scan.
    seen : Places
        Its detections.
    radars : sequence of Sensor
        Those that reported in it.
    model : TrackerModel
    rng : numpy.random.Generator
    """
    if not model.detection_births.enabled:
        return list(touched)
    return [
        _redraw_velocities(rows, (stamp_ns - rows.entry.stamp_ns) * 1e-9, seen, radars, model, rng)
        for rows in touched
    ]


def _redraw_velocities(
    rows: CurrentParticles,
    dt: float,
    seen: Places,
    radars: Sequence[Sensor],
    model: TrackerModel,
    rng: np.random.Generator,
) -> CurrentParticles:
    stored, births = rows.entry.stored, model.detection_births
    broad = BROAD * np.sqrt(np.linalg.eigvalsh(seen.covariance)[:, -1])
    sharp = births.velocity_std * dt > broad
    seen = Places(seen.position[sharp], seen.covariance[sharp], seen.time_s[sharp])
    newborn = (stored.parent < 0) & is_detected(stored.origin)
    if rows.rows is not None:
        of_rows = np.zeros(len(stored), dtype=bool)
        of_rows[rows.rows] = True
        newborn &= of_rows
    chosen = np.flatnonzero(newborn)
    if not len(chosen) or not len(seen.position):
        return rows
    state, factor = _redrawn(stored, chosen, dt, seen, radars, model, rng)
    entry = Entry(
        rows.entry.stamp_ns,
        replace(
            stored,
            state=state,
            poisson=stored.poisson * factor,
            components=scale_rows(stored.components, factor),
        ),
        rows.entry.sources,
        rows.entry.link,
    )
    return Current(entry, rows.rows)


def _redrawn(
    stored: ParticleSet,
    chosen: IntArray,
    dt: float,
    seen: Places,
    radars: Sequence[Sensor],
    model: TrackerModel,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Return all states with the velocities of some rows drawn again, and the weights' factors."""
    space, births = model.modes.space, model.detection_births
    place, speed = list(space.position), list(space.velocity)
    state, factor = stored.state.copy(), np.ones(len(stored))
    shape = [INFLATION * np.linalg.cholesky(matrix) / dt for matrix in seen.covariance]
    for origin in np.unique(stored.origin[chosen]):
        row = chosen[stored.origin[chosen] == origin]
        centre = state[row][:, place].mean(axis=0)
        reach = REACH_SIGMA * births.velocity_std * dt
        near = np.flatnonzero(np.hypot(*(seen.position - centre).T) <= reach)
        along = _measured_along(state[row], radars, births)
        if along is not None:
            std = np.sqrt(np.linalg.eigvalsh(seen.covariance[near])[:, -1])
            near = near[births.velocity_std * dt > BROAD_ACROSS * std]
        if len(near):
            leads = (seen.position[near][:, None] - state[row][:, place]) / dt
            if along is None:
                velocity, ratio = _drawn(leads, [shape[index] for index in near], births, rng)
            else:
                spread = (INFLATION / dt) ** 2 * seen.covariance[near]
                velocity, ratio = _drawn_across(
                    leads, spread, state[np.ix_(row, speed)], along, births, rng
                )
            state[np.ix_(row, speed)] = velocity
            weight = stored.weight[row]
            factor[row] = ratio * weight.sum() / (ratio * weight).sum()
    return state, factor


def _measured_along(
    state: FloatArray, radars: Sequence[Sensor], births: DetectionBirthModel
) -> FloatArray | None:
    """Return the directions in which the velocities of a newborn are known, (n, 2).

    They are those from the radar whose range rate told them, up to its ambiguity. None if none did.
    """
    best, least = None, NARROW * births.velocity_std
    for radar in radars:
        if radar.range_rate is None:
            continue
        rate = radar.range_rate_of(state)
        std = float(radar.range_rate.wrapped(rate - rate[0]).std())
        if std < least:
            line = state[:, list(radar.space.position)] - np.asarray(radar.position)
            distance = np.maximum(np.hypot(line[:, 0], line[:, 1]), LEAST_RANGE)
            best, least = line / distance[:, None], std
    return best


def _drawn_across(
    leads: FloatArray,
    spread: FloatArray,
    velocity: FloatArray,
    along: FloatArray,
    births: DetectionBirthModel,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Draw velocities across some directions, and return all with the prior's share of the density.

    Parameters
    ----------
    leads : array of shape (J, n, 2)
        Velocities that lead each particle to each detection.
    spread : array of shape (J, 2, 2)
        Covariances about them.
    velocity, along : arrays of shape (n, 2)
        Present velocities, and unit vectors along which they stay.
    births : DetectionBirthModel
    rng : numpy.random.Generator
    """
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    kept = (velocity * along).sum(axis=1)
    beside = (leads * along).sum(axis=2) - kept
    square = beside**2 / np.einsum("na,jab,nb->jn", along, spread, along)
    # A detection that the velocity along leads far away from is none of the target's.
    share = np.exp(-0.5 * (square - square.min(axis=0)))
    share *= (1.0 - PRIOR_SHARE) / share.sum(axis=0)
    mean = (leads * across).sum(axis=2)
    std = np.sqrt(np.einsum("na,jab,nb->jn", across, spread, across))
    count = len(kept)
    uniform = (np.arange(count) + rng.random()) / count
    part = (rng.permutation(uniform) >= np.cumsum(share, axis=0)).sum(axis=0)
    normal = rng.standard_normal(count)
    own = np.minimum(part, len(leads) - 1), np.arange(count)
    drawn = np.where(part < len(leads), mean[own] + std[own] * normal, births.velocity_std * normal)
    prior = np.exp(-0.5 * (drawn / births.velocity_std) ** 2) / births.velocity_std
    mixture = PRIOR_SHARE * prior
    mixture += (share * np.exp(-0.5 * ((drawn - mean) / std) ** 2) / std).sum(axis=0)
    return kept[:, None] * along + drawn[:, None] * across, prior / mixture


def _drawn(
    leads: FloatArray,
    shapes: Sequence[FloatArray],
    births: DetectionBirthModel,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Draw velocities from a mixture, and return them with the prior's share of its density.

    Parameters
    ----------
    leads : array of shape (J, n, 2)
        Velocities that lead each particle to each detection.
    shapes : sequence of J arrays of shape (2, 2)
        Cholesky factors of the covariances about them.
    births : DetectionBirthModel
    rng : numpy.random.Generator
    """
    count, size = leads.shape[:2]
    share = (1.0 - PRIOR_SHARE) / count
    part = np.floor((np.arange(size) + rng.random()) / size * (1.0 / share)).astype(np.int64)
    normal = rng.standard_normal((size, 2))
    velocity = births.velocity_std * normal
    for index in range(count):
        rows = np.flatnonzero(part == index)
        velocity[rows] = leads[index, rows] + normal[rows] @ shapes[index].T
    prior = np.exp(-0.5 * (velocity**2).sum(axis=1) / births.velocity_std**2)
    prior /= 2.0 * np.pi * births.velocity_std**2
    mixture = PRIOR_SHARE * prior
    for lead, factor in zip(leads, shapes, strict=True):
        whitened = np.linalg.solve(factor, (velocity - lead).T)
        density = np.exp(-0.5 * (whitened**2).sum(axis=0))
        mixture += share * density / (2.0 * np.pi * np.linalg.det(factor))
    return velocity, prior / mixture
