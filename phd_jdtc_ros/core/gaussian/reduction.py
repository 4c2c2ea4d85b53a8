"""Reduction of each target's hypotheses: improbable ones are dropped, similar ones merged.

Of those that are left, each probable motion mode then goes on as a hypothesis of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from .. import backend
from ..arrays import FloatArray, IntArray
from ..snapshot import floats, integers
from .algebra import kalman, moments
from .mixture import Mixture

# Of the most hypotheses: those of one mode each may have so many. The others are for the detections
# of the next scan, each of which branches a hypothesis.
ROOM = 0.25


@dataclass(frozen=True)
class Bounds:
    """What is kept of a target's hypotheses.

    Parameters
    ----------
    hypotheses : int
        Per target; at most, before each goes on once for each of its motion modes.
    least_share : float
        Of the target's existence probability; hypotheses with less are dropped.
    merge_distance : float
        Square Mahalanobis distance within which hypotheses are merged.
    least_existence : float
        Targets with a smaller existence probability are dropped.
    most : int
        Hypotheses of all targets together.
    least_mode : float
        Of a hypothesis; motion modes with a smaller share do not go on as hypotheses of their own.
        With 1 none does, and modes are mixed by every prediction.
    """

    hypotheses: int
    least_share: float
    merge_distance: float
    least_existence: float
    most: int
    least_mode: float


@dataclass(frozen=True)
class Branched:
    """Hypotheses, and the predicted rows that they come from.

    Parameters
    ----------
    mixture : Mixture
    parent : int array of shape (H,)
        Row of the predicted mixture; -1 for targets born at detections.
    """

    mixture: Mixture
    parent: IntArray

    def take(self, rows: IntArray) -> Branched:
        """Return the hypotheses of these rows."""
        return Branched(self.mixture.take(rows), self.parent[rows])


@dataclass(frozen=True)
class Ancestry:
    """The hypotheses that were merged into those kept, and where they come from.

    Parameters
    ----------
    child : int array of shape (E,)
        Row of the kept mixture, ascending.
    parent : int array of shape (E,)
        Row of the predicted mixture; -1 for targets born at detections.
    share : array of shape (E, R, S)
        Of the child's weight; sums to one over the rows of a child where that has weight.
    """

    child: Annotated[IntArray, integers("E", 0, below="H")]
    parent: Annotated[IntArray, integers("E", -1, below="P")]
    share: Annotated[FloatArray, floats("EOS", 0.0, 1.0)]


def probable(target: IntArray, mass: FloatArray, bounds: Bounds) -> tuple[IntArray, FloatArray]:
    """Return the most probable hypotheses of each target, most probable first.

    Parameters
    ----------
    target : int array of shape (N,)
        The target of each hypothesis; all numbers from 0 occur.
    mass : array of shape (N,)
    bounds : Bounds

    Returns
    -------
    kept : int array of shape (K,)
        By target.
    factor : array of shape (K,)
        On their weights, so that the targets' existence probabilities stay the same.
    """
    existence = np.bincount(target, mass)
    kept = np.flatnonzero((mass >= bounds.least_share * existence[target]) & (mass > 0.0))
    target, mass = target[kept], mass[kept]
    order = np.lexsort((-mass, target))
    target = target[order]
    rank = np.arange(len(target)) - np.searchsorted(target, target)
    first = rank < bounds.hypotheses
    kept, target = kept[order[first]], target[first]
    left = np.bincount(target, mass[order[first]], len(existence))
    factor = existence / np.where(left > 0.0, left, 1.0)
    return kept, factor[target]


def reduced(branched: Branched, bounds: Bounds) -> tuple[Mixture, Ancestry, int]:
    """Return the hypotheses that the filter goes on with.

    Parameters
    ----------
    branched : Branched
        By target, each target's most probable one first.
    bounds : Bounds

    Returns
    -------
    mixture : Mixture
    ancestry : Ancestry
    floored : int
        Number of covariances that rounding had left with negative eigenvalues.

    Notes
    -----
    Targets that hardly exist are dropped. Of the others, the most probable hypothesis of a target
    takes in all that are within the merge distance of it, then the most probable of those left, and
    so on. Each motion mode's Gaussian keeps the mean and covariance of what it takes in.

    To merge hypotheses of different motion modes only now, after an update, is the second-order
    generalised pseudo-Bayesian filter; to keep those that are not near to each other is more exact.

    References
    ----------
    Chang and Athans, "State estimation for discrete systems with switching parameters", IEEE
    Transactions on Aerospace and Electronic Systems 14(3), 1978.
    Salmond, "Mixture reduction algorithms for target tracking in clutter", Proceedings of SPIE
    1305, 1990, the clustering algorithm.
    """
    branched = branched.take(_existing(branched.mixture, bounds))
    mixture = branched.mixture
    if not len(mixture):
        none = np.zeros(0, dtype=np.int64)
        return mixture, Ancestry(none, none, mixture.weight), 0
    cluster = _clusters(mixture, bounds.merge_distance)
    order = np.argsort(cluster, kind="stable")
    ordered = branched.take(order)
    mixture, cluster = ordered.mixture, cluster[order]
    first = np.flatnonzero(np.concatenate([[True], cluster[1:] != cluster[:-1]]))
    child = np.cumsum(np.concatenate([[False], cluster[1:] != cluster[:-1]]))
    weight = np.add.reduceat(mixture.weight, first)
    total = np.add.reduceat(mixture.mode_weight, first)[child]
    size = np.diff(np.append(first, len(child)))[child].astype(np.float64)
    has_weight = total > 0.0
    share = np.where(
        has_weight, mixture.mode_weight / np.where(has_weight, total, 1.0), 1.0 / size[:, None]
    )
    mean, covariance = moments.merged(share, mixture.mean, mixture.covariance, first)
    part = weight[child]
    part = np.where(part > 0.0, mixture.weight / np.where(part > 0.0, part, 1.0), 0.0)
    covariance, floored = kalman.floored(covariance)
    merged = Mixture(mixture.origin[first], weight, mean, covariance)
    return *_by_mode(merged, Ancestry(child, ordered.parent, part), bounds), floored


def _by_mode(mixture: Mixture, ancestry: Ancestry, bounds: Bounds) -> tuple[Mixture, Ancestry]:
    """Return hypotheses of one motion mode each, of those with a share of at least `least_mode`.

    Modes with less stay with the most probable one. Where these are so many that the next scan
    could cost targets, none goes on by itself: modes are mixed, as with a `least_mode` of 1.
    """
    least = bounds.least_mode
    mass = np.where(mixture.mass > 0.0, mixture.mass, 1.0)
    own = (mixture.mode_weight >= least * mass[:, None]) & (mixture.mode_weight > 0.0)
    main = mixture.mode_weight.argmax(axis=1)
    own[np.arange(len(mixture)), main] = True
    count = np.count_nonzero(own)
    if count == len(mixture) or count > ROOM * bounds.most:
        return mixture, ancestry
    row, mode = np.nonzero(own)
    kept = mode[:, None] == np.arange(own.shape[1])
    kept |= ~own[row] & (mode == main[row])[:, None]
    each = mixture.take(row)
    # The rows of `ancestry` of each hypothesis, once for each of its modes.
    first = np.searchsorted(ancestry.child, row)
    size = np.searchsorted(ancestry.child, row, side="right") - first
    child = np.arange(len(row)).repeat(size)
    edge = np.arange(len(child)) + (first - (np.cumsum(size) - size)).repeat(size)
    return (
        each.with_gaussians(each.weight * kept[..., None], each.mean, each.covariance),
        Ancestry(child, ancestry.parent[edge], ancestry.share[edge] * kept[child][..., None]),
    )


def _existing(mixture: Mixture, bounds: Bounds) -> IntArray:
    """Return the rows of the targets that are kept."""
    existence = mixture.existence
    kept = existence >= bounds.least_existence
    size = np.bincount(mixture.target, minlength=len(existence))
    if size[kept].sum() > bounds.most:
        order = np.argsort(-existence, kind="stable")
        most = order[np.cumsum(size[order]) <= bounds.most]
        affordable = np.zeros(len(existence), dtype=bool)
        affordable[most] = True
        kept &= affordable
    rows: IntArray = np.flatnonzero(kept[mixture.target])
    return rows


def _clusters(mixture: Mixture, distance: float) -> IntArray:
    """Return the row of the hypothesis into which each is merged, its own if none."""
    target, count = mixture.target, len(mixture)
    into = np.arange(count)
    size = np.bincount(target)
    free = np.flatnonzero(size[target] > 1)
    if not len(free):
        return into
    mean, covariance = _across_modes(mixture)
    if loops := backend.compiled("gaussian.algebra"):
        sound, into[:] = loops.clusters(target, mean, covariance, distance)
        if sound:
            return into
        into = np.arange(count)
    while len(free):
        _, place, group = np.unique(target[free], return_index=True, return_inverse=True)
        centre = free[place]  # the most probable: rows of a target come in this order
        inverse = kalman.inverse(covariance[centre])
        apart = mean[free] - mean[centre][group]
        square = (apart[:, None] @ inverse[group] @ apart[..., None])[:, 0, 0]
        near = (square <= distance) | (free == centre[group])
        into[free[near]] = centre[group[near]]
        free = free[~near]
    return into


def _across_modes(mixture: Mixture) -> tuple[FloatArray, FloatArray]:
    """Return each hypothesis's mean and covariance over its motion modes; unused axes have 1."""
    mass = np.where(mixture.mass > 0.0, mixture.mass, 1.0)[:, None]
    mean, covariance = moments.matched(
        (mixture.mode_weight / mass)[:, None], mixture.mean, mixture.covariance
    )
    mean, covariance = mean[:, 0], covariance[:, 0]
    axes = np.arange(mean.shape[1])
    covariance[:, axes, axes] += covariance[:, axes, axes] == 0.0
    return mean, covariance
