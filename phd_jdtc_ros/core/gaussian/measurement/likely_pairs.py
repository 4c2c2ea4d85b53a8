"""The selection of the pairs that may matter, before their measurements are linearised exactly."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...association.marginals import LEAST_CLUTTER
from ...compilation import Bool1, Float1, Float2, Float3, Int1, compiled, inner
from ..mixture import Hypotheses, Mixture
from .amplitude import Amplitudes
from .pairs import PairLikelihoods, Sources, sources_of, write_missed_weight, write_pair_weight

# A pair with less than this share of its detection's sources, or of its target's hypotheses, is
# left out before the iterated update.
LEAST_SHARE = 1e-4


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
    mixture: Hypotheses,
    relative: FloatArray,
    pairs: PairLikelihoods,
    sources: Sources,
    selection: _Selection,
) -> None:
    """Write the likelihoods of the pairs' amplitudes and their odds."""
    row, column, measurement, largest, evidence, _ = pairs
    weight, snr = mixture.weight, mixture.snr
    amplitude, odds = selection.amplitude, selection.odds
    for pair in range(len(row)):
        hypothesis, z = row[pair], column[pair]
        for class_id in range(snr.shape[1]):
            total = 0.0
            for cell in range(snr.shape[2]):
                total += snr[hypothesis, class_id, cell] * relative[z, class_id, cell]
            amplitude[pair, class_id] = total
        factor = evidence[pair] + largest[z] - sources.scale[z]
        mass = write_pair_weight(
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
    mixture: Hypotheses,
    detection_probability: Float3,
    amplitudes: Amplitudes,
    pairs: PairLikelihoods,
) -> tuple[IntArray, FloatArray]:
    """Return the likely pairs and the likelihoods of their amplitudes; see `select_likely`."""
    target_of, existence, weight = mixture.target, mixture.existence, mixture.weight
    row, column = pairs.row, pairs.column
    (modes, classes), count, size = weight.shape[1:], len(row), len(pairs.largest)
    sources = sources_of(pairs)
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
    _write_odds(mixture, amplitudes.relative, pairs, sources, selection)
    _sort_by_target(target_of, row, selection.start, selection.order)
    for target in range(len(existence)):
        selection.alternatives[target] = 1.0 - existence[target]
    for hypothesis in range(len(target_of)):
        selection.alternatives[target_of[hypothesis]] += write_missed_weight(
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
    amplitudes: Amplitudes,
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
    """
    return _select_likely(LEAST_SHARE, mixture.hypotheses, detection_probability, amplitudes, pairs)
