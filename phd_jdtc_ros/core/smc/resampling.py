# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Systematic resampling within groups, to unique particles with a multiplicity.

Contract: `within` says what the whole set may have, `allocate` how many copies each group gets,
`systematic` how many of them fall on each particle, and `comb` the same for a given start.
Resampling particles of one class and origin among themselves only keeps a target that was just
missed from being starved by its neighbours' mass.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray, factorize, run_starts, sum_by
from ..models.modes import ModeSpace
from .budget import ParticleBudget
from .correction import scale_rows
from .particle_set import ParticleSet


def allocate(
    mass: FloatArray, particles_per_target: float, least: int, rng: np.random.Generator
) -> tuple[IntArray, FloatArray]:
    """Return the number of copies and the weight of a copy for every group.

    Parameters
    ----------
    mass : array of shape (G,)
        Weight of each group, in targets.
    particles_per_target : float
    least : int
        Groups of at least ``1 / particles_per_target`` targets get no fewer than this.
    rng : numpy.random.Generator

    Returns
    -------
    count : int array of shape (G,)
    weight : array of shape (G,)
        Weight of one copy, so that the expected mass of every group is kept: groups too small
        for a particle survive by lot, with the weight of one.
    """
    wanted = mass * particles_per_target
    lucky = rng.random(len(mass)) < wanted
    count = np.where(wanted < 1.0, lucky, np.maximum(np.rint(wanted), float(least))).astype(
        np.int64
    )
    weight = np.where(wanted < 1.0, 1.0 / particles_per_target, mass / np.maximum(count, 1))
    return count, weight


def within(most: int, mass: FloatArray, particles_per_target: int, least: int) -> tuple[float, int]:
    """Return the particles per target and the least of a group with which a set has at most `most`.

    What groups get without the mass for it goes first, so that targets keep theirs while there is
    much that might be one; groups that survive by lot come on top.
    """
    density = particles_per_target * min(1.0, most / max(mass.sum() * particles_per_target, 1.0))
    wanted = np.rint(mass[mass * density >= 1.0] * density)
    while least > 1 and np.maximum(wanted, least).sum() > most:
        least //= 2
    return density, least


def systematic(
    weight: FloatArray, group: IntArray, count: IntArray, rng: np.random.Generator
) -> IntArray:
    """Return how many copies each particle gets, by one systematic comb a group.

    Parameters
    ----------
    weight : array of shape (N,)
        Non-negative; particles sorted by group.
    group : int array of shape (N,)
        Ascending, 0 to G - 1.
    count : int array of shape (G,)
        Copies to draw in each group.
    rng : numpy.random.Generator

    Returns
    -------
    copies : int array of shape (N,)
        Sums to `count` in every group; expectation proportional to `weight`.
    """
    if len(weight) == 0:
        return np.zeros(0, dtype=np.int64)
    return comb(weight, group, count, rng.random(len(count)))


def comb(weight: FloatArray, group: IntArray, count: IntArray, offset: FloatArray) -> IntArray:
    """Return what `systematic` does where each group's comb begins at `offset`.

    Parameters
    ----------
    weight : array of shape (N,)
        Not empty.
    group : int array of shape (N,)
    count : int array of shape (G,)
    offset : array of shape (G,)
        At least 0 and below 1; drawn evenly, it makes the copies unbiased.
    """
    mass = sum_by(group, weight, len(count))
    expected = weight * (count / np.where(mass > 0.0, mass, 1.0)).take(group)
    running = np.cumsum(expected)
    last = np.append(run_starts(group)[1:], len(group)) - 1
    base = np.zeros(len(count))
    base[group[last]] = running[last]
    base = np.concatenate([[0.0], base[:-1]])
    within = running - np.maximum.accumulate(base).take(group)
    # The comb's teeth stand at offset, offset + 1, ...: count those passed so far. Rounding must
    # not decide whether the group's last tooth is hit, so the last particle passes them all.
    passed = np.ceil(within - offset.take(group))
    passed = np.clip(passed, 0.0, count.take(group))
    passed[last] = count[group[last]]
    previous = np.concatenate([[0.0], passed[:-1]])
    previous[np.append(0, last[:-1] + 1)] = 0.0
    copies: IntArray = (passed - previous).astype(np.int64)
    return copies


def resample(
    particles: ParticleSet, modes: ModeSpace, budget: ParticleBudget, rng: np.random.Generator
) -> ParticleSet:
    """Resample within each (class, origin) to unique rows with a multiplicity.

    Parameters
    ----------
    particles : ParticleSet
        Updated.
    modes : ModeSpace
    budget : ParticleBudget
    rng : numpy.random.Generator

    Returns
    -------
    ParticleSet
        Sorted by (class, origin); every component of a row is scaled by its new over its old
        weight.

    Notes
    -----
    Sec. IV-C, Step 3. Deviation: within class and origin, not class alone.
    """
    origins, origin = factorize(particles.origin)
    key = modes.class_of[particles.mode] * len(origins) + origin
    # numpy sorts narrow integers by radix.
    narrow = key.astype(np.int16) if len(modes.classes) * len(origins) < 2**15 else key
    order = np.argsort(narrow, kind="stable")
    ranked = key[order]
    group = np.zeros(len(particles), dtype=np.int64)
    np.cumsum(ranked[1:] != ranked[:-1], out=group[1:])
    weight = particles.weight[order]
    mass = sum_by(group, weight, int(group[-1]) + 1 if len(group) else 0)
    density, least = within(budget.most, mass, budget.per_target, budget.least)
    count, copy_weight = allocate(mass, density, least, rng)
    copies = systematic(weight, group, count, rng)
    kept = np.flatnonzero(copies)
    row = order[kept]
    factor = copies[kept] * copy_weight[group[kept]] / weight[kept]
    return ParticleSet(
        state=particles.state.take(row, axis=0),
        mode=particles.mode[row],
        origin=particles.origin[row],
        parent=particles.parent[row],
        multiplicity=copies[kept],
        poisson=particles.poisson[row] * factor,
        components=scale_rows(particles.components[row], factor),
        label=particles.label,
        log_snr=particles.log_snr[row],
    )
