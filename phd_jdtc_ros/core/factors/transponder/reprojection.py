"""Projects plots with missing or false heights again, at the heights of nearby targets.

A ground range follows from the slant range and the height. A plot without a height is projected at
an assumed one, and a plot with a garbled height at the garbled one: hundreds of metres from the
aircraft. Such a plot is paired with a target if the target's own height puts it at the target.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...association.evidence import Gate, Paired, pair_as_reported
from ...sensors.site import HeightProjection
from ...sensors.view import View
from ...types import Detections
from .height import HeightModel, Heights, HeightUpdate, compare

# Smallest probability of a height that is used to project plots.
MIN_KNOWN = 0.5


def pair(
    gate: Gate,
    target: IntArray,
    heights: Heights,
    report: View,
    projection: HeightProjection,
    model: HeightModel,
) -> Paired:
    """Return the pairs of a report's detections, some of them projected at heights of the targets.

    `target` has the target of each of the engine's rows, (N,), and `heights` the heights of all
    targets at the scan's stamp.
    """
    plots, size = _Plots(report, heights, projection, model), len(report)
    reported = pair_as_reported(gate, report.detections)
    edge = np.unique(target[reported.row] * size + reported.column)
    is_known = heights.known > MIN_KNOWN
    # A detection is doubtful unless its height is that of a target whose gate contains it.
    explained = edge[is_known[edge // size] & plots.compare(edge).probably_known]
    doubtful = np.setdiff1d(np.arange(size), explained % size)
    if not is_known.any() or not len(doubtful):
        return reported
    row, column, _ = gate(plots.widen(doubtful, heights.mean[is_known, 0]))
    edge = np.unique(target[row] * size + doubtful[column])
    edge = edge[is_known[edge // size] & plots.compare(edge).probably_garbled]
    if not len(edge):
        return reported
    projected = pair_as_reported(gate, plots.project(edge))
    return _replace_pairs(reported, projected, target, edge, report.detection_std)


class _Plots(NamedTuple):
    """A report's plots, and the heights at which they can be projected again.

    Edges, (E,), are numbers of pairs: target * M + detection.
    """

    report: View
    heights: Heights  # Of the targets
    projection: HeightProjection
    model: HeightModel

    @property
    def height(self) -> FloatArray:
        """Height of each detection, NaN if missing, (M,)."""
        measured = self.report.detections.height
        return np.full(len(self.report), np.nan) if measured is None else measured

    def compare(self, edge: IntArray) -> HeightUpdate:
        """Return the likelihood of the heights of edges."""
        target, column = np.divmod(edge, len(self.report))
        time_s = self.report.time_s[column]
        return compare(self.heights, target, self.height[column], time_s, self.model)

    def at(self, columns: IntArray, height: FloatArray) -> FloatArray:
        """Return detections projected at other heights, (K, 2)."""
        measured = self.report.detections.measurement[columns]
        return self.projection.at(measured, self.height[columns], height)

    def widen(self, columns: IntArray, heights: FloatArray) -> Detections:
        """Return detections with gates that contain their positions at all of the heights."""
        plots, std = self.report.detections.take(columns), self.report.detection_std[columns]
        widened = std.copy()
        for height in (heights.min(), heights.max()):
            shift = self.at(columns, np.full(len(columns), height)) - plots.measurement
            # A widened gate has a standard deviation larger by the shift of the plot over this
            # number, so that the shifted plot is well inside the gate.
            widening = 3.0
            widened[:, 0] = np.maximum(widened[:, 0], std[:, 0] + np.abs(shift[:, 0]) / widening)
        return replace(plots, noise_std=widened)

    def project(self, edge: IntArray) -> Detections:
        """Return the detection of each edge, projected at the height of its target."""
        target, column = np.divmod(edge, len(self.report))
        height = self.heights.mean[target, 0]
        position, std = self.at(column, height), self.report.detection_std[column]
        # The uncertainty of the height adds to that of the range.
        higher = height + np.sqrt(self.heights.covariance[target, 0, 0])
        range_std = self.at(column, higher)[:, 0] - position[:, 0]
        noise = np.stack([np.hypot(std[:, 0], range_std), std[:, 1]], axis=1)
        return replace(self.report.detections.take(column), measurement=position, noise_std=noise)


def _replace_pairs(
    reported: Paired, projected: Paired, target: IntArray, edge: IntArray, std: FloatArray
) -> Paired:
    """Return the pairs, with those of some edges replaced by pairs at the target's height.

    `projected` has the pairs of the detections that were projected again, one for each edge, (E,).
    """
    size = len(reported.projected)
    owner, column = np.divmod(edge, size)
    own_pairs = np.flatnonzero(target[projected.row] == owner[projected.column])
    kept_pairs = np.flatnonzero(~np.isin(target[reported.row] * size + reported.column, edge))
    row = np.concatenate([reported.row[kept_pairs], projected.row[own_pairs]])
    order = np.argsort(row, kind="stable")
    detections = reported.projected.take(np.concatenate([np.arange(size), column]))
    own_column = projected.column[own_pairs]
    return Paired(
        row[order],
        np.concatenate([reported.column[kept_pairs], column[own_column]])[order],
        np.concatenate([reported.log_likelihood[kept_pairs], projected.log_likelihood[own_pairs]])[
            order
        ],
        np.concatenate([reported.column[kept_pairs], size + own_column])[order],
        replace(
            detections,
            measurement=np.concatenate(
                [reported.projected.measurement, projected.projected.measurement]
            ),
            noise_std=np.concatenate([std, projected.projected.noise_std]),
        ),
    )
