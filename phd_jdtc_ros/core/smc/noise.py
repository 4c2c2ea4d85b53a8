"""Evidence on a sensor's noise from the detections of particles."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray, contiguous
from ..compilation import Float1, Float2, Int1, compiled
from ..learned.evidence import evidence_of
from ..learned.noise_factor import COMPONENTS, NoiseEvidence
from ..models.sensor_memory import KNOWN_EXISTENCE
from ..sensors.report import Report


def noise_evidence(
    report: Report,
    target: IntArray,
    mass: FloatArray,
    state: FloatArray,
    measured: FloatArray,
    pairs: tuple[IntArray, IntArray],
    probability: FloatArray,
) -> NoiseEvidence:
    """Return the evidence of the pairs of particles and detections on the sensor's noise.

    `target`, `mass`, `state` and `measured` have each particle's target, whose particles are
    consecutive, its weight before the update, (N,), its state, (N, D), and its measurement, (N, Z).
    `pairs` has the particle and the detection of each pair, and `probability` its association
    probability, (P,).

    For Gaussians, E (z - h(x))^2 over the posterior is R (1 + p (u - 1)), with the innovation's
    square u relative to its variance S, and p = R / S. So u follows from the posterior particles,
    and p from the spread of the prior ones. Components are taken one by one.
    """
    row, column = pairs
    sensor, detections = report.sensor, report.detections
    order = np.lexsort((target.take(row), column))
    first = np.unique(target, return_index=True)[1][target]
    difference = sensor.wrap(measured - measured[first])
    error, std = sensor.wrap(detections.measurement[column] - measured[row]), report.sensors_own_std
    factor, rates = sensor.noise_factor, report.range_rates
    if rates is not None and factor is not None and factor.learned[-1]:
        rate, rate_std = sensor.range_rate_of(state), report.sensors_own_rate_std(rates)
        rate_error = sensor.range_rate_error(state, detections, rates, pairs)
        difference = np.column_stack([difference, rate - rate[first]])
        error = np.column_stack([error, rates.model.wrap(rate_error)])
        std = np.column_stack([std, rate_std])
    return NoiseEvidence(
        *_evidence(
            KNOWN_EXISTENCE,
            *contiguous(target, mass, _measured_variance(target, mass, difference)),
            *contiguous(row[order], column[order], probability[order], error[order]),
            *contiguous(std),
        )
    )


def _measured_variance(target: IntArray, mass: FloatArray, difference: FloatArray) -> FloatArray:
    """Return the variance of each target's measurements before the update, (T, Z).

    `difference` are the differences from a measurement of each target, (N, Z).
    """
    targets = int(target.max(initial=-1)) + 1
    total = np.bincount(target, mass, targets)
    weight = mass / np.where(total > 0.0, total, 1.0)[target]
    columns = []
    for axis in range(difference.shape[1]):
        mean = np.bincount(target, weight * difference[:, axis], targets)
        square = np.bincount(target, weight * difference[:, axis] ** 2, targets)
        columns.append(np.maximum(square - mean**2, 0.0))
    return np.stack(columns, axis=1)


@compiled
def _evidence(
    least_existence: float,
    target_of: Int1,
    mass: Float1,
    spread: Float2,
    row: Int1,
    column: Int1,
    probability: Float1,
    error: Float2,
    std: Float2,
) -> tuple[FloatArray, FloatArray]:
    """Return the columns of `NoiseEvidence`; the pairs are ordered by detection and target."""
    size = spread.shape[1]
    weight, excess, square = np.zeros(COMPONENTS), np.zeros(COMPONENTS), np.zeros(size)
    existence = np.zeros(len(spread))
    for particle in range(len(target_of)):
        existence[target_of[particle]] += mass[particle]
    share = 0.0
    for pair in range(len(row)):
        target, z = target_of[row[pair]], column[pair]
        share += probability[pair]
        for axis in range(size):
            square[axis] += probability[pair] * error[pair, axis] ** 2
        last = pair + 1 == len(row)
        if not last and column[pair + 1] == z and target_of[row[pair + 1]] == target:
            continue
        if share > 0.0 and existence[target] >= least_existence:
            for axis in range(size):
                variance = std[z, axis] ** 2
                noise_share = variance / (variance + spread[target, axis])
                posterior_ratio = square[axis] / (share * variance)
                added_weight, added_excess = evidence_of(
                    1.0 + (posterior_ratio - 1.0) / noise_share, noise_share
                )
                weight[axis] += share * added_weight
                excess[axis] += share * added_excess
        share, square[:] = 0.0, 0.0
    return weight, excess
