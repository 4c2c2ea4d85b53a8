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
from ...compilation import Bool1, Float1, Float2, Float3, Int1, compiled, inner
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
    prior_row: IntArray
    kept_pair: IntArray  # Index of each kept one's pair with a detection, (K,); -1 for a miss
    weight: FloatArray  # Weights of the kept hypotheses, (K, R, C)
    approximate: int  # Number of clusters of targets too large for exact association probabilities


def sum_modes(weight: FloatArray) -> FloatArray:
    """Return the sums over modes and classes, (N,), three times as fast as sums of short axes."""
    total: FloatArray = np.einsum("hrs->h", weight)
    return total


class _Sources(NamedTuple):
    """The log scale, the intensities and their sum, as in `CompetingSources`."""

    scale: Float1
    intensity: Float2
    total: Float1


@inner
def _no_sources(other: FloatArray) -> _Sources:
    """Return arrays for the sources of all detections; for `other` see `PairLikelihoods`."""
    size = other.shape[1]
    return _Sources(np.full(size, -np.inf), np.empty(other.shape), np.zeros(size))


@inner
def _write_sources(
    column: IntArray,
    measurement: FloatArray,
    largest: FloatArray,
    evidence: FloatArray,
    other: FloatArray,
    sources: _Sources,
) -> None:
    """Write the sources, into new arrays; for the other parameters see `PairLikelihoods`."""
    scale, intensity, total = sources
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


