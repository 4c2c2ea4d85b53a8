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
    source: IntArray
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
    for kind in range(len(other)):
        for z in range(len(scale)):
            scale[z] = max(scale[z], other[kind, z])
    for pair in range(len(column)):
        z = column[pair]
        for mode in range(measurement.shape[1]):
            scale[z] = max(scale[z], measurement[pair, mode] + largest[z] + evidence[pair])
    for kind in range(len(other)):
        for z in range(len(scale)):
            intensity[kind, z] = math.exp(other[kind, z] - scale[z])
            total[z] += intensity[kind, z]


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
    place: int,
    weight: FloatArray,
) -> float:
    """Write the weight of a hypothesis without a detection, times a factor; return its sum.

    `place` is the row of `weight` to write.
    """
    mass = 0.0
    for mode in range(prior.shape[1]):
        total = 0.0
        for class_id in range(prior.shape[2]):
            missed = prior[one, mode, class_id] * (1.0 - detectable[one, mode, class_id])
            weight[place, mode, class_id] = factor * missed
            total += factor * missed
        mass += total
    return mass


class _Likely(NamedTuple):
    """Whether each pair is likely, and working arrays."""

    likely: Bool1  # (P,)
    amplitude: Float2  # Likelihood of each pair's amplitude by class, (P, C)
    odds: Float1  # Mass of each pair relative to its detection's other sources, (P,)
    wanted: Float1  # Sum of all pairs' odds of each detection, (M,)
    own: Float1  # Sum of one target's odds of each detection, zeros, (M,)
    alone: Float1  # Mass of each target's alternatives, (T,)
    start: Int1  # Where the pairs of each target begin in `order`, zeros, (T + 2,)
    order: Int1  # The pairs by target, (P,)
    weight: Float3  # Weights that are not used, (1, R, C)


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
    """Return the likely pairs and the likelihoods of their amplitudes; see `likely`."""
    (modes, classes), count, size = weight.shape[1:], len(row), len(largest)
    sources = _no_sources(other)
    found = _Likely(
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
    amplitude, odds, wanted, own, alone = found[1:6]
    start, order = found.start, found.order
    _write_sources(column, measurement, largest, evidence, other, sources)
    for pair in range(len(row)):
        one, z = row[pair], column[pair]
        for class_id in range(snr.shape[1]):
            total = 0.0
            for cell in range(snr.shape[2]):
                total += snr[one, class_id, cell] * relative[z, class_id, cell]
            amplitude[pair, class_id] = total
        factor = evidence[pair] + largest[z] - sources.scale[z]
        mass = _write_pair_weight(
            one, weight, pair, measurement, amplitude, factor, 0, found.weight
        )
        odds[pair] = mass / max(sources.total[z], LEAST_CLUTTER)
        wanted[z] += odds[pair]
        start[target[one] + 2] += 1
    for one in range(len(alone)):
        alone[one] = 1.0 - existence[one]
        start[one + 2] += start[one + 1]
    # While the pairs are sorted, `start[one + 1]` is the place of the next pair of target `one`;
    # afterwards it is the end of its pairs.
    for pair in range(len(row)):
        one = target[row[pair]] + 1
        order[start[one]] = pair
        start[one] += 1
    for one in range(len(target)):
        missed = _write_missed_weight(one, weight, detectable, 1.0, 0, found.weight)
        alone[target[one]] += missed
    for one in range(len(alone)):
        for place in range(start[one], start[one + 1]):
            own[column[order[place]]] += odds[order[place]]
        for place in range(start[one], start[one + 1]):
            # Each detection counts once, by the share that other targets' claims leave of it.
            z = column[order[place]]
            alone[one] += own[z] / (1.0 + max(wanted[z] - own[z], 0.0))
            own[z] = 0.0
        for place in range(start[one], start[one + 1]):
            pair = order[place]
            found.likely[pair] = odds[pair] > least_share * max(alone[one], 1.0)
    kept, most = np.empty(count, np.int64), 0
    for pair in range(count):
        if found.likely[pair]:
            for class_id in range(classes):
                found.amplitude[most, class_id] = found.amplitude[pair, class_id]
            kept[most] = pair
            most += 1
    return kept[:most], found.amplitude[:most]


def likely(
    mixture: Mixture, detectable: FloatArray, pairs: PairLikelihoods, relative: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return the pairs that may exceed `LEAST_SHARE` of both their target and their detection.

    The second value is the likelihood of each pair's amplitude by class, p_D g(a) relative to the
    largest of its detection, (P, C).

    Another target may claim a detection, however probable it is for this one. A target's share is
    therefore computed from the part of each detection that remains if all other targets claim it.

    Parameters
    ----------
    detectable : array of shape (H, R, C)
        Probability of detection.
    relative : array of shape (M, C, S)
        See `amplitude.Amplitudes`.
    """
    of_mixture = LEAST_SHARE, mixture.target, mixture.existence, mixture.weight
    return _likely(*(*of_mixture, detectable, mixture.snr, relative, *pairs))


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
    targets: int,
) -> tuple[_Weights, _Sources, FloatArray]:
    """Return the weights of pairs before their association, their sources, and their masses.

    For the parameters see `associate`.
    """
    rows, modes, classes = weight.shape
    count, sources = rows + len(row), _no_sources(other)
    later = _Weights(
        np.empty(count, np.int64),
        np.empty((count, modes, classes)),
        np.empty(count),
        np.empty(rows),
        np.empty(rows),
        np.zeros(targets),
    )
    _write_sources(column, measurement, largest, evidence, other, sources)
    for one in range(rows):
        later.target[one], detected = target[one], 0.0
        later.prior[one] = sum_of(weight[one])
        for mode in range(modes):
            for class_id in range(classes):
                detected += weight[one, mode, class_id] * detectable[one, mode, class_id]
        prior = later.prior[one] if later.prior[one] > 0.0 else 1.0
        later.detected[one] = detected / prior
    for pair in range(len(row)):
        one, z = row[pair], column[pair]
        factor = evidence[pair] + largest[z] - sources.scale[z]
        later.target[rows + pair] = target[one]
        later.mass[rows + pair] = _write_pair_weight(
            one, weight, pair, measurement, amplitude, factor, rows + pair, later.weight
        )
    return later, sources, later.mass[rows:].copy()


@in_place
def _write_associated(
    weight: Float3,
    detectable: Float3,
    scaled: Float1,
    unseen: Float1,
    share: Float1,
    later: _Weights,
) -> None:
    """Write the weights after the association, of which `posterior_shares` gives the factors."""
    rows, modes, classes = weight.shape
    for one in range(rows):
        prior = later.prior[one]
        factor = unseen[later.target[one]] * (scaled[one] / prior if prior > 0.0 else 1.0)
        later.mass[one] = _write_missed_weight(one, weight, detectable, factor, one, later.weight)
    for pair in range(len(share)):
        later.mass[rows + pair] *= share[pair]
        for mode in range(modes):
            for class_id in range(classes):
                later.weight[rows + pair, mode, class_id] *= share[pair]
    for one in range(len(later.mass)):
        later.existence[later.target[one]] += later.mass[one]


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
    rows, targets = len(mixture), len(mixture.label)
    weight, target = mixture.weight, mixture.target
    later, sources, mass = _weights(target, weight, detectable, amplitude, *pairs, targets)
    claims = Claims(pairs.row, pairs.column, mass, sources.total, later.detected)
    scaled, unseen, share, claimed, approximate = posterior_shares(
        *(marginals.MOST_WORK, targets, target, later.prior, pairs.row, pairs.column),
        *(mass, sources.total, later.detected),
    )
    _write_associated(weight, detectable, scaled, unseen, share, later)
    least = bounds.hypotheses, bounds.least_share
    kept, factor = most_probable(*least, later.target, later.mass)
    return Association(
        claims=claims,
        sources=CompetingSources(sources.scale, sources.intensity),
        claimed=claimed,
        pair=later.mass[rows:],
        existence=later.existence,
        source=np.concatenate([np.arange(rows), pairs.row]).take(kept),
        kept_pair=np.maximum(kept - rows, -1),
        weight=factor[:, None, None] * later.weight.take(kept, axis=0),
        approximate=approximate,
    )
