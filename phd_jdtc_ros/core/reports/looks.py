"""Plots of a look: pairs are updated with the association probabilities of the engine."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import FloatArray, IntArray
from ..compilation import Writeable, compiled, inner
from .filters import State, observe
from .pair_filter import MOST_WEIGHT, advance
from .tables import Look, Pairs, Rows

# Association probability below which a plot is not of a track.
LEAST_PROBABILITY = 1e-6
LEAST_EVIDENCE = 1e-12


@inner
def _density(error: tuple[float, float], a: float, b: float, c: float) -> float:
    """Return the normal density of a residual with the covariance ((a, b), (b, c))."""
    determinant = a * c - b * b
    square = (c * error[0] ** 2 - 2.0 * b * error[0] * error[1] + a * error[1] ** 2) / determinant
    return math.exp(-0.5 * square) / (2.0 * math.pi * math.sqrt(determinant))


@inner
def _by_target(target: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Return the rows by target, and the first of each target among them."""
    first = np.zeros(count + 1, np.int64)
    for row in range(len(target)):
        first[target[row] + 1] += 1
    for index in range(count):
        first[index + 1] += first[index]
    order, filled = np.empty(len(target), np.int64), first.copy()
    for row in range(len(target)):
        order[filled[target[row]]] = row
        filled[target[row]] += 1
    return order, first


@compiled
def _of_tracks(rows: Rows, look: Look) -> FloatArray:
    """Return the density of each plot as its target's own tracks expect it, (E,)."""
    order, first = _by_target(rows.target, len(rows.label))
    found = np.zeros(len(look.target))
    for pair in range(len(look.target)):
        target, z = look.target[pair], look.column[pair]
        dt, total, mass = look.time_s[z], 0.0, 0.0
        for index in range(first[target], first[target + 1]):
            row = order[index]
            for mode in range(rows.weight.shape[1]):
                weight = 0.0
                for class_id in range(rows.weight.shape[2]):
                    weight += rows.weight[row, mode, class_id]
                if weight <= 0.0:
                    continue
                mean, own = rows.mean[row, mode], rows.covariance[row, mode]
                error = (
                    look.position[z, 0] - mean[0] - dt * mean[1],
                    look.position[z, 1] - mean[2] - dt * mean[3],
                )
                total += weight * _density(
                    error,
                    own[0, 0] + 2.0 * dt * own[0, 1] + dt**2 * own[1, 1] + look.noise[z, 0, 0],
                    own[0, 2]
                    + dt * (own[0, 3] + own[1, 2])
                    + dt**2 * own[1, 3]
                    + look.noise[z, 0, 1],
                    own[2, 2] + 2.0 * dt * own[2, 3] + dt**2 * own[3, 3] + look.noise[z, 1, 1],
                )
                mass += weight
        found[pair] = total / mass if mass > 0.0 else 0.0
    return found


@compiled
def take_look(
    rows: Rows, look: Look, corrected: Look, density: float, pairs: Writeable[Pairs]
) -> None:
    """Update pairs of sources and tracks with a look at the tracks.

    With the probabilities p(z) and p(0) that a track has the plot z or none, and the densities D(z)
    of its own filter and N(z) of the pair's, the evidence of the pair against the track's own
    filter is p(0) + sum p(z) N(z) / D(z). For the pair the plots are `corrected`.
    """
    of_track = _of_tracks(rows, look)
    order, first = _by_target(look.target, len(rows.label))
    matrix = np.zeros((2, 6))
    matrix[0, 0] = matrix[1, 1] = 1.0
    mean, covariance = np.empty(6), np.empty((6, 6))
    for row in range(len(pairs.label)):
        target = np.searchsorted(rows.label, pairs.label[row])
        if target == len(rows.label) or rows.label[target] != pairs.label[row]:
            continue
        if pairs.time_ns[row] < look.stamp_ns:
            advance(pairs, row, look.stamp_ns, density)
        count = first[target + 1] - first[target]
        means, spreads = np.empty((count, 6)), np.empty((count, 6, 6))
        share, evidence = np.zeros(count), look.missed[target]
        for index in range(count):
            pair = order[first[target] + index]
            z, probability = look.column[pair], look.probability[pair]
            if probability < LEAST_PROBABILITY or of_track[pair] <= 0.0:
                continue
            means[index], spreads[index] = pairs.mean[row], pairs.covariance[row]
            matrix[0, 2] = matrix[1, 3] = look.time_s[z]
            log_density, _ = observe(
                State(means[index], spreads[index]),
                corrected.position[z],
                matrix,
                corrected.noise[z],
                2,
            )
            share[index] = probability * math.exp(log_density) / of_track[pair]
            evidence += share[index]
        evidence = max(evidence, LEAST_EVIDENCE)
        gained = pairs.log_weight[row] + math.log(evidence)
        pairs.log_weight[row] = min(max(gained, -MOST_WEIGHT), MOST_WEIGHT)
        none = look.missed[target] / evidence
        for i in range(6):
            mean[i] = none * pairs.mean[row, i]
            for index in range(count):
                if share[index] > 0.0:
                    mean[i] += share[index] / evidence * means[index, i]
        for i in range(6):
            for k in range(6):
                own = (pairs.mean[row, i] - mean[i]) * (pairs.mean[row, k] - mean[k])
                covariance[i, k] = none * (pairs.covariance[row, i, k] + own)
                for index in range(count):
                    if share[index] > 0.0:
                        off = (means[index, i] - mean[i]) * (means[index, k] - mean[k])
                        covariance[i, k] += share[index] / evidence * (spreads[index, i, k] + off)
        if none + share.sum() / evidence > 0.5:
            pairs.mean[row], pairs.covariance[row] = mean, covariance


@compiled
def moments(rows: Rows) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return position and velocity of each target with their covariance, (T, 4) and (T, 4, 4).

    Its existence probability follows, (T,), and the probabilities of its classes, (T, C).
    """
    targets, classes = len(rows.label), rows.weight.shape[2]
    mean, covariance = np.zeros((targets, 4)), np.zeros((targets, 4, 4))
    existence, of_class = np.zeros(targets), np.zeros((targets, classes))
    axes = (0, 2, 1, 3)
    for row in range(len(rows.target)):
        target = rows.target[row]
        for mode in range(rows.weight.shape[1]):
            for class_id in range(classes):
                weight = rows.weight[row, mode, class_id]
                existence[target] += weight
                of_class[target, class_id] += weight
                for i in range(4):
                    mean[target, i] += weight * rows.mean[row, mode, axes[i]]
    for target in range(targets):
        mass = existence[target] if existence[target] > 0.0 else 1.0
        for i in range(4):
            mean[target, i] /= mass
        for class_id in range(classes):
            of_class[target, class_id] /= mass
    for row in range(len(rows.target)):
        target = rows.target[row]
        mass = existence[target] if existence[target] > 0.0 else 1.0
        for mode in range(rows.weight.shape[1]):
            weight = 0.0
            for class_id in range(classes):
                weight += rows.weight[row, mode, class_id]
            for i in range(4):
                off = rows.mean[row, mode, axes[i]] - mean[target, i]
                for k in range(4):
                    other = rows.mean[row, mode, axes[k]] - mean[target, k]
                    own = rows.covariance[row, mode, axes[i], axes[k]]
                    covariance[target, i, k] += weight / mass * (own + off * other)
    return mean, covariance, existence, of_class
