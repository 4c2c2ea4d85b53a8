"""Random clusters of targets and detections, as graphs."""

import numpy as np

from phd_jdtc_ros.core.association.clusters import graph_of


def graph(odds):
    """Return the graph of dense odds, the targets and detections of its edges, and its nodes."""
    target, detection = map(np.ascontiguousarray, np.nonzero(odds))
    order, found = graph_of(*odds.shape, target, detection)
    return found, target, detection, order


def banded(rng, targets, span, weights):
    """Return odds of targets that compete with their neighbours only, in any order."""
    odds = np.zeros((targets, targets + span - 1))
    for target in range(targets):
        odds[target, target : target + span] = weights(span)
    return odds[rng.permutation(targets)][:, rng.permutation(odds.shape[1])]
