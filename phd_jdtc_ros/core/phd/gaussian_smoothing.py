"""The backward step in closed form: along the lineages of Gaussians.

The smoother of Sec. III-B multiplies D_{t|t}(x) by 1 - P_s + P_s times the integral over y of
f(y|x) D_{t+1|k}(y) / D_{t+1|t}(y). The ratio in it is the factor of the correction at t+1 times
that of the smoother at t+1. So a Gaussian s of D_{t|t} times the integral is a sum over its
descendants q, the Gaussians of D_{t+1|t+1} that came from s: each has the smoothed weight of q, and
the moments of a Rauch-Tung-Striebel step back from the smoothed q. One Gaussian with the moments of
the sum takes its place. Births and spawned targets are in D_{t+1|t} and not in the integral, so
that they pass no weight back.

Where descendants were merged, the smoothed weight of the merged Gaussian is divided in proportion
to their weights before the merging, and the step of each begins at the smoothed merged one.

References
----------
Vo, Vo and Mahler, "Closed-form solutions to forward-backward smoothing", IEEE Transactions on
Signal Processing 60(1), 2012, whose backward correctors have the same terms.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by
from .gaussian_mixture import Mixture, Predicted, Updated, inverses, moments
from .smoothing import bernoulli_death_term


class Lineage(NamedTuple):
    """The surviving descendants, in a stored mixture, of the Gaussians of the one before.

    Given the state y of a descendant, its parent's is Gaussian with the mean m + G y, with the gain
    G of the Rauch-Tung-Striebel step.
    """

    survival: FloatArray  # P_s of each Gaussian of the earlier mixture, (J_t,)
    parent: IntArray  # Row of each descendant's parent in the earlier mixture, (I,)
    row: IntArray  # Row in the later mixture with which it was merged, (I,)
    share: FloatArray  # Its share in the weight of that row, (I,)
    gain: FloatArray  # G, (I, D, D)
    mean: FloatArray  # Means m, (I, D)
    covariance: FloatArray  # Covariance of the parent's state, given y, (I, D, D)


def trace(
    earlier: Mixture,
    predicted: Predicted,
    updated: Updated,
    stored: Mixture,
    row: IntArray,
    survival: FloatArray,
) -> Lineage:
    """Return the lineage from one stored mixture to the next.

    `row` has the row of each updated Gaussian in the next one, and `survival` has P_s of each
    Gaussian of the earlier one.
    """
    (index,) = (updated.source < len(predicted.parent)).nonzero()
    source, row = updated.source[index], row[index]
    parent, before = predicted.parent[source], predicted.mixture.covariance[source]
    gain = predicted.cross[source] @ inverses(before)
    step = gain @ predicted.mixture.mean[source][..., None]
    return Lineage(
        survival,
        parent=parent,
        row=row,
        share=updated.mixture.weight[index] / stored.weight[row],
        gain=gain,
        mean=earlier.mean[parent] - step[..., 0],
        covariance=earlier.covariance[parent] - gain @ before @ gain.swapaxes(1, 2),
    )


def backward_step(mixture: Mixture, lineage: Lineage, later: Mixture) -> Mixture:
    """Return the smoothed mixture at t, given the filtered one and the smoothed next one.

    Deviation from Sec. II-B: the death term of a component is that of a Bernoulli target, see
    `smoothing.bernoulli_death_term`. A target that died keeps its filtered moments.
    """
    parent, row, size = lineage.parent, lineage.row, len(mixture)
    weight = later.weight[row] * lineage.share
    alive, surviving = sum_by(parent, weight, size), lineage.survival * mixture.weight
    part, parts = mixture.component, int(mixture.component.max(initial=-1)) + 1
    explained = part >= 0

    def by_component(value: FloatArray) -> FloatArray:
        return sum_by(part[explained], value[explained], parts)

    factor = np.ones(size)
    masses = by_component(mixture.weight), by_component(surviving), by_component(alive)
    factor[explained] = bernoulli_death_term(*masses)[part[explained]]
    dead = (mixture.weight - surviving) * factor

    gain = lineage.gain
    mean = lineage.mean + (gain @ later.mean[row][..., None])[..., 0]
    covariance = lineage.covariance + gain @ later.covariance[row] @ gain.swapaxes(1, 2)
    smoothed = moments(
        np.append(dead, weight),
        np.concatenate([mixture.mean, mean]),
        np.concatenate([mixture.covariance, covariance]),
        np.append(np.arange(size), parent),
        near=mixture.mean,
    )
    return mixture.changed(**smoothed._asdict())
