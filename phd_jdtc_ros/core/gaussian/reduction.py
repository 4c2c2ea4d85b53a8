"""Reduction of each target's hypotheses: improbable ones are dropped, similar ones merged.

Each probable motion mode of a remaining hypothesis then becomes a hypothesis of its own.
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

# Share of `Bounds.most` that single-mode hypotheses may take. The rest is reserved for the next
# scan, in which every detection branches a hypothesis.
ROOM = 0.25


@dataclass(frozen=True)
class Bounds:
    """Limits of the reduction.

    Parameters
    ----------
    hypotheses : int
        Largest number per target, before they are split by motion mode.
    least_share : float
        Hypotheses with less than this share of their target's existence probability are dropped.
    merge_distance : float
        Square Mahalanobis distance within which hypotheses are merged.
    least_existence : float
        Targets with a smaller existence probability are dropped.
    most : int
        Largest number of hypotheses of all targets together.
    least_mode : float
        Motion modes with at least this share of their hypothesis become hypotheses of their own.
        With 1 none does, and every prediction mixes the modes.
    """

    hypotheses: int
    least_share: float
    merge_distance: float
    least_existence: float
    most: int
    least_mode: float


@dataclass(frozen=True)
class Branched:
    """Hypotheses, and the predicted row from which each descends.

    Parameters
    ----------
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
    """For each kept hypothesis, the hypotheses merged into it and their predicted rows.

    Parameters
    ----------
    child : int array of shape (E,)
        Row of the kept mixture, ascending.
    parent : int array of shape (E,)
        Row of the predicted mixture; -1 for targets born at detections.
    share : array of shape (E, R, S)
        Share of the child's weight; sums to one over the rows of a child with positive weight.
    """

    child: Annotated[IntArray, integers("E", 0, below="H")]
    parent: Annotated[IntArray, integers("E", -1, below="P")]
    share: Annotated[FloatArray, floats("EOS", 0.0, 1.0)]


def probable(target: IntArray, mass: FloatArray, bounds: Bounds) -> tuple[IntArray, FloatArray]:
    """Return the most probable hypotheses of each target in descending order of probability.

    Parameters
    ----------
    target : int array of shape (N,)
        The target of each hypothesis; every index below the number of targets occurs.
    mass : array of shape (N,)

    Returns
    -------
    kept : int array of shape (K,)
        Rows of the kept hypotheses, sorted by target.
    factor : array of shape (K,)
        Factor on their weights that preserves the existence probability of each target.
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


def reduce_hypotheses(branched: Branched, bounds: Bounds) -> tuple[Mixture, Ancestry, int]:
    """Return the reduced hypotheses, from which the next prediction starts.

    Parameters
    ----------
    branched : Branched
        Sorted by target, and then by descending probability.

    Returns
    -------
    mixture : Mixture
    ancestry : Ancestry
    floored : int
        Number of covariances in which rounding had caused negative eigenvalues.

    Notes
    -----
    Targets of small existence probability are dropped. The most probable hypothesis of each other
    target absorbs all hypotheses within the merge distance, then the most probable remaining one
    does, and so on. Each motion mode's Gaussian is moment-matched to the Gaussians it absorbs.

    A merge of hypotheses of different motion modes only after the update is the second-order
    generalised pseudo-Bayesian filter; hypotheses that are kept apart make this more exact.

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
    mean, covariance = moments.merge_moments(share, mixture.mean, mixture.covariance, first)
    part = weight[child]
    part = np.where(part > 0.0, mixture.weight / np.where(part > 0.0, part, 1.0), 0.0)
    covariance, floored = kalman.floor_eigenvalues(covariance)
    merged = Mixture(mixture.row_label[first], weight, mean, covariance)
    return *_by_mode(merged, Ancestry(child, ordered.parent, part), bounds), floored


def _by_mode(mixture: Mixture, ancestry: Ancestry, bounds: Bounds) -> tuple[Mixture, Ancestry]:
    """Return a hypothesis for each motion mode whose share is at least `least_mode`.

    Less probable modes stay with the most probable one. If the number of hypotheses would leave
    too little room for the next scan, none is split: modes are mixed, as with a `least_mode` of 1.
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
    # Repeat the rows of `ancestry` of each hypothesis for each of its modes.
    first = np.searchsorted(ancestry.child, row)
    size = np.searchsorted(ancestry.child, row, side="right") - first
    child = np.arange(len(row)).repeat(size)
    edge = np.arange(len(child)) + (first - (np.cumsum(size) - size)).repeat(size)
    return (
        each.with_gaussians(each.weight * kept[..., None], each.mean, each.covariance),
        Ancestry(child, ancestry.parent[edge], ancestry.share[edge] * kept[child][..., None]),
    )


def _existing(mixture: Mixture, bounds: Bounds) -> IntArray:
    """Return the rows of the targets of sufficient existence probability."""
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
    """Return for each hypothesis the row that absorbs it; its own row if it is not merged."""
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
        centre = free[place]  # the most probable one: rows of a target are in this order
        inverse = kalman.inverse(covariance[centre])
        apart = mean[free] - mean[centre][group]
        square = (apart[:, None] @ inverse[group] @ apart[..., None])[:, 0, 0]
        near = (square <= distance) | (free == centre[group])
        into[free[near]] = centre[group[near]]
        free = free[~near]
    return into


def _across_modes(mixture: Mixture) -> tuple[FloatArray, FloatArray]:
    """Return each hypothesis's moments over its motion modes; unused axes have variance 1."""
    mass = np.where(mixture.mass > 0.0, mixture.mass, 1.0)[:, None]
    mean, covariance = moments.match_moments(
        (mixture.mode_weight / mass)[:, None], mixture.mean, mixture.covariance
    )
    mean, covariance = mean[:, 0], covariance[:, 0]
    axes = np.arange(mean.shape[1])
    covariance[:, axes, axes] += covariance[:, axes, axes] == 0.0
    return mean, covariance