@inner
def _write_pair_weight(
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
def _write_missed_weight(
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


class _Selection(NamedTuple):
    """Whether each pair is likely, and working arrays."""

    likely: Bool1  # (P,)
    amplitude: Float2  # Likelihood of each pair's amplitude by class, (P, C)
    odds: Float1  # Mass of each pair relative to its detection's other sources, (P,)
    total_odds: Float1  # Sum of all pairs' odds of each detection, zeros, (M,)
    own_odds: Float1  # Sum of one target's odds of each detection, zeros, (M,)
    alternatives: Float1  # Mass of each target's alternatives to a single pair, (T,)
    start: Int1  # Where the pairs of each target begin in `order`, zeros, (T + 2,)
    order: Int1  # The pairs by target, (P,)
    weight: Float3  # Weights that are not used, (1, R, C)


@inner
def _write_odds(
    weight: FloatArray,
    snr: FloatArray,
    relative: FloatArray,
    row: IntArray,
    column: IntArray,
    measurement: FloatArray,
    largest: FloatArray,
    evidence: FloatArray,
    sources: _Sources,
    selection: _Selection,
) -> None:
    """Write the likelihoods of the pairs' amplitudes and their odds."""
    amplitude, odds = selection.amplitude, selection.odds
    for pair in range(len(row)):
        hypothesis, z = row[pair], column[pair]
        for class_id in range(snr.shape[1]):
            total = 0.0
            for cell in range(snr.shape[2]):
                total += snr[hypothesis, class_id, cell] * relative[z, class_id, cell]
            amplitude[pair, class_id] = total
        factor = evidence[pair] + largest[z] - sources.scale[z]
        mass = _write_pair_weight(
            hypothesis, weight, pair, measurement, amplitude, factor, 0, selection.weight
        )
        odds[pair] = mass / max(sources.total[z], LEAST_CLUTTER)
        selection.total_odds[z] += odds[pair]


@inner
def _sort_by_target(target_of: IntArray, row: IntArray, start: IntArray, order: IntArray) -> None:
    """Write the order of the pairs by target, and where the pairs of each target begin."""
    for pair in range(len(row)):
        start[target_of[row[pair]] + 2] += 1
    for target in range(len(start) - 2):
        start[target + 2] += start[target + 1]
    # While the pairs are sorted, `start[target + 1]` is the place of the target's next pair;
    # afterwards it is the end of its pairs.
    for pair in range(len(row)):
        target = target_of[row[pair]]
        order[start[target + 1]] = pair
        start[target + 1] += 1


@inner
def _mark_likely(least_share: float, target: int, column: IntArray, selection: _Selection) -> None:
    """Add the pairs of a target to its alternatives, and mark those that are likely.

    Each detection counts once, by the share that other targets' claims leave of it.
    """
    _, _, odds, total_odds, own_odds, alternatives, start, order, _ = selection
    for index in range(start[target], start[target + 1]):
        own_odds[column[order[index]]] += odds[order[index]]
    for index in range(start[target], start[target + 1]):
        z = column[order[index]]
        alternatives[target] += own_odds[z] / (1.0 + max(total_odds[z] - own_odds[z], 0.0))
        own_odds[z] = 0.0
    for index in range(start[target], start[target + 1]):
        pair = order[index]
        selection.likely[pair] = odds[pair] > least_share * max(alternatives[target], 1.0)


@compiled
def _select_likely(
    least_share: float,
    target_of: Int1,
    existence: Float1,
    weight: Float3,
    detection_probability: Float3,
    snr: Float3,
    relative: Float3,
    row: Int1,
    column: Int1,
    measurement: Float2,
    largest: Float1,
    evidence: Float1,
    other: Float2,
) -> tuple[IntArray, FloatArray]:
    """Return the likely pairs and the likelihoods of their amplitudes; see `select_likely`."""
    (modes, classes), count, size = weight.shape[1:], len(row), len(largest)
    sources = _no_sources(other)
    selection = _Selection(
        np.empty(count, np.bool_),
        np.empty((count, classes)),
        np.empty(count),
        np.zeros(size),
        np.zeros(size),
        np.empty(len(existence)),
        np.zeros(len(existence) + 2, np.int64),
        np.empty(count, np.int64),
        np.empty((1, modes, classes)),
    )
    _write_sources(column, measurement, largest, evidence, other, sources)
    _write_odds(
        weight,
        snr,
        relative,
        row,
        column,
        measurement,
        largest,
        evidence,
        sources,
        selection,
    )
    _sort_by_target(target_of, row, selection.start, selection.order)
    for target in range(len(existence)):
        selection.alternatives[target] = 1.0 - existence[target]
    for hypothesis in range(len(target_of)):
        selection.alternatives[target_of[hypothesis]] += _write_missed_weight(
            hypothesis, weight, detection_probability, 1.0, 0, selection.weight
        )
    for target in range(len(existence)):
        _mark_likely(least_share, target, column, selection)
    kept, amplitude = np.empty(count, np.int64), selection.amplitude
    found = 0
    for pair in range(count):
        if selection.likely[pair]:
            for class_id in range(classes):
                amplitude[found, class_id] = amplitude[pair, class_id]
            kept[found] = pair
            found += 1
    return kept[:found], amplitude[:found]


def select_likely(
    mixture: Mixture,
    detection_probability: FloatArray,
    pairs: PairLikelihoods,
    relative: FloatArray,
) -> tuple[IntArray, FloatArray]:
    """Return the pairs that may exceed `LEAST_SHARE` of both their target and their detection.

    The second value is the likelihood of each pair's amplitude by class, p_D g(a) relative to the
    largest of its detection, (P, C).

    Another target may claim a detection, however probable it is for this one. A target's share is
    therefore computed from the part of each detection that remains if all other targets claim it.

    Parameters
    ----------
    detection_probability : array of shape (H, R, C)
        Probability of detection.
    relative : array of shape (M, C, S)
        See `amplitude.Amplitudes`.
    """
    of_mixture = LEAST_SHARE, mixture.target, mixture.existence, mixture.weight
    return _select_likely(*(*of_mixture, detection_probability, mixture.snr, relative, *pairs))


@inner
def _weights(
    target_of: IntArray,
    weight: FloatArray,
    detection_probability: FloatArray,
    amplitude: FloatArray,
    row: IntArray,
    measurement: FloatArray,
    log_factor: FloatArray,
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the hypotheses before the association: those of missed detections, then of pairs.

    These are the target of each, its weights and their sum, and the weight before the update and
    the probability of detection of each prior one. `log_factor` is as in `_write_pair_weight`.
    """
    rows, modes, classes = weight.shape
    count = rows + len(row)
    target, posterior = np.empty(count, np.int64), np.empty((count, modes, classes))
    mass, prior, detected = np.empty(count), np.empty(rows), np.empty(rows)
    for hypothesis in range(rows):
        target[hypothesis], total = target_of[hypothesis], 0.0
        prior[hypothesis] = sum_of(weight[hypothesis])
        for mode in range(modes):
            for class_id in range(classes):
                total += (
                    weight[hypothesis, mode, class_id]
                    * detection_probability[hypothesis, mode, class_id]
                )
        detected[hypothesis] = total / (prior[hypothesis] if prior[hypothesis] > 0.0 else 1.0)
    for pair in range(len(row)):
        hypothesis, factor = row[pair], log_factor[pair]
        target[rows + pair] = target_of[hypothesis]
        mass[rows + pair] = _write_pair_weight(
            hypothesis, weight, pair, measurement, amplitude, factor, rows + pair, posterior
        )
    return target, posterior, mass, prior, detected


@inner
def _write_posterior(
    weight: FloatArray,
    detection_probability: FloatArray,
    scaled: FloatArray,
    unseen: FloatArray,
    share: FloatArray,
    prior: FloatArray,
    target: IntArray,
    posterior: FloatArray,
    mass: FloatArray,
) -> None:
    """Write the weights after the association, of which `posterior_shares` gives the factors."""
    rows, modes, classes = weight.shape
    for hypothesis in range(rows):
        factor = unseen[target[hypothesis]] * (
            scaled[hypothesis] / prior[hypothesis] if prior[hypothesis] > 0.0 else 1.0
        )
        mass[hypothesis] = _write_missed_weight(
            hypothesis, weight, detection_probability, factor, hypothesis, posterior
        )
    for pair in range(len(share)):
        mass[rows + pair] *= share[pair]
        for mode in range(modes):
            for class_id in range(classes):
                posterior[rows + pair, mode, class_id] *= share[pair]


@compiled
def _associate(
    most_work: int,
    most: int,
    least_share: float,
    targets: int,
    target_of: Int1,
    weight: Float3,
    detection_probability: Float3,
    amplitude: Float2,
    row: Int1,
    column: Int1,
    measurement: Float2,
    largest: Float1,
    evidence: Float1,
    other: Float2,
) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...], tuple[Any, ...]]:
    """Return columns of `Claims`, of `CompetingSources`, and the other ones of `Association`."""
    (rows, modes, classes), sources = weight.shape, _no_sources(other)
    _write_sources(column, measurement, largest, evidence, other, sources)
    log_factor = evidence + largest[column] - sources.scale[column]
    target, posterior, mass, prior, detected = _weights(
        target_of, weight, detection_probability, amplitude, row, measurement, log_factor
    )
    claimed_mass = mass[rows:].copy()
    scaled, unseen, share, claimed, approximate = posterior_shares(
        *(most_work, targets, target_of, prior, row, column, claimed_mass, sources.total, detected)
    )
    _write_posterior(
        weight, detection_probability, scaled, unseen, share, prior, target, posterior, mass
    )
    existence = np.zeros(targets)
    for index in range(len(mass)):
        existence[target[index]] += mass[index]
    kept, factor = most_probable(most, least_share, target, mass)
    kept_pair, kept_weight = np.full(len(kept), -1), np.empty((len(kept), modes, classes))
    prior_row = kept.copy()
    for index in range(len(kept)):
        if kept[index] >= rows:
            kept_pair[index] = kept[index] - rows
            prior_row[index] = row[kept_pair[index]]
        for mode in range(modes):
            for class_id in range(classes):
                unscaled = posterior[kept[index], mode, class_id]
                kept_weight[index, mode, class_id] = factor[index] * unscaled
    hypotheses = prior_row, kept_pair, kept_weight
    return (
        (claimed_mass, sources.total, detected),
        (sources.scale, sources.intensity),
        (claimed, mass[rows:], existence, *hypotheses, approximate),
    )


def associate(
    mixture: Mixture,
    detection_probability: FloatArray,
    amplitude: FloatArray,
    pairs: PairLikelihoods,
    bounds: Bounds,
) -> Association:
    """Return the association of pairs, and the most probable hypotheses of each target.

    Parameters
    ----------
    detection_probability : array of shape (H, R, C)
        Probability of detection.
    amplitude : array of shape (P, C)
        See `select_likely`.
    """
    limits = marginals.MOST_WORK, bounds.hypotheses, bounds.least_share, len(mixture.label)
    claims, sources, others = _associate(
        *(*limits, mixture.target, mixture.weight, detection_probability, amplitude, *pairs)
    )
    claimed = Claims(pairs.row, pairs.column, *claims)
    return Association(claimed, CompetingSources(*sources), *others)
