"""The association of pairs, and the most probable hypotheses that follow from it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray, frozen
from ...association import marginals
from ...association.claims import Claims
from ...association.shares import Shares, posterior_shares
from ...compilation import Float1, Float2, Float3, Int1, Writeable, compiled
from ...models.competing_sources import CompetingSources
from ..algebra.blocks import sum_of
from ..bounds import Bounds
from ..mixture import Hypotheses, Mixture
from .pairs import PairLikelihoods, Sources, sources_of, write_missed_weight, write_pair_weight


@compiled
def most_probable(
    most: int, least_share: float, target_of: Int1, mass: Float1
) -> tuple[IntArray, FloatArray]:
    """Return the most probable hypotheses of each target in descending order of probability.

    Parameters
    ----------
    most : int
        Largest number per target.
    least_share : float
        Hypotheses with less than this share of their target's existence probability are dropped.
    target_of : int array of shape (N,)
        The target of each hypothesis; every index below the number of targets occurs.
    mass : array of shape (N,)

    Returns
    -------
    kept : int array of shape (K,)
        Rows of the kept hypotheses, sorted by target.
    factor : array of shape (K,)
        Factor on their weights that preserves the existence probability of each target.
    """
    targets = 0
    for target in target_of:
        targets = max(targets, target + 1)
    existence, size = np.zeros(targets), np.zeros(targets, np.int64)
    for row in range(len(target_of)):
        existence[target_of[row]] += mass[row]
    best, factor = np.empty((targets, most), np.int64), np.empty(targets)
    for row in range(len(target_of)):
        target = target_of[row]
        if mass[row] < least_share * existence[target] or not mass[row] > 0.0:
            continue
        # Insertion in descending order of mass; of too many, the last one is dropped.
        rank = size[target]
        while rank > 0 and mass[best[target, rank - 1]] < mass[row]:
            if rank < most:
                best[target, rank] = best[target, rank - 1]
            rank -= 1
        if rank < most:
            best[target, rank] = row
            size[target] = min(size[target] + 1, most)
    total = 0
    for target in range(targets):
        left = 0.0
        for rank in range(size[target]):
            left += mass[best[target, rank]]
        factor[target] = existence[target] / left if left > 0.0 else 1.0
        total += size[target]
    kept, by_row = np.empty(total, np.int64), np.empty(total)
    total = 0
    for target in range(targets):
        for rank in range(size[target]):
            kept[total], by_row[total] = best[target, rank], factor[target]
            total += 1
    return kept, by_row


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


class _Weights(NamedTuple):
    """Weights before the association."""

    prior: Float1  # Weight of each hypothesis before the update, (H,)
    pair: Float3  # Weights of each pair, p_D L_z w divided by a scale of its detection, (P, R, C)


@compiled
def _weigh(
    mixture: Hypotheses, detection_probability: Float3, amplitude: Float2, pairs: PairLikelihoods
) -> tuple[Claims, Sources, _Weights]:
    """Return the association likelihoods of targets and of other sources, and the weights."""
    weight, sources = mixture.weight, sources_of(pairs)
    (rows, modes, classes), (row, column, measurement, largest, evidence, _) = weight.shape, pairs
    mass, pair_weight = np.empty(len(row)), np.empty((len(row), modes, classes))
    prior, detected = np.empty(rows), np.empty(rows)
    for hypothesis in range(rows):
        prior[hypothesis], total = sum_of(weight[hypothesis]), 0.0
        for mode in range(modes):
            for class_id in range(classes):
                total += (
                    weight[hypothesis, mode, class_id]
                    * detection_probability[hypothesis, mode, class_id]
                )
        detected[hypothesis] = total / (prior[hypothesis] if prior[hypothesis] > 0.0 else 1.0)
    for pair in range(len(row)):
        z = column[pair]
        factor = evidence[pair] + largest[z] - sources.scale[z]
        mass[pair] = write_pair_weight(
            row[pair], weight, pair, measurement, amplitude, factor, pair, pair_weight
        )
    claims = Claims(row.copy(), column.copy(), mass, sources.total, detected)
    return claims, sources, _Weights(prior, pair_weight)


@compiled
def _most_probable_hypotheses(
    most: int,
    least_share: float,
    mixture: Hypotheses,
    detection_probability: Float3,
    claims: Writeable[Claims],
    weights: Writeable[_Weights],
    shares: Writeable[Shares],
) -> tuple[FloatArray, FloatArray, IntArray, IntArray, FloatArray]:
    """Return columns of `Association`, from `pair` to `weight`."""
    target_of, weight = mixture.target, mixture.weight
    row, claimed_mass, prior, pair_weight = claims.row, claims.mass, weights.prior, weights.pair
    scaled, unseen, share = shares.prior, shares.missed, shares.pair
    rows, modes, classes = weight.shape
    count = rows + len(row)
    target, mass, existence = np.empty(count, np.int64), np.empty(count), np.zeros(len(unseen))
    factor_of, missed = np.empty(count), np.empty((1, modes, classes))
    for hypothesis in range(rows):
        target[hypothesis] = target_of[hypothesis]
        factor_of[hypothesis] = unseen[target_of[hypothesis]] * (
            scaled[hypothesis] / prior[hypothesis] if prior[hypothesis] > 0.0 else 1.0
        )
        mass[hypothesis] = write_missed_weight(
            hypothesis, weight, detection_probability, factor_of[hypothesis], 0, missed
        )
    for pair in range(len(row)):
        target[rows + pair], factor_of[rows + pair] = target_of[row[pair]], share[pair]
        mass[rows + pair] = claimed_mass[pair] * share[pair]
    for index in range(count):
        existence[target[index]] += mass[index]
    kept, factor = most_probable(most, least_share, target, mass)
    kept_pair, kept_weight = np.full(len(kept), -1), np.empty((len(kept), modes, classes))
    prior_row = kept.copy()
    for index in range(len(kept)):
        if kept[index] >= rows:
            pair = kept[index] - rows
            kept_pair[index], prior_row[index] = pair, row[pair]
            for mode in range(modes):
                for class_id in range(classes):
                    scaled_weight = pair_weight[pair, mode, class_id] * share[pair]
                    kept_weight[index, mode, class_id] = factor[index] * scaled_weight
        else:
            row_factor = factor_of[kept[index]]
            write_missed_weight(
                kept[index], weight, detection_probability, row_factor, index, kept_weight
            )
            for mode in range(modes):
                for class_id in range(classes):
                    kept_weight[index, mode, class_id] *= factor[index]
    return mass[rows:], existence, prior_row, kept_pair, kept_weight


class _Limits(NamedTuple):
    """What the work and the number of hypotheses must not exceed."""

    work: int  # See `marginals.edge_probabilities`
    hypotheses: int  # These are those of the `Bounds`
    least_share: float


@compiled
def _associate(
    limits: _Limits,
    mixture: Hypotheses,
    detection_probability: Float3,
    amplitude: Float2,
    pairs: PairLikelihoods,
) -> tuple[
    Claims,
    Sources,
    tuple[FloatArray, int],
    tuple[FloatArray, FloatArray, IntArray, IntArray, FloatArray],
]:
    """Return the claims, the other sources, and columns of `Association`.

    The columns are `claimed` and `approximate`, and those from `pair` to `weight`.
    """
    claims, sources, weights = _weigh(mixture, detection_probability, amplitude, pairs)
    shares = posterior_shares(
        limits.work, len(mixture.label), mixture.target, weights.prior, claims
    )
    kept = _most_probable_hypotheses(
        limits.hypotheses,
        limits.least_share,
        mixture,
        detection_probability,
        claims,
        weights,
        shares,
    )
    return claims, sources, (shares.claimed, shares.approximate), kept


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
    limits = _Limits(marginals.MOST_WORK, bounds.hypotheses, bounds.least_share)
    claims, found, (claimed, approximate), kept = _associate(
        limits, mixture.hypotheses, detection_probability, amplitude, pairs
    )
    sources = CompetingSources(found.scale, found.intensity)
    return Association(frozen(claims), sources, claimed, *kept, approximate)
