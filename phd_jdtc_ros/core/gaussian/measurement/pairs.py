"""Pairs of hypothesis and detection: the selection of probable pairs, and their association."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...association import marginals
from ...association.claims import Claims
from ...association.marginals import LEAST_CLUTTER
from ...association.shares import posterior_shares
from ...compilation import Float1, Float2, Float3, Int1, compiled, inner
from ...models.competing_sources import CompetingSources
from ..algebra.vectors import sum_of
from ..bounds import Bounds
from ..mixture import Mixture
from .pruning import most_probable

# A pair with less than this share of its detection's sources, or of its target's hypotheses, is
# left out before the iterated update.
LEAST_SHARE = 1e-4


class PairLikelihoods(NamedTuple):
    """Log likelihoods of the P pairs of hypotheses and detections.

    p_D L_z is exp(`measurement` + `largest` + `evidence`) times the likelihood of the amplitude
    relative to that scale, broadcast over modes and classes.
    """

    row: IntArray  # Hypothesis of each pair, (P,)
    column: IntArray  # Detection of each pair, (P,)
    # Log likelihood of the measurement for each motion mode, (P, R); -inf outside its gate.
    measurement: FloatArray
    # Log scale of each detection's amplitude likelihoods, (M,); see `amplitude.Amplitudes`.
    largest: FloatArray
    evidence: FloatArray  # Log likelihood of the identity and the height, (P,)
    other: FloatArray  # See `competing_sources.log_intensities`, (1 + C, M)


class Association(NamedTuple):
    """The association of pairs, and the hypotheses that follow from it."""

    claims: Claims
    sources: CompetingSources
    claimed: FloatArray  # Probability that a known target is the source of each detection, (M,)
    pair: FloatArray  # Association probability of each pair, (P,)
    existence: FloatArray  # Existence probability of each target, (T,)
    # Prior hypothesis of each kept one, by target and then descending probability, (K,).
    source: IntArray
    kept_pair: IntArray  # Index of each kept one's pair with a detection, (K,); -1 for a miss
    weight: FloatArray  # Weights of the kept hypotheses, (K, R, C)
    approximate: int  # Number of clusters of targets too large for exact association probabilities


def sum_modes(weight: FloatArray) -> FloatArray:
    """Return the sums over modes and classes, (N,), three times as fast as sums of short axes."""
    total: FloatArray = np.einsum("hrs->h", weight)
    return total


@inner
def _sources(
    column: IntArray,
    measurement: FloatArray,
    largest: FloatArray,
    evidence: FloatArray,
    other: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the log scale, the intensities and their sum, as of `CompetingSources`."""
    kinds, size = other.shape
    scale, intensity, total = np.full(size, -np.inf), np.empty((kinds, size)), np.zeros(size)
    for kind in range(kinds):
        for z in range(size):
            scale[z] = max(scale[z], other[kind, z])
    for pair in range(len(column)):
        z = column[pair]
        for mode in range(measurement.shape[1]):
            scale[z] = max(scale[z], measurement[pair, mode] + largest[z] + evidence[pair])
    for kind in range(kinds):
        for z in range(size):
            intensity[kind, z] = math.exp(other[kind, z] - scale[z])
            total[z] += intensity[kind, z]
    return scale, intensity, total


@inner
def _write_pair_weight(
    one: int,
    prior: FloatArray,
    pair: int,
    measurement: FloatArray,
    amplitude: FloatArray,
    log_factor: float,
    place: int,
    weight: FloatArray,
) -> float:
    """Write the weight of a pair, p_D L_z w relative to the scale of its detection; return its sum.

    `log_factor` is the log of all factors besides the measurement and the relative amplitude;
    `place` is the row of `weight` to write.
    """
    mass = 0.0
    for mode in range(prior.shape[1]):
        likelihood, total = 0.0, 0.0
        if measurement[pair, mode] > -np.inf and log_factor > -np.inf:
            likelihood = math.exp(measurement[pair, mode] + log_factor)
        for class_id in range(prior.shape[2]):
            own = prior[one, mode, class_id] * likelihood * amplitude[pair, class_id]
            weight[place, mode, class_id] = own
            total += own
        mass += total
    return mass


@inner
def _write_missed_weight(
    one: int,
    prior: FloatArray,
    detectable: FloatArray,
    factor: float,
    weight: FloatArray,
) -> float:
    """Write the weight of a hypothesis without a detection, times a factor; return its sum."""
    mass = 0.0
    for mode in range(prior.shape[1]):
        total = 0.0
        for class_id in range(prior.shape[2]):
            missed = prior[one, mode, class_id] * (1.0 - detectable[one, mode, class_id])
            weight[one, mode, class_id] = factor * missed
            total += factor * missed
        mass += total
    return mass


