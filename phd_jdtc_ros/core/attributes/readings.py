"""Projects plots with missing or false heights again, at the heights of nearby targets.

A ground range follows from the slant range and the height. A plot without a height is projected at
an assumed one, and a plot with a garbled height at the garbled one: hundreds of metres from the
aircraft. Such a plot is paired with a target if the target's own height puts it at the target.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ..arrays import FloatArray, IntArray
from ..sensors.slant_range import HeightReading
from ..types import Detections
from .height import HeightModel, Heights, compare

# Smallest probability of a height that is used to project plots.
KNOWN = 0.5
# Columns of `height.Measured.part`.
RIGHT, FALSE = 0, 1
# Ratio of the shift of a plot by another height to the standard deviation that widens its gate: the
# shifted plot is then well inside the gate.
WIDENING = 3.0

# Returns rows, detections and log likelihoods of the pairs in gates, (P,), (P,) and (P, ...).
Gate: TypeAlias = Callable[[Detections], tuple[IntArray, IntArray, FloatArray]]


class Paired(NamedTuple):
    """Pairs of rows and detections, each detection projected at the height of the row's target.

    Parameters
    ----------
    row, column : int arrays of shape (P,)
        Row and detection of each pair.
    log_likelihood : array of shape (P, ...)
        As the gate returns it.
    reading : int array of shape (P,)
        Index of each pair's detection in `readings`.
    readings : Detections
        The detections, followed by those projected at a target's height.
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
    """Return the pairs of detections with their own projection."""
    row, column, log_likelihood = gate(detections)
    return Paired(row, column, log_likelihood, column, detections)


def pair(
    gate: Gate,
    target: IntArray,
    heights: Heights,
    detections: Detections,
    std: FloatArray,
    reading: HeightReading,
    model: HeightModel,
) -> Paired:
    """Return the pairs of detections, some of them projected at the heights of the targets.

    Parameters
    ----------
    gate : Gate
    target : int array of shape (N,)
        Target of each of the engine's rows.
    heights : Heights
        Of all targets, at the scan's stamp.
    detections : Detections
    std : array of shape (M, 2)
        Standard deviations of the detections, metres and radians.
    reading : HeightReading
        Dependence of the ranges on the heights.
    model : HeightModel
    """
    first, size = plain(gate, detections), len(detections)
    known = heights.known > KNOWN
    edge = np.unique(target[first.row] * size + first.column)
    part = _most_probable_part(heights, edge // size, edge % size, detections, model)
    right = known[edge // size] & (part == RIGHT)
    # A detection with the height of a nearby target needs no other projection.
    doubtful = np.setdiff1d(np.arange(size), edge[right] % size)
    if not known.any() or not len(doubtful):
        return first
    lowest, highest = heights.mean[known, 0].min(), heights.mean[known, 0].max()
    edge = _near(gate, target, detections, std, reading, doubtful, (lowest, highest))
    owner, column = edge // size, edge % size
    wrong = known[owner] & (_most_probable_part(heights, owner, column, detections, model) == FALSE)
    owner, column, edge = owner[wrong], column[wrong], edge[wrong]
    if not len(edge):
        return first
    again = _read(owner, column, heights, detections, std, reading)
    row, which, log_likelihood = gate(again)
    own = np.flatnonzero(target[row] == owner[which])
    # The projection at the target's height replaces the one at the plot's height.
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


def _most_probable_part(
    heights: Heights,
    target: IntArray,
    column: IntArray,
    detections: Detections,
    model: HeightModel,
) -> IntArray:
    """Return the most probable column of `height.Measured.part` for each pair, (E,)."""
    since = np.zeros(len(detections)) if detections.time_s is None else detections.time_s
    part = compare(heights, target, _heights(detections)[column], since[column], model).part
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
    """Return the cells (target times M plus detection) of pairs near at a height between two."""
    doubtful, wide = detections.take(columns), std[columns]
    for height in between:
        shift = _at(reading, doubtful, np.full(len(columns), height)) - doubtful.measurement
        wide[:, 0] = np.maximum(wide[:, 0], std[columns, 0] + np.abs(shift[:, 0]) / WIDENING)
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
    """Return the detections of some columns, projected at the heights of targets."""
    again = detections.take(column)
    height, deviation = heights.mean[target, 0], np.sqrt(heights.covariance[target, 0, 0])
    place = _at(reading, again, height)
    # The uncertainty of the height adds to that of the range.
    spread = _at(reading, again, height + deviation)[:, 0] - place[:, 0]
    noise = np.stack([np.hypot(std[column, 0], spread), std[column, 1]], axis=1)
    return replace(again, measurement=place, noise_std=noise)


def _at(reading: HeightReading, detections: Detections, height: FloatArray) -> FloatArray:
    """Return detections projected at other heights, (M, 2)."""
    return reading.at(detections.measurement, _heights(detections), height)


def _heights(detections: Detections) -> FloatArray:
    """Return the heights of detections, NaN if missing, (M,)."""
    given = detections.height
    return np.full(len(detections), np.nan) if given is None else given
