"""Evidence on a sensor's noise from the innovations of Gaussians."""

from __future__ import annotations

import math

import numpy as np

from ...arrays import FloatArray, contiguous
from ...compilation import Float1, Float2, Float3, Int1, compiled
from ...learned.evidence import evidence_of
from ...learned.noise_factor import COMPONENTS, NoiseEvidence
from ...models.sensor_memory import KNOWN_EXISTENCE
from ..mixture import Mixture
from .iterated_update import PairUpdate


def noise_evidence(mixture: Mixture, found: PairUpdate, probability: FloatArray) -> NoiseEvidence:
    """Return the evidence of the innovations of pairs; see `evidence.evidence_of`.

    Only targets that existed with `KNOWN_EXISTENCE` before the update count.

    Parameters
    ----------
    mixture : Mixture
        Before the update.
    probability : array of shape (P,)
        Association probability of each pair; distributed over its motion modes by their
        likelihoods.
    """
    innovation = found.innovation
    rate_square, rate_part = _rates(found, mixture.mode_weight.shape[1])
    return NoiseEvidence(
        *_evidence(
            KNOWN_EXISTENCE,
            *contiguous(mixture.existence, mixture.target, mixture.mode_weight),
            *contiguous(found.row, found.column, probability, found.log_likelihood),
            *contiguous(innovation.weighted, innovation.inverse, found.report.sensors_own_std),
            *contiguous(rate_square, rate_part),
        )
    )


def _rates(found: PairUpdate, modes: int) -> tuple[FloatArray, FloatArray]:
    """Return the squares and parts of `evidence_of` for range rates, (P R,); none if not learned.

    A range rate updates a Gaussian after the position, so that its innovation has one dimension.
    """
    report, rate_update = found.report, found.rate_update
    factor, rates = report.sensor.noise_factor, report.range_rates
    if rate_update is None or rates is None or factor is None or not factor.learned[-1]:
        return np.zeros(0), np.zeros(0)
    own = report.sensors_own_rate_std(rates)[found.column].repeat(modes)
    return rate_update.innovation**2 / rate_update.variance, own**2 / rate_update.variance


@compiled
def _evidence(
    least_existence: float,
    existence: Float1,
    target: Int1,
    mode_weight: Float2,
    row: Int1,
    column: Int1,
    probability: Float1,
    log_likelihood: Float1,
    weighted: Float2,
    inverse: Float3,
    std: Float2,
    rate_square: Float1,
    rate_part: Float1,
) -> tuple[FloatArray, FloatArray]:
    """Return the columns of `NoiseEvidence`; the last two arguments may be empty."""
    modes = mode_weight.shape[1]
    weight, excess = np.zeros(COMPONENTS), np.zeros(COMPONENTS)
    share = np.empty(modes)
    for pair in range(len(row)):
        one, first = row[pair], pair * modes
        if existence[target[one]] < least_existence:
            continue
        largest, total = -np.inf, 0.0
        for mode in range(modes):
            largest = max(largest, log_likelihood[first + mode])
        for mode in range(modes):
            share[mode] = 0.0
            if log_likelihood[first + mode] > -np.inf:
                relative = math.exp(log_likelihood[first + mode] - largest)
                share[mode] = mode_weight[one, mode] * relative
            total += share[mode]
        for mode in range(modes):
            if share[mode] <= 0.0:
                continue
            counts = probability[pair] * share[mode] / total
            for axis in range(2):
                expected = inverse[first + mode, axis, axis]
                square = weighted[first + mode, axis] ** 2 / expected
                part = std[column[pair], axis] ** 2 * expected
                more, beyond = evidence_of(square, part)
                weight[axis] += counts * more
                excess[axis] += counts * beyond
            if len(rate_part) > 0:
                more, beyond = evidence_of(rate_square[first + mode], rate_part[first + mode])
                weight[COMPONENTS - 1] += counts * more
                excess[COMPONENTS - 1] += counts * beyond
    return weight, excess
