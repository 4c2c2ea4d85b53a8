"""Figures of pairs of targets and estimates, paired by position alone."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from ..accumulator import (
    CLASSES,
    SURVEILLANCE,
    WHOLE,
    Accumulator,
    Metric,
    Values,
    mean,
    root_mean,
    share,
)
from ..comparison import Comparison

# Error of position that suffices for air surveillance, metres.
NEAR = 500.0


def _square_errors(part: Comparison) -> FloatArray:
    """Return the squared distances of the pairs, m^2, shape (P,)."""
    error = part.paired_truth.position - part.paired_estimate.position
    square: FloatArray = np.einsum("ij,ij->i", error, error)
    return square


class Pairs(Accumulator):
    """The pairs and their errors of position."""

    names = ("pairs", "square_error")
    metrics = (
        Metric(
            key="position_rms",
            heading="position RMS",
            unit="m",
            form=".1f",
            of_run=root_mean("square_error", "pairs"),
            definition=(
                "Root mean square, over all pairs of the run, of the distance between a target and "
                "the estimate that it is paired with, by position alone, closer than c."
            ),
            group=SURVEILLANCE,
        ),
        Metric(
            key="position_detection",
            heading="position detected",
            unit="",
            form=".2%",
            of_run=share("pairs", "n_true"),
            definition=(
                "Share of the targets, over all scans, that are paired with an estimate, by "
                "position alone, closer than c."
            ),
            group=SURVEILLANCE,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return the number of pairs and the sum of their squared distances."""
        return len(part.paired_truth), float(_square_errors(part).sum())


class Nearness(Accumulator):
    """Estimates far from all targets, and near pairs."""

    names = ("beyond", "near")
    metrics = (
        Metric(
            key="false_per_scan",
            heading="false per scan",
            unit="",
            form=".3f",
            of_run=mean("beyond"),
            definition=(
                "Mean number per scan of estimates that are farther than c from every target. A "
                "second estimate near a target does not count here; `false` counts it too."
            ),
            group=WHOLE,
            headline=True,
        ),
        Metric(
            key="position_near",
            heading=f"within {NEAR:g} m",
            unit="",
            form=".2%",
            of_run=share("near", "n_true"),
            definition=(
                "Share of the targets, over all scans, that are paired with an estimate closer "
                f"than {NEAR:g} m, and than c."
            ),
            group=WHOLE,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return the number of estimates farther than c from every target, and of near pairs."""
        apart = part.estimate.position[:, None] - part.truth.position
        nearest = np.hypot(apart[..., 0], apart[..., 1]).min(axis=1, initial=np.inf)
        near = np.count_nonzero(_square_errors(part) < NEAR**2)
        return int(np.count_nonzero(nearest > self.cutoff)), int(near)


class Heights(Accumulator):
    """The errors of the heights."""

    names = ("heights", "height_square_error")
    metrics = (
        Metric(
            key="height_rms",
            heading="height RMS",
            unit="m",
            form=".1f",
            of_run=root_mean("height_square_error", "heights"),
            definition=(
                "Root mean square, over all pairs of the run whose true and estimated heights are "
                "known, of the difference of the two."
            ),
            group=WHOLE,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return the number of pairs with known heights and the sum of their squared errors."""
        true, found = part.paired_truth.height, part.paired_estimate.height
        if true is None or found is None:
            return 0, 0.0
        error = (found - true)[np.isfinite(found - true)]
        return len(error), float((error**2).sum())


class Classes(Accumulator):
    """The classes of the pairs."""

    names = ("right_class",)
    metrics = (
        Metric(
            key="class_accuracy",
            heading="class accuracy",
            unit="",
            form=".1%",
            of_run=share("right_class", "pairs"),
            definition=(
                "Share of the pairs with the right class. Pairs are of an estimate and a target, "
                "by position alone, closer than c; in a report the estimates are those of the "
                "smoother. Missed and false targets are left out."
            ),
            group=CLASSES,
            headline=True,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return the number of pairs with the right class; None if no classes are compared."""
        if not part.classes:
            return (None,)
        right = part.paired_truth.class_id == part.paired_estimate.class_id
        return (int(np.count_nonzero(right)),)


def confusion_matrix(
    pairs: tuple[IntArray, IntArray], truth: IntArray, estimate: IntArray, classes: int
) -> IntArray:
    """Return the number of targets of one scan by true and by estimated class, (C + 1, C + 1).

    The pairs are those of `metrics.assign`, by position alone; `truth`, (T,), and `estimate`, (E,),
    are classes, of which others than 0 to C - 1 are left out. The last column counts missed
    targets, the last row false estimates. The matrix of a run is the sum over its scans.
    """
    row, column = pairs
    missed, false = np.delete(truth, row), np.delete(estimate, column)
    true = np.concatenate([truth[row], missed, np.full(len(false), classes)])
    estimated = np.concatenate([estimate[column], np.full(len(missed), classes), false])
    counted = (true <= classes) & (estimated <= classes)
    matrix = np.zeros((classes + 1, classes + 1), dtype=np.int64)
    np.add.at(matrix, (true[counted], estimated[counted]), 1)
    return matrix
