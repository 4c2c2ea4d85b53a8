# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plots of unknown height, read at the height of each target that they may be of.

Ranges over ground follow from slant ranges by heights. A plot without one is read at a supposed
height, hundreds of metres from an aircraft whose transponder has failed to answer once. It is the
target's detection all the same, if the target's height puts it where the target is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ..arrays import FloatArray, IntArray, distinct_cells
from ..sited_plots import HeightReading
from ..types import Detections
from .height import Heights

# A target's height is known with at least this probability.
KNOWN = 0.5
# Gates are widened by a deviation of this part of the way to the place at a target's height, which
# is then well inside.
WIDENING = 3.0

# Returns rows, detections and log likelihoods of the pairs in gates, (P,), (P,) and (P, ...).
Gate: TypeAlias = Callable[[Detections], tuple[IntArray, IntArray, FloatArray]]


class Paired(NamedTuple):
    """Pairs of an engine's rows and detections, each read as for the row's target.

    Parameters
    ----------
    row, column : int arrays of shape (P,)
        Row and detection of each pair.
    log_likelihood : array of shape (P, ...)
        As the gate returns it.
    reading : int array of shape (P,)
        Which of `readings` each pair has.
    readings : Detections
        The detections, and those that were read once more.
    """

    row: IntArray
    column: IntArray
    log_likelihood: FloatArray
    reading: IntArray
    readings: Detections


def plain(gate: Gate, detections: Detections) -> Paired:
    """Return the pairs of detections as they were read."""
    row, column, log_likelihood = gate(detections)
    return Paired(row, column, log_likelihood, column, detections)


def paired(
    gate: Gate,
    target: IntArray,
    heights: Heights,
    detections: Detections,
    std: FloatArray,
    reading: HeightReading,
) -> Paired:
    """Return the pairs of detections, those of unknown height read at the heights of the targets.

    Parameters
    ----------
    gate : Gate
    target : int array of shape (N,)
        Of each of the engine's rows.
    heights : Heights
        Of all targets, at the scan's stamp.
    detections : Detections
    std : array of shape (M, 2)
        Deviations of the detections.
    reading : HeightReading
        How their ranges depend on heights.
    """
    known, missing = np.flatnonzero(heights.known > KNOWN), _without_height(detections)
    if not len(known) or not len(missing):
        return plain(gate, detections)
    size, unread, wide = len(detections), detections.take(missing), std[missing]
    for bound in (heights.mean[known, 0].min(), heights.mean[known, 0].max()):
        moved = reading.at(unread.measurement, np.full(len(missing), bound)) - unread.measurement
        wide[:, 0] = np.maximum(wide[:, 0], std[missing, 0] + np.abs(moved[:, 0]) / WIDENING)
    row, column, _ = gate(replace(unread, noise_std=wide))
    inside = np.isin(target[row], known)
    edge, _ = distinct_cells(
        target[row[inside]] * size + missing[column[inside]], len(heights.known) * size
    )
    if not len(edge):
        return plain(gate, detections)
    readings = _read(edge // size, edge % size, heights, detections, std, reading)
    row, place, log_likelihood = gate(readings)
    # Each target's own reading replaces the one without a height.
    of = np.concatenate([np.arange(size), edge % size])
    column, again = of[place], place >= size
    wanted = target[row] * size + column
    kept = np.where(
        again, np.append(np.full(size, -1), edge)[place] == wanted, ~np.isin(wanted, edge)
    )
    rows = np.flatnonzero(kept)
    return Paired(row[rows], column[rows], log_likelihood[rows], place[rows], readings)


def _without_height(detections: Detections) -> IntArray:
    """Return the rows of those of unknown height; none if a radar reports no heights."""
    if detections.height is None:
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(np.isnan(detections.height))


def _read(
    target: IntArray,
    column: IntArray,
    heights: Heights,
    detections: Detections,
    std: FloatArray,
    reading: HeightReading,
) -> Detections:
    """Return the detections, and then those of some columns read at the heights of targets."""
    again = detections.measurement[column]
    height, deviation = heights.mean[target, 0], np.sqrt(heights.covariance[target, 0, 0])
    place = reading.at(again, height)
    # What the height may be off by, the range is too.
    spread = reading.at(again, height + deviation)[:, 0] - place[:, 0]
    noise = np.stack([np.hypot(std[column, 0], spread), std[column, 1]], axis=1)
    every = detections.take(np.concatenate([np.arange(len(detections)), column]))
    return replace(
        every,
        measurement=np.concatenate([detections.measurement, place]),
        noise_std=np.concatenate([std, noise]),
    )
