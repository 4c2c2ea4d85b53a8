"""Reports of one batch as the compiled functions take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, frozen, run_starts
from ..compilation import Float1, Float2, Float3, Int1, Int2
from ..types import UNKNOWN
from ..types.reports import ACCURATE, SelfReports
from .model import MOST_OF_ADDRESS, MOST_PAIRS, MOST_PER_SECOND, MOST_SOURCES, Receiver
from .tables import Pairs, Sources

# Standard deviations of errors are within these bounds, metres.
LEAST_STD, MOST_STD = 1.0, 1e5
# Antennas that ships say are farther from their middles are errors, metres. The others are right
# within the larger one of this standard deviation and the ship's length by this number.
LONGEST, LEAST_ANTENNA_STD, LENGTHS = 500.0, 5.0, 10.0


class Batch(NamedTuple):
    """Reports in the order of their times."""

    time_ns: Int1
    measured: Float2  # Position and velocity, (M, 4)
    noise: Float3  # Covariance of both, (M, 4, 4)
    components: Int1  # 4, or 2 without a velocity, (M,)
    ahead: Float2  # Direction of the bow, unit vector, or 0, 0 if unknown, (M, 2)
    chain: Int1  # Index of the report's address among those of the batch, (M,)
    receiver: Int1
    gap_s: Float1  # Shortest time between two reports of such a transmitter, 0 if unknown, (M,)
    # The antenna's place ahead and left as said, and its standard deviation, 0 if unknown, (M, 3).
    antenna: Float2


class Chains(NamedTuple):
    """The sources of each address of a batch, and the pairs of each source, as linked lists."""

    first: Int1  # Row of the first source of each address; -1 for none, (A,)
    most: Int1  # Largest number of sources of each address, (A,)
    following: Int1  # Row of the next source of the same address; -1 for none, (S,)
    pairs: Int2  # Rows of the pairs of each source; -1 for none, (S, MOST_PAIRS)


class Tables(NamedTuple):
    """What reports change."""

    sources: Sources
    pairs: Pairs
    chains: Chains


def keys_of(address: IntArray, space: IntArray) -> IntArray:
    """Return one number for each address in its space, (N,)."""
    keys: IntArray = space * (1 << 33) + address + 1
    return keys


def selected(reports: SelfReports) -> SelfReports:
    """Return reports in the order of their times, at most so many of one address in a second.

    Reports of one time are in the order of their addresses and places, whatever the order in which
    they came.
    """
    key = keys_of(reports.address, reports.space)
    order = np.lexsort((*reports.position.T, key, reports.time_ns))
    key, second = key[order], reports.time_ns[order] // 1_000_000_000
    grouped = np.lexsort((second, key))
    first = run_starts(key[grouped] * 31 + second[grouped])
    rank = np.arange(len(order)) - np.repeat(first, np.diff(np.append(first, len(order))))
    keep = np.zeros(len(order), dtype=np.bool_)
    keep[grouped] = (rank < MOST_PER_SECOND) | (reports.address[order][grouped] == UNKNOWN)
    return reports.take(order[keep])


def batch_of(reports: SelfReports, receivers: tuple[Receiver, ...]) -> Batch:
    """Return reports in the order of their times as a batch."""
    habits = [receivers[index].habits for index in reports.receiver.tolist()]
    usual = np.array([each.usual_std for each in habits])
    accurate = np.array([each.accurate_std for each in habits])
    usual = np.where(reports.accurate == ACCURATE, accurate, usual)
    known = np.isfinite(reports.covariance.sum(axis=(1, 2)))
    covariance = np.where(
        known[:, None, None],
        reports.covariance,
        (usual**2)[:, None, None] * np.eye(2),
    )
    diagonal = np.clip(np.einsum("mkk->mk", covariance), LEAST_STD**2, MOST_STD**2)
    cross = np.clip(
        covariance[:, 0, 1], *(0.99 * side * np.sqrt(diagonal.prod(axis=1)) for side in (-1, 1))
    )
    moves = np.isfinite(reports.velocity.sum(axis=1))
    velocity = np.where(moves[:, None], reports.velocity, 0.0)
    step = np.array([each.time_step_s for each in habits])
    noise = np.zeros((len(reports), 4, 4))
    noise[:, [0, 1], [0, 1]] = diagonal
    noise[:, 0, 1] = noise[:, 1, 0] = cross
    # The error of a time in whole steps is along the velocity.
    noise[:, :2, :2] += (step**2 / 12.0)[:, None, None] * (velocity[:, :, None] * velocity[:, None])
    noise[:, [2, 3], [2, 3]] = (np.array([each.velocity_std for each in habits]) ** 2)[:, None]
    return frozen(
        Batch(
            reports.time_ns.copy(),
            np.concatenate([reports.position, velocity], axis=1),
            noise,
            np.where(moves, 4, 2),
            _ahead(reports, velocity),
            np.unique(keys_of(reports.address, reports.space), return_inverse=True)[1].ravel(),
            reports.receiver.copy(),
            np.where(reports.interval_s > 0.0, reports.interval_s + step, 0.0),
            _antennas(reports.hull),
        )
    )


def _ahead(reports: SelfReports, velocity: FloatArray) -> FloatArray:
    """Return the directions of the bows, (M, 2): headings, or courses of moving transmitters."""
    has_heading = np.isfinite(reports.heading)
    heading = np.where(has_heading, reports.heading, 0.0)
    speed = np.hypot(*velocity.T)
    course = velocity / np.maximum(speed, 1e-9)[:, None]
    # The course of a slow ship is not where its bow is.
    course[speed < 1.0] = 0.0
    by_heading = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return np.where(has_heading[:, None], by_heading, course)


def _antennas(hull: FloatArray) -> FloatArray:
    """Return where antennas are ahead and left, with the standard deviation, (M, 3).

    The latter is 0 if nothing is said. What a radar sees is not the middle of a long ship.
    """
    known = np.abs(hull[:, 0]) + np.abs(hull[:, 1]) < LONGEST  # False for NaN
    long = np.nan_to_num(hull[:, 2], nan=0.0, posinf=0.0).clip(0.0, LONGEST)
    std = np.where(known, np.maximum(LEAST_ANTENNA_STD, long / LENGTHS), 0.0)
    return np.column_stack([np.where(known[:, None], hull[:, :2], 0.0), std])


def chains_of(reports: SelfReports, sources: Sources, pairs: Pairs, free: int) -> Chains:
    """Return the sources of each address of a batch, and the pairs of each source.

    `free` is the number of rows for new sources.
    """
    keys = np.unique(keys_of(reports.address, reports.space))
    own = keys_of(sources.address, sources.space)
    size = len(own) + free
    first, following = np.full(len(keys), -1), np.full(size, -1)
    index = keys.searchsorted(own)
    for row in np.flatnonzero(index < len(keys)).tolist():
        chain = int(index[row])
        if keys[chain] == own[row]:
            following[row], first[chain] = first[chain], row
    anonymous = keys % (1 << 33) == UNKNOWN + 1
    slots = np.full((size, MOST_PAIRS), -1)
    filled = np.zeros(size, dtype=np.int64)
    for pair, row in enumerate(sources.number.searchsorted(pairs.source).tolist()):
        if filled[row] < MOST_PAIRS:
            slots[row, filled[row]] = pair
            filled[row] += 1
    most = np.where(anonymous, MOST_SOURCES, MOST_OF_ADDRESS)
    return Chains(first, most, following, slots)


def describe_sources(sources: Sources, reports: SelfReports, row: IntArray) -> None:
    """Write what reports say of their sources besides places, in place; `row` is each one's."""
    sources.address[row], sources.space[row] = reports.address, reports.space
    for column, value, known in (
        (sources.type, reports.type, reports.type != UNKNOWN),
        (sources.height, reports.height, np.isfinite(reports.height)),
        (sources.name, reports.name, reports.name.any(axis=1)),
    ):
        column[row[known]] = value[known]
