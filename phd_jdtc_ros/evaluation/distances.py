"""OSPA, GOSPA and the number of targets, also in space, and figures of paired targets.

Targets and estimates are paired by position alone. Distances in space are computed where the
estimates are in space and heights are true.
"""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from .accumulator import (
    CLASSES,
    GOSPA,
    OSPA,
    SPACE,
    SURVEILLANCE,
    WHOLE,
    Accumulator,
    Metric,
    Values,
    root_mean,
    share,
)
from .comparison import Comparison, PointSet, are_in_space
from .metrics import assign, gospa, ospa


class OspaAccumulator(Accumulator):
    """The OSPA distance and its parts."""

    names = published = ("ospa", "localization", "cardinality")
    curves = ("ospa", "localization")
    metrics = (
        Metric(
            key="ospa",
            heading="OSPA",
            unit="m",
            definition="Mean over the scans of the optimal sub-pattern assignment distance between "
            "the estimated and the true positions of a scan. Estimates and targets are paired so "
            "that the sum of the p-th powers of their distances, each cut off at c, is least. A "
            "missed or false target counts as a distance of c. The OSPA distance is the mean of "
            "these powers over the larger set, to the power 1/p. It is 0 if both sets are empty "
            "and c if only one is.",
            group=OSPA,
        ),
        Metric(
            key="localization",
            heading="localisation",
            unit="m",
            definition="The part of the OSPA distance due to the position errors of the pairs. The "
            "p-th powers of the two parts add up to that of the distance in every scan; the parts "
            "themselves add only for p = 1.",
            group=OSPA,
        ),
        Metric(
            key="cardinality",
            heading="cardinality",
            unit="m",
            definition="The part of the OSPA distance due to the wrong number of targets.",
            group=OSPA,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return the distance and its parts."""
        found = ospa(part.truth.position, part.estimate.position, self.cutoff, self.order)
        return found.distance, found.localization, found.cardinality


class GospaAccumulator(Accumulator):
    """The GOSPA distance and its parts."""

    names = published = ("gospa", "gospa_localization", "missed", "false")
    metrics = (
        Metric(
            key="gospa",
            heading="GOSPA",
            unit="m",
            definition="Mean over the scans of the generalised OSPA distance (alpha = 2) with the "
            "same p and c. It is not divided by the number of targets, and every missed and every "
            "false target costs c / 2^(1/p).",
            group=GOSPA,
        ),
        Metric(
            key="gospa_localization",
            heading="localisation",
            unit="m",
            definition="The part of the GOSPA distance due to the position errors of the pairs; it "
            "is not divided by their number.",
            group=GOSPA,
        ),
        Metric(
            key="missed",
            heading="missed",
            form=".3f",
            definition="Mean number per scan of targets that GOSPA pairs with no estimate.",
            group=GOSPA,
        ),
        Metric(
            key="false",
            heading="false",
            form=".3f",
            definition="Mean number per scan of estimates that GOSPA pairs with no target.",
            group=GOSPA,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return the distance and its parts."""
        found = gospa(part.truth.position, part.estimate.position, self.cutoff, self.order)
        return found.distance, found.localization, found.missed, found.false


class Numbers(Accumulator):
    """The numbers of targets and of estimates."""

    names = ("n_true", "n_est", "cardinality_abs_error")
    published = curves = ("n_true", "n_est")
    metrics = (
        Metric(
            key="cardinality_abs_error",
            heading="number error",
            form=".3f",
            definition="Mean over the scans of the absolute difference between the number of "
            "estimates and the number of targets.",
            group=OSPA,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return both numbers and their absolute difference."""
        true, estimated = len(part.truth), len(part.estimate)
        return true, estimated, abs(estimated - true)


class Space(Accumulator):
    """OSPA and GOSPA of positions in space, and the NEES of six axes; for all targets only."""

    names = ("ospa_3d", "gospa_3d", "judged_in_space", "nees_3d_sum")
    metrics = (
        Metric(
            key="ospa_3d",
            heading="OSPA in space",
            unit="m",
            definition="The OSPA distance of positions with heights, in scans whose estimates are "
            "in space and whose true heights are known. An estimate whose height is unknown is as "
            "far as c from every target.",
            group=SPACE,
        ),
        Metric(
            key="gospa_3d",
            heading="GOSPA in space",
            unit="m",
            definition="The GOSPA distance of the same positions.",
            group=SPACE,
        ),
        Metric(
            key="nees_3d",
            heading="NEES in space",
            form="#.3g",
            figure=share("nees_3d_sum", "judged_in_space"),
            definition="Normalised estimation error squared of position and velocity in space, "
            "divided by 6: the mean over the pairs with known heights and climb rates. It is 1 if "
            "the covariances are right, and larger if they are too small.",
            group=SPACE,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return both distances, the number of pairs with a NEES, and its sum."""
        if not (part.whole and are_in_space(part.truth, part.estimate)):
            return (None, None, 0, 0.0) if part.whole else (None,) * len(self.names)
        # Beyond the cutoff all places are alike.
        far = np.full((len(part.estimate), 3), 1e3 * self.cutoff + 1e9)
        place = part.estimate.place
        found = np.where(np.isnan(place).any(axis=1, keepdims=True), far, place)
        parameters = part.truth.place, found, self.cutoff, self.order
        squares = self._squares(part.truth, part.estimate)
        return (
            ospa(*parameters).distance,
            gospa(*parameters).distance,
            len(squares),
            # Number of axes: position and velocity in space.
            float(squares.sum()) / 6,
        )

    def _squares(self, truth: PointSet, estimate: PointSet) -> FloatArray:
        """Return the squared Mahalanobis distances of the pairs that are known in all axes.

        Pairs are nearest in position and velocity, of a second: where a target passes another,
        positions alone would take the velocity of one for an error of the other.
        """
        covariance = estimate.space_covariance
        if covariance is None:
            return np.zeros(0)
        true, found = (np.hstack([each.place, each.motion]) for each in (truth, estimate))
        true = true[np.isfinite(true).all(axis=1)]
        known = np.isfinite(found).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
        found, covariance = found[known], covariance[known]
        sound = np.linalg.eigvalsh(covariance).min(axis=1, initial=1.0) > 0.0
        found, covariance = found[sound], covariance[sound]
        row, column = assign(true, found, self.cutoff, self.order)
        error = found[column] - true[row]
        solved = np.linalg.solve(covariance[column], error[..., None])[..., 0]
        squares: FloatArray = (solved * error).sum(axis=1)
        return squares


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
            figure=root_mean("square_error", "pairs"),
            definition="Root mean square, over all pairs of the run, of the distance between a "
            "target and the estimate that it is paired with, by position alone, closer than c.",
            group=SURVEILLANCE,
        ),
        Metric(
            key="position_detection",
            heading="position detected",
            form=".2%",
            figure=share("pairs", "n_true"),
            definition="Share of the targets, over all scans, that are paired with an estimate, by "
            "position alone, closer than c.",
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
            form=".3f",
            figure=lambda run: run.mean("beyond"),
            definition="Mean number per scan of estimates that are farther than c from every "
            "target. A second estimate near a target does not count here; `false` counts it too.",
            group=WHOLE,
            headline=True,
        ),
        Metric(
            key="position_near",
            heading=f"within {NEAR:g} m",
            form=".2%",
            figure=share("near", "n_true"),
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
            figure=root_mean("height_square_error", "heights"),
            definition="Root mean square, over all pairs of the run whose true and estimated "
            "heights are known, of the difference of the two.",
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
            form=".1%",
            figure=share("right_class", "pairs"),
            definition="Share of the pairs with the right class. Pairs are of an estimate and a "
            "target, by position alone, closer than c; in a report the estimates are those of the "
            "smoother. Missed and false targets are left out.",
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
