"""Pairs of hypothesis and detection: the selection of probable pairs, and their association."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...association import marginals
from ...association.claims import Claims
from ...association.marginals import LEAST_CLUTTER
from ...association.shares import posterior_shares
from ...compilation import Bool1, Float1, Float2, Float3, Int1, compiled, in_place, inner
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


class _Weights(NamedTuple):
    """The N hypotheses after the update: first those of missed detections, then those of pairs."""

    target: Int1
    weight: Float3  # (N, R, C)
    mass: Float1
    prior: Float1  # Weight of each hypothesis before the update, (H,)
    detected: Float1  # Mean probability that each is detected, (H,)
    existence: Float1  # Existence probability of each target, zeros at first, (T,)


@compiled
def _weights(
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
    targets: int,
) -> tuple[_Weights, _Sources, FloatArray]:
    """Return the weights of pairs before their association, their sources, and their masses.

    For the parameters see `associate`.
    """
    rows, modes, classes = weight.shape
    count, sources = rows + len(row), _no_sources(other)
    posterior = _Weights(
        np.empty(count, np.int64),
        np.empty((count, modes, classes)),
        np.empty(count),
        np.empty(rows),
        np.empty(rows),
        np.zeros(targets),
    )
    _write_sources(column, measurement, largest, evidence, other, sources)
    for hypothesis in range(rows):
        posterior.target[hypothesis], detected = target_of[hypothesis], 0.0
        posterior.prior[hypothesis] = sum_of(weight[hypothesis])
        for mode in range(modes):
            for class_id in range(classes):
                detected += (
                    weight[hypothesis, mode, class_id]
                    * detection_probability[hypothesis, mode, class_id]
                )
        prior = posterior.prior[hypothesis] if posterior.prior[hypothesis] > 0.0 else 1.0
        posterior.detected[hypothesis] = detected / prior
    for pair in range(len(row)):
        hypothesis, z = row[pair], column[pair]
        factor = evidence[pair] + largest[z] - sources.scale[z]
        posterior.target[rows + pair] = target_of[hypothesis]
        posterior.mass[rows + pair] = _write_pair_weight(
            hypothesis, weight, pair, measurement, amplitude, factor, rows + pair, posterior.weight
        )
    return posterior, sources, posterior.mass[rows:].copy()


@in_place
def _write_posterior(
    weight: Float3,
    detection_probability: Float3,
    scaled: Float1,
    unseen: Float1,
    share: Float1,
    posterior: _Weights,
) -> None:
    """Write the weights after the association, of which `posterior_shares` gives the factors."""
    rows, modes, classes = weight.shape
    for hypothesis in range(rows):
        prior = posterior.prior[hypothesis]
        factor = unseen[posterior.target[hypothesis]] * (
            scaled[hypothesis] / prior if prior > 0.0 else 1.0
        )
        posterior.mass[hypothesis] = _write_missed_weight(
            hypothesis, weight, detection_probability, factor, hypothesis, posterior.weight
        )
    for pair in range(len(share)):
        posterior.mass[rows + pair] *= share[pair]
        for mode in range(modes):
            for class_id in range(classes):
                posterior.weight[rows + pair, mode, class_id] *= share[pair]
    for index in range(len(posterior.mass)):
        posterior.existence[posterior.target[index]] += posterior.mass[index]


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
    rows, targets = len(mixture), len(mixture.label)
    weight, target = mixture.weight, mixture.target
    posterior, sources, mass = _weights(
        target, weight, detection_probability, amplitude, *pairs, targets
    )
    claims = Claims(pairs.row, pairs.column, mass, sources.total, posterior.detected)
    scaled, unseen, share, claimed, approximate = posterior_shares(
        *(marginals.MOST_WORK, targets, target, posterior.prior, pairs.row, pairs.column),
        *(mass, sources.total, posterior.detected),
    )
    _write_posterior(weight, detection_probability, scaled, unseen, share, posterior)
    least = bounds.hypotheses, bounds.least_share
    kept, factor = most_probable(*least, posterior.target, posterior.mass)
    return Association(
        claims=claims,
        sources=CompetingSources(sources.scale, sources.intensity),
        claimed=claimed,
        pair=posterior.mass[rows:],
        existence=posterior.existence,
        prior_row=np.concatenate([np.arange(rows), pairs.row]).take(kept),
        kept_pair=np.maximum(kept - rows, -1),
        weight=factor[:, None, None] * posterior.weight.take(kept, axis=0),
        approximate=approximate,
    )
