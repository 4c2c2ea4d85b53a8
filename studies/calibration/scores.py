"""Said probabilities with their outcomes, and squared errors, summed over the scans of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.types import Estimates, Truth
from phd_jdtc_ros.evaluation.consistency import BOUND, mahalanobis2

# Existence probability above which a target is scored, and that from which its class and its
# covariance are.
LEAST, LIKELY = 0.01, 0.5
EXISTENCE_EDGES = (LEAST, *(0.1 * tenth for tenth in range(1, 10)), 0.95, 0.99, 1.0)
CLASS_EDGES = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
# Gate of the pairs of targets and estimates, in standard deviations of the estimate. It is wide,
# because it must not hide errors beyond 3 sigma.
GATE = 6.0
# Quantile of a 95 % interval.
QUANTILE = 1.96


class Reliability(NamedTuple):
    """Sums of a run by bin of the said probability, each of shape (B,)."""

    number: FloatArray  # Number of statements
    said: FloatArray  # Sum of the said probabilities
    right: FloatArray  # Number of statements that were right


class Errors(NamedTuple):
    """Sums of a run over pairs, each of shape (2,): targets in and out of all radars' coverage."""

    # `pairs`, `outside`: numbers of pairs, and of those beyond 3 sigma.
    pairs: FloatArray
    outside: FloatArray
    nees: FloatArray  # Sum of half the squared Mahalanobis distances of the positions


class Scores(NamedTuple):
    """The scores of a run for one source of estimates."""

    existence: Reliability
    target_class: Reliability
    errors: Errors


def matched(truth: Truth, found: Estimates) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the rows of the paired targets and estimates, and their squared distances.

    Distances are Mahalanobis distances of positions within `GATE`. The assignment has the most
    pairs, and among these the largest product of existence probability and density.
    """
    shape = len(truth.state), len(found)
    error = (truth.position[:, None] - found.position[None]).reshape(-1, 2)
    spread = found.position_covariance
    square = mahalanobis2(error, np.tile(spread, (shape[0], 1, 1))).reshape(shape)
    inside = square < GATE**2
    cost = square + np.log(np.linalg.det(spread)) - 2.0 * np.log(found.weight)
    # A pair more outweighs all differences of density.
    cost = np.where(inside, cost - cost[inside].max(initial=0.0) - 1e6, 0.0)
    target, estimate = linear_sum_assignment(cost)
    kept = inside[target, estimate]
    target, estimate = target[kept], estimate[kept]
    return target, estimate, square[target, estimate]


def of_run(
    truths: Sequence[Truth], covered: Sequence[BoolArray], found: Sequence[Estimates]
) -> Scores:
    """Return the scores of estimates of all targets above `LEAST`, scan by scan.

    `covered` says for each target of a scan, shape (T,), whether a radar can see it.
    """
    said, exists, believed, right = ([np.zeros(0)] for _ in range(4))
    squares, seen = [np.zeros(0)], [np.zeros(0, dtype=bool)]
    for truth, visible, estimates in zip(truths, covered, found, strict=True):
        target, estimate, square = matched(truth, estimates)
        said.append(estimates.weight)
        exists.append(np.isin(np.arange(len(estimates)), estimate).astype(float))
        likely = estimates.weight[estimate] >= LIKELY
        target, estimate = target[likely], estimate[likely]
        believed.append(estimates.class_probability[estimate].max(axis=1))
        right.append((estimates.class_id[estimate] == truth.class_id[target]).astype(float))
        squares.append(square[likely])
        seen.append(visible[target])
    square, inside = np.concatenate(squares), np.concatenate(seen)
    groups = [square[inside], square[~inside]]
    return Scores(
        binned(EXISTENCE_EDGES, np.concatenate(said), np.concatenate(exists)),
        binned(CLASS_EDGES, np.concatenate(believed), np.concatenate(right)),
        Errors(
            np.array([len(group) for group in groups], dtype=float),
            np.array([np.count_nonzero(group > BOUND**2) for group in groups], dtype=float),
            np.array([0.5 * group.sum() for group in groups]),
        ),
    )


def binned(edges: Sequence[float], said: FloatArray, right: FloatArray) -> Reliability:
    """Return the sums by bin; rounding may put a probability a little above 1."""
    index = np.searchsorted(edges[1:-1], said, side="right")
    size = len(edges) - 1
    weights = (np.ones_like(said), said, right)
    sums = (np.bincount(index, each, minlength=size).astype(float) for each in weights)
    return Reliability(*sums)


class Bins(NamedTuple):
    """Reliability over several runs, each of shape (B,); NaN without statements."""

    # `number`, `said`, `right`: number of statements, mean said probability, and the share that was
    # right.
    number: FloatArray
    said: FloatArray
    right: FloatArray
    # `low`, `high`: 95 % interval of the share.
    low: FloatArray
    high: FloatArray


def pooled(runs: Reliability) -> Bins:
    """Return the reliability over runs, given sums of shape (runs, B).

    Notes
    -----
    A target makes nearly the same statement in many scans. The intervals are therefore Wilson's for
    the effective number of independent statements: the number that would have the variance of the
    share between runs, at most the true one. Where all statements agree it is the number of runs
    that have any.

    References
    ----------
    Wilson, "Probable inference, the law of succession, and statistical inference", Journal of the
    American Statistical Association 22, 1927.
    Kish, "Survey Sampling", 1965, Sec. 8.2, the design effect of clusters.
    """
    count, several = runs.number.sum(axis=0), len(runs.number)
    with np.errstate(divide="ignore", invalid="ignore"):
        said, right = runs.said.sum(axis=0) / count, runs.right.sum(axis=0) / count
        between = ((runs.right - right * runs.number) ** 2).sum(axis=0) / count**2
        variance = between * several / max(several - 1, 1)
        independent = np.minimum(right * (1.0 - right) / variance, count)
    having = np.count_nonzero(runs.number, axis=0).astype(float)
    independent = np.where(np.isfinite(independent), independent, having)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = QUANTILE**2 / independent
        centre = (right + 0.5 * ratio) / (1.0 + ratio)
        half = np.sqrt(ratio * right * (1.0 - right) + 0.25 * ratio**2) / (1.0 + ratio)
    return Bins(count, said, right, centre - half, centre + half)
