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
from ..sensors.slant_range import HeightProjection
from ..types import Detections
from .height import HeightModel, Heights, HeightUpdate, compare

# Smallest probability of a height that is used to project plots.
MIN_KNOWN = 0.5
# Ratio of the shift of a plot by another height to the standard deviation that widens its gate: the
# shifted plot is then well inside the gate.
WIDENING = 3.0

# Returns rows, detections and log likelihoods of the pairs in gates, (P,), (P,) and (P, ...).
Gate: TypeAlias = Callable[[Detections], tuple[IntArray, IntArray, FloatArray]]


class Paired(NamedTuple):
    """Pairs of rows and detections, each detection projected at the height of the row's target."""

    # `row`, `column`: row and detection of each pair, (P,).
    row: IntArray
    column: IntArray
    log_likelihood: FloatArray  # As the gate returns it, (P, ...)
    projected_index: IntArray  # Row of each pair's detection in `projected`, (P,)
    projected: Detections  # The detections, followed by those projected again at a target's height

    def take(self, pairs: IntArray) -> Paired:
        """Return these pairs alone."""
        return self._replace(
            row=self.row.take(pairs),
            column=self.column.take(pairs),
            log_likelihood=self.log_likelihood.take(pairs, axis=0),
            projected_index=self.projected_index.take(pairs),
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
    projection: HeightProjection,
    model: HeightModel,
) -> Paired:
    """Return the pairs of detections, some of them projected at the heights of the targets.

    Given are the target of each of the engine's rows, (N,), the heights of all targets at the
    scan's stamp, and the standard deviations of the detections, metres and radians, (M, 2).
    """
    first, size = plain(gate, detections), len(detections)
    edge = np.unique(target[first.row] * size + first.column)
    doubtful = _doubtful(edge, heights, detections, model)
    known = heights.known > MIN_KNOWN
    if not known.any() or not len(doubtful):
        return first
    between = heights.mean[known, 0].min(), heights.mean[known, 0].max()
    edge = _gated_at_heights(gate, target, detections, std, projection, doubtful, between)
    owner, column = edge // size, edge % size
    update = _height_update(heights, owner, column, detections, model)
    edge = edge[known[owner] & update.probably_garbled]
    if not len(edge):
        return first
    again = _project(edge // size, edge % size, heights, detections, std, projection)
    return _replace_pairs(first, plain(gate, again), target, edge, std)


def _doubtful(
    edge: IntArray, heights: Heights, detections: Detections, model: HeightModel
) -> IntArray:
    """Return the detections without the height of a target in whose gate they are."""
    size = len(detections)
    owner, column = edge // size, edge % size
    update = _height_update(heights, owner, column, detections, model)
    right = (heights.known > MIN_KNOWN)[owner] & update.probably_known
    return np.setdiff1d(np.arange(size), column[right])


def _replace_pairs(
    first: Paired, again: Paired, target: IntArray, edge: IntArray, std: FloatArray
) -> Paired:
    """Return the pairs, with those of some edges replaced by pairs at the target's height.

    `again` has pairs of the detections that were projected again, one for each edge, (E,).
    """
    size = len(first.projected)
    owner, column = edge // size, edge % size
    own = np.flatnonzero(target[again.row] == owner[again.column])
    kept = np.flatnonzero(~np.isin(target[first.row] * size + first.column, edge))
    row = np.concatenate([first.row[kept], again.row[own]])
    order = np.argsort(row, kind="stable")
    every = first.projected.take(np.concatenate([np.arange(size), column]))
    own_column = again.column[own]
    return Paired(
        row[order],
        np.concatenate([first.column[kept], column[own_column]])[order],
        np.concatenate([first.log_likelihood[kept], again.log_likelihood[own]])[order],
        np.concatenate([first.column[kept], size + own_column])[order],
        replace(
            every,
            measurement=np.concatenate([first.projected.measurement, again.projected.measurement]),
            noise_std=np.concatenate([std, again.projected.noise_std]),
        ),
    )


def _height_update(
    heights: Heights,
    target: IntArray,
    column: IntArray,
    detections: Detections,
    model: HeightModel,
) -> HeightUpdate:
    """Return the likelihood of the heights of (target, detection) pairs."""
    since = np.zeros(len(detections)) if detections.time_s is None else detections.time_s
    return compare(heights, target, _heights(detections)[column], since[column], model)


def _gated_at_heights(
    gate: Gate,
    target: IntArray,
    detections: Detections,
    std: FloatArray,
    projection: HeightProjection,
    columns: IntArray,
    between: tuple[float, float],
) -> IntArray:
    """Return the pairs of targets and detections that may be in a gate at some height `between`.

    The result, (E,), is ascending and has target * M + detection.
    """
    doubtful, wide = detections.take(columns), std[columns]
    for height in between:
        shift = _at(projection, doubtful, np.full(len(columns), height)) - doubtful.measurement
        wide[:, 0] = np.maximum(wide[:, 0], std[columns, 0] + np.abs(shift[:, 0]) / WIDENING)
    row, column, _ = gate(replace(doubtful, noise_std=wide))
    size = len(detections)
    return np.unique(target[row] * size + columns[column])


def _project(
    target: IntArray,
    column: IntArray,
    heights: Heights,
    detections: Detections,
    std: FloatArray,
    projection: HeightProjection,
) -> Detections:
    """Return the detections of some columns, projected at the heights of targets."""
    again = detections.take(column)
    height, std_height = heights.mean[target, 0], np.sqrt(heights.covariance[target, 0, 0])
    place = _at(projection, again, height)
    # The uncertainty of the height adds to that of the range.
    spread = _at(projection, again, height + std_height)[:, 0] - place[:, 0]
    noise = np.stack([np.hypot(std[column, 0], spread), std[column, 1]], axis=1)
    return replace(again, measurement=place, noise_std=noise)


def _at(projection: HeightProjection, detections: Detections, height: FloatArray) -> FloatArray:
    """Return detections projected at other heights, (M, 2)."""
    return projection.at(detections.measurement, _heights(detections), height)


def _heights(detections: Detections) -> FloatArray:
    """Return the heights of detections, NaN if missing, (M,)."""
    given = detections.height
    return np.full(len(detections), np.nan) if given is None else given
