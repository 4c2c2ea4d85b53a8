"""Compiled loops of what is learned; a module of their own, so that only engines load numba."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import FloatArray, IntArray
from ..bisection import count_below
from ..compilation import Float1, Float2, Int1, compiled, inner
from .trials import Alarm, FactorPriors, LearnedFactors, ReportTrials, Trials, TrialSums


@inner
def _posterior(
    right: float, scale: float, wide: float, log_ratio: float, precision: float
) -> tuple[float, float]:
    """Return the mean and the variance of a log ratio; see `RatioPrior`."""
    # Variances of the shown log ratio relative to that of its error.
    near, far = 1.0 + precision * scale * scale, 1.0 + precision * wide * wide
    log_odds = math.log(right / (1.0 - right)) - 0.5 * math.log(near / far)
    log_odds -= 0.5 * precision * log_ratio**2 * (1.0 / near - 1.0 / far)
    share = 1.0 / (1.0 + math.exp(min(log_odds, 500.0)))
    difference = log_ratio * (1.0 / near - 1.0 / far)
    of_near, of_far = scale * scale / near, wide * wide / far
    variance = of_near + share * (of_far - of_near) + share * (1.0 - share) * difference**2
    return log_ratio * (1.0 - 1.0 / near) + share * difference, variance


@compiled
def mixture_posterior(
    right: float, scale: float, wide: float, log_ratio: Float1, precision: Float1
) -> FloatArray:
    """Return the mean and the variance of each log ratio, (2, K); see `RatioPrior`."""
    moments = np.empty((2, len(log_ratio)))
    for row in range(len(log_ratio)):
        moments[0, row], moments[1, row] = _posterior(
            right, scale, wide, log_ratio[row], precision[row]
        )
    return moments


@inner
def _detection_factor(
    prior: tuple[float, float, float],
    bounds: tuple[float, float],
    probability: float,
    expected: float,
    detected: float,
) -> tuple[float, float]:
    """Return the factor of a probability and its deviation; see `detection_factors`."""
    (right, scale, wide), (prior_weight, most) = prior, bounds
    shrunk = (prior_weight + detected) / (prior_weight + expected)
    # The smaller of both probabilities has the lower precision, so that few looks prove little.
    bounded = min(probability * min(shrunk, 1.0), most)
    precision = expected / probability * bounded / (1.0 - bounded)
    mean, variance = _posterior(right, scale, wide, math.log(shrunk), precision)
    factor = math.exp(mean)
    return factor, factor * math.sqrt(variance)


@compiled
def detection_factors(
    assumed: FactorPriors,
    probability: float,
    all_expected: float,
    all_detected: float,
    expected: Float1,
    detected: Float1,
) -> tuple[float, float, FloatArray]:
    """Return a sensor's factor, its deviation, and the factor of each cell, (K,).

    The arguments from `all_expected` on are the expected and actual numbers of detections, of the
    sensor and of each cell; see `Detection`.
    """
    right, scale, wide, cell_right, cell_scale, cell_wide, weight, most = assumed
    factors, bounds = np.empty(len(expected)), (weight, most)
    prior, of_cell = (right, scale, wide), (cell_right, cell_scale, cell_wide)
    mean, std = _detection_factor(prior, bounds, probability, all_expected, all_detected)
    for cell in range(len(expected)):
        relative, _ = _detection_factor(
            of_cell, bounds, mean * probability, mean * expected[cell], detected[cell]
        )
        factors[cell] = mean * relative
    return mean, std, factors


@compiled
def evidence_after_trials(
    evidence: Float1,
    alarm: Alarm,
    learned: LearnedFactors,
    sums: TrialSums,
    all_remembered: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the evidence of changes after trials, (1 + A,), and the factors before it, (K,).

    `evidence` is that before the trials, and `all_remembered` the expected number of detections
    that is remembered for the sensor as a whole; see `Detection`.
    """
    (raised, most, changed, unchanged, known), (now, before, remembered) = alarm, learned
    trials, expected, detected = sums
    after, sectors = evidence.copy(), len(known) - 1
    totals, factor_before = np.zeros((4, len(known))), now.copy()
    for cell in range(len(now)):
        sector = 1 + cell % sectors
        if 0.0 < evidence[sector] < raised:
            factor_before[cell] = before[cell]
        for place in (0, sector):
            factor = factor_before[cell] if place else now[cell]
            totals[0, place] += trials[cell]
            totals[1, place] += detected[cell]
            totals[2, place] += factor * expected[cell]
            totals[3, place] += remembered[cell]
    totals[3, 0] = all_remembered
    for place in range(len(known)):
        if totals[3, place] >= known[place]:
            count, hits = totals[0, place], totals[1, place]
            usual = min(max(totals[2, place] / (count if count > 0.0 else 1.0), 0.01), 0.99)
            of_miss = (1.0 - changed[place] * usual) / (1.0 - unchanged[place] * usual)
            ratio = hits * math.log(changed[place] / unchanged[place])
            ratio += (count - hits) * math.log(of_miss)
            after[place] = min(max(evidence[place] + ratio, 0.0), most)
    return after, factor_before


