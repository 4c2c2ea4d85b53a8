"""Pairs of hypothesis and detection, and the weights of hypotheses that follow from them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray
from ...compilation import Float1, Float2, Int1, inner


class PairLikelihoods(NamedTuple):
    """Log likelihoods of the P pairs of hypotheses and detections.

    p_D L_z is exp(`measurement` + `largest` + `evidence`) times the likelihood of the amplitude
    relative to that scale, broadcast over modes and classes.
    """

    row: Int1  # Hypothesis of each pair, (P,)
    column: Int1  # Detection of each pair, (P,)
    # Log likelihood of the measurement for each motion mode, (P, R); -inf outside its gate.
    measurement: Float2
    # Log scale of each detection's amplitude likelihoods, (M,); see `amplitude.Amplitudes`.
    largest: Float1
    evidence: Float1  # Log likelihood of the identity and the height, (P,)
    other: Float2  # See `competing_sources.log_intensities`, (1 + C, M)


def sum_modes(weight: FloatArray) -> FloatArray:
    """Return the sums over modes and classes, (N,), three times as fast as sums of short axes."""
    total: FloatArray = np.einsum("hrs->h", weight)
    return total


class Sources(NamedTuple):
    """The log scale, the intensities and their sum, as in `CompetingSources`."""

    scale: Float1
    intensity: Float2
    total: Float1


@inner
def sources_of(pairs: PairLikelihoods) -> Sources:
    """Return the sources of all detections."""
    _, column, measurement, largest, evidence, other = pairs
    size = other.shape[1]
    scale, intensity, total = np.full(size, -np.inf), np.empty(other.shape), np.zeros(size)
    for source_type in range(len(other)):
        for z in range(len(scale)):
            scale[z] = max(scale[z], other[source_type, z])
    for pair in range(len(column)):
        z = column[pair]
        for mode in range(measurement.shape[1]):
            scale[z] = max(scale[z], measurement[pair, mode] + largest[z] + evidence[pair])
    for source_type in range(len(other)):
        for z in range(len(scale)):
            intensity[source_type, z] = math.exp(other[source_type, z] - scale[z])
            total[z] += intensity[source_type, z]
    return Sources(scale, intensity, total)


@inner
def write_pair_weight(
    hypothesis: int,
    prior: FloatArray,
    pair: int,
    measurement: FloatArray,
    amplitude: FloatArray,
    log_factor: float,
    row: int,
    weight: FloatArray,
) -> float:
    """Write the weight of a pair, p_D L_z w relative to the scale of its detection; return its sum.

    `log_factor` is the log of all factors besides the measurement and the relative amplitude;
    `row` is the row of `weight` to write.
    """
    mass = 0.0
    for mode in range(prior.shape[1]):
        likelihood, total = 0.0, 0.0
        if measurement[pair, mode] > -np.inf and log_factor > -np.inf:
            likelihood = math.exp(measurement[pair, mode] + log_factor)
        for class_id in range(prior.shape[2]):
            class_weight = (
                prior[hypothesis, mode, class_id] * likelihood * amplitude[pair, class_id]
            )
            weight[row, mode, class_id] = class_weight
            total += class_weight
        mass += total
    return mass


@inner
def write_missed_weight(
    hypothesis: int,
    prior: FloatArray,
    detection_probability: FloatArray,
    factor: float,
    row: int,
    weight: FloatArray,
) -> float:
    """Write the weight of a hypothesis without a detection, times a factor; return its sum.

    `row` is the row of `weight` to write.
    """
    mass = 0.0
    for mode in range(prior.shape[1]):
        total = 0.0
        for class_id in range(prior.shape[2]):
            missed = prior[hypothesis, mode, class_id] * (
                1.0 - detection_probability[hypothesis, mode, class_id]
            )
            weight[row, mode, class_id] = factor * missed
            total += factor * missed
        mass += total
    return mass
