"""Systematic resampling within groups (Sec. IV-C, Step 3), to unique particles with a multiplicity.

Deviation: groups are (class, origin) and not classes alone. Targets with more mass thus take no
particles from a target that was just missed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray, IntArray, factorize, run_starts, sum_by
from ..targets.modes import ModeSpace

if TYPE_CHECKING:
    # Every configuration has a budget; without this import the other engines start sooner.
    from .particles import Particles


@dataclass(frozen=True)
class ParticleBudget:
    """The numbers of particles that represent the intensity."""

    per_target: int  # Number of copies to which unit mass is resampled
    least: int  # Minimum number of copies of a (class, origin) group
    per_birth_term: int  # Particles of each birth term per scan; a power of two
    most: int  # Maximum number of copies in a stored set


def resample(
    particles: Particles, modes: ModeSpace, budget: ParticleBudget, rng: np.random.Generator
) -> Particles:
    """Resample a set within each (class, origin) to unique rows with a multiplicity.

    The rows are sorted by (class, origin). All parts of a weight are scaled alike.
    """
    distinct, origin_index = factorize(particles.origin)
    key = modes.class_of[particles.mode] * len(distinct) + origin_index
    # NumPy sorts 16-bit integers by radix, which is faster.
    sort_key = key.astype(np.int16) if len(modes.classes) * len(distinct) < 2**15 else key
    order = np.argsort(sort_key, kind="stable")
    ranked = key[order]
    group = np.zeros(len(particles), dtype=np.int64)
    np.cumsum(ranked[1:] != ranked[:-1], out=group[1:])
    weight = particles.weight[order]
    mass = sum_by(group, weight, int(group[-1]) + 1 if len(group) else 0)
    per_target, least = fit_to_budget(mass, budget)
    count, copy_weight = allocate(mass, per_target, least, rng)
    copies = systematic(weight, group, count, rng)
    rows = np.flatnonzero(copies)
    factor = copies[rows] * copy_weight[group[rows]] / weight[rows]
    return particles.scaled(order[rows], factor, copies[rows])


def fit_to_budget(mass: FloatArray, budget: ParticleBudget) -> tuple[float, int]:
    """Return the particles per target and the minimum per group with which a set fits the budget.

    The particles per target are scaled down first if the mass of all groups, (G,), is too large;
    then the minimum is halved until the set fits. Groups with less than one particle are not
    counted: `allocate` draws them at random.
    """
    total = float(mass.sum()) * budget.per_target
    per_target, least = budget.per_target * min(1.0, budget.most / max(total, 1.0)), budget.least
    copies = np.rint((mass * per_target)[mass * per_target >= 1.0])
    while least > 1 and np.maximum(copies, least).sum() > budget.most:
        least //= 2
    return per_target, least


def allocate(
    mass: FloatArray, per_target: float, least: int, rng: np.random.Generator
) -> tuple[IntArray, FloatArray]:
    """Return the number of copies, and the weight of each copy, of every group, (G,).

    The mass, (G,), is in targets. A group with a mass of at least ``1 / per_target`` has at least
    `least` copies. The expected mass of every group is preserved: a group too small for one
    particle keeps one of weight ``1 / per_target`` with the probability that preserves its mass,
    and none otherwise.
    """
    expected = mass * per_target
    is_drawn = rng.random(len(mass)) < expected
    several = np.maximum(np.rint(expected), float(least))
    count = np.where(expected < 1.0, is_drawn, several).astype(np.int64)
    weight = np.where(expected < 1.0, 1.0 / per_target, mass / np.maximum(count, 1))
    return count, weight


def draw(weight: FloatArray, count: int, rng: np.random.Generator) -> IntArray:
    """Return `count` rows, ascending, drawn in proportion to their weights by one comb."""
    group = np.zeros(len(weight), dtype=np.int64)
    return np.arange(len(weight)).repeat(systematic(weight, group, np.array([count]), rng))


def systematic(
    weight: FloatArray, group: IntArray, count: IntArray, rng: np.random.Generator
) -> IntArray:
    """Return the copies of each particle, (N,), by one systematic comb per group; see `comb`."""
    if len(weight) == 0:
        return np.zeros(0, dtype=np.int64)
    return comb(weight, group, count, rng.random(len(count)))


def comb(weight: FloatArray, group: IntArray, count: IntArray, offset: FloatArray) -> IntArray:
    """Return the number of copies of each particle, by combs that begin at `offset`.

    Weights, (N,), are non-negative and not empty; groups ascend, 0 to G - 1. `count` is the number
    of copies to draw in each group, to which the result sums. Offsets, (G,), are at least 0 and
    below 1; a uniform draw gives unbiased numbers of copies.
    """
    mass = sum_by(group, weight, len(count))
    expected = weight * (count / np.where(mass > 0.0, mass, 1.0)).take(group)
    running = np.cumsum(expected)
    last = np.append(run_starts(group)[1:], len(group)) - 1
    base = np.zeros(len(count))
    base[group[last]] = running[last]
    base = np.concatenate([[0.0], base[:-1]])
    in_group = running - np.maximum.accumulate(base).take(group)
    # The comb has teeth at offset, offset + 1, ...; this counts the teeth passed so far. The last
    # particle passes all teeth, so that rounding cannot lose the group's last one.
    passed = np.ceil(in_group - offset.take(group))
    passed = np.clip(passed, 0.0, count.take(group))
    passed[last] = count[group[last]]
    previous = np.concatenate([[0.0], passed[:-1]])
    previous[np.append(0, last[:-1] + 1)] = 0.0
    copies: IntArray = (passed - previous).astype(np.int64)
    return copies