@compiled
def count_trials(
    least: float, cells: int, trials: Trials, own: ReportTrials
) -> tuple[Trials, TrialSums]:
    """Return the open trials after a report, and the sums over those that count now.

    `own` are the report's. Trials with a smaller open share than `least` are dropped.
    """
    label, cell, expected, detected, share = trials
    own_label, own_cell, own_expected, own_detected, existence = own
    size, targets, count = len(label), len(own_label), 0
    sums, capacity = TrialSums(np.zeros(cells), np.zeros(cells), np.zeros(cells)), size + targets
    labels, places = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    values = np.empty((3, capacity))
    for trial in range(size):
        target, detected_now = count_below(own_label, label[trial]), 0.0
        if target < targets and own_label[target] == label[trial]:
            detected_now = own_detected[target]
            counted = detected_now * existence[target] * share[trial]
            sums.trials[cell[trial]] += counted
            sums.expected[cell[trial]] += counted * expected[trial]
            sums.detected[cell[trial]] += counted * detected[trial]
        remaining = (1.0 - detected_now) * share[trial]
        if remaining > least:
            labels[count], places[count] = label[trial], cell[trial]
            values[0, count], values[1, count] = expected[trial], detected[trial]
            values[2, count] = remaining
            count += 1
    for target in range(targets):
        if own_expected[target] > 0.0:
            labels[count], places[count] = own_label[target], own_cell[target]
            values[0, count], values[1, count] = own_expected[target], own_detected[target]
            values[2, count] = 1.0
            count += 1
    expected, detected, share = values[0, :count], values[1, :count], values[2, :count]
    columns = expected.copy(), detected.copy(), share.copy()
    return Trials(labels[:count].copy(), places[:count].copy(), *columns), sums


@compiled
def add_detections(
    stamp_ns: int,
    least: float,
    label: Int1,
    unseen: Float1,
    seen_ns: Int1,
    detected_label: Int1,
    detected: Float1,
) -> tuple[IntArray, FloatArray, IntArray]:
    """Return the columns of a pass after detections of targets with these labels."""
    count, row, written = len(label), 0, 0
    most = count + len(detected_label)
    labels = np.empty(most, np.int64)
    unseen_after = np.empty(most)
    stamps = np.empty(most, np.int64)
    for index in range(len(detected_label) + 1):
        if index < len(detected_label) and not detected[index] > least:
            continue
        while row < count and (index == len(detected_label) or label[row] < detected_label[index]):
            labels[written], stamps[written] = label[row], seen_ns[row]
            unseen_after[written] = unseen[row]
            row, written = row + 1, written + 1
        if index < len(detected_label):
            is_known = row < count and label[row] == detected_label[index]
            labels[written], stamps[written] = detected_label[index], stamp_ns
            unseen_after[written] = (unseen[row] if is_known else 1.0) * (1.0 - detected[index])
            row, written = row + is_known, written + 1
    return labels[:written].copy(), unseen_after[:written].copy(), stamps[:written].copy()