@compiled
def _likely(
    least_share: float,
    target: Int1,
    existence: Float1,
    weight: Float3,
    detectable: Float3,
    snr: Float3,
    relative: Float3,
    row: Int1,
    column: Int1,
    measurement: Float2,
    largest: Float1,
    evidence: Float1,
    other: Float2,
) -> tuple[IntArray, FloatArray]:
    """Return the results of `likely`; for the parameters see `PairLikelihoods`."""
    count, targets, size = len(row), len(existence), other.shape[1]
    amplitude = np.zeros((count, snr.shape[1]))
    scale, _, total = _sources(column, measurement, largest, evidence, other)
    odds, wanted = np.empty(count), np.zeros(size)
    start, each = np.zeros(targets + 1, np.int64), np.empty_like(weight)
    for pair in range(count):
        one, z = row[pair], column[pair]
        for class_id in range(snr.shape[1]):
            for cell in range(snr.shape[2]):
                amplitude[pair, class_id] += snr[one, class_id, cell] * relative[z, class_id, cell]
        factor = evidence[pair] + largest[z] - scale[z]
        mass = _write_pair_weight(one, weight, pair, measurement, amplitude, factor, one, each)
        odds[pair] = mass / max(total[z], LEAST_CLUTTER)
        wanted[z] += odds[pair]
        start[target[one] + 1] += 1
    start = np.cumsum(start)
    order, room = np.empty(count, np.int64), start.copy()
    for pair in range(count):
        one = target[row[pair]]
        order[room[one]] = pair
        room[one] += 1
    alone = 1.0 - existence
    for one in range(len(target)):
        alone[target[one]] += _write_missed_weight(one, weight, detectable, 1.0, each)
    own, counted = np.zeros(size), np.zeros(count, np.bool_)
    for one in range(targets):
        pairs = order[start[one] : start[one + 1]]
        for pair in pairs:
            own[column[pair]] += odds[pair]
        for pair in pairs:
            # Each detection counts once, by the share that other targets' claims leave of it.
            z = column[pair]
            alone[one] += own[z] / (1.0 + max(wanted[z] - own[z], 0.0))
            own[z] = 0.0
        for pair in pairs:
            counted[pair] = odds[pair] > least_share * max(alone[one], 1.0)
    kept = np.flatnonzero(counted)
    return kept, amplitude[kept]


def likely(
    mixture: Mixture, detectable: FloatArray, pairs: PairLikelihoods, relative: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return the pairs that may exceed `LEAST_SHARE` of both their target and their detection.

    With them comes the likelihood of each pair's amplitude by class, p_D g(a) relative to the
    largest of its detection, (P, C).

    Another target may claim a detection, however probable it is for this one. So a target's share
    is computed from the part of each detection that remains if all other targets claim it.

    Parameters
    ----------
    detectable : array of shape (H, R, C)
        Probability of detection.
    relative : array of shape (M, C, S)
        See `amplitude.Amplitudes`.
    """
    columns = mixture.existence, mixture.weight, detectable, mixture.snr, relative, *pairs
    return _likely(LEAST_SHARE, mixture.target, *columns)


@compiled
def _associate(
    most_work: int,
    most: int,
    least_share: float,
    targets: int,
    target: Int1,
    weight: Float3,
    detectable: Float3,
    amplitude: Float2,
    row: Int1,
    column: Int1,
    measurement: Float2,
    largest: Float1,
    evidence: Float1,
    other: Float2,
) -> tuple[Any, ...]:
    """Return the columns of `Association`; for the parameters see `associate`.

    These are mass, total and detection probability of the claims, log scale and intensity of the
    sources, and then the others in their order.
    """
    rows, modes, classes = weight.shape
    count = rows + len(row)
    scale, intensity, total = _sources(column, measurement, largest, evidence, other)
    later, mass = np.empty((count, modes, classes)), np.empty(count)
    target_of, prior, probability = np.empty(count, np.int64), np.empty(rows), np.empty(rows)
    for one in range(rows):
        target_of[one], prior[one], detected = target[one], sum_of(weight[one]), 0.0
        for mode in range(modes):
            for class_id in range(classes):
                detected += weight[one, mode, class_id] * detectable[one, mode, class_id]
        probability[one] = detected / prior[one] if prior[one] > 0.0 else detected
    for pair in range(len(row)):
        one, z = row[pair], column[pair]
        factor = evidence[pair] + largest[z] - scale[z]
        target_of[rows + pair] = target[one]
        mass[rows + pair] = _write_pair_weight(
            one, weight, pair, measurement, amplitude, factor, rows + pair, later
        )
    claim = mass[rows:].copy()
    scaled, unseen, share, claimed, approximate = posterior_shares(
        most_work, targets, target, prior, row, column, claim, total, probability
    )
    existence = np.zeros(targets)
    for one in range(rows):
        factor = unseen[target[one]] * (scaled[one] / prior[one] if prior[one] > 0.0 else 1.0)
        mass[one] = _write_missed_weight(one, weight, detectable, factor, later)
    for pair in range(len(row)):
        mass[rows + pair] *= share[pair]
    for one in range(count):
        existence[target_of[one]] += mass[one]
    kept, factors = most_probable(most, least_share, target_of, mass)
    found, source = np.empty((len(kept), modes, classes)), kept.copy()
    for place in range(len(kept)):
        pair = kept[place] - rows
        source[place] = kept[place] if pair < 0 else row[pair]
        part = 1.0 if pair < 0 else share[pair]
        for mode in range(modes):
            for class_id in range(classes):
                own = part * later[kept[place], mode, class_id]
                found[place, mode, class_id] = factors[place] * own
        kept[place] = max(pair, -1)
    associated, claims = mass[rows:].copy(), (claim, total, probability)
    hypotheses = source, kept, found, approximate
    return *claims, scale, intensity, claimed, associated, existence, *hypotheses


def associate(
    mixture: Mixture,
    detectable: FloatArray,
    amplitude: FloatArray,
    pairs: PairLikelihoods,
    bounds: Bounds,
) -> Association:
    """Return the association of pairs, and the most probable hypotheses of each target.

    Parameters
    ----------
    detectable : array of shape (H, R, C)
        Probability of detection.
    amplitude : array of shape (P, C)
        See `likely`.
    """
    columns = len(mixture.label), mixture.target, mixture.weight, detectable, amplitude, *pairs
    associated = _associate(marginals.MOST_WORK, bounds.hypotheses, bounds.least_share, *columns)
    claims, sources = Claims(pairs.row, pairs.column, *associated[:3]), associated[3:5]
    return Association(claims, CompetingSources(*sources), *associated[5:])
