"""Plots whose heights are missing or false, read at the height of each target that they may be of.

Ranges over ground follow from slant ranges by heights. A plot without one is read at a supposed
height, and one with a garbled height at that: hundreds of metres from the aircraft. It is the
target's detection all the same, if the target's own height puts it where the target is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ..arrays import FloatArray, IntArray
from ..sensors.slant_range import HeightReading
from ..types import Detections
from .height import HeightModel, Heights, compared

# A target's height is known with at least this probability.
KNOWN = 0.5
# Columns of `height.Measured.part`.
RIGHT, FALSE = 0, 1
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

    def take(self, pairs: IntArray) -> Paired:
        """Return these pairs alone."""
        return Paired(
            self.row[pairs],
            self.column[pairs],
            self.log_likelihood[pairs],
            self.reading[pairs],
            self.readings,
        )


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
    model: HeightModel,
) -> Paired:
    """Return the pairs of detections, some of them read at the heights of the targets.

    Parameters
    ----------
    gate : Gate
    target : int array of shape (N,)
        Of each of the engine's rows.
    heights : Heights
        Of all targets, at the scan's stamp.
    detections : Detections
    std : array of shape (M, 2)
        Their deviations.
    reading : HeightReading
        How their ranges depend on heights.
    model : HeightModel
    """
    first, size = plain(gate, detections), len(detections)
    known = heights.known > KNOWN
    edge = np.unique(target[first.row] * size + first.column)
    said = _said(heights, edge // size, edge % size, detections, model)
    right = known[edge // size] & (said == RIGHT)
    # What has the height of a target that it is near to needs no other reading.
    doubtful = np.setdiff1d(np.arange(size), edge[right] % size)
    if not known.any() or not len(doubtful):
        return first
    lowest, highest = heights.mean[known, 0].min(), heights.mean[known, 0].max()
    edge = _near(gate, target, detections, std, reading, doubtful, (lowest, highest))
    owner, column = edge // size, edge % size
    wrong = known[owner] & (_said(heights, owner, column, detections, model) == FALSE)
    owner, column, edge = owner[wrong], column[wrong], edge[wrong]
    if not len(edge):
        return first
    again = _read(owner, column, heights, detections, std, reading)
    row, which, log_likelihood = gate(again)
    own = np.flatnonzero(target[row] == owner[which])
    # Each target's own reading replaces the one by the plot's height.
    kept = np.flatnonzero(~np.isin(target[first.row] * size + first.column, edge))
    rows = np.concatenate([first.row[kept], row[own]])
    order = np.argsort(rows, kind="stable")
    every = detections.take(np.concatenate([np.arange(size), column]))
    return Paired(
        rows[order],
        np.concatenate([first.column[kept], column[which[own]]])[order],
        np.concatenate([first.log_likelihood[kept], log_likelihood[own]])[order],
        np.concatenate([first.column[kept], size + which[own]])[order],
        replace(
            every,
            measurement=np.concatenate([detections.measurement, again.measurement]),
            noise_std=np.concatenate([std, again.noise_std]),
        ),
    )


def _said(
    heights: Heights,
    target: IntArray,
    column: IntArray,
    detections: Detections,
    model: HeightModel,
) -> IntArray:
    """Return what detections most probably say of the heights of targets, (E,).

    It is the target's height, nothing, or that the one that was known was wrong.
    """
    since = np.zeros(len(detections)) if detections.time_s is None else detections.time_s
    part = compared(heights, target, _heights(detections)[column], since[column], model).part
    most: IntArray = part.argmax(axis=1)
    return most


def _near(
    gate: Gate,
    target: IntArray,
    detections: Detections,
    std: FloatArray,
    reading: HeightReading,
    columns: IntArray,
    between: tuple[float, float],
) -> IntArray:
    """Return the cells, target times M plus detection, of those near at a height between two."""
    doubtful, wide = detections.take(columns), std[columns]
    for height in between:
        moved = _at(reading, doubtful, np.full(len(columns), height)) - doubtful.measurement
        wide[:, 0] = np.maximum(wide[:, 0], std[columns, 0] + np.abs(moved[:, 0]) / WIDENING)
    row, column, _ = gate(replace(doubtful, noise_std=wide))
    size = len(detections)
    return np.unique(target[row] * size + columns[column])


def _read(
    target: IntArray,
    column: IntArray,
    heights: Heights,
    detections: Detections,
    std: FloatArray,
    reading: HeightReading,
) -> Detections:
    """Return the detections of some columns, read at the heights of targets."""
    again = detections.take(column)
    height, deviation = heights.mean[target, 0], np.sqrt(heights.covariance[target, 0, 0])
    place = _at(reading, again, height)
    # What the height may be off by, the range is too.
    spread = _at(reading, again, height + deviation)[:, 0] - place[:, 0]
    noise = np.stack([np.hypot(std[column, 0], spread), std[column, 1]], axis=1)
    return replace(again, measurement=place, noise_std=noise)


def _at(reading: HeightReading, detections: Detections, height: FloatArray) -> FloatArray:
    """Return detections as they are read at other heights, (M, 2)."""
    return reading.at(detections.measurement, _heights(detections), height)


def _heights(detections: Detections) -> FloatArray:
    """Return the heights of detections, NaN where there is none, (M,)."""
    given = detections.height
    return np.full(len(detections), np.nan) if given is None else given