@inner
def _log_posterior(
    log_ratio: FloatArray, count: FloatArray, precision: FloatArray, share: FloatArray
) -> tuple[float, FloatArray, FloatArray, float]:
    """Return the log posterior density of a law, its gradient, (K,), and minus its Hessian.

    The last result is the log integral of the law, by which it is normalised. For the arguments see
    `most_probable_density`. The log posterior is relative to that of the given density.
    """
    nodes, (parts, points) = len(log_ratio), share.shape
    first, second, mass = np.zeros(nodes), np.zeros((nodes, nodes)), 0.0
    for node in range(parts):
        for point in range(points):
            above = (point + 0.5) / points
            below = 1.0 - above
            probability = share[node, point] * math.exp(
                below * log_ratio[node] + above * log_ratio[node + 1]
            )
            mass += probability
            first[node] += below * probability
            first[node + 1] += above * probability
            second[node, node] += below * below * probability
            second[node + 1, node + 1] += above * above * probability
            second[node, node + 1] += below * above * probability
            second[node + 1, node] += below * above * probability
    total, value, gradient = count.sum(), 0.0, np.zeros(nodes)
    for node in range(nodes):
        for other in range(nodes):
            gradient[node] -= precision[node, other] * log_ratio[other]
            spread = second[node, other] - first[node] * first[other] / mass
            second[node, other] = precision[node, other] + total * spread / mass
        value += log_ratio[node] * (count[node] + 0.5 * gradient[node])
        gradient[node] += count[node] - total * first[node] / mass
    log_mass = math.log(mass)
    return value - total * log_mass, gradient, second, log_mass


@inner
def _solved(matrix: FloatArray, right: FloatArray) -> tuple[float, FloatArray]:
    """Return the log determinant of a positive matrix, and the solution of a linear equation."""
    size, root, solution, log_determinant = len(matrix), matrix.copy(), right.copy(), 0.0
    for row in range(size):
        for column in range(row + 1):
            for before in range(column):
                root[row, column] -= root[row, before] * root[column, before]
            if column < row:
                root[row, column] /= root[column, column]
        root[row, row] = math.sqrt(root[row, row])
        log_determinant += 2.0 * math.log(root[row, row])
        for before in range(row):
            solution[row] -= root[row, before] * solution[before]
        solution[row] /= root[row, row]
    for row in range(size - 1, -1, -1):
        for after in range(row + 1, size):
            solution[row] -= root[after, row] * solution[after]
        solution[row] /= root[row, row]
    return log_determinant, solution


@compiled
def most_probable_density(
    count: Float1, precision: Float2, share: Float2
) -> tuple[float, FloatArray]:
    """Return the log odds of a density that is learned against the given one, and its log ratio.

    The log ratio is linear between K nodes. It is the most probable one, by Newton's method, and
    the odds follow from the curvature there (Laplace's approximation).

    Parameters
    ----------
    count : float array of shape (K,)
        Number of samples of each node; one between two nodes counts at both, by its place.
    precision : float array of shape (K, K)
        Inverse of the prior covariance of the log ratio at the nodes; its mean is 0.
    share : float array of shape (K - 1, P)
        Probability of each of P equal parts between two nodes, by the given density.
    """
    log_ratio = np.zeros(len(count))
    found = _log_posterior(log_ratio, count, precision, share)
    value, gradient, curvature, log_mass = found
    prior_determinant, _ = _solved(precision, gradient)
    determinant, step = _solved(curvature, gradient)
    # The posterior density has one maximum, and halved steps rise to it.
    scale = 1.0
    while scale * (gradient * step).sum() > 1e-9:
        further = log_ratio + scale * step
        found = _log_posterior(further, count, precision, share)
        if found[0] > value:
            log_ratio, scale = further, 1.0
            value, gradient, curvature, log_mass = found
            determinant, step = _solved(curvature, gradient)
        else:
            scale *= 0.5
    return value + 0.5 * (prior_determinant - determinant), log_ratio - log_mass
